"""Images of a capture for the figures, and where a point of the world is seen in them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dlolib.errors import FormatError
from dlolib.types import Camera, CaptureIndex, Floats, Recording

Window = tuple[int, int, int, int]
"""First and last row, first and last column (the last not included)."""


def rgb(path: Path) -> NDArray[np.uint8]:
    """An image as (H, W, 3) red, green, blue."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise FormatError("no readable image", file=path, mend="record or copy it again")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def depth_m(path: Path, scale: float) -> Floats:
    """A depth image (H, W) in m; 0 where there is no reading."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise FormatError("no readable image", file=path, mend="record or copy it again")
    return np.asarray(image, dtype=np.float64) / scale


def project(points_m: Floats, camera: Camera) -> Floats:
    """Pixels (P, 2), column and row, at which points (P, 3) of the world are seen."""
    assert camera.fx and camera.fy and camera.cx is not None and camera.cy is not None
    to_camera = np.linalg.inv(camera.world_from_camera)
    seen = points_m @ to_camera[:3, :3].T + to_camera[:3, 3]
    return np.column_stack(
        [camera.fx * seen[:, 0] / seen[:, 2] + camera.cx, camera.fy * seen[:, 1] / seen[:, 2] + camera.cy]
    )


def toward_camera(offset_m: Floats, points_m: Floats, camera: Camera) -> Floats:
    """Part of offsets (P, 3) along the line of sight, positive toward the camera, (P,) [m]."""
    sight = camera.world_from_camera[:3, 3] - points_m
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    return np.asarray(np.sum(offset_m * sight, axis=1))


def rope_window(capture: CaptureIndex, recording: Recording | None, margin: float = 0.08) -> Window:
    """The part of the images that the rope passes in any frame, with a margin; all of it without a chain."""
    camera = capture.camera
    height, width = camera.height or 0, camera.width or 0
    if recording is None:
        return (0, height, 0, width)
    pixels = project(recording.points.xyz_m, camera)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    pad = margin * float(max(high - low))
    first = np.maximum(np.floor(low - pad), 0).astype(int)
    last = np.minimum(np.ceil(high + pad), [width, height]).astype(int)
    return (int(first[1]), int(last[1]), int(first[0]), int(last[0]))


def shown(image: NDArray[np.uint8], window: Window, columns: int) -> NDArray[np.uint8]:
    """The window of an image, with no more than `columns` columns, so that the page stays small."""
    part = image[window[0] : window[1], window[2] : window[3]]
    if part.shape[1] <= columns:
        return part
    rows = max(1, round(part.shape[0] * columns / part.shape[1]))
    return np.asarray(cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.uint8)
