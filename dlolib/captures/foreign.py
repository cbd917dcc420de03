"""What a recording made elsewhere offers, whatever its format."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from dlolib.captures.base import Image
from dlolib.formats import Given
from dlolib.types import Floats, Motion

Units = NDArray[np.uint16]


@dataclass(frozen=True)
class Shot:
    """One moment as the capture will hold it. Either color and depth are there, or a cloud's file.

    color (H, W, 3) 8-bit RGB; depth (H, W) in units of 1 / depth_scale, 0 where there is no reading, both
    as one pinhole camera without distortion sees them; `file` and `place` say where it comes from.
    """

    t_s: float
    file: Path
    place: str | None = None
    color: Image | None = None
    depth: Units | None = None
    cloud: Path | None = None


@dataclass(frozen=True)
class Asked:
    """What a person says beside the recording: the scene, and which topic has which role."""

    given: Given
    topics: Mapping[str, str]


class Foreign(Protocol):
    """A format of recordings made elsewhere; an instance is a recording that was opened."""

    kind: ClassVar[str]
    """What people call it."""

    roles: ClassVar[tuple[str, ...]]
    """What `--topic ROLE=NAME` may name; empty where there are no topics."""

    @classmethod
    def matches(cls, path: Path) -> bool:
        """Whether `path` looks like this format; its content may be damaged all the same."""
        ...

    @classmethod
    def open(cls, path: Path, asked: Asked) -> Self:
        """Read what comes before the frames; a `FormatError` names what cannot be used."""
        ...

    @property
    def count(self) -> int:
        """How many shots there are."""
        ...

    @property
    def optics(self) -> Mapping[str, float]:
        """Those of width, height, fx, fy, cx, cy [px] and depth_scale [1/m] that the recording says."""
        ...

    @property
    def world_from_camera(self) -> Floats | None:
        """The camera's pose (4, 4), or None where the recording does not say it."""
        ...

    @property
    def motion(self) -> Motion | None:
        """How the ends moved, or None where the recording does not say it."""
        ...

    @property
    def hint(self) -> str:
        """Which topics could give a pose or a motion, for a question; empty where none could."""
        ...

    @property
    def doubts(self) -> list[str]:
        """What is odd and yet may be meant, a line each."""
        ...

    def shots(self) -> Iterator[Shot]:
        """Read one shot after the other, in the order of time."""
        ...


class FramesAlone:
    """What a recording answers that holds frames and nothing of robots: the base of most formats."""

    roles: ClassVar[tuple[str, ...]] = ()

    @property
    def world_from_camera(self) -> Floats | None:
        """Not recorded."""
        return None

    @property
    def motion(self) -> Motion | None:
        """Not recorded."""
        return None

    @property
    def hint(self) -> str:
        """There are no topics."""
        return ""

    @property
    def doubts(self) -> list[str]:
        """None."""
        return []
