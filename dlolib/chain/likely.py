"""Which of several masks is likeliest the rope: by how much of it there is, and where its held ends are."""

from __future__ import annotations

import cv2
import numpy as np

from dlolib.captures.base import Frame, Mask
from dlolib.chain.anchor import anchors
from dlolib.chain.cleaning import window_of
from dlolib.types import CaptureIndex

# Share of the rope's outline, length times diameter, that a mask may have and be a rope of this size.
LEAST_AREA, MOST_AREA = 0.15, 1.6
# A mask of less of the rope may be slivers of something else, one of more has something else on it.
MOST_OF_ROPE, MORE_THAN_ROPE = 0.5, 1.15
# Where a rope that leaves its clamp must be, and at how much of these places it is looked for no further.
BEFORE_M, AT_ENDS = np.array([0.005, 0.01, 0.015]), 0.5
MOST_OF_IMAGE = 0.25


def likelihood(mask: Mask, frame: Frame, index: CaptureIndex) -> tuple[bool, float, float]:
    """How likely a mask (H, W) is the rope, to be compared: whether it can be, how far it is where the held
    ends are, and how much of the rope it is, where more than the rope is least."""
    share = share_of_rope(mask, frame, index)
    return share > 0, _at_held_ends(mask, frame, index), share if share < MORE_THAN_ROPE else -share


def must_be(mask: Mask, frame: Frame, index: CaptureIndex) -> bool:
    """Whether a mask (H, W) is as much as the rope, and where its held ends are: no other need be found."""
    is_much = MOST_OF_ROPE < share_of_rope(mask, frame, index) < MORE_THAN_ROPE
    return is_much and _at_held_ends(mask, frame, index) >= AT_ENDS


def share_of_rope(mask: Mask, frame: Frame, index: CaptureIndex) -> float:
    """The mask's area, at its own distance, over the rope's outline's; 0 where it cannot be the rope.

    At its outline a pixel may read what is behind, which before a far wall makes many times its own area: of
    what is read beside it the nearest counts.
    """
    focal, diameter = index.camera.fx, index.rope.diameter_m
    if diameter is None or focal is None or frame.depth_m is None:
        return float(0 < mask.mean() < MOST_OF_IMAGE)
    if not mask.any():
        return 0.0
    window = window_of(np.ascontiguousarray(mask))
    read = frame.depth_m[window]
    nearest = cv2.erode(np.where(read > 0, read, np.float32(np.inf)), np.ones((3, 3), np.uint8))
    depth = nearest[mask[window] & (read > 0)].astype(np.float64)
    area = float(((depth / focal) ** 2).sum()) / (index.rope.length_m * diameter)
    return area if LEAST_AREA < area < MOST_AREA else 0.0


def _at_held_ends(mask: Mask, frame: Frame, index: CaptureIndex) -> float:
    """The share of places just before the held ends, where the rope is straight, with some of a mask within
    the rope's width; 1 where none is known to be in the image."""
    start, end = anchors(frame, index)
    held = [one for one in (start, end.turned() if end else None) if one is not None]
    camera, diameter = index.camera, index.rope.diameter_m
    if not held or diameter is None or camera.fx is None or camera.fy is None:
        return 1.0
    places = np.concatenate([one.place_m + np.outer(BEFORE_M, one.tangent) for one in held])
    places = places[places[:, 2] > diameter]
    wide = np.ceil(diameter * camera.fx / places[:, 2]).astype(int)
    optics = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    column, row = np.round(places[:, :2] / places[:, 2:] * optics[0] + optics[1]).astype(int).T
    inside = (column >= 0) & (column < mask.shape[1]) & (row >= 0) & (row < mask.shape[0])
    beside = [
        mask[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1].any()
        for x, y, reach in zip(column[inside], row[inside], wide[inside], strict=True)
    ]
    return float(np.mean(beside)) if beside else 1.0
