"""The rope by what it differs from: what is around it, or the empty scene."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dlolib.captures.base import Depth, Frame, Image, Mask
from dlolib.captures.pictures import read_color, read_depth
from dlolib.chain.settings import ChainSettings
from dlolib.errors import ChainError
from dlolib.types import Camera, CaptureIndex, Floats

# A window in which a rope that runs through its middle is in the minority, in widths of the rope.
WINDOW_WIDTHS = 3.0
UNKNOWN_WIDTH_PX, LARGEST_WINDOW_PX = 12.0, 255
LEAST_DIFFERENCE, LEAST_PX = 12.0, 20
WEAK = 0.5
RING_PX, EDGE_PX = 9, 5
# As much as this share of the rope is no speck; depths are counted in every so many rows and columns.
NEAREST_SHARE, COUNTED_EVERY = 0.1, 2
# A median of distances from none as a deviation, and from how many of them on a difference is no noise.
TO_DEVIATION, SURE = 1.4826, 3.0
# A channel in which the rope differs by less of the whole difference may be saturated.
SATURATED, LEAST_WEIGHT = 255, 0.1


def local_masks(frame: Frame, index: CaptureIndex) -> list[Mask]:
    """Pixels (H, W) whose colour differs from the median of what is around: a rope is narrow, a table not.

    A bright rope and a dark pillar before it differ in opposite ways: each has its mask, first what is more.
    What differs most says in which colour; how much is found by Otsu's method, and is at least 12 levels.
    Of what is connected to it half of that is enough, since light falls unevenly.

    Raises:
        ChainError: nothing differs.
    """
    assert frame.color is not None
    window = min(2 * round(0.5 * WINDOW_WIDTHS * _width_px(frame, index)) + 1, LARGEST_WINDOW_PX)
    blurred = cv2.merge([cv2.medianBlur(channel, window) for channel in cv2.split(frame.color)])
    around = np.asarray(blurred, dtype=np.uint8)
    difference = np.asarray(cv2.absdiff(frame.color, around).max(axis=-1), dtype=np.uint8)
    sure = difference >= _otsu(difference)
    step = frame.color[sure].astype(np.float32) - around[sure]
    side = step @ np.linalg.eigh(step.T @ step)[1][:, -1]
    ways = sorted((step[side > 0], step[side <= 0]), key=len, reverse=True)
    if len(ways[0]) < LEAST_PX:
        raise ChainError(
            "no rope: nothing differs from what is around it",
            file=frame.file,
            place=f"frame {frame.frame}",
            mend="remove the frame, or give rope_color_hsv, a background or a mask",
        )
    return [
        _that_way(frame.color, around, np.asarray(np.median(way, axis=0)))
        for way in ways
        if len(way) >= LEAST_PX
    ]


def _that_way(color: Image, around: Image, step: Floats) -> Mask:
    """Pixels (H, W) that differ from what is around (H, W, 3) as a step (3,) in colour does."""
    weights = (step / max(float(np.linalg.norm(step)), 1e-6)).reshape(1, 3)
    signed = cv2.transform(color.astype(np.float32) - around.astype(np.float32), weights)
    towards = np.clip(signed, 0, 255).astype(np.uint8)
    level = _otsu(towards)
    count, labels = cv2.connectedComponents((towards >= WEAK * level).astype(np.uint8), connectivity=8)
    rope = np.zeros(count, dtype=np.bool_)
    rope[labels[towards >= level]] = True
    rope[0] = False
    return np.asarray(rope[labels], dtype=np.bool_)


def background_mask(frame: Frame, index: CaptureIndex, settings: ChainSettings) -> Mask:
    """Pixels (H, W) that differ from the empty scene in colour, or are nearer than it.

    Raises:
        ChainError: the capture has no image of the empty scene.
    """
    if index.background_color is None and index.background_depth is None:
        raise ChainError(
            "has no image of the empty scene",
            file=frame.file,
            place=f"frame {frame.frame}",
            mend="add background_color or background_depth to capture.json, or set chain.segmentation",
        )
    found: Mask | None = None
    if index.background_color is not None and frame.color is not None:
        difference = cv2.absdiff(frame.color, _empty_color(index.background_color, index.camera))
        found = np.asarray(difference.max(axis=-1) >= settings.background_levels)
    if index.background_depth is not None and frame.depth_m is not None:
        empty = _empty_depth(index.background_depth, index.camera)
        nearer = _nearer(frame.depth_m, empty, settings.background_depth_m)
        found = np.asarray(nearer if found is None else found | nearer)
    assert found is not None
    return found


def _nearer(depth_m: Depth, empty_m: Depth, least_m: float) -> Mask:
    """Pixels (H, W) whose depth [m] is by so much [m] nearer than that of the empty scene, and surely so.

    Noise grows with the square of the distance: of a wall at 2 m a quarter of the pixels are nearer by 6 mm.
    How large it is, most of the image tells, where nothing has changed.
    """
    both = (depth_m > 0) & (empty_m > 0)
    some = np.s_[::COUNTED_EVERY, ::COUNTED_EVERY]
    apart = np.abs(empty_m[some] - depth_m[some])[both[some]] / empty_m[some][both[some]] ** 2
    noise = TO_DEVIATION * float(np.median(apart)) if len(apart) else 0.0
    return np.asarray(both & (empty_m - depth_m > np.maximum(least_m, SURE * noise * empty_m**2)))


def rope_levels(color: Image | None, mask: Mask) -> NDArray[np.float32] | None:
    """The mixture of red, green and blue in which the rope stands out from what is beside it, (H, W).

    Linear in the light, so that a pixel half covered lies half-way. Infinite where a channel is saturated:
    upwards where more of it is more like the rope, downwards where it is less.
    """
    if color is None or not mask.any():
        return None
    rope = mask.astype(np.uint8)
    close = cv2.dilate(rope, np.ones((EDGE_PX, EDGE_PX), np.uint8))
    beside = (cv2.dilate(rope, np.ones((2 * RING_PX + 1,) * 2, np.uint8)) > 0) & (close == 0)
    if not beside.any():
        return None
    step = np.median(color[mask], axis=0) - np.median(color[beside], axis=0)
    size = float(np.abs(step).sum())
    if size < LEAST_DIFFERENCE:
        return None
    weights = step / size
    levels = np.asarray(color.astype(np.float32) @ weights.astype(np.float32))
    for counts, beyond in ((weights < -LEAST_WEIGHT, -np.inf), (weights > LEAST_WEIGHT, np.inf)):
        levels[(color[..., counts] >= SATURATED).any(axis=-1)] = beyond
    return np.asarray(levels, dtype=np.float32)


def _otsu(difference: NDArray[np.uint8]) -> float:
    return max(cv2.threshold(difference, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[0], LEAST_DIFFERENCE)


def _width_px(frame: Frame, index: CaptureIndex) -> float:
    """How wide the rope may look [px]: at the nearest things that there are, so not too narrow.

    A thin rope before a wall is a hundredth of the image. So what is nearest is counted in ropes: at which
    depth there is a tenth of what the rope would cover there.
    """
    diameter, focal = index.rope.diameter_m, index.camera.fx
    if diameter is None or focal is None or frame.depth_m is None:
        return UNKNOWN_WIDTH_PX
    some = frame.depth_m[::COUNTED_EVERY, ::COUNTED_EVERY]
    depth = np.sort(some[some > 0])
    if not len(depth):
        return UNKNOWN_WIDTH_PX
    area_m2 = COUNTED_EVERY**2 * np.arange(1, len(depth) + 1) * (depth / focal) ** 2
    enough = int(np.searchsorted(area_m2, NEAREST_SHARE * index.rope.length_m * diameter))
    return max(diameter * focal / float(depth[min(enough, len(depth) - 1)]), 2.0)


def _empty_color(path: Path, camera: Camera) -> Image:
    return _read_color(path, path.stat().st_mtime_ns, camera.width, camera.height)


def _empty_depth(path: Path, camera: Camera) -> Depth:
    return _read_depth(path, path.stat().st_mtime_ns, camera.width, camera.height, camera.depth_scale)


# The empty scene is the same in each frame of a capture.
@lru_cache(maxsize=2)
def _read_color(path: Path, _: int, width: int | None, height: int | None) -> Image:
    return read_color(path, Camera(np.eye(4), width, height))


@lru_cache(maxsize=2)
def _read_depth(path: Path, _: int, width: int | None, height: int | None, scale: float | None) -> Depth:
    return read_depth(path, Camera(np.eye(4), width, height, depth_scale=scale))
