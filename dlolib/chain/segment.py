"""Which pixels are rope: line 2 of Algorithm 1, `Binarize`, and the other ways to tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dlolib.captures.base import Frame, Image, Mask
from dlolib.chain.cleaning import cleaned, window_of, without_blocks, without_obstacles
from dlolib.chain.contrast import background_mask, local_masks, rope_levels
from dlolib.chain.likely import likelihood, must_be, share_of_rope
from dlolib.chain.settings import ChainSettings
from dlolib.errors import ChainError
from dlolib.formats.capture import LAST_HUE
from dlolib.types import CaptureIndex

SHADE, PLATEAU = 0.25, 0.75
# What is dark is so in hundreds of thousands of pixels: every so many tell its median as well.
DARK_EVERY = 4

Levels = NDArray[np.float32]


@dataclass(frozen=True)
class Segmentation:
    """The rope's pixels, shape (H, W), and the levels (H, W) in which the rope stands out, as light adds up.

    levels is None where nothing but the mask is known, and infinite, of either sign, where a channel is
    saturated.
    """

    mask: Mask
    levels: Levels | None


def segment(frame: Frame, index: CaptureIndex, settings: ChainSettings) -> Segmentation:
    """Find the rope in a frame in the way that the settings choose.

    `threshold`: brightness, as in the paper, a white rope before black. `local`: whatever differs from what
    is around it and is as narrow as a rope. `color`: the capture's `rope_color_hsv`. `background`: what
    differs from the capture's images of the empty scene, in colour or by being nearer. `mask`: from outside.
    `auto` takes the first that the capture offers: mask, colour, background; else the threshold, and where
    what it finds cannot be the rope (a bright table, a pillar) or is not where its held ends are, the local
    difference, with the obstacles that are known taken out where that is likelier.

    Specks go, and so does whatever is far thicker than the rope at its distance (a gripper, a board), where
    the diameter is known.

    Raises:
        ChainError: nothing in the frame looks like a rope, or the capture lacks what the choice needs.
    """
    way = settings.segmentation if settings.segmentation != "auto" else _offered(frame, index)
    if way == "mask":
        if frame.mask is None:
            raise _lacking(frame, "has no mask", "add a column `mask` to frames.csv")
        return Segmentation(cleaned(frame.mask, frame, index), None)
    if frame.color is None and way != "background":
        raise ChainError("has no color image", file=frame.file, mend="give color, or a mask")
    if way == "color":
        if index.rope_color_hsv is None:
            raise _lacking(frame, "has no rope colour", "add `rope_color_hsv` to capture.json")
        mask = cleaned(_in_range(frame, index), frame, index)
        return Segmentation(mask, rope_levels(frame.color, mask))
    if way == "background":
        mask = cleaned(background_mask(frame, index, settings), frame, index)
        return Segmentation(mask, rope_levels(frame.color, mask))
    if way == "local":
        return _local(frame, index)
    if settings.segmentation == "threshold":
        return _threshold(frame, index, settings)
    return _either(frame, index, settings)


def _either(frame: Frame, index: CaptureIndex, settings: ChainSettings) -> Segmentation:
    """By brightness, and where what that finds cannot be most of the rope, has more on it or is not at its
    held ends, by the local difference if that is likelier."""
    found, refusal = None, None
    try:
        found = _threshold(frame, index, settings)
    except ChainError as error:
        refusal = error
    if found is not None and must_be(found.mask, frame, index):
        return found
    try:
        local = _local(frame, index)
    except ChainError:
        local = None
    both = [one for one in (found, local) if one is not None]
    if found is None and not any(share_of_rope(one.mask, frame, index) for one in both):
        assert refusal is not None
        raise refusal
    return max(both, key=lambda one: likelihood(one.mask, frame, index))


def _offered(frame: Frame, index: CaptureIndex) -> str:
    if frame.mask is not None:
        return "mask"
    if index.rope_color_hsv is not None:
        return "color"
    if index.background_color is not None or index.background_depth is not None:
        return "background"
    return "either"


def _threshold(frame: Frame, index: CaptureIndex, settings: ChainSettings) -> Segmentation:
    assert frame.color is not None
    grey = np.asarray(cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    mask = cleaned(_bright(grey, frame, index, settings), frame, index)
    levels = grey.astype(np.float32)
    levels[grey == 255] = np.inf
    return Segmentation(mask, levels)


def _local(frame: Frame, index: CaptureIndex) -> Segmentation:
    found = local_masks(frame, index)
    found += [without_obstacles(mask, frame, index) for mask in found]
    masks = [cleaned(mask, frame, index) for mask in found]
    mask = max(masks, key=lambda one: likelihood(one, frame, index))
    return Segmentation(mask, rope_levels(frame.color, mask))


def _in_range(frame: Frame, index: CaptureIndex) -> Mask:
    """Where the rope's colour is. Hue is a circle: from a low above the high it goes through red."""
    assert frame.color is not None and index.rope_color_hsv is not None
    low, high = np.array(index.rope_color_hsv)
    hsv = cv2.cvtColor(frame.color, cv2.COLOR_RGB2HSV)
    if low[0] <= high[0]:
        return np.asarray(cv2.inRange(hsv, low, high) > 0)
    to_red = cv2.inRange(hsv, low, np.array([LAST_HUE, *high[1:]]))
    from_red = cv2.inRange(hsv, np.array([0, *low[1:]]), high)
    return np.asarray((to_red > 0) | (from_red > 0))


def _bright(grey: Image, frame: Frame, index: CaptureIndex, settings: ChainSettings) -> Mask:
    if settings.threshold is not None:
        return np.asarray(grey >= settings.threshold, dtype=np.bool_)
    level, binary = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    sure = np.asarray(binary > 0, dtype=np.bool_)
    contrast = 0.0
    if sure.any() and not sure.all():
        contrast = float(cv2.mean(grey, binary)[0] - cv2.mean(grey, cv2.bitwise_not(binary))[0])
    if contrast < settings.min_contrast:
        raise ChainError(
            f"no rope: the bright part is only {contrast:.0f} grey levels above the rest (level {level:.0f})",
            file=frame.file,
            place=f"frame {frame.frame}",
            mend="remove the frame, or set chain.threshold or rope_color_hsv",
        )
    # Light from one side leaves the other side of the rope dark: what is connected may be much darker.
    # How bright the rope is, a pillar before it does not tell; nor do slivers that are left of a table.
    dark, narrow = _dark(grey, sure), without_blocks(sure, frame, index)
    lit = narrow if share_of_rope(narrow, frame, index) else sure
    lowest = dark + SHADE * (float(np.median(grey[lit])) - dark)
    rope = np.asarray(grey >= lowest, dtype=np.bool_)
    window = window_of(rope)
    count, labels = cv2.connectedComponents(rope[window].astype(np.uint8), connectivity=8)
    kept = np.zeros(count, dtype=np.bool_)
    kept[labels[sure[window]]] = True
    kept[0] = False
    rope[window] = kept[labels]
    return rope


def _dark(levels: NDArray[Any], rope: Mask) -> float:
    """How bright it is beside the rope: the median of every so many pixels."""
    some = np.s_[::DARK_EVERY, ::DARK_EVERY]
    beside = levels[some][~rope[some]]
    return float(np.median(beside)) if len(beside) else 0.0


def coverage(found: Segmentation) -> NDArray[np.float32]:
    """How much of each pixel the rope covers, shape (H, W), 0 to 1; 1 on the mask where colour says nothing.

    A pixel on the outline is a mixture of rope and background. How bright the rope is there, its
    neighbour further in tells: so the lit side counts no more than the side in the shade.
    """
    mask, levels = found.mask, found.levels
    covered = mask.astype(np.float32)
    if levels is None or mask.all() or not mask.any():
        return covered
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    window = np.s_[max(rows[0] - 1, 0) : rows[-1] + 2, max(columns[0] - 1, 0) : columns[-1] + 2]
    dark = _dark(levels, mask)
    # How far an overexposed background is from the rope nobody knows; what is not so is something else.
    if not np.isfinite(dark):
        return covered
    near, inside = np.minimum(levels[window], 255), mask[window]
    inner = cv2.dilate(near, np.ones((3, 3), np.uint8))[inside]
    share = (near[inside] - dark) / np.maximum(PLATEAU * (inner - dark), 1)
    covered[mask] = np.clip(share, 0, 1)
    return covered


def _lacking(frame: Frame, problem: str, mend: str) -> ChainError:
    return ChainError(problem, file=frame.file, place=f"frame {frame.frame}", mend=mend)
