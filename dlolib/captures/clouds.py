"""Segmented point clouds as PLY files, numbered, in a folder of their own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Self

from dlolib.captures.foreign import Asked, FramesAlone, Shot
from dlolib.captures.redwood import at_rate, numbered, unnumbered


@dataclass(frozen=True)
class Clouds(FramesAlone):
    """Points [m] of the rope alone, in camera axes; times from the number and the rate."""

    kind: ClassVar[str] = "folder of segmented clouds (000000.ply, ...)"
    optics: ClassVar[Mapping[str, float]] = {}

    files: tuple[Path, ...]
    t_s: tuple[float, ...]
    odd: list[str]

    @classmethod
    def matches(cls, path: Path) -> bool:
        """Whether PLY files lie in the folder."""
        return path.is_dir() and any(path.glob("*.ply"))

    @classmethod
    def open(cls, path: Path, asked: Asked) -> Self:
        """Order the clouds by number."""
        found = numbered(path, (".ply",))
        rate, where = asked.given.rate_hz, asked.given.file
        times = tuple(at_rate(number, rate, where, found[number]) for number in sorted(found))
        files = tuple(found[number] for number in sorted(found))
        return cls(files, times, unnumbered(path, (".ply",)))

    @property
    def count(self) -> int:
        """How many clouds there are."""
        return len(self.files)

    @property
    def doubts(self) -> list[str]:
        """What is left out: clouds without a number."""
        return self.odd

    def shots(self) -> Iterator[Shot]:
        """One cloud after the other."""
        for path, t_s in zip(self.files, self.t_s, strict=True):
            yield Shot(t_s, path, cloud=path)
