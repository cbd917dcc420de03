"""Jobs of a study, shared out among processes of which this one is the first."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from types import TracebackType
from typing import Any

from dlolib.diagnose.study import Study
from dlolib.progress import track

_STUDY: list[Study] = []


@contextmanager
def _unheard() -> Iterator[None]:
    """A process that is started here does not hear Ctrl-C until it is ready: it would print where it was."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _never_alone() -> None:
    """End with the first process, however that one ends: it may be killed in the middle of a job."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(1))
    first = multiprocessing.parent_process()
    assert first is not None, "this is the first process"

    def wait() -> None:
        first.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def _begin(packed: bytes) -> None:
    _STUDY[:] = [pickle.loads(packed)]


def _ready(function: Callable[[Study], Any]) -> None:
    function(_STUDY[0])


def _call(function: Callable[[Study, Any], Any], job: Any) -> Any:
    return function(_STUDY[0], job)


class Workers:
    """Runs jobs of the study that it was given last, in the same order whoever does them.

    A process of its own takes seconds to start and to compile: it starts with the first study. Others take
    jobs from the front, this one from the back, so that none waits for long.
    """

    def __init__(self, count: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._others = [ProcessPoolExecutor(1, context, _never_alone) for _ in range(count - 1)]
        self._begun: list[Future[None]] = []
        self._study: Study | None = None

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            # nobody waits for what they are at
            for process in multiprocessing.active_children():
                process.terminate()
        for pool in self._others:
            pool.shutdown(cancel_futures=True)

    def begin(self, study: Study, ready: Callable[[Study], Any] | None = None) -> None:
        """Go on with this study; the other processes do `ready` first, which compiles what they need."""
        self._study = study
        # packed here and now: a pool packs what it is given some time later, while this process works with
        # the study and what it keeps changes; that failed, unheard, and the study before went on there
        packed = pickle.dumps(study) if self._others else b""
        self._begun = []
        for pool in self._others:
            with _unheard():
                self._begun.append(pool.submit(_begin, packed))
            if ready is not None:
                pool.submit(_ready, ready)

    def __call__(self, function: Callable[[Study, Any], Any], jobs: Sequence[Any], what: str) -> list[Any]:
        """What the function makes of the study and each job."""
        assert self._study is not None, "jobs without a study"
        futures = [
            self._others[k % len(self._others)].submit(_call, function, job)
            for k, job in enumerate(jobs)
            if self._others
        ]
        found: list[Any] = [None] * len(jobs)
        for k in track(reversed(range(len(jobs))), what, len(jobs)):
            mine = not self._others or futures[k].cancel()
            if not mine:
                # where a job was done the study had begun, or failed to
                self._begun[k % len(self._others)].result()
            found[k] = function(self._study, jobs[k]) if mine else futures[k].result()
        return found


__all__ = ["Workers"]
