"""What is odd about a motion and yet may be meant: a warning says so."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from dlolib.errors import FormatError
from dlolib.types import Floats, Motion

LOG = logging.getLogger(__name__)
# Beyond a motion's first and last row its poses hold; what is more than a part of a frame is worth a word.
BEYOND_FRAMES = 0.5
# An end that stands still fits every clock.
MOVES_M = 1e-3


def motion_doubts(motion: Motion, t_s: Floats, file: Path) -> list[str]:
    """Frames at times (F,) [s] before or after the rows of a motion, where its first or last pose holds."""
    if not moves(motion):
        return []
    times = np.unique(t_s)
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    found = []
    for late, what in (
        (motion.t_s[0] - times[0], "begins {:.3g} s after the first frame"),
        (times[-1] - motion.t_s[-1], "ends {:.3g} s before the last frame"),
    ):
        if late > BEYOND_FRAMES * step:
            problem = f"{what.format(late)}, and its pose there is taken to hold"
            mend = "check that it is whole and that both clocks agree"
            found.append(str(FormatError(problem, file=file, place="column t_s", mend=mend)))
    return found


def say(lines: Iterable[str]) -> None:
    """Say doubts as warnings; by default Python's logging writes them to standard error."""
    for line in lines:
        LOG.warning("warning: %s", line)


def moves(motion: Motion) -> bool:
    """Whether a held end moves at all."""
    held = [place for place in (motion.start_m, motion.end_m) if not np.isnan(place).all()]
    return any(float(np.ptp(place, axis=0).max()) > MOVES_M for place in held)
