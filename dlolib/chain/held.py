"""Whether the rope is seen where and as its held ends are logged: a wrong pose of the camera shows there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dlolib.chain.anchor import Anchor
from dlolib.chain.axis import ALONG, STRAIGHT_M
from dlolib.chain.centre import tangents
from dlolib.chain.lift import Strand
from dlolib.chain.view import View
from dlolib.formats import interpolate_motion
from dlolib.types import CaptureIndex, Floats

# What to do where a held end is logged elsewhere than the rope is seen.
POSES = "check camera.world_from_camera, motion.csv and its clock"
# Further from a held end the rope tells nothing of it; nearer, the end is where it was logged (in plain view
# the rope is seen to end within 2 mm of it).
NEAR_M, ASTRAY_M = 0.05, 0.006
# Both tips are off together where they differ by no more than this share of it.
TOGETHER = 0.3
# So much further than the rope a reading is of what is behind it; over this share of a gap nothing hides it.
BEHIND_M, OPEN_SHARE, SAMPLES = 0.01, 0.8, 21
# The direction in which a rope leaves its clamp shows over so much of it, seen from so close to the clamp on.
LEAVES_M, CLOSE_M = 0.02, 0.02


def astray(
    strands: list[Strand], start: Anchor | None, end: Anchor | None, view: View, skin_m: float
) -> tuple[float, float]:
    """How far [m] from the rope the start and the end were logged; 0 where it agrees, or cannot be told.

    What hides a rope beside its clamp leaves a gap, too, and a tail may hang out on a clamp's other side. But
    no gap and tail are alike by chance: where both tips are off by the same, the camera is.

    Args:
        strands: the visible stretches in order, each from start to end, at least one.
        start, end: the held ends in the same axes; None where free.
        view: what the camera saw.
        skin_m: how far before the axis the strands lie.
    """
    opening, closing = _deeper(strands[0], skin_m), _deeper(strands[-1], skin_m)
    if start is not None and end is not None:
        offsets = np.array([opening.points_m[0] - start.place_m, closing.points_m[-1] - end.place_m])
        off = float(np.linalg.norm(offsets.mean(axis=0)))
        if ASTRAY_M < off <= NEAR_M and np.linalg.norm(np.diff(offsets, axis=0)) <= TOGETHER * off:
            first, last = np.linalg.norm(offsets, axis=1)
            return float(first), float(last)
    turned = None if end is None else end.turned()
    return _beside(opening, start, view), _beside(closing.turned(), turned, view)


def off_together(tips_m: Floats, t_s: Floats, index: CaptureIndex) -> Floats:
    """How far [m] (F,) both held ends were logged from where what is seen of the rope begins and ends; NaN in
    frames where they are not off by the same. However far that is, no gap and tail are alike by chance.

    Args:
        tips_m: where that is in each frame (F, 2, 3), world axes.
        t_s: the frames' times (F,) [s].
        index: both ends are held.
    """
    assert index.motion is not None
    poses = interpolate_motion(index.motion, t_s)
    offsets = tips_m - np.stack([poses.start_m, poses.end_m], axis=1)
    off = np.linalg.norm(offsets.mean(axis=1), axis=1)
    apart = np.linalg.norm(offsets[:, 1] - offsets[:, 0], axis=1)
    return np.where((off > ASTRAY_M) & (apart <= TOGETHER * off), off, np.nan)


def turned(
    strands: list[Strand], start: Anchor | None, end: Anchor | None, skin_m: float
) -> tuple[float, float]:
    """By how much [rad] the rope is seen to leave the start and to reach the end in another direction than is
    logged; NaN where an end is free, or the rope not seen close to it. Arguments as for `astray`."""
    opening, closing = _deeper(strands[0], skin_m), _deeper(strands[-1], skin_m).turned()
    backwards = None if end is None else end.turned()
    return _leaves(opening.points_m, start), _leaves(closing.points_m, backwards)


def _leaves(points_m: Floats, start: Anchor | None) -> float:
    """The angle [rad] between a held start's tangent and the rope (N, 3) that is seen from there on."""
    if start is None or np.linalg.norm(points_m[0] - start.place_m) > CLOSE_M:
        return float("nan")
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_m, axis=0), axis=1))])
    chord = points_m[min(int(np.searchsorted(way, LEAVES_M)), len(way) - 1)] - points_m[0]
    cosine = float(chord @ start.tangent) / max(float(np.linalg.norm(chord)), 1e-12)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _deeper(strand: Strand, by_m: float) -> Strand:
    """A strand carried so much further from the camera."""
    distance = np.linalg.norm(strand.points_m, axis=1, keepdims=True)
    return replace(strand, points_m=strand.points_m * (1 + by_m / distance))


def _beside(first: Strand, start: Anchor | None, view: View) -> float:
    """How far [m] from the first strand a held start was logged, by itself.

    It tells only where the rope passes abreast of it, or the camera looks through the gap. The chord of a
    bend between them runs in the mean of both directions, so that a bend is neither.
    """
    if start is None:
        return 0.0
    points, heading = first.points_m, tangents(first.points_m)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    near = (way <= 2 * NEAR_M) & (heading @ start.tangent > ALONG)
    if not near.any():
        return 0.0
    offset, heading = points[near] - start.place_m, heading[near]
    nearest = int(np.argmin(np.linalg.norm(offset, axis=1)))
    gap = float(np.linalg.norm(offset[nearest]))
    if not ASTRAY_M < gap <= NEAR_M:
        return 0.0
    middle = start.tangent + heading[nearest]
    along = abs(float(offset[nearest] @ middle)) / float(np.linalg.norm(middle))
    abreast = along <= STRAIGHT_M and gap**2 - along**2 > max(ASTRAY_M, along) ** 2
    return gap if abreast or _open(start.place_m, offset[nearest], view) else 0.0


def _open(place_m: Floats, gap_m: Floats, view: View) -> bool:
    """Whether the camera sees what is behind a gap (3,) from a place (3,) on, so that nothing hides it."""
    points = place_m + np.linspace(0, 1, SAMPLES)[:, None] * gap_m
    column, row = np.round(view.pixel(points)).astype(int).T
    height, width = view.depth_m.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    read = np.zeros(SAMPLES)
    read[inside] = view.depth_m[row[inside], column[inside]]
    return float(np.mean(read > points[:, 2] + BEHIND_M)) >= OPEN_SHARE
