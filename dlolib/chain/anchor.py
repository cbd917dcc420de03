"""The rope's held ends as the camera sees them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.captures.base import Frame
from dlolib.formats import interpolate_motion
from dlolib.types import CaptureIndex, Floats

TANGENT = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Anchor:
    """A held end: its position [m] (3,) and the direction (3,) in which the rope leaves or enters it."""

    place_m: Floats
    tangent: Floats

    def turned(self) -> Anchor:
        """The same end, come upon the other way round."""
        return Anchor(self.place_m, -self.tangent)


def anchors(frame: Frame, index: CaptureIndex) -> tuple[Anchor | None, Anchor | None]:
    """The held ends at the time of a frame, in camera axes; None where free."""
    if index.motion is None:
        return None, None
    pose = interpolate_motion(index.motion, np.array([frame.t_s]))
    held = (index.ends.start == "clamped", index.ends.end == "clamped")
    places = ((pose.start_m[0], pose.start_q[0]), (pose.end_m[0], pose.end_q[0]))
    start, end = (
        _anchor(*place, index) if is_held else None for is_held, place in zip(held, places, strict=True)
    )
    return start, end


def _anchor(place_m: Floats, quaternion: Floats, index: CaptureIndex) -> Anchor:
    turn, camera_m = index.camera.world_from_camera[:3, :3], index.camera.world_from_camera[:3, 3]
    tangent = Rotation.from_quat(quaternion, scalar_first=True).apply(TANGENT)
    return Anchor((place_m - camera_m) @ turn, tangent @ turn)
