"""The rope's axis from start to end with its arc length, and what of it was seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.ndimage import minimum_filter1d

from dlolib.chain.anchor import Anchor
from dlolib.chain.centre import tangents
from dlolib.chain.lift import Strand
from dlolib.chain.order import LONGER, length
from dlolib.types import Floats, Ints

BRIDGE_STEP_M = 0.002
STRAIGHT_M, OVERLAP_M = 0.01, 0.03
HIDDEN_DOUBT, SEEN_DOUBT = 0.1, 0.003
# What a rope that is seen and has its length comes out too long by: a share of it, and what its line's errors
# make, which go to and fro over this share of the shortest wave that is left along it.
LONG_SHARE, TO_AND_FRO = 3e-4, 0.4
LARGEST_MISFIT, LARGEST_BRIDGE_MISFIT = 0.03, 0.33
# A free tip may be out of sight: more than so many deviations of what was seen is no error of measurement.
SURE = 3.0
# By so much a rope of which both tips are free may be shorter than it is said to be; of what is shorter still
# a tip is out of sight, and where arc length begins nobody knows.
SHORTER = 0.1
BACK_SAMPLES = 10
ALONG = 0.5


@dataclass(frozen=True)
class Axis:
    """A dense line along the rope: s_m (M,), points_m (M, 3), seen (M,), pixel (M, 2), NaN where hidden.

    measured_m is the length as measured from start to end, hidden stretches included; fitted tells
    whether s_m was brought to the rope's known length; else it is counted from the start, or from the end
    back from the known length there, and goes no further than that where no end is held. doubt_m (M,): the
    deviation of these arc lengths. sigma_m (M, 2), the deviations of the depth and across the line of sight
    where they were asked for, NaN where hidden.
    """

    s_m: Floats
    points_m: Floats
    seen: NDArray[np.bool_]
    pixel: Floats
    measured_m: float
    fitted: bool
    doubt_m: Floats
    sigma_m: Floats | None = None

    def counts(self, ends_held: int, length_m: float) -> bool:
        """Whether this can be the rope: from held end to held end it is all there; from one that is held the
        tip may be out of sight, but there is hardly more of it than the known length."""
        least = {0: (1 - SHORTER) * length_m, 1: 0.0}
        return self.fitted or (
            ends_held < 2 and least[ends_held] <= self.measured_m <= (1 + LONGER) * length_m
        )


def assemble(
    strands: list[Strand],
    start: Anchor | None,
    end: Anchor | None,
    length_m: float,
    bridge_m: float,
    smooth_m: float,
) -> Axis:
    """String ordered strands together and give every sample its arc length from the start.

    Hidden stretches are bridged by cubics for their length only. Where the measured length is within 3 %
    of the known one (within 0.9 % where one end is held and the other's tip may be out of sight; a third of
    what is hidden comes on top where an end is held), what is left of the difference is spread: hidden
    stretches are trusted to 10 %, and are no shorter than a straight line; seen ones to 0.3 %, which are
    mostly longer where their line is less sure. Else an end is out of sight, and arc length counts as
    measured from the end that is held, or from the first that is seen.

    Args:
        strands: the visible stretches in camera axes, each from start to end, at least one.
        start, end: the held ends in the same axes; None where free.
        length_m: the rope's known length [m].
        bridge_m: the longest stretch that counts as seen though nothing was read in it.
        smooth_m: half of the shortest wave that is left along the strands.
    """
    if start is not None:
        strands = _cut_before(strands, start, length_m)
    if end is not None:
        strands = _turned(_cut_before(_turned(strands), end.turned(), length_m))
    pieces = _pieces(_without_overlap(strands), start, end, bridge_m)
    points, pixel = (
        np.concatenate([getattr(piece, name) for piece in pieces]) for name in ("points_m", "pixel")
    )
    seen = np.concatenate([piece.seen for piece in pieces])
    hidden = np.repeat([piece.hidden for piece in pieces], [len(piece.seen) for piece in pieces])
    sigma = np.concatenate([piece.sigma_m for piece in pieces])
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    measured = float(step.sum())
    unseen = hidden[1:] | hidden[:-1]
    held = (start is not None) + (end is not None)
    fitted = abs(measured - length_m) <= _largest_misfit(step, unseen, held, length_m)
    long = (LONG_SHARE if fitted else SEEN_DOUBT) * step
    long += _to_and_fro(step, sigma, TO_AND_FRO * smooth_m)
    off = np.where(unseen, HIDDEN_DOUBT * step, long)
    if fitted:
        step, off = _fitted(step, unseen, off, length_m, _straight(points, step, unseen))
    s = np.concatenate([[0.0], np.cumsum(step)])
    from_end = start is None and end is not None and not fitted
    if from_end:
        s += length_m - s[-1]
    elif held == 0 and not fitted:
        # both tips are seen and the length is not what it was taken for: the points go from tip to tip
        s *= min(1.0, length_m / max(s[-1], 1e-12))
    doubt = _doubt(unseen, off, fitted, from_end)
    known = sigma if np.isfinite(sigma).any() else None
    return Axis(s, points, seen, pixel, measured, fitted, doubt, known)


@dataclass(frozen=True)
class _Piece:
    points_m: Floats
    pixel: Floats
    seen: NDArray[np.bool_]
    hidden: bool
    sigma_m: Floats


def _pieces(strands: list[Strand], start: Anchor | None, end: Anchor | None, bridge_m: float) -> list[_Piece]:
    """Strands and the bridges between them, from held end to held end."""
    pieces: list[_Piece] = []
    if start is not None:
        first = strands[0]
        anchor = _beside(start, first.points_m[0])
        # A held end may lie so far beyond what was seen, if the rope itself was seen there at all; inside the
        # rope no place in a short gap is further away.
        at_start = 0.5 * bridge_m * float(first.seen[0])
        pieces.append(
            _bridge(anchor, start.tangent, first.points_m[0], _heading(first, 0), at_start, keep="first")
        )
    for number, strand in enumerate(strands):
        if number:
            last = strands[number - 1]
            pieces.append(
                _bridge(
                    last.points_m[-1], _heading(last, -1), strand.points_m[0], _heading(strand, 0), bridge_m
                )
            )
        sigma = np.full((len(strand.seen), 2), np.nan)
        if strand.depth_sigma_m is not None and strand.across_sigma_m is not None:
            sigma = np.stack([strand.depth_sigma_m, strand.across_sigma_m], axis=-1)
        pieces.append(_Piece(strand.points_m, strand.pixel, strand.seen, False, sigma))
    if end is not None:
        last = strands[-1]
        anchor = _beside(end, last.points_m[-1])
        at_end = 0.5 * bridge_m * float(last.seen[-1])
        pieces.append(
            _bridge(last.points_m[-1], _heading(last, -1), anchor, end.tangent, at_end, keep="last")
        )
    return pieces


def _beside(anchor: Anchor, tip: Floats) -> Floats:
    """Where the rope ends, as the camera sees it: a held end close to the tip only says how far along.

    The rope is straight there, and a camera's pose is known to some millimetres only.
    """
    offset = tip - anchor.place_m
    if np.linalg.norm(offset) > STRAIGHT_M:
        return anchor.place_m
    place: Floats = tip - float(offset @ anchor.tangent) * anchor.tangent
    return place


def _bridge(
    here: Floats, heading: Floats, there: Floats, arriving: Floats, bridge_m: float, keep: str = ""
) -> _Piece:
    """A cubic from one place and direction to another; its outermost point stays where it is an end."""
    gap = float(np.linalg.norm(there - here))
    curve = CubicHermiteSpline([0.0, 1.0], [here, there], [gap * heading, gap * arriving])
    share = np.linspace(0.0, 1.0, max(int(gap / BRIDGE_STEP_M), 1) + 1)
    share = share[0 if keep == "first" else 1 : len(share) if keep == "last" else -1]
    points = np.asarray(curve(share), dtype=np.float64).reshape(-1, 3)
    seen = np.full(len(points), gap <= bridge_m)
    unknown = np.full((len(points), 2), np.nan)
    return _Piece(points, unknown, seen, gap > bridge_m, unknown)


def _heading(strand: Strand, at: int) -> Floats:
    """Unit direction (3,) of the rope at the first (0) or last (-1) sample of a strand."""
    back = min(BACK_SAMPLES, len(strand.points_m) - 1)
    step = (
        strand.points_m[back] - strand.points_m[0]
        if at == 0
        else strand.points_m[-1] - strand.points_m[-1 - back]
    )
    unit: Floats = step / max(float(np.linalg.norm(step)), 1e-12)
    return unit


def _without_overlap(strands: list[Strand]) -> list[Strand]:
    """Let each strand begin where the one before ends: at a cut fork both go on a little into the cut."""
    apart = strands[:1]
    for strand in strands[1:]:
        last = apart[-1]
        offset = strand.points_m - last.points_m[-1]
        behind = (offset @ _heading(last, -1) <= 0) & (np.linalg.norm(offset, axis=1) < OVERLAP_M)
        cut = int(np.argmin(behind)) if not behind.all() else len(behind) - 2
        apart.append(_from(strand, min(cut, len(strand.seen) - 2)))
    return apart


def _from(strand: Strand, first: int) -> Strand:
    return strand.part(slice(first, None))


def _turned(strands: list[Strand]) -> list[Strand]:
    return [strand.turned() for strand in strands[::-1]]


def _cut_before(strands: list[Strand], anchor: Anchor, length_m: float) -> list[Strand]:
    """Leave out what lies before a held start: the rope's tail on the other side of the clamp.

    A rope with a loop may pass by its own clamp: of all passes in the clamp's direction, the one counts
    that leaves the length which is known.
    """
    first = strands[0]
    offset = first.points_m - anchor.place_m
    distance = np.linalg.norm(offset, axis=1)
    along = tangents(first.points_m) @ anchor.tangent > ALONG
    passing = (
        along & (distance <= minimum_filter1d(distance, 2 * BACK_SAMPLES + 1)) & (distance <= STRAIGHT_M)
    )
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(first.points_m, axis=0), axis=1))])
    rest = way[-1] - way + sum(length(strand) for strand in strands[1:])
    if not passing.any():
        return strands
    nearest = min(np.flatnonzero(passing), key=lambda at: abs(float(rest[at]) - length_m))
    before = offset @ anchor.tangent < 0
    before[nearest + 1 :] = False
    before[: max(nearest - round(STRAIGHT_M / max(way[-1] / len(way), 1e-9)), 0)] = False
    if not before.any():
        return strands
    cut = int(np.flatnonzero(before)[-1]) + 1
    if len(first.points_m) - cut < 2:
        return strands
    return [_from(first, cut), *strands[1:]]


def _largest_misfit(step: Floats, hidden: NDArray[np.bool_], held: int, length_m: float) -> float:
    """By how much [m] steps (M - 1,) between so many held ends may together be off the known length."""
    hidden_m = float(step[hidden].sum())
    if held == 0:
        return LARGEST_MISFIT * length_m
    seen_m = LARGEST_MISFIT * length_m if held == 2 else SURE * SEEN_DOUBT * float(step[~hidden].sum())
    return seen_m + LARGEST_BRIDGE_MISFIT * hidden_m


def _to_and_fro(step: Floats, sigma: Floats, wave_m: float) -> Floats:
    """By how much [m] (M - 1,) errors of these deviations (M, 2) make each step of a line longer, on average:
    half of its squared slope, which has a share of how the deviation itself changes."""
    size = np.nan_to_num(0.5 * (sigma[1:] + sigma[:-1]))
    grows = np.nan_to_num(np.diff(sigma, axis=0)) / np.maximum(step, 1e-9)[:, None]
    return np.asarray(0.5 * step * np.sum((size / wave_m) ** 2 + grows**2, axis=1))


def _straight(points_m: Floats, step: Floats, hidden: NDArray[np.bool_]) -> Floats:
    """Steps (M - 1,) of the line through points (M, 3) whose hidden stretches go straight; 0 where seen."""
    straight = np.zeros(len(step))
    edges = np.flatnonzero(np.diff(hidden, prepend=False, append=False))
    for first, last in edges.reshape(-1, 2):
        chord_m = float(np.linalg.norm(points_m[last] - points_m[first]))
        straight[first:last] = step[first:last] * chord_m / max(float(step[first:last].sum()), 1e-12)
    return straight


def _fitted(
    step: Floats, hidden: NDArray[np.bool_], off: Floats, length_m: float, least: Floats
) -> tuple[Floats, Floats]:
    """Steps (M - 1,) that add up to the known length, each changed by its share of what those that were
    hidden, or seen, may be off, none to less than `least`; and what they may be off, more where all are off
    by more."""
    hidden_m, seen_m = float(step[hidden].sum()), float(step[~hidden].sum())
    variances = (HIDDEN_DOUBT * hidden_m) ** 2, (SEEN_DOUBT * seen_m) ** 2
    of_hidden = (length_m - hidden_m - seen_m) * variances[0] / max(sum(variances), 1e-300)
    share = off / np.where(hidden, off[hidden].sum(), off[~hidden].sum())
    # what hidden stretches cannot give way by, seen ones do
    of_seen = length_m - seen_m - float(np.maximum(step + of_hidden * share, least)[hidden].sum())
    change = np.where(hidden, of_hidden, of_seen)
    return np.maximum(step + change * share, least), np.maximum(off, np.abs(change) * share)


def _doubt(hidden: NDArray[np.bool_], off: Floats, fitted: bool, from_end: bool) -> Floats:
    """The deviation [m] (M,) of arc lengths along steps (M - 1,) that may be off by so much.

    From an end on, all that was seen is too long together; each hidden stretch is off by itself. Of a rope
    whose length is known both ends tell.
    """
    number = np.cumsum(np.diff(hidden.astype(np.int64), prepend=0) > 0, dtype=np.int64)
    before = _counted(hidden, off, number)
    after = _counted(hidden[::-1], off[::-1], number[::-1])[::-1]
    if fitted:
        return np.asarray(np.sqrt(before * after / np.maximum(before + after, 1e-300)))
    return np.asarray(np.sqrt(after if from_end else before))


def _counted(hidden: NDArray[np.bool_], off: Floats, number: Ints) -> Floats:
    """The variance [m^2] (M,) of arc lengths from the first place on."""
    groups = [~hidden, *(hidden & (number == one) for one in np.unique(number[hidden]))]
    parts = [np.concatenate([[0.0], np.cumsum(np.where(mine, off, 0.0))]) ** 2 for mine in groups]
    return np.asarray(np.sum(parts, axis=0))
