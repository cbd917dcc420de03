"""Which pixels are rope: line 2 of Algorithm 1, `Binarize`, and the other ways to tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dlolib.captures.base import Frame, Image, Mask
from dlolib.chain.anchor import anchors
from dlolib.chain.contrast import background_mask, local_masks, rope_levels
from dlolib.chain.settings import ChainSettings
from dlolib.errors import ChainError
from dlolib.formats.capture import LAST_HUE
from dlolib.types import CaptureIndex

SMALLEST_PX = 20
# A hole no larger than this is noise: pixels out of the colour's range.
PINHOLE_PX = 4
SHADE, PLATEAU = 0.25, 0.75
# Two strands that cross at a small angle lie side by side.
THICK = 2.3
# Share of the rope's outline, length times diameter, that a mask may have and be a rope of this size.
LEAST_AREA, MOST_AREA = 0.15, 1.6
# A mask of less of the rope may be slivers of something else, one of more has something else on it.
MOST_OF_ROPE, MORE_THAN_ROPE = 0.5, 1.15
# Where a rope that leaves its clamp must be, and at how much of these places it is looked for no further.
BEFORE_M, AT_ENDS = np.array([0.005, 0.01, 0.015]), 0.5
MOST_OF_IMAGE = 0.25
# What is dark is so in hundreds of thousands of pixels: every so many tell its median as well.
DARK_EVERY = 4

Levels = NDArray[np.float32]


@dataclass(frozen=True)
class Segmentation:
    """The rope's pixels, shape (H, W), and the levels (H, W) in which the rope stands out, as light adds up.

    levels is None where nothing but the mask is known, and infinite where a channel is saturated.
    """

    mask: Mask
    levels: Levels | None


def segment(frame: Frame, index: CaptureIndex, settings: ChainSettings) -> Segmentation:
    """Find the rope in a frame in the way that the settings choose.

    `threshold`: brightness, as in the paper, a white rope before black. `local`: whatever differs from what
    is around it and is as narrow as a rope. `color`: the capture's `rope_color_hsv`. `background`: what
    differs from the capture's images of the empty scene, in colour or by being nearer. `mask`: from outside.
    `auto` takes the first that the capture offers: mask, colour, background; else the threshold, and where
    what it finds cannot be the rope (a bright table, a pillar), the local difference.

    Specks go, and so does whatever is far thicker than the rope at its distance (a gripper, a board), where
    the diameter is known.

    Raises:
        ChainError: nothing in the frame looks like a rope, or the capture lacks what the choice needs.
    """
    way = settings.segmentation if settings.segmentation != "auto" else _offered(frame, index)
    if way == "mask":
        if frame.mask is None:
            raise _lacking(frame, "has no mask", "add a column `mask` to frames.csv")
        return Segmentation(_cleaned(frame.mask, frame, index), None)
    if frame.color is None and way != "background":
        raise ChainError("has no color image", file=frame.file, mend="give color, or a mask")
    if way == "color":
        if index.rope_color_hsv is None:
            raise _lacking(frame, "has no rope colour", "add `rope_color_hsv` to capture.json")
        mask = _cleaned(_in_range(frame, index), frame, index)
        return Segmentation(mask, rope_levels(frame.color, mask))
    if way == "background":
        mask = _cleaned(background_mask(frame, index, settings), frame, index)
        return Segmentation(mask, rope_levels(frame.color, mask))
    if way == "local":
        return _local(frame, index)
    if settings.segmentation == "threshold":
        return _threshold(frame, index, settings)
    return _either(frame, index, settings)


def _either(frame: Frame, index: CaptureIndex, settings: ChainSettings) -> Segmentation:
    """By brightness, and where what that finds cannot be most of the rope, or has more on it, by the local
    difference if that is likelier."""
    found, refusal = None, None
    try:
        found = _threshold(frame, index, settings)
    except ChainError as error:
        refusal = error
    if found is not None and _must_be(found.mask, frame, index):
        return found
    try:
        local = _local(frame, index)
    except ChainError:
        local = None
    both = [one for one in (found, local) if one is not None]
    if found is None and not any(_share_of_rope(one.mask, frame, index) for one in both):
        assert refusal is not None
        raise refusal
    return max(both, key=lambda one: _likely(one.mask, frame, index))


def _likely(mask: Mask, frame: Frame, index: CaptureIndex) -> tuple[bool, float, float]:
    """How likely a mask is the rope: it can be; it is where the held ends are; it is most of it, not more."""
    share = _share_of_rope(mask, frame, index)
    return share > 0, _at_held_ends(mask, frame, index), share if share < MORE_THAN_ROPE else -share


def _must_be(mask: Mask, frame: Frame, index: CaptureIndex) -> bool:
    """Whether a mask is as much as the rope, and where its held ends are: nothing else need be looked for."""
    is_much = MOST_OF_ROPE < _share_of_rope(mask, frame, index) < MORE_THAN_ROPE
    return is_much and _at_held_ends(mask, frame, index) >= AT_ENDS


def _at_held_ends(mask: Mask, frame: Frame, index: CaptureIndex) -> float:
    """The share of places just before the held ends, where the rope is straight, with some of a mask beside;
    1 where none is known to be in the image."""
    start, end = anchors(frame, index)
    held = [one for one in (start, end.turned() if end else None) if one is not None]
    camera, diameter = index.camera, index.rope.diameter_m
    if not held or diameter is None or camera.fx is None or camera.fy is None:
        return 1.0
    places = np.concatenate([one.place_m + np.outer(BEFORE_M, one.tangent) for one in held])
    reach = max(round(diameter * camera.fx / float(np.median(places[:, 2]))), 1)
    near = cv2.dilate(mask.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8))
    optics = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    column, row = np.round(places[:, :2] / places[:, 2:] * optics[0] + optics[1]).astype(int).T
    inside = (column >= 0) & (column < mask.shape[1]) & (row >= 0) & (row < mask.shape[0])
    return float(near[row[inside], column[inside]].mean()) if inside.any() else 1.0


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
    mask = _cleaned(_bright(grey, frame, index, settings), frame, index)
    levels = grey.astype(np.float32)
    levels[grey == 255] = np.inf
    return Segmentation(mask, levels)


def _local(frame: Frame, index: CaptureIndex) -> Segmentation:
    masks = [_cleaned(mask, frame, index) for mask in local_masks(frame, index)]
    mask = max(masks, key=lambda one: _likely(one, frame, index))
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
    dark, narrow = _dark(grey, sure), _without_blocks(sure, frame, index)
    lit = narrow if _share_of_rope(narrow, frame, index) else sure
    lowest = dark + SHADE * (float(np.median(grey[lit])) - dark)
    rope = np.asarray(grey >= lowest, dtype=np.bool_)
    window = _window(rope)
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


def _window(mask: Mask) -> tuple[slice, slice]:
    """The part of an image where a mask (H, W) is, to search no more than that."""
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    return slice(top, top + height), slice(left, left + width)


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
    near, inside = np.minimum(levels[window], 255), mask[window]
    inner = cv2.dilate(near, np.ones((3, 3), np.uint8))[inside]
    share = (near[inside] - dark) / np.maximum(PLATEAU * (inner - dark), 1)
    covered[mask] = np.clip(share, 0, 1)
    return covered


def _cleaned(mask: Mask, frame: Frame, index: CaptureIndex) -> Mask:
    return without_specks(_without_blocks(_without_pinholes(mask), frame, index))


def _without_pinholes(mask: Mask) -> Mask:
    """Fill what noise pierces: there the rope is as wide, and its line goes on."""
    filled, window = mask.copy(), _window(np.ascontiguousarray(mask))
    filled[window] = without_holes(np.pad(mask[window], 1), PINHOLE_PX)[1:-1, 1:-1]
    return filled


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


def _share_of_rope(mask: Mask, frame: Frame, index: CaptureIndex) -> float:
    """The mask's area, at its own distance, over the rope's outline's; 0 where it cannot be the rope."""
    focal, diameter = index.camera.fx, index.rope.diameter_m
    if diameter is None or focal is None or frame.depth_m is None:
        return float(0 < mask.mean() < MOST_OF_IMAGE)
    depth = frame.depth_m[mask]
    area = float(((depth / focal) ** 2).sum()) / (index.rope.length_m * diameter)
    return area if LEAST_AREA < area < MOST_AREA else 0.0


def _lacking(frame: Frame, problem: str, mend: str) -> ChainError:
    return ChainError(problem, file=frame.file, place=f"frame {frame.frame}", mend=mend)


def without_specks(mask: Mask) -> Mask:
    """Keep the connected parts of a mask (H, W) that have 20 pixels or more."""
    cleaned = np.zeros_like(mask)
    window = _window(np.ascontiguousarray(mask))
    if mask.any():
        part = mask[window].astype(np.uint8)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(part, connectivity=8)
        large = np.zeros(count, dtype=np.bool_)
        large[1:] = stats[1:, cv2.CC_STAT_AREA] >= SMALLEST_PX
        cleaned[window] = large[labels]
    return cleaned


def without_holes(mask: Mask, largest_px: float) -> Mask:
    """Fill holes up to a size: lost pixels, a frayed tip. Around each a skeleton would run twice."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] <= largest_px
    small[0] = False
    return np.asarray(mask | small[labels]) if count > 2 and small.any() else mask
