"""PNG files of a capture, read strictly: a damaged file is refused, never half decoded."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dlolib.captures.base import Depth, Image, Mask
from dlolib.errors import FormatError
from dlolib.types import Camera

SIGNATURE = b"\x89PNG\r\n\x1a\n"
NEAREST_M, FURTHEST_M = 0.05, 30.0


def read_color(path: Path, camera: Camera) -> Image:
    """An 8-bit RGB image, shape (H, W, 3)."""
    image = _read(path, camera)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise FormatError(
            f"is {_kind(image)}, not 8-bit RGB",
            file=path,
            mend="save it as 8-bit RGB; is depth named as color?",
        )
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def read_depth(path: Path, camera: Camera) -> Depth:
    """A 16-bit depth image as metres, shape (H, W); 0 where there is no reading."""
    image = _read(path, camera)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise FormatError(
            f"is {_kind(image)}, not 16-bit grey",
            file=path,
            mend="save depth as 16-bit; is color named as depth?",
        )
    if not image.any():
        raise FormatError("depth is zero everywhere", file=path, mend="remove the frame from frames.csv")
    assert camera.depth_scale is not None
    depth = image.astype(np.float32) / np.float32(camera.depth_scale)
    typical = float(np.median(depth[image > 0]))
    if not NEAREST_M < typical < FURTHEST_M:
        raise FormatError(
            f"the median depth is {typical:.4g} m with depth_scale {camera.depth_scale:g}",
            file=path,
            mend="correct camera.depth_scale in capture.json (units per metre; 1000 for millimetres)",
        )
    return depth


def read_mask(path: Path, camera: Camera) -> Mask:
    """An 8-bit mask, shape (H, W), True where it is bright."""
    image = _read(path, camera)
    if image.dtype != np.uint8 or image.ndim != 2:
        raise FormatError(f"is {_kind(image)}, not 8-bit grey", file=path, mend="save the mask as 8-bit grey")
    return np.asarray(image > 127, dtype=np.bool_)


def _read(path: Path, camera: Camera) -> NDArray[np.uint8] | NDArray[np.uint16]:
    data = path.read_bytes()
    _check_whole(data, path)
    image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise FormatError("cannot be decoded", file=path, mend="record or copy it again")
    if image.shape[:2] != (camera.height, camera.width):
        raise FormatError(
            f"is {image.shape[1]} x {image.shape[0]} pixels, the camera {camera.width} x {camera.height}",
            file=path,
            mend="correct camera.width and height in capture.json, or the image",
        )
    if image.dtype not in (np.uint8, np.uint16):
        raise FormatError(f"is {image.dtype}", file=path, mend="save it with 8 or 16 bits")
    return image  # type: ignore[return-value]


def _check_whole(data: bytes, path: Path) -> None:
    """Walk the chunks of a PNG: OpenCV decodes a truncated one silently to a half-black picture."""
    if not data.startswith(SIGNATURE):
        raise FormatError("is no PNG", file=path, mend="save it as PNG")
    at = len(SIGNATURE)
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind = data[at + 4 : at + 8]
        if at + 12 + length > len(data):
            break
        (checksum,) = struct.unpack_from(">I", data, at + 8 + length)
        if zlib.crc32(data[at + 4 : at + 8 + length]) != checksum:
            raise FormatError(
                "is damaged: a checksum is wrong", file=path, place=f"byte {at}", mend="copy it again"
            )
        if kind == b"IEND":
            return
        at += 12 + length
    raise FormatError("is truncated", file=path, place=f"byte {len(data)}", mend="record or copy it again")


def _kind(image: NDArray[np.uint8] | NDArray[np.uint16]) -> str:
    channels = 1 if image.ndim == 2 else image.shape[2]
    return f"{8 * image.dtype.itemsize}-bit with {channels} channel{'s' if channels > 1 else ''}"
