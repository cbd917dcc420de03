"""The chains of many frames, found on all cores: the same as one after the other, bit for bit."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from itertools import islice

import cv2
import numpy as np
from loky import ProcessPoolExecutor, cpu_count

from dlolib.captures.base import Frame
from dlolib.chain.frame import FrameChain, chain_frame
from dlolib.chain.settings import ChainSettings
from dlolib.errors import ChainError
from dlolib.types import CaptureIndex

# Processes take seconds to start: fewer frames are done by this one in that time.
MANY = 100
# Frames at a time, one of which is looked at twice; and how many such stretches wait, for each process.
STRETCH, AHEAD = 24, 1
# Each process has a core: threads of its own would take another's.
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

Stretch = list[Frame]
Guesses = list[FrameChain]


def chains_of(frames: Iterable[Frame], index: CaptureIndex, settings: ChainSettings) -> list[FrameChain]:
    """The chain of every frame of a capture, each found with the one before it at hand.

    Raises:
        ChainError: a frame shows no rope.
        FormatError: a frame cannot be read.
    """
    found: list[FrameChain] = []
    cores = cpu_count()
    if cores == 1 or len(index.frame) < MANY or multiprocessing.parent_process() is not None:
        for frame in frames:
            found.append(chain_frame(frame, index, settings, found[-1] if found else None))
        return found
    # A process of loky's does not run the program's own file again, as others would.
    with ProcessPoolExecutor(cores, initializer=cv2.setNumThreads, initargs=(1,), env=ONE_THREAD) as pool:
        waiting: deque[tuple[Stretch, Future[Guesses]]] = deque()
        last: Stretch = []
        for stretch in _stretches(frames):
            before = found[-1] if found else None
            waiting.append((stretch, pool.submit(_guessed, [*last, *stretch], before, index, settings)))
            last = stretch[-1:]
            if len(waiting) > AHEAD * cores:
                _settle(*waiting.popleft(), found, index, settings)
        while waiting:
            _settle(*waiting.popleft(), found, index, settings)
    return found


def _stretches(frames: Iterable[Frame]) -> Iterator[Stretch]:
    each = iter(frames)
    while stretch := list(islice(each, STRETCH)):
        yield stretch


def _guessed(
    frames: Stretch, before: FrameChain | None, index: CaptureIndex, settings: ChainSettings
) -> Guesses:
    """Chains of frames that follow each other, as if `before` were the chain before them; up to one that
    shows no rope."""
    found: Guesses = []
    try:
        for frame in frames:
            before = chain_frame(frame, index, settings, before)
            found.append(before)
    except ChainError:
        # With the right chain before it, it may show one: who asked will see.
        pass
    return found


def _settle(
    stretch: Stretch,
    guesses: Future[Guesses],
    found: list[FrameChain],
    index: CaptureIndex,
    settings: ChainSettings,
) -> None:
    """Append the chains of a stretch to what was found: guesses hold that were made after the right chain."""
    made = iter(guesses.result())
    assumed = next(made, None) if found else None
    for frame in stretch:
        before, guess = found[-1] if found else None, next(made, None)
        right = guess is not None and _same(before, assumed)
        found.append(guess if guess and right else chain_frame(frame, index, settings, before))
        assumed = guess


def _same(one: FrameChain | None, other: FrameChain | None) -> bool:
    """Whether what follows the one would follow the other: its line is all of a chain that is used then."""
    if one is None or other is None:
        return one is other
    return np.array_equal(one.line_m, other.line_m)
