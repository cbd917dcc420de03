"""The rope as a ruler: do camera and robot share a clock?

Where they are far apart, the rope is seen to end elsewhere than its held end was logged, and just where that
was logged earlier or later. Its length tells the rest: arc length counts from held end to held end. Where
these are looked up at the wrong time the rope comes out longer by what they went apart meanwhile, and each
point is off by its share of that: errors along the rope that follow the motion, as physics would. The length,
measured to a tenth of a millimetre, tells the time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from dlolib.chain.frame import FrameChain
from dlolib.formats import interpolate_motion
from dlolib.types import CaptureIndex, Floats, Motion

TANGENT = np.array([0.0, 0.0, 1.0])
# Lengths further than so many deviations from the others are of frames that lost the rope; an offset of so
# many is no chance, one that moves no point by so much does not matter.
OUTLYING, SURE, MATTERS_M = 4.0, 5.0, 5e-5
FEWEST_FRAMES = 20
# An offset that the tip of the rope tells: it strays by so much from its usual distance to the logged end in
# half of the frames, and by no more than this share of it once the end is looked up at another time.
STRAYS_M, LEFT, FEWEST_TIPS = 0.006, 1 / 3, 8
# Those that are tried: a share of the recording, at most so many seconds, in so many steps.
SHARE, LONGEST_S, STEPS = 0.2, 10.0, 240
# Of a motion that repeats itself the smallest offset counts that leaves no more than so many times the least.
AS_GOOD = 1.5


def clocks_apart(chains: Sequence[FrameChain], index: CaptureIndex) -> float:
    """By how much the camera's clock is ahead of the robot's [s], as in the effect `clock_offset`.

    Args:
        chains: of the capture's frames, their arc lengths counted by the ends' logged poses.
        index: with that motion.

    Returns:
        0 where no end is held, none moves, the offset is less than five deviations from it, or matters to no
        point.
    """
    motion = index.motion
    if motion is None or len(motion.t_s) < 2 or index.ends.start == index.ends.end == "free":
        return 0.0
    return _by_tips(chains, motion, index) or _by_length(chains, motion, index)


def _by_tips(chains: Sequence[FrameChain], motion: Motion, index: CaptureIndex) -> float:
    """The offset at which the held end that moves most stays where the rope is seen to end; 0 where it does
    so as logged, or nowhere better. Medians over the frames: a tip may be hidden in some, and a camera that
    stands elsewhere than said moves all of them alike."""
    t_s = np.array([chain.t_s for chain in chains])
    end = _moving(motion, index)
    seen_m = np.array([chain.tips_m[0 if end == "start" else 1] for chain in chains])
    if np.isfinite(seen_m).all(axis=1).sum() < FEWEST_TIPS:
        return 0.0

    def strays_m(offset_s: float) -> float:
        off = seen_m - getattr(interpolate_motion(motion, t_s - offset_s), f"{end}_m")
        return float(np.nanmedian(np.linalg.norm(off - np.nanmedian(off, axis=0), axis=1)))

    as_logged = strays_m(0.0)
    if as_logged <= STRAYS_M:
        return 0.0
    widest = min(SHARE * float(np.ptp(t_s)), LONGEST_S)
    tried = np.linspace(-widest, widest, STEPS + 1)
    left = np.array([strays_m(float(offset)) for offset in tried])
    good = tried[left <= AS_GOOD * left.min()]
    near = float(good[np.argmin(np.abs(good))])
    step = 2 * widest / STEPS
    best = minimize_scalar(strays_m, bounds=(near - step, near + step), method="bounded")
    return float(best.x) if best.fun <= LEFT * as_logged else 0.0


def _moving(motion: Motion, index: CaptureIndex) -> str:
    """The held end that goes furthest; one at least is held."""
    held = [end for end in ("start", "end") if getattr(index.ends, end) == "clamped"]
    return max(held, key=lambda end: float(np.ptp(getattr(motion, f"{end}_m"), axis=0).max()))


def _by_length(chains: Sequence[FrameChain], motion: Motion, index: CaptureIndex) -> float:
    """Least squares of the measured lengths over how fast the held ends go apart along the rope, beside a
    length, a drift, and what follows the place of the end that moves most. What is left goes together from
    frame to frame, which widens the deviation (a first-order process)."""
    if len(chains) < FEWEST_FRAMES:
        return 0.0
    t_s = np.array([chain.t_s for chain in chains])
    length_m = np.array([chain.measured_m for chain in chains])
    apart_m_s, place_m = _parting(motion, t_s, index)
    known = np.column_stack([np.ones_like(t_s), t_s - t_s.mean(), place_m - place_m.mean(axis=0), apart_m_s])
    good = _together(known, length_m)
    if good.sum() < FEWEST_FRAMES or np.ptp(apart_m_s[good]) == 0:
        return 0.0
    coordinates, rank, left = _fit(known[good], length_m[good])
    spread = float(np.sum(left**2)) / max(len(left) - rank, 1) * _widening(left)
    deviation = np.sqrt(spread * np.linalg.pinv(known[good].T @ known[good])[-1, -1])
    offset = float(coordinates[-1])
    matters = abs(offset) * float(np.abs(apart_m_s[good]).max()) > MATTERS_M
    return offset if matters and abs(offset) > SURE * deviation else 0.0


def _parting(motion: Motion, t_s: Floats, index: CaptureIndex) -> tuple[Floats, Floats]:
    """How fast the held ends go apart along the rope (F,) [m/s]; where the one is that moves most (F, 3)."""
    step = float(np.median(np.diff(motion.t_s)))
    here, before, after = (interpolate_motion(motion, t_s + late) for late in (0.0, -step, step))
    apart = np.zeros(len(t_s))
    for end, kind, sign in (("start", index.ends.start, -1.0), ("end", index.ends.end, 1.0)):
        if kind != "clamped":
            continue
        speed = (getattr(after, f"{end}_m") - getattr(before, f"{end}_m")) / (2 * step)
        turn = Rotation.from_quat(getattr(here, f"{end}_q"), scalar_first=True)
        apart += sign * np.sum(speed * turn.apply(TANGENT), axis=1)
    return apart, np.asarray(getattr(here, f"{_moving(motion, index)}_m"))


def _together(known: Floats, length_m: Floats) -> np.ndarray:
    """The frames whose lengths lie near what the others say."""
    good = np.ones(len(length_m), dtype=bool)
    for _ in range(3):
        coordinates, _, left = _fit(known[good], length_m[good])
        off = np.abs(length_m - known @ coordinates)
        good = off <= OUTLYING * max(1.4826 * float(np.median(np.abs(left))), 1e-12)
    return good


def _fit(known: Floats, length_m: Floats) -> tuple[Floats, int, Floats]:
    coordinates, _, rank, _ = np.linalg.lstsq(known, length_m)
    return np.asarray(coordinates, dtype=np.float64), int(rank), length_m - known @ coordinates


def _widening(left: Floats) -> float:
    """By how much residuals that go together from frame to frame widen a variance."""
    lag = float(np.clip(np.sum(left[1:] * left[:-1]) / max(float(np.sum(left**2)), 1e-300), 0.0, 0.9))
    return (1 + lag) / (1 - lag)
