"""What is cleaned away from a mask before it counts as rope."""

from __future__ import annotations

import cv2
import numpy as np

from dlolib.captures.base import Frame, Mask
from dlolib.formats.geometry import nearest_distance
from dlolib.types import CaptureIndex

SMALLEST_PX = 20
# A hole no larger than this is noise: pixels out of the colour's range.
PINHOLE_PX = 4
# Two strands that cross at a small angle lie side by side.
THICK = 2.3
# What is read nearer to an obstacle than so much of the rope's diameter is the obstacle; so close to it in
# the image there may be a mixture.
ON_SHARE, BESIDE_PX = 0.4, 2


def cleaned(mask: Mask, frame: Frame, index: CaptureIndex) -> Mask:
    """The mask (H, W) of a frame without what is no rope: pinholes filled, blocks and specks taken away."""
    return without_specks(without_blocks(without_pinholes(mask), frame, index))


def without_blocks(mask: Mask, frame: Frame, index: CaptureIndex) -> Mask:
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


def without_obstacles(mask: Mask, frame: Frame, index: CaptureIndex) -> Mask:
    """Take away from a mask (H, W) what is known to stand there: what is read on an obstacle, where no rope's
    skin would be, and what lies beside that and no nearer."""
    camera, diameter, depth = index.camera, index.rope.diameter_m, frame.depth_m
    if not index.obstacles or diameter is None or depth is None or not camera.fx or not camera.fy:
        return mask
    row, column = np.nonzero(mask & (depth > 0))
    x, y = (column - (camera.cx or 0)) / camera.fx, (row - (camera.cy or 0)) / camera.fy
    own = np.stack([x, y, np.ones_like(x)], axis=-1) * depth[row, column][:, None]
    view = camera.world_from_camera
    on = nearest_distance(index.obstacles, own @ view[:3, :3].T + view[:3, 3]) < ON_SHARE * diameter
    known = np.zeros_like(depth)
    known[row[on], column[on]] = depth[row[on], column[on]]
    near = cv2.dilate(known, np.ones((2 * BESIDE_PX + 1,) * 2, np.uint8))
    gone = (near > 0) & ((depth == 0) | (depth > near - ON_SHARE * diameter))
    return np.asarray(mask & ~gone, dtype=np.bool_)


def without_pinholes(mask: Mask) -> Mask:
    """Fill what noise pierces: there the rope is as wide, and its line goes on."""
    filled, window = mask.copy(), window_of(np.ascontiguousarray(mask))
    filled[window] = without_holes(np.pad(mask[window], 1), PINHOLE_PX)[1:-1, 1:-1]
    return filled


def without_specks(mask: Mask) -> Mask:
    """Keep the connected parts of a mask (H, W) that have 20 pixels or more."""
    large_parts = np.zeros_like(mask)
    window = window_of(np.ascontiguousarray(mask))
    if mask.any():
        part = mask[window].astype(np.uint8)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(part, connectivity=8)
        large = np.zeros(count, dtype=np.bool_)
        large[1:] = stats[1:, cv2.CC_STAT_AREA] >= SMALLEST_PX
        large_parts[window] = large[labels]
    return large_parts


def without_holes(mask: Mask, largest_px: float) -> Mask:
    """Fill holes up to a size: lost pixels, a frayed tip. Around each a skeleton would run twice."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] <= largest_px
    small[0] = False
    return np.asarray(mask | small[labels]) if count > 2 and small.any() else mask


def window_of(mask: Mask) -> tuple[slice, slice]:
    """The part of an image where a mask (H, W) is, to search no more than that."""
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    return slice(top, top + height), slice(left, left + width)
