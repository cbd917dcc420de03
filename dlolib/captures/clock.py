"""Which colour image belongs to which depth image, by their times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np

from dlolib.errors import FormatError
from dlolib.types import Floats

Item = TypeVar("Item")
# That of the TUM benchmark's own association.
WITHIN_S = 0.02
Pairs = list[tuple[int, int]]


def falls(before_s: float, after_s: float) -> str | None:
    """What is wrong with two times [s] that follow one another; None where the second is later."""
    if after_s > before_s:
        return None
    if after_s == before_s:
        return f"time stands still at {after_s!r} s"
    return f"time goes back from {before_s!r} to {after_s!r} s"


def check_clock(t_s: Floats, path: Path, what: str) -> None:
    """Refuse times (N,) [s] that do not rise, or none."""
    if not len(t_s):
        raise FormatError("holds no image", file=path, place=what, mend="record it again")
    back = np.flatnonzero(np.diff(t_s) <= 0)
    if back.size:
        row = int(back[0]) + 1
        problem = falls(float(t_s[row - 1]), float(t_s[row])) or ""
        place = f"{what}, image {row}"
        raise FormatError(problem, file=path, place=place, mend="mend the clock or the order")


def paired(depth_s: Floats, color_s: Floats, path: Path, within_s: float = WITHIN_S) -> Pairs:
    """The colour image nearest in time to each depth image, as (depth, color), both rising.

    A depth image without a colour image within `within_s` [s] is left out, and so is the further one of
    two that share a colour image.

    Raises:
        FormatError: no two images belong together.
    """
    after = np.clip(np.searchsorted(color_s, depth_s), 1, max(len(color_s) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(color_s) - 1)
    nearest = np.where(np.abs(color_s[after] - depth_s) < np.abs(color_s[before] - depth_s), after, before)
    apart = np.abs(color_s[nearest] - depth_s)
    best: dict[int, int] = {}
    for row in np.flatnonzero(apart <= within_s).tolist():
        color = int(nearest[row])
        if color not in best or apart[row] < apart[best[color]]:
            best[color] = row
    if not best:
        problem = f"the nearest color and depth images are {float(apart.min()):.4g} s apart"
        raise FormatError(problem, file=path, mend="bring both to one clock, in seconds")
    return sorted((depth, color) for color, depth in best.items())


def times_of(pairs: Pairs, color_s: Floats) -> dict[int, float]:
    """When each pair was taken [s], by the number of its depth image: at its colour image's time.

    Where the rope lies across the line of sight, to a tenth of a pixel, the colour image tells.
    """
    return {depth: float(color_s[color]) for depth, color in pairs}


def together(items: Iterable[tuple[str, int, Item]], pairs: Pairs) -> Iterator[tuple[int, Item, Item]]:
    """From a mixed stream of ("depth" | "color", its number, item): number, depth and color of each pair.

    Only what still waits for its partner is kept in memory.
    """
    partner = {("depth", depth): ("color", color) for depth, color in pairs}
    partner |= {other: one for one, other in partner.items()}
    waiting: dict[tuple[str, int], Item] = {}
    for role, number, item in items:
        other = partner.get((role, number))
        if other is None:
            continue
        if other not in waiting:
            waiting[role, number] = item
        elif role == "depth":
            yield number, item, waiting.pop(other)
        else:
            yield other[1], waiting.pop(other), item
