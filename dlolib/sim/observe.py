"""From the simulated rope to what a recording would show of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from dlolib.sim.effects.base import Camera
from dlolib.types import Floats, Ints, Points, Recording


def point_weights(points: Points, length_m: float, particles: int) -> Floats:
    """Cubic spline through the particles, as weights (P, n) that give each point at its arc length."""
    nodes = np.linspace(0, length_m, particles)
    spline = make_interp_spline(nodes, np.eye(particles), k=3)
    return np.asarray(spline(np.clip(points.s_m, 0, length_m)))


@dataclass(frozen=True)
class Sampling:
    """How observed points lie between the times that a rope is solved for, and between its particles.

    times_s (T,) [s]; steps (S,): those of them next to an observation; weights (P, S n): of every particle at
    those steps in every point.
    """

    times_s: Floats
    steps: Ints
    weights: csr_array

    def __call__(self, field: Floats) -> Floats:
        """C fields over those steps and the particles, (S, C, n, 3), at the points: (P, C, 3)."""
        columns = np.moveaxis(field, 1, 2)
        found = self.weights @ columns.reshape(self.weights.shape[1], -1)
        return np.asarray(found.reshape(-1, *columns.shape[2:]))


def sampling_of(at_s: Floats, times_s: Floats, weights: Floats) -> Sampling:
    """For points seen at these times (P,) [s], whose weights along the rope (P, n) are known."""
    before, after, share = _brackets(at_s, times_s)
    steps = np.unique(np.concatenate([before, after]))
    points, n = weights.shape
    first, second = (
        csr_array(
            (
                (part[:, None] * weights).ravel(),
                (np.searchsorted(steps, side)[:, None] * n + np.arange(n)).ravel(),
                np.arange(0, points * n + 1, n),
            ),
            shape=(points, len(steps) * n),
        )
        for part, side in ((1 - share, before), (share, after))
    )
    both = csr_array(first + second)
    both.eliminate_zeros()
    return Sampling(times_s, steps, both)


def _brackets(at: Floats, times: Floats) -> tuple[Ints, Ints, Floats]:
    """For each time the steps before and after it and the share of the second."""
    after = np.clip(np.searchsorted(times, at - 1e-9), 0, len(times) - 1)
    before = np.where(times[after] <= at + 1e-9, after, np.maximum(after - 1, 0))
    span = times[after] - times[before]
    share = np.where(span > 0, (at - times[before]) / np.where(span > 0, span, 1.0), 0.0)
    return before, after, np.clip(share, 0.0, 1.0)


def viewing_axis(recording: Recording) -> Floats:
    """The camera's +z in world axes, (3,); world +y where the recording names no camera."""
    if recording.world_from_camera is None:
        return np.array([0.0, 1.0, 0.0])
    return np.asarray(recording.world_from_camera[:3, 2], dtype=float)


def seen(xyz_m: Floats, camera: Camera, axis: Floats) -> Floats:
    """True points (..., 3) [m] as a camera with a wrong pose shows them."""
    if camera == Camera():
        return xyz_m
    turn = Rotation.from_rotvec(camera.rotation).as_matrix()
    return np.asarray(xyz_m @ turn.T + camera.depth_m * axis + np.array(camera.shift_m))


def unseen(xyz_m: Floats, camera: Camera, axis: Floats) -> Floats:
    """The true points (..., 3) [m] of those that such a camera shows: the inverse of `seen`."""
    if camera == Camera():
        return xyz_m
    turn = Rotation.from_rotvec(camera.rotation).as_matrix()
    return np.asarray((xyz_m - camera.depth_m * axis - np.array(camera.shift_m)) @ turn)


def turned(vectors: Floats, camera: Camera) -> Floats:
    """Derivatives of true points (..., 3) as derivatives of seen ones."""
    if camera.rotation == Camera().rotation:
        return vectors
    return np.asarray(vectors @ Rotation.from_rotvec(camera.rotation).as_matrix().T)


__all__ = ["Sampling", "point_weights", "sampling_of", "seen", "turned", "unseen", "viewing_axis"]
