"""The chains of many frames, found on all cores: the same as one after the other, bit for bit."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field
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
Guesses = list[FrameChain | None]


@dataclass
class Found:
    """The chains of the frames that show a rope, in their order, and what was said of the others."""

    chains: list[FrameChain] = field(default_factory=list)
    refused: list[ChainError] = field(default_factory=list)
    last: FrameChain | None = None
    """The last chain that counts: from it the next goes on."""

    def see(self, frame: Frame, index: CaptureIndex, settings: ChainSettings) -> None:
        """Find the chain of the next frame."""
        try:
            self.take(chain_frame(frame, index, settings, self.last))
        except ChainError as error:
            self.refused.append(error)

    def take(self, chain: FrameChain) -> None:
        """The next frame's chain is this one."""
        self.chains.append(chain)
        self.last = following(self.last, chain)


@dataclass(frozen=True)
class Waiting:
    """A stretch whose chains another process guesses, as if `before` were the last that counts before the
    first of so many frames that are looked at again, and then the stretch."""

    stretch: Stretch
    before: FrameChain | None
    again: int
    guesses: Future[Guesses]


def chains_of(frames: Iterable[Frame], index: CaptureIndex, settings: ChainSettings) -> Found:
    """The chain of every frame of a capture, each found with the last that counts at hand.

    Raises:
        FormatError: a frame cannot be read.
    """
    found = Found()
    cores = cpu_count()
    if cores == 1 or len(index.frame) < MANY or multiprocessing.parent_process() is not None:
        for frame in frames:
            found.see(frame, index, settings)
        return found
    # A process of loky's does not run the program's own file again, as others would.
    with ProcessPoolExecutor(cores, initializer=cv2.setNumThreads, initargs=(1,), env=ONE_THREAD) as pool:
        waiting: deque[Waiting] = deque()
        last: Stretch = []
        for stretch in _stretches(frames):
            guesses = pool.submit(_guessed, [*last, *stretch], found.last, index, settings)
            waiting.append(Waiting(stretch, found.last, len(last), guesses))
            last = stretch[-1:]
            if len(waiting) > AHEAD * cores:
                _settle(waiting.popleft(), found, index, settings)
        while waiting:
            _settle(waiting.popleft(), found, index, settings)
    return found


def following(before: FrameChain | None, chain: FrameChain) -> FrameChain | None:
    """What the next frame goes on from: a chain for which something else was taken tells nothing."""
    return chain if chain.counts else before


def _stretches(frames: Iterable[Frame]) -> Iterator[Stretch]:
    each = iter(frames)
    while stretch := list(islice(each, STRETCH)):
        yield stretch


def _guessed(
    frames: Stretch, before: FrameChain | None, index: CaptureIndex, settings: ChainSettings
) -> Guesses:
    """Chains of frames that follow each other, as if `before` were the chain before them; None where one
    shows no rope. With the right chain before it, it may show one: who asked will see."""
    found: Guesses = []
    for frame in frames:
        try:
            chain = chain_frame(frame, index, settings, before)
        except ChainError:
            found.append(None)
        else:
            found.append(chain)
            before = following(before, chain)
    return found


def _settle(waited: Waiting, found: Found, index: CaptureIndex, settings: ChainSettings) -> None:
    """Add the chains of a stretch to what was found: guesses hold that were made after the right chain."""
    made, assumed = waited.guesses.result(), waited.before
    for guess in made[: waited.again]:
        assumed = assumed if guess is None else following(assumed, guess)
    for frame, guess in zip(waited.stretch, made[waited.again :], strict=True):
        if guess is not None and _same(found.last, assumed):
            found.take(guess)
        else:
            found.see(frame, index, settings)
        assumed = assumed if guess is None else following(assumed, guess)


def _same(one: FrameChain | None, other: FrameChain | None) -> bool:
    """Whether what follows the one would follow the other: its line is all of a chain that is used then."""
    if one is None or other is None:
        return one is other
    return np.array_equal(one.line_m, other.line_m)
