"""Images of a capture, read strictly: a damaged file is refused, never half decoded.

Every damage of a PNG shows in its checksums. A JPEG has none: there what makes no sense is refused.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dlolib.captures.base import Depth, Image, Mask
from dlolib.errors import FormatError
from dlolib.types import Camera

SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG = b"\xff\xd8"
NEAREST_M, FURTHEST_M = 0.05, 30.0
# More than any camera has on a side; a few bytes can ask for gigabytes.
LARGEST_PX = 20_000


def read_color(path: Path, camera: Camera) -> Image:
    """An 8-bit RGB image, shape (H, W, 3)."""
    image = decode_png(path.read_bytes(), path)
    check_color(image, camera, path)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def read_depth(path: Path, camera: Camera) -> Depth:
    """A 16-bit depth image as metres, shape (H, W); 0 where there is no reading."""
    image = decode_png(path.read_bytes(), path)
    check_depth(image, camera, path)
    return image.astype(np.float32) / np.float32(camera.depth_scale or 1.0)


def read_mask(path: Path, camera: Camera) -> Mask:
    """An 8-bit mask, shape (H, W), True where it is bright."""
    image = decode_png(path.read_bytes(), path)
    _check_size(image, camera, path, None)
    if image.dtype != np.uint8 or image.ndim != 2:
        raise FormatError(f"is {_kind(image)}, not 8-bit grey", file=path, mend="save the mask as 8-bit grey")
    bright = np.asarray(image > 127, dtype=np.bool_)
    if image.any() and not bright.any():
        problem = f"is no brighter than {image.max()} of 255 anywhere"
        raise FormatError(problem, file=path, mend="save the rope as white (255) on black (0)")
    return bright


def check_backgrounds(color: Path | None, depth: Path | None, camera: Camera) -> None:
    """Refuse images of the empty scene that this camera cannot have taken."""
    if color is not None:
        read_color(color, camera)
    if depth is not None:
        read_depth(depth, camera)


def check_color(image: NDArray[Any], camera: Camera, path: Path, place: str | None = None) -> None:
    """Refuse what is no colour image (H, W, 3) of 8 bits and the camera's size."""
    _check_size(image, camera, path, place)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise FormatError(
            f"is {_kind(image)}, not 8-bit RGB",
            file=path,
            place=place,
            mend="save it as 8-bit RGB; is depth named as color?",
        )


def check_depth(image: NDArray[Any], camera: Camera, path: Path, place: str | None = None) -> None:
    """Refuse what is no depth image (H, W) of 16 bits, the camera's size and a rope's distance."""
    _check_size(image, camera, path, place)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise FormatError(
            f"is {_kind(image)}, not 16-bit grey",
            file=path,
            place=place,
            mend="save depth as 16-bit; is color named as depth?",
        )
    if not image.any():
        mend = "take the frame out, or record it again"
        raise FormatError("depth is zero everywhere", file=path, place=place, mend=mend)
    assert camera.depth_scale is not None
    typical = float(np.median(image[image > 0])) / camera.depth_scale
    if not NEAREST_M < typical < FURTHEST_M:
        raise FormatError(
            f"the median depth is {typical:.4g} m with depth_scale {camera.depth_scale:g}",
            file=path,
            place=place,
            mend="correct camera.depth_scale in capture.json (units per metre; 1000 for millimetres)",
        )


def decode_png(data: bytes, path: Path, place: str | None = None) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The image (H, W) or (H, W, channels) as OpenCV orders them (blue first), of 8 or 16 bits.

    Raises:
        FormatError: no PNG, truncated, or damaged.
    """
    _check_whole(data, path, place)
    image = _decoded(data, cv2.IMREAD_UNCHANGED)
    if image is None:
        raise FormatError("cannot be decoded", file=path, place=place, mend="record or copy it again")
    if image.dtype not in (np.uint8, np.uint16):
        raise FormatError(f"is {image.dtype}", file=path, place=place, mend="save it with 8 or 16 bits")
    return image


def decode_color(data: bytes, path: Path, place: str | None = None) -> Image:
    """An 8-bit RGB image (H, W, 3) from a PNG or a JPEG.

    Raises:
        FormatError: neither, truncated, damaged (of a JPEG as far as it shows), or without colour.
    """
    if data.startswith(JPEG):
        # A turn noted in a JPEG would turn it against its depth.
        flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
        image = _decoded(data, flags) if _makes_sense(data) else None
        if image is None:
            raise FormatError("is a damaged JPEG", file=path, place=place, mend="record or copy it again")
    else:
        image = decode_png(data, path, place)
    if image.ndim != 3 or image.dtype != np.uint8:
        mend = "name a colour image; is depth named as color?"
        raise FormatError(f"is {_kind(image)}, not 8-bit RGB", file=path, place=place, mend=mend)
    return np.asarray(cv2.cvtColor(image[..., :3], cv2.COLOR_BGR2RGB), dtype=np.uint8)


def decode_depth(data: bytes, path: Path, place: str | None = None) -> NDArray[np.uint16]:
    """A 16-bit depth image (H, W) from a PNG.

    Raises:
        FormatError: no PNG, truncated, damaged, or no depth.
    """
    image = decode_png(data, path, place)
    if image.ndim != 2 or image.dtype != np.uint16:
        mend = "save depth as 16-bit; is color named as depth?"
        raise FormatError(f"is {_kind(image)}, not 16-bit grey", file=path, place=place, mend=mend)
    return image  # type: ignore[return-value]


def _makes_sense(jpeg: bytes) -> bool:
    """Whether FFmpeg, told to overlook nothing, finds no damage: OpenCV makes up what it cannot decode."""
    import av

    decoder = av.CodecContext.create("mjpeg", "r")
    assert isinstance(decoder, av.VideoCodecContext)
    decoder.options = {"err_detect": "explode", "max_pixels": str(LARGEST_PX**2)}
    try:
        decoder.decode(av.Packet(jpeg))
    except av.error.InvalidDataError:
        return False
    except av.error.FFmpegError:
        # of a kind that it does not know: OpenCV may
        return True
    return True


def _decoded(data: bytes, flags: int) -> NDArray[Any] | None:
    """What OpenCV makes of an image; None where it makes nothing or refuses by an error of its own."""
    try:
        image: NDArray[Any] | None = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error:
        return None
    return image


def _check_size(image: NDArray[Any], camera: Camera, path: Path, place: str | None) -> None:
    if image.shape[:2] != (camera.height, camera.width):
        raise FormatError(
            f"is {image.shape[1]} x {image.shape[0]} pixels, the camera {camera.width} x {camera.height}",
            file=path,
            place=place,
            mend="give the camera's width, height, fx, fy, cx and cy of this size, or correct the image",
        )


def _check_whole(data: bytes, path: Path, frame: str | None) -> None:
    """Walk the chunks of a PNG: OpenCV decodes a truncated one silently to a half-black picture."""
    if not data.startswith(SIGNATURE):
        raise FormatError("is no PNG", file=path, place=frame, mend="save it as PNG")
    at = len(SIGNATURE)
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind = data[at + 4 : at + 8]
        if at == len(SIGNATURE):
            _check_header(kind, data[at + 8 : at + 16], path, frame)
        if at + 12 + length > len(data):
            break
        (checksum,) = struct.unpack_from(">I", data, at + 8 + length)
        if zlib.crc32(data[at + 4 : at + 8 + length]) != checksum:
            place = f"{frame}, byte {at}" if frame else f"byte {at}"
            raise FormatError("is damaged: a checksum is wrong", file=path, place=place, mend="copy it again")
        if kind == b"IEND":
            return
        at += 12 + length
    place = f"{frame}, byte {len(data)}" if frame else f"byte {len(data)}"
    raise FormatError("is truncated", file=path, place=place, mend="record or copy it again")


def _check_header(kind: bytes, sizes: bytes, path: Path, frame: str | None) -> None:
    """Refuse a PNG that asks for more memory than any camera's image."""
    place = f"{frame}, header" if frame else "header"
    if kind != b"IHDR" or len(sizes) < 8:
        raise FormatError(
            "is damaged: it does not begin with a header", file=path, place=place, mend="copy it again"
        )
    width, height = struct.unpack(">II", sizes)
    if not (0 < width <= LARGEST_PX and 0 < height <= LARGEST_PX):
        problem = f"says that it has {width} x {height} pixels"
        raise FormatError(problem, file=path, place=place, mend="record or copy it again")


def _kind(image: NDArray[Any]) -> str:
    channels = 1 if image.ndim == 2 else image.shape[2]
    return f"{8 * image.dtype.itemsize}-bit with {channels} channel{'s' if channels > 1 else ''}"
