"""Clamps whose roll was not recorded.

Such a clamp holds the rope as any other does: it does not let it turn about itself. Where motion.csv says how
it is rolled that stands for nothing, least of all where the clamp points down, since it is the shortest turn
from straight up. So it is taken as upright: rolled as if an arm had turned it at the first pose the shortest
way from straight up, or from straight down where it points down, and carried on from there. Arms that grip
alike each time have the same roll in this sense; by how much one end of the rope is rolled against the other
is `end_twist.end`, one number of the rope as it was gripped, which is fitted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.sim.start import frames_along
from dlolib.types import Floats, Motion, Pose, Recording

# How an end of unknown roll is rolled against the other, and where a fit of it may begin [rad].
ROLL, ROLLS = "end_twist.end", (0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi)
# A clamp whose direction has less than this upwards points down: many are level, and must not be either.
DOWN = -0.25


def upright(recording: Recording) -> Recording:
    """The recording with clamps of unknown roll upright at its first pose, all rolls known then."""
    ends, motion = recording.ends, recording.motion
    turned = {}
    for end, known in (("start", ends.start_roll_known), ("end", ends.end_roll_known)):
        if not known and getattr(ends, end) == "clamped":
            q = getattr(motion, f"{end}_q")
            turned[f"{end}_q"] = about_axis(q, _roll(q[0]))
    known_ends = replace(ends, start_roll_known=True, end_roll_known=True)
    return replace(recording, ends=known_ends, motion=replace(motion, **turned))


def as_logged(motion: Motion, recording: Recording) -> Motion:
    """A motion that goes on from the upright recording's, as it goes on from the recording's own."""
    ends, turned = recording.ends, {}
    for end, known in (("start", ends.start_roll_known), ("end", ends.end_roll_known)):
        if not known and getattr(ends, end) == "clamped":
            back = -_roll(getattr(recording.motion, f"{end}_q")[0])
            turned[f"{end}_q"] = about_axis(getattr(motion, f"{end}_q"), back)
    return replace(motion, **turned)


def unrolled(recording: Recording) -> bool:
    """Whether the roll of one end against the other is not known: both are held, one of unknown roll."""
    ends = recording.ends
    held = ends.start == ends.end == "clamped"
    return held and not (ends.start_roll_known and ends.end_roll_known)


def about_axis(quaternions: Floats, angle: float | Floats) -> Floats:
    """Frames (T, 4) turned about their own third axis by an angle or angles (T,) [rad], no sign flipped."""
    c, s = np.cos(angle / 2), np.sin(angle / 2)
    w, x, y, z = quaternions.T
    return np.stack([c * w - s * z, c * x + s * y, c * y - s * x, c * z + s * w], axis=1)


def _roll(quaternion: Floats) -> float:
    """How far to roll a clamp of this frame (4,) for it to be upright [rad]."""
    own = Rotation.from_quat(quaternion, scalar_first=True)
    tangent = own.as_matrix()[:, 2]
    vertical = Rotation.identity() if tangent[2] > DOWN else Rotation.from_rotvec([np.pi, 0.0, 0.0])
    pose = Pose(np.zeros(3), vertical.as_quat(scalar_first=True))
    there = frames_along(np.stack([np.zeros(3), tangent]), pose, None)[1]
    return float((own.inv() * Rotation.from_quat(there, scalar_first=True)).as_rotvec()[2])


__all__ = ["ROLL", "ROLLS", "about_axis", "as_logged", "unrolled", "upright"]
