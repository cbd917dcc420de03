"""The pose of a flat target from its corners in one image, and from its face's depth where there is one."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from dlolib.types import Floats

# How well a corner and a depth camera's plane are known. What a depth camera gets wrong it gets wrong over
# the whole face: many readings weigh as a few.
CORNER_PX, DEPTH_M, WORTH = 0.15, 0.002, 9.0
# Of two poses that are turned further apart than noise turns one, the better must fit by so much in chi
# squared: of a marker of 13 to 17 px with corners off by 0.1 px, a wrong one was the better by up to 3.6.
NOISE_RAD, LEAST_LEAD = 0.1, 4.0


@dataclass(frozen=True)
class PlanePose:
    """camera_from_target (4, 4); RMS of its corners [px] and of the face's depth [m], None without depth.

    lead: by how much chi squared is less than the other pose's, infinite where there is no other; apart_rad:
    by how much the face is turned there.
    """

    camera_from_target: Floats
    corner_px: float
    depth_m: float | None = None
    lead: float = np.inf
    apart_rad: float = 0.0

    @property
    def is_clear(self) -> bool:
        """Whether no pose that is turned elsewhere shows the target about as well."""
        return self.lead >= LEAST_LEAD or self.apart_rad <= NOISE_RAD


def plane_pose(
    object_m: Floats, pixel: Floats, matrix: Floats, face_m: Floats | None = None
) -> PlanePose | None:
    """The pose in which a flat target shows these corners; None where there is none before the camera.

    A plane seen from afar has two poses that show nearly the same corners (Collins and Bartoli, Infinitesimal
    plane-based pose estimation, 2014). The better one is taken; the depth of the face helps to tell, and
    `is_clear` says whether anything did.

    Args:
        object_m: corners (K, 3) [m] with z = 0, K ≥ 4.
        pixel: where they are seen (K, 2) [px].
        matrix: the camera's (3, 3) [px].
        face_m: points (N, 3) [m] of the face in camera axes, from a depth image.
    """
    found, turns, places, _ = cv2.solvePnPGeneric(object_m, pixel, matrix, None, flags=cv2.SOLVEPNP_IPPE)
    starts = (
        [np.concatenate([t.ravel(), p.ravel()]) for t, p in zip(turns, places, strict=True)] if found else []
    )
    starts = [start for start in starts if np.isfinite(start).all() and start[5] > 0]
    if not starts:
        return None

    def residual(values: Floats) -> Floats:
        corners = (projected(posed(values), object_m, matrix) - pixel).ravel() / CORNER_PX
        if face_m is None:
            return corners
        return np.concatenate([corners, _off_plane(values, face_m) / DEPTH_M * np.sqrt(WORTH / len(face_m))])

    fits = sorted(
        (least_squares(residual, start, x_scale="jac") for start in starts), key=lambda fit: float(fit.cost)
    )
    best = fits[0].x
    lead = 2 * float(fits[1].cost - fits[0].cost) if len(fits) > 1 else np.inf
    off = (projected(posed(best), object_m, matrix) - pixel).ravel()
    depth = None if face_m is None else float(np.sqrt(np.mean(_off_plane(best, face_m) ** 2)))
    turned = _between(best, fits[-1].x)
    return PlanePose(posed(best), float(np.sqrt(2 * np.mean(off**2))), depth, lead, turned)


def posed(values: Floats) -> Floats:
    """The pose (4, 4) of a rotation vector and a place, (6,)."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(values[:3]).as_matrix()
    pose[:3, 3] = values[3:]
    return pose


def projected(camera_from_target: Floats, object_m: Floats, matrix: Floats) -> Floats:
    """Where points (..., K, 3) of targets at poses (..., 4, 4) are seen [px], shape (..., K, 2)."""
    places = object_m @ np.swapaxes(camera_from_target[..., :3, :3], -1, -2)
    places = places + camera_from_target[..., None, :3, 3]
    seen: Floats = places[..., :2] / places[..., 2:] * np.diag(matrix)[:2] + matrix[:2, 2]
    return seen


def _off_plane(values: Floats, face_m: Floats) -> Floats:
    off: Floats = (face_m - values[3:]) @ _normal(values)
    return off


def _between(values: Floats, others: Floats) -> float:
    """The angle [rad] between a target's face in two poses, (6,) each."""
    return float(np.arccos(np.clip(_normal(values) @ _normal(others), -1.0, 1.0)))


def _normal(values: Floats) -> Floats:
    normal: Floats = Rotation.from_rotvec(values[:3]).as_matrix()[:, 2]
    return normal
