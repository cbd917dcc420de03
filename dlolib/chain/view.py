"""What a pinhole camera saw of the rope, and the way between its pixels and space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dlolib.captures.base import Depth, Mask
from dlolib.types import Floats

# A reading further from so many neighbours than this many deviations is none.
NEIGHBOURS, OUTLIER_RATIO = 12, 3.0


@dataclass(frozen=True)
class View:
    """What a pinhole camera saw of the rope: its mask, the share of each pixel that is rope, its depth [m].

    All three are of shape (H, W); so are the levels in which the rope stands out,
    linear in the light, infinite, of either sign, where saturated; None where light does not tell rope from
    the rest.
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

    @cached_property
    def pixels(self) -> Floats:
        """The rope's pixels (N, 2), column and row."""
        return places_of(self.mask)

    @cached_property
    def shares(self) -> Floats:
        """How much of each of the rope's pixels is rope (N,)."""
        return self._at_pixels(self.coverage)

    @cached_property
    def cloud_m(self) -> Floats:
        """The readings at the rope's pixels that count (`read`) as points (M, 3) in camera axes."""
        return self.space(self.pixels[self.read], self._at_pixels(self.depth_m)[self.read])

    @cached_property
    def read(self) -> NDArray[np.bool_]:
        """Which of the rope's pixels (N,) have a depth that is no statistical outlier.

        The slowest of all that is known of a view, and asked for late: `chain_frame` has it found meanwhile.
        """
        depth_m = self._at_pixels(self.depth_m)
        read = depth_m > 0
        cloud = self.space(self.pixels[read], depth_m[read])
        if len(cloud) > NEIGHBOURS:
            # As Open3D's `remove_statistical_outlier`, which takes thrice as long.
            near = np.asarray(cKDTree(cloud).query(cloud, k=NEIGHBOURS)[0]).mean(axis=1)
            read[read] = near < near.mean() + OUTLIER_RATIO * near.std(ddof=1)
        return read

    def _at_pixels(self, image: NDArray[np.float32]) -> Floats:
        """An image's values at the rope's pixels, (N,)."""
        return image.ravel()[np.flatnonzero(self.mask)].astype(np.float64)

    def space(self, pixel: Floats, depth_m: Floats) -> Floats:
        """Points [m] (N, 3) in camera axes of pixels (N, 2) at depths (N,)."""
        x = (pixel[:, 0] - self.cx) / self.fx * depth_m
        y = (pixel[:, 1] - self.cy) / self.fy * depth_m
        return np.stack([x, y, depth_m], axis=-1)

    def pixel(self, points_m: Floats) -> Floats:
        """Pixels (N, 2), column and row, of points [m] (N, 3) in camera axes."""
        flat = points_m[:, :2] / points_m[:, 2:]
        return np.stack([flat[:, 0] * self.fx + self.cx, flat[:, 1] * self.fy + self.cy], axis=-1)

    @cached_property
    def pitch(self) -> float:
        """How much of the rope one pixel shows [m], at its typical depth."""
        depth = self._at_pixels(self.depth_m)
        depth = depth[depth > 0]
        return float(np.median(depth)) / self.focal if len(depth) else 0.0


def places_of(mask: Mask) -> Floats:
    """Column and row [px] of each pixel of a mask (H, W), row by row: (N, 2).

    As `np.nonzero`, which takes fifteen times as long.
    """
    rows, columns = divmod(np.flatnonzero(mask), mask.shape[1])
    return np.stack([columns, rows], axis=-1).astype(np.float64)
