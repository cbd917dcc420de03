"""What a recording has for itself and is no physics: between recordings of one object how it is mounted,
where the camera stands, and what happened before.

The first recording's poses hold; each further one may differ from it, by as much as its prior lets it. A
camera that looks another way is expected to have been turned about the rope, wherever the world's origin is.
What happened before a recording whose motion begins with its first frame is each one's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from dlolib.identify.parameters import Unknown
from dlolib.sim.effects import parameter
from dlolib.types import Floats, Recording

# Deviations expected of a grip, of a camera's direction and place; a difference in mounting worth saying.
MOUNTED_RAD, TURNED_RAD, SHIFTED_M = np.deg2rad(2.5), np.deg2rad(1.0), 5e-3
WORTH_SAYING_RAD = np.deg2rad(5.0)
MOUNTING = ("end_angle", "end_twist")
PRIORS = {
    **{f"end_angle.{end}_{axis}": MOUNTED_RAD for end in ("start", "end") for axis in (1, 2)},
    **{f"end_twist.{end}": MOUNTED_RAD for end in ("start", "end")},
    **{f"camera_pose.rotation_{axis}": TURNED_RAD for axis in (1, 2, 3)},
    **{f"camera_pose.shift_{axis}": SHIFTED_M for axis in (1, 2, 3)},
}
# What is off by more deviations is no nuisance; a difference in mounting may be, and is then said.
FARTHEST = 3.0
HISTORY = ("prior_history.kappa_1", "prior_history.kappa_2")


def between(recordings: Sequence[Recording]) -> dict[Unknown, float]:
    """What each recording but the first has for itself, and the deviation expected of it."""
    return {
        Unknown(name, k): deviation
        for k in range(1, len(recordings))
        for name, deviation in PRIORS.items()
        if held(recordings[k], name)
    }


def held(recording: Recording, name: str) -> bool:
    """Whether somebody holds the end that a parameter belongs to: a free one is mounted nowhere, and slips
    through no grasp."""
    end = parameter(name).end
    return not end or getattr(recording.ends, end) == "clamped"


def bounded(name: str) -> bool:
    """Whether a nuisance is sought within `FARTHEST` of its deviations only."""
    return name.partition(".")[0] not in MOUNTING


def swung(unknown: Unknown, pivot_m: Floats) -> dict[Unknown, float]:
    """By how much [m/rad] a camera's turns about the world's origin move the pivot (3,) [m] along the axis of
    a shift; nothing for any other unknown."""
    if not unknown.name.startswith("camera_pose.shift_"):
        return {}
    along = int(unknown.name[-1]) - 1
    arms = np.cross(np.eye(3), pivot_m)[:, along]
    return {Unknown(f"camera_pose.rotation_{k + 1}", unknown.recording): float(arms[k]) for k in range(3)}


def before(recordings: Sequence[Recording]) -> dict[Unknown, float]:
    """Of several recordings the curvature that the rope once had, if nobody saw how it came to its first
    shape: up to that of a circle."""
    if len(recordings) < 2:
        return {}
    return {
        Unknown(name, k): 2 * np.pi / recording.rope.length_m
        for k, recording in enumerate(recordings)
        if begins_unseen(recording)
        for name in HISTORY
    }


def begins_unseen(recording: Recording) -> bool:
    """Whether the motion is known from the first frame on alone, so that what came before it is not."""
    return bool(recording.motion.t_s[0] >= recording.points.t_s.min())


def mounted_otherwise(values: Mapping[Unknown, float], names: Sequence[str]) -> Iterator[str]:
    """A sentence for each recording of which an end is mounted otherwise than in one before it by more than 5
    degrees, and by how much in that which differs most."""
    turns = [_mountings(values, k) for k in range(len(names))]
    for k in range(1, len(names)):
        off = [float(np.linalg.norm(turns[k] - turn, axis=1).max()) for turn in turns[:k]]
        worst = int(np.argmax(off))
        if off[worst] > WORTH_SAYING_RAD:
            yield f"{names[k]} is mounted {np.rad2deg(off[worst]):.0f} degrees otherwise than {names[worst]}."


def _mountings(values: Mapping[Unknown, float], k: int) -> Floats:
    """How the start and the end are turned in a recording against the first, (2, 3) [rad]."""
    axes = ("end_angle.{}_1", "end_angle.{}_2", "end_twist.{}")
    return np.array(
        [[values.get(Unknown(name.format(end), k), 0.0) for name in axes] for end in ("start", "end")]
    )


__all__ = ["FARTHEST", "before", "begins_unseen", "between", "bounded", "held", "mounted_otherwise", "swung"]
