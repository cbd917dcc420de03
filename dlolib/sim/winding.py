"""How far a rope between two held ends is twisted at settled poses, whole turns and all.

What was seen of a pose tells the twist but for whole turns. These follow from the way there: from row to row
the ends turn the way round that the quaternions' signs tell, and from one shape seen to the next the rope is
taken to go the shortest way. At first it is twisted the least.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.formats import interpolate_motion
from dlolib.sim.start import frames_along
from dlolib.sim.upright import about_axis
from dlolib.types import Floats, Motion, Pose

# Parts of the way between two rows, on which an end turns once at most: in none may it turn the rope by half.
PARTS = 16
# A direction that is turned onto its opposite has no shortest way; any will do.
LEAST = 1e-12


def twists(motion: Motion, frames_s: Floats, shapes_m: Floats) -> Floats:
    """The twist from start to end [rad], (F,), of a rope at these times (F,) [s]; the least at first.

    Args:
        motion: of both ends, which are held.
        frames_s: in order.
        shapes_m: where its particles are then, (F, n, 3) [m]; before the first as at the first.
    """
    rows_s = motion.t_s[motion.t_s < frames_s[-1]]
    knots_s = np.union1d(rows_s, frames_s)
    times_s = np.interp(np.arange(PARTS * (len(knots_s) - 1) + 1) / PARTS, np.arange(len(knots_s)), knots_s)
    way = interpolate_motion(motion, times_s)
    start, end = (_axes(q) for q in (way.start_q, way.end_q))
    directions = np.concatenate(
        [start[:, None, :, 2], _tangents_at(times_s, frames_s, shapes_m), end[:, None, :, 2]], axis=1
    )
    carried, there = _carried(start[:, :, 0], directions), end[:, :, 0]
    sine = np.einsum("tk,tk->t", np.cross(carried, there), directions[:, -1])
    followed = np.unwrap(np.arctan2(sine, np.einsum("tk,tk->t", carried, there)))
    return np.asarray(followed[PARTS * np.searchsorted(knots_s, frames_s)])


def wound(places_m: Floats, start_q: Floats, end_q: Floats, twist: float) -> Floats:
    """Frames of wall, segments and grasp (n + 1, 4) along places (n, 3) [m], a twist [rad] spread evenly."""
    frames = frames_along(places_m, Pose(places_m[0], start_q), None)[:-1]
    return np.concatenate([about_axis(frames, np.linspace(0, twist, len(frames))), end_q[None]])


def _axes(quaternions: Floats) -> Floats:
    return np.asarray(Rotation.from_quat(quaternions, scalar_first=True).as_matrix())


def _tangents_at(times_s: Floats, frames_s: Floats, shapes_m: Floats) -> Floats:
    """The segments' directions (T, n - 1, 3), turned from frame to frame; before the first, its own."""
    tangents = _unit(np.diff(shapes_m, axis=1))
    at = np.interp(times_s, frames_s, np.arange(len(frames_s)))
    before = np.minimum(at.astype(int), max(len(frames_s) - 2, 0))
    after = np.minimum(before + 1, len(frames_s) - 1)
    share = (at - before)[:, None, None]
    return _unit((1 - share) * tangents[before] + share * tangents[after])


def _carried(across: Floats, directions: Floats) -> Floats:
    """Vectors (T, 3) across the first of directions (T, D, 3), turned with them the shortest way."""
    for one, other in pairwise(np.moveaxis(directions, 1, 0)):
        along = np.einsum("tk,tk->t", across, other)
        both = 1 + np.einsum("tk,tk->t", one, other)
        across = across - (along / np.maximum(both, LEAST))[:, None] * (one + other)
    return across


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), LEAST))


__all__ = ["twists", "wound"]
