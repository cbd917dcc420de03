"""The chain: lines 6 to 15 of Algorithm 1, the greedy sampling at spacing l."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlolib.chain.axis import Axis
from dlolib.types import Floats

CROWDED = 0.25
ROUNDING_M = 1e-9


def greedy_chain(axis: Axis, spacing_m: float, points: int) -> tuple[Floats, Floats, Floats]:
    """Sample an axis at spacing l from its start, forward along the rope; the last point is its end.

    Algorithm 1 of the paper takes as y_i the point of the line whose distance from y_{i-1} is nearest to
    l, that is, argmin | ‖u - start‖ - l |, and means only points further along the rope (facts on the
    paper's equations). The distance here is the one along the rope: with the chord, each step would be a
    little more than l long in a bend and the last segment several per cent too short. Where the rope was
    not seen there is no point.

    Args:
        axis: the dense line; s_m increases.
        spacing_m: l [m].
        points: n, counting those that are not seen.

    Returns:
        Arc lengths s_m (K,), points (K, 3) [m] in the line's axes, pixels (K, 2); K ≤ n.
    """
    # The end is the last corner, not one more step: y_n of line 14. So is the start, where arc length counts
    # from the end and the line begins between two steps.
    begin, end = max(0.0, float(axis.s_m[0])), min(spacing_m * (points - 1), float(axis.s_m[-1]))
    inner = np.arange(1.0, points - 1.0) * spacing_m
    inner = inner[(inner >= begin + CROWDED * spacing_m) & (inner <= end - CROWDED * spacing_m)]
    s = np.array([begin, *inner.tolist(), end])
    s = s[_seen_at(axis, s)]
    place = [np.interp(s, axis.s_m, axis.points_m[:, k]) for k in range(3)]
    known = np.isfinite(axis.pixel[:, 0])
    pixel = [np.interp(s, axis.s_m[known], axis.pixel[known, k]) for k in range(2)]
    return s, np.stack(place, axis=-1), np.stack(pixel, axis=-1)


def _seen_at(axis: Axis, s: Floats) -> NDArray[np.bool_]:
    """Whether the samples on both sides of each arc length (K,) were seen."""
    after = np.clip(np.searchsorted(axis.s_m, s - ROUNDING_M), 0, len(axis.s_m) - 1)
    before = np.clip(np.searchsorted(axis.s_m, s + ROUNDING_M, side="right") - 1, 0, len(axis.s_m) - 1)
    seen: NDArray[np.bool_] = axis.seen[after] & axis.seen[before]
    return seen
