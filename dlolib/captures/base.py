"""What every source of frames offers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dlolib.types import CaptureIndex

Image = NDArray[np.uint8]
Depth = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Frame:
    """What a camera saw at one time. Either color and depth are there, or a cloud.

    color (H, W, 3) 8-bit RGB; depth_m (H, W) [m] along the viewing axis, 0 where there is no reading;
    cloud_m (N, 3) [m] in camera axes (x right, y down, z forward); mask (H, W), True on the rope, where
    the segmentation comes from outside. `file` is the one to name when something is wrong with it.
    """

    frame: int
    t_s: float
    file: Path
    color: Image | None = None
    depth_m: Depth | None = None
    cloud_m: NDArray[np.float64] | None = None
    mask: Mask | None = None


class Source(Protocol):
    """A capture that can be read frame by frame, in the order of time, as often as wanted."""

    @property
    def index(self) -> CaptureIndex:
        """What the capture says about itself."""
        ...

    def frames(self) -> Iterator[Frame]:
        """Read one frame after the other; a `FormatError` names the file that cannot be used."""
        ...
