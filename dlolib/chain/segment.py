"""Which pixels are rope: line 2 of Algorithm 1, `Binarize`."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from dlolib.captures.base import Frame, Image, Mask
from dlolib.chain.settings import ChainSettings
from dlolib.errors import ChainError
from dlolib.types import CaptureIndex

SMALLEST_PX = 20
SHADE, PLATEAU = 0.25, 0.75
THICK = 1.7


def rope_mask(frame: Frame, index: CaptureIndex, settings: ChainSettings) -> Mask:
    """The rope's pixels, shape (H, W).

    From outside where the capture has masks, by colour where it names the rope's colour in OpenCV's HSV,
    else by brightness, as in the paper: a white rope before black. Specks go, and so does whatever is
    far thicker than the rope at its distance (a gripper's shine, a board), where the diameter is known.

    Raises:
        ChainError: nothing in the frame looks like a rope.
    """
    if frame.mask is not None:
        mask = frame.mask
    elif frame.color is None:
        raise ChainError("has no color image", file=frame.file, mend="give color, or a mask")
    elif index.rope_color_hsv is not None:
        low, high = index.rope_color_hsv
        hsv = cv2.cvtColor(frame.color, cv2.COLOR_RGB2HSV)
        mask = np.asarray(cv2.inRange(hsv, np.array(low), np.array(high)) > 0)
    else:
        mask = _bright(frame.color, frame, settings)
    return without_specks(_without_blocks(mask, frame, index))


def _bright(color: Image, frame: Frame, settings: ChainSettings) -> Mask:
    grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    if settings.threshold is not None:
        return np.asarray(grey >= settings.threshold, dtype=np.bool_)
    level, binary = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    sure = np.asarray(binary > 0, dtype=np.bool_)
    contrast = float(grey[sure].mean() - grey[~sure].mean()) if sure.any() and not sure.all() else 0.0
    if contrast < settings.min_contrast:
        raise ChainError(
            f"no rope: the bright part is only {contrast:.0f} grey levels above the rest (level {level:.0f})",
            file=frame.file,
            place=f"frame {frame.frame}",
            mend="remove the frame, or set chain.threshold or rope_color_hsv",
        )
    # Light from one side leaves the other side of the rope dark: what is connected may be much darker.
    dark = float(np.median(grey[~sure]))
    lowest = dark + SHADE * (float(np.median(grey[sure])) - dark)
    count, labels = cv2.connectedComponents((grey >= lowest).astype(np.uint8), connectivity=8)
    rope = np.zeros(count, dtype=np.bool_)
    rope[labels[sure]] = True
    rope[0] = False
    return np.asarray(rope[labels], dtype=np.bool_)


def grey_levels(frame: Frame, index: CaptureIndex) -> Image | None:
    """Brightness (H, W) where it tells rope from background; None with a mask or a colour from outside."""
    if frame.color is None or frame.mask is not None or index.rope_color_hsv is not None:
        return None
    return np.asarray(cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def coverage(frame: Frame, index: CaptureIndex, mask: Mask) -> NDArray[np.float32]:
    """How much of each pixel the rope covers, shape (H, W), 0 to 1; 1 on the mask where colour says nothing.

    A pixel on the outline is a mixture of rope and background. How bright the rope is there, its
    neighbour further in tells: so the lit side counts no more than the side in the shade.
    """
    covered = mask.astype(np.float32)
    grey = grey_levels(frame, index)
    if grey is None or mask.all():
        return covered
    dark = float(np.median(grey[~mask]))
    inner = cv2.dilate(grey, np.ones((3, 3), np.uint8))[mask].astype(np.float32)
    share = (grey[mask] - dark) / np.maximum(PLATEAU * (inner - dark), 1)
    covered[mask] = np.clip(share, 0, 1)
    return covered


def _without_blocks(mask: Mask, frame: Frame, index: CaptureIndex) -> Mask:
    """Take away what is thicker than a rope of the known diameter would look."""
    focal, diameter = index.camera.fx, index.rope.diameter_m
    if diameter is None or focal is None or frame.depth_m is None:
        return mask
    depth = frame.depth_m[mask & (frame.depth_m > 0)]
    if len(depth) == 0:
        return mask
    widest = int(np.ceil(THICK * diameter * focal / float(np.median(depth)))) + 1
    rope = mask.astype(np.uint8)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (widest, widest))
    blocks = cv2.erode(rope, kernel)
    if not blocks.any():
        return mask
    grown = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (widest + 2, widest + 2))
    return np.asarray(mask & (cv2.dilate(blocks, grown) == 0), dtype=np.bool_)


def without_specks(mask: Mask) -> Mask:
    """Keep the connected parts of a mask (H, W) that have 20 pixels or more."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    large = np.zeros(count, dtype=np.bool_)
    large[1:] = stats[1:, cv2.CC_STAT_AREA] >= SMALLEST_PX
    return np.asarray(large[labels], dtype=np.bool_)
