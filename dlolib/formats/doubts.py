"""What is odd about a motion and yet may be meant: a warning says so."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from dlolib.errors import FormatError
from dlolib.types import Floats, Motion

LOG = logging.getLogger(__name__)
# What is odd, in which column, and the mend.
Doubt = tuple[str, str, str]
# Beyond a motion's first and last row its poses hold; what is more than a part of a frame is worth a word.
BEYOND_FRAMES = 0.5
# An end that stands still fits every clock.
MOVES_M = 1e-3
# Nobody turns an end by almost a whole turn from one row to the next: the same pose has two signs.
ALMOST_WHOLE_RAD = 6.0
# A motion that lasts so many times as long as its frames counts its time in another unit.
ANOTHER_UNIT = 100
# Rows so many times further apart than most, while an end moves, have others lost between them.
LOST_ROWS = 10


def motion_doubts(motion: Motion, t_s: Floats, file: Path) -> list[str]:
    """What is odd about a motion seen in frames at times (F,) [s], a line each."""
    some = [*_turned_whole(motion), *(_beyond(motion, t_s) + _lost(motion, t_s) if moves(motion) else [])]
    return [
        str(FormatError(problem, file=file, place=f"column {column}", mend=mend))
        for problem, column, mend in some
    ]


def _beyond(motion: Motion, t_s: Floats) -> list[Doubt]:
    """Frames before or after the rows of a motion, where its first or last pose holds; too few of them."""
    times = np.unique(t_s)
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    found = []
    for late, what in (
        (motion.t_s[0] - times[0], "begins {:.3g} s after the first frame"),
        (times[-1] - motion.t_s[-1], "ends {:.3g} s before the last frame"),
    ):
        if late > BEYOND_FRAMES * step:
            problem = f"{what.format(late)}, and its pose there is taken to hold"
            found.append((problem, "t_s", "check that it is whole and that both clocks agree"))
    lasts_s, seen_s = float(np.ptp(motion.t_s)), float(np.ptp(times))
    if 0 < ANOTHER_UNIT * seen_s < lasts_s:
        problem = f"goes on for {lasts_s:.4g} s, and the frames for {seen_s:.4g} s"
        found.append((problem, "t_s", "give seconds: divide milliseconds by 1000"))
    return found


def _lost(motion: Motion, t_s: Floats) -> list[Doubt]:
    """The longest stretch without rows in which frames were seen and an end went on."""
    between = np.diff(motion.t_s)
    ways = [np.linalg.norm(np.diff(place, axis=0), axis=1) for place in (motion.start_m, motion.end_m)]
    seen = np.diff(np.searchsorted(np.unique(t_s), motion.t_s)) > 0
    long = (between > LOST_ROWS * np.median(between)) & (np.nan_to_num(ways).max(axis=0) > MOVES_M) & seen
    if not long.any():
        return []
    row = int(np.argmax(np.where(long, between, 0.0)))
    begin, end = motion.t_s[row], motion.t_s[row + 1]
    problem = f"has no row between {begin:.12g} and {end:.12g} s, and the ends are taken to go straight there"
    return [(problem, "t_s", "check that none was lost")]


def _turned_whole(motion: Motion) -> list[Doubt]:
    """The first rows between which an end turns the long way round though it hardly turns."""
    found = []
    for end, q in (("start", motion.start_q), ("end", motion.end_q)):
        turn = 2 * np.arccos(np.clip(np.sum(q[1:] * q[:-1], axis=1), -1, 1))
        whole = np.flatnonzero(np.nan_to_num(turn) > ALMOST_WHOLE_RAD)
        if len(whole):
            first = whole[0]
            problem = (
                f"the signs say that the {end} turns by {np.degrees(turn[first]):.4g}° between "
                f"{motion.t_s[first]:.12g} and {motion.t_s[first + 1]:.12g} s"
            )
            more = f", as in {len(whole) - 1} other places" if len(whole) > 1 else ""
            found.append((problem + more, f"{end}_qw", "turn the signs, if it does not"))
    return found


def say(lines: Iterable[str]) -> None:
    """Say doubts as warnings; by default Python's logging writes them to standard error."""
    for line in lines:
        LOG.warning("warning: %s", line)


def moves(motion: Motion) -> bool:
    """Whether a held end moves at all."""
    held = [place for place in (motion.start_m, motion.end_m) if not np.isnan(place).all()]
    return any(float(np.ptp(place, axis=0).max()) > MOVES_M for place in held)
