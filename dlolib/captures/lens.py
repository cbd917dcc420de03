"""A lens' distortion, taken out: a capture's camera is a pinhole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from dlolib.captures.base import Image
from dlolib.captures.foreign import Units
from dlolib.types import Floats

# Where a camera's matrix has what.
PINHOLE = {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2)}


@dataclass(frozen=True)
class Lens:
    """A camera's matrix (3, 3) [px] and OpenCV's distortion coefficients (4, 5 or 8).

    pinhole (3, 3) [px]: the matrix of what comes out; None where it is the camera's own.
    """

    matrix: Floats
    distortion: Floats
    pinhole: Floats | None = None

    @property
    def optics(self) -> dict[str, float]:
        """fx, fy, cx, cy [px] of the pinhole."""
        return {name: float(self.straight[place]) for name, place in PINHOLE.items()}

    def color(self, image: Image) -> Image:
        """The image (H, W, 3) as the pinhole sees it, mixed between neighbours; untouched where straight."""
        if self._leaves_alone:
            return image
        return np.asarray(cv2.remap(image, *self._maps(image.shape), cv2.INTER_LINEAR), dtype=np.uint8)

    def depth(self, image: Units) -> Units:
        """The depth (H, W) likewise, from the nearest pixel: a mean of near and far is a point in the air."""
        if self._leaves_alone:
            return image
        return np.asarray(cv2.remap(image, *self._maps(image.shape), cv2.INTER_NEAREST), dtype=np.uint16)

    @property
    def straight(self) -> Floats:
        """The pinhole's matrix (3, 3) [px]."""
        return self.matrix if self.pinhole is None else self.pinhole

    @property
    def _leaves_alone(self) -> bool:
        return not self.distortion.any() and np.array_equal(self.straight, self.matrix)

    def _maps(self, shape: tuple[int, ...]) -> tuple[Any, Any]:
        size = (shape[1], shape[0])
        maps = cv2.initUndistortRectifyMap(
            self.matrix, self.distortion, None, self.straight, size, cv2.CV_32FC1
        )
        return maps[0], maps[1]
