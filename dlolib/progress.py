"""Progress on standard error: a bar with an estimate on a terminal, a line now and then in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

Item = TypeVar("Item")
LOG_INTERVAL_S = 10.0


def track(items: Iterable[Item], what: str, total: int | None = None) -> Iterator[Item]:
    """Yield the items while showing how far they are; `what` is the label."""
    count = total if total is not None else len(items)  # type: ignore[arg-type]
    if not sys.stderr.isatty():
        yield from _logged(items, what, count)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        yield from bar.track(items, total=count, description=what)


def _logged(items: Iterable[Item], what: str, count: int) -> Iterator[Item]:
    began = said = time.monotonic()
    for done, item in enumerate(items):
        now = time.monotonic()
        if now - said > LOG_INTERVAL_S and done:
            left = (now - began) / done * (count - done)
            print(f"{what}: {done}/{count}, about {left:.0f} s left", file=sys.stderr, flush=True)
            said = now
        yield item
