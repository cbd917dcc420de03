"""What a pinhole camera saw of the rope, and the way between its pixels and space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlolib.captures.base import Depth, Mask
from dlolib.types import Floats


@dataclass(frozen=True)
class View:
    """What a pinhole camera saw of the rope: its mask, the share of each pixel that is rope, its depth [m].

    All three are of shape (H, W); so are the levels in which the rope stands out,
    linear in the light, infinite where saturated; None where light does not tell rope from the rest.
    """

    mask: Mask
    coverage: NDArray[np.float32]
    depth_m: Depth
    fx: float
    fy: float
    cx: float
    cy: float
    levels: NDArray[np.float32] | None = None

    @property
    def focal(self) -> float:
        """The mean focal length [px]."""
        return float(np.sqrt(self.fx * self.fy))

    def space(self, pixel: Floats, depth_m: Floats) -> Floats:
        """Points [m] (N, 3) in camera axes of pixels (N, 2) at depths (N,)."""
        x = (pixel[:, 0] - self.cx) / self.fx * depth_m
        y = (pixel[:, 1] - self.cy) / self.fy * depth_m
        return np.stack([x, y, depth_m], axis=-1)

    def pixel(self, points_m: Floats) -> Floats:
        """Pixels (N, 2), column and row, of points [m] (N, 3) in camera axes."""
        flat = points_m[:, :2] / points_m[:, 2:]
        return np.stack([flat[:, 0] * self.fx + self.cx, flat[:, 1] * self.fy + self.cy], axis=-1)

    def pitch(self) -> float:
        """How much of the rope one pixel shows [m], at its typical depth."""
        depth = self.depth_m[self.mask & (self.depth_m > 0)]
        return float(np.median(depth)) / self.focal if len(depth) else 0.0
