"""Which stretch follows which: the visible stretches of a rope, put in order from its start to its end."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from dlolib.chain.anchor import Anchor
from dlolib.chain.lift import Strand
from dlolib.types import Floats

MOST_STRANDS = 12
TURN_M = 0.05
SKIP = 2.0
# By so much a rope may be longer than it is said to be; what is longer still is not that rope alone.
LONGER = 0.1
# Within a width of its tip a strand at a crossing is bent into the other: where it goes is what it does
# before that, over so many more widths.
BENT_WIDTHS, HEADING_WIDTHS = 1.0, 2.0
# At a tip, beside what hides the rope or beyond its last readings, depth is less sure than the place in the
# image: of a way's length along the line of sight this share counts.
DEPTH_SHARE = 0.5
BLUR_M = 0.004
NEAR_BEFORE_M, AGAINST_M = 0.03, 0.03


@dataclass(frozen=True)
class _Tip:
    """Where a strand or a held end comes to an end [m] (3,), from where on it is straight, and its direction
    outward (3,)."""

    place_m: Floats
    base_m: Floats
    outward: Floats


def in_order(
    strands: list[Strand],
    width: float,
    start: Anchor | None,
    end: Anchor | None,
    length_m: float,
    before_m: Floats | None = None,
) -> list[Strand]:
    """Order the strands along the rope and turn each to run from start to end.

    The best order is found exactly (the Held-Karp recursion over subsets): least total of what lies
    between, counted as the distance plus a price for turning, where leaving a strand out costs twice its
    length; but of what is longer than the rope (length_m) together, some is not of it, and so does what is
    taken too much. The held ends are known; with both ends free the direction is arbitrary. Where the rope
    was a frame ago (a line before_m (M, 3), from start to end) settles what else is nearly even: to run along
    a strand against it costs a little. All are in camera axes; width, the rope's, is in samples of a strand.
    """
    strands = _longest(strands)[:MOST_STRANDS]
    if not strands:
        return []
    tips = [tip for strand in strands for tip in _tips(strand, width)]
    count = len(tips)
    between = np.full((count, count), np.inf)
    for leave, enter in combinations(range(count), 2):
        if leave // 2 != enter // 2:
            between[leave, enter] = between[enter, leave] = _price(tips[leave], tips[enter])
    opening, closing = [0.0] * count, [0.0] * count
    if start is not None:
        opening = [_price(_Tip(start.place_m, start.place_m, start.tangent), tip) for tip in tips]
    if end is not None:
        closing = [_price(tip, _Tip(end.place_m, end.place_m, -end.tangent)) for tip in tips]
    # Of a strand that is left through a tip, whichever way the rope came to it.
    against = _against(np.array([tip.place_m for tip in tips]), before_m)
    closing = [price + wrong for price, wrong in zip(closing, against, strict=True)]
    between += against[:, None]
    exits = _held_karp(between, opening, closing, _misses([_worth(strand) for strand in strands], length_m))
    return [strands[e // 2] if e % 2 else strands[e // 2].turned() for e in exits]


def unordered_m(strands: list[Strand]) -> float:
    """Length [m] of the strands that are more than can be put in order."""
    return sum(length(strand) for strand in _longest(strands)[MOST_STRANDS:])


def _longest(strands: list[Strand]) -> list[Strand]:
    return sorted(strands, key=length, reverse=True)


def length(strand: Strand) -> float:
    """Length [m] of a strand's polyline."""
    return float(np.linalg.norm(np.diff(strand.points_m, axis=0), axis=1).sum())


def _worth(strand: Strand) -> float:
    """How long [m] a strand looks: a stub whose depth runs away is no more of the rope than that."""
    middle = _unit(strand.points_m[len(strand.points_m) // 2])
    return float(np.linalg.norm(_flat(np.diff(strand.points_m, axis=0), middle, 0.0), axis=1).sum())


def _tips(strand: Strand, width: float) -> tuple[_Tip, _Tip]:
    """Its first and its last end."""
    last = len(strand.points_m) - 1
    base = min(round(BENT_WIDTHS * width), last // 2)
    inner = min(base + max(round(HEADING_WIDTHS * width), 1), last)
    first, second = (
        _Tip(points[0], points[base], _unit(points[base] - points[inner]))
        for points in (strand.points_m, strand.points_m[::-1])
    )
    return first, second


def _against(places: Floats, before_m: Floats | None) -> Floats:
    """Price [m] (2S,) of leaving each strand through each tip, if the rope ran the other way a frame ago."""
    price = np.zeros(len(places))
    if before_m is None or len(before_m) < 2:
        return price
    apart = np.linalg.norm(places[:, None] - before_m, axis=-1)
    nearest, near = apart.argmin(axis=1), apart.min(axis=1) < NEAR_BEFORE_M
    for tip in range(len(places)):
        if near[tip] and near[tip ^ 1] and nearest[tip] < nearest[tip ^ 1]:
            price[tip] = AGAINST_M
    return price


def _price(leave: _Tip, enter: _Tip) -> float:
    """Price [m] of going from one tip on to another, or back: the way, and the turning on it."""
    sight = _unit(leave.place_m + enter.place_m)
    gap = _flat(enter.place_m - leave.place_m, sight)
    heading, arriving = _unit(_flat(leave.outward, sight)), _unit(_flat(-enter.outward, sight))
    way = _unit(_flat(enter.base_m - leave.base_m, sight) + BLUR_M * (heading + arriving))
    turning = 2.0 - float(heading @ way) - float(way @ arriving)
    return float(np.linalg.norm(gap)) + TURN_M * turning


def _flat(vector: Floats, sight: Floats, share: float = DEPTH_SHARE) -> Floats:
    """Vectors (..., 3) with a share of their part along the line of sight (3,)."""
    flat: Floats = vector - (1.0 - share) * (vector @ sight)[..., None] * sight
    return flat


def _misses(lengths_m: list[float], length_m: float) -> list[float]:
    """Price [m] of taking each set of strands, a bit each: what it lacks, or has too much."""
    taken = [
        sum(one for k, one in enumerate(lengths_m) if used >> k & 1) for used in range(1 << len(lengths_m))
    ]
    whole = min(taken[-1], (1 + LONGER) * length_m)
    return [SKIP * abs(whole - one) for one in taken]


def _held_karp(between: Floats, opening: list[float], closing: list[float], misses: list[float]) -> list[int]:
    """The tips through which the strands are left, in order, on the cheapest way."""
    tips = np.arange(len(closing))
    strand, other = tips // 2, tips ^ 1
    cost = np.full((1 << len(tips) // 2, len(tips)), np.inf)
    before = np.full(cost.shape, -1)
    # A strand is entered through one tip and left through the other.
    cost[1 << strand, tips] = np.asarray(opening)[other]
    onward = between[:, other]
    for used in range(1, len(cost)):
        prices = cost[used][:, None] + onward
        leave = tips[(used >> strand & 1) == 0]
        last = prices[:, leave].argmin(axis=0)
        state = used | 1 << strand[leave]
        cost[state, leave], before[state, leave] = prices[last, leave], last
    whole = cost + closing + np.asarray(misses)[:, None]
    used, tip = map(int, np.unravel_index(whole.argmin(), whole.shape))
    exits = [tip]
    while before[used, tip] >= 0:
        used, tip = used & ~(1 << tip // 2), int(before[used, tip])
        exits.append(tip)
    return exits[::-1]


def _unit(vector: Floats) -> Floats:
    unit: Floats = vector / max(float(np.linalg.norm(vector)), 1e-12)
    return unit
