"""Which stretch follows which: the visible stretches of a rope, put in order from its start to its end."""

from __future__ import annotations

import numpy as np

from dlolib.chain.anchor import Anchor
from dlolib.chain.lift import Strand
from dlolib.types import Floats

MOST_STRANDS = 12
TURN_M = 0.05
SKIP = 2.0
# By so much a rope may be longer than it is said to be; what is longer still is not that rope alone.
LONGER = 0.1
DIRECTION_SAMPLES = 10
BLUR_M = 0.004
NEAR_BEFORE_M, AGAINST_M = 0.03, 0.03


def in_order(
    strands: list[Strand],
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
    a strand against it costs a little. All are in the same axes.
    """
    strands = _longest(strands)[:MOST_STRANDS]
    if not strands:
        return []
    places, outward = _tips(strands)
    count = len(strands)
    between = np.array([[_link(places, outward, a, b) for b in range(2 * count)] for a in range(2 * count)])
    opening = [
        0.0 if start is None else _price(start.place_m, start.tangent, places[e], -outward[e])
        for e in range(2 * count)
    ]
    closing = [
        0.0 if end is None else _price(places[e], outward[e], end.place_m, end.tangent)
        for e in range(2 * count)
    ]
    # Of a strand that is left through a tip, whichever way the rope came to it.
    against = _against(places, before_m)
    closing = [price + wrong for price, wrong in zip(closing, against, strict=True)]
    between += against[:, None]
    exits = _held_karp(between, opening, closing, _misses([length(strand) for strand in strands], length_m))
    return [strands[e // 2] if e % 2 else strands[e // 2].turned() for e in exits]


def unordered_m(strands: list[Strand]) -> float:
    """Length [m] of the strands that are more than can be put in order."""
    return sum(length(strand) for strand in _longest(strands)[MOST_STRANDS:])


def _longest(strands: list[Strand]) -> list[Strand]:
    return sorted(strands, key=length, reverse=True)


def length(strand: Strand) -> float:
    """Length [m] of a strand's polyline."""
    return float(np.linalg.norm(np.diff(strand.points_m, axis=0), axis=1).sum())


def _tips(strands: list[Strand]) -> tuple[Floats, Floats]:
    """Places (2S, 3) and outward directions (2S, 3) of all tips: 2k the first, 2k + 1 the last of k."""
    places, outward = [], []
    for strand in strands:
        back = min(DIRECTION_SAMPLES, len(strand.points_m) - 1)
        for tip, inner in ((0, back), (-1, -1 - back)):
            places.append(strand.points_m[tip])
            outward.append(_unit(strand.points_m[tip] - strand.points_m[inner]))
    return np.array(places), np.array(outward)


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


def _link(places: Floats, outward: Floats, leave: int, enter: int) -> float:
    if leave // 2 == enter // 2:
        return np.inf
    return _price(places[leave], outward[leave], places[enter], -outward[enter])


def _price(here: Floats, heading: Floats, there: Floats, arriving: Floats) -> float:
    """Price [m] of going from one place and direction to another: the way, and the turning on it."""
    gap = there - here
    way = _unit(gap + BLUR_M * (heading + arriving))
    turning = 2.0 - float(heading @ way) - float(way @ arriving)
    return float(np.linalg.norm(gap)) + TURN_M * turning


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
