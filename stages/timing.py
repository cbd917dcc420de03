"""What `make bench` measures with: a figure with how it was made, and jobs timed in turn."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

REPEATS = 7


@dataclass(frozen=True)
class Figure:
    """A figure of the table: null where it could not be measured."""

    value: float | None
    how: str


def in_turn(jobs: list[Callable[[], Any]], repeats: int = REPEATS) -> list[float]:
    """The best time of each job [s], all of them run in turn; once before, for what is compiled."""
    best = [np.inf] * len(jobs)
    for number in range(repeats + 1):
        for k, job in enumerate(jobs):
            begin = time.perf_counter()
            job()
            if number:
                best[k] = min(best[k], time.perf_counter() - begin)
    return [float(value) for value in best]


def us(seconds: float, steps: int) -> str:
    """Microseconds a step."""
    return f"{1e6 * seconds / steps:.3g} µs"
