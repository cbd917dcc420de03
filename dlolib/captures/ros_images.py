"""Images in ROS messages: sensor_msgs/Image and CompressedImage, and the CameraInfo beside them."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from dlolib.captures.bag import Bag
from dlolib.captures.base import Image
from dlolib.captures.clock import Pairs, together
from dlolib.captures.foreign import Units
from dlolib.captures.lens import PINHOLE, Lens
from dlolib.captures.pictures import decode_color, decode_depth, decode_png
from dlolib.errors import FormatError
from dlolib.types import Floats

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
COLORS = {
    "rgb8": None,
    "bgr8": cv2.COLOR_BGR2RGB,
    "rgba8": cv2.COLOR_RGBA2RGB,
    "bgra8": cv2.COLOR_BGRA2RGB,
}
MILLIMETRES = ("16UC1", "mono16")
METRES = "32FC1"
# Depth in metres as floats gets units of 0.1 mm; what lies beyond 6.5 m then counts as no reading.
MILLIMETRE_SCALE, FLOAT_SCALE = 1000.0, 10_000.0
LARGEST = np.iinfo(np.uint16).max
# of compressed_depth_image_transport: a format and the two parameters of its quantisation
HEADER = struct.Struct("<iff")
UNDISTORTED = ("", "plumb_bob", "rational_polynomial")
# As librealsense calls the first; the numbers of its inverse one are OpenCV's, too (librealsense #13824).
OF_REALSENSE = ("Brown Conrady", "Inverse Brown Conrady")
# In names of models that bend straight lines even where all coefficients are 0.
NO_PINHOLE = ("equidistant", "fisheye", "kannala", "omni", "theta")
# A rectification that turns by less moves no pixel by one.
TURN_RAD = 1e-3
Role = Literal["color", "depth"]


@dataclass(frozen=True)
class Spot:
    """Where an image comes from, for messages."""

    path: Path
    place: str

    def refusal(self, problem: str, mend: str) -> FormatError:
        """The error that names file and message."""
        return FormatError(problem, file=self.path, place=self.place, mend=mend)


# A message, and where it comes from.
Found = tuple[Any, Spot]


def pairs_of(path: Path, topics: Mapping[Role, str], pairs: Pairs) -> Iterator[tuple[int, Found, Found]]:
    """Of each depth image in a bag that has a partner: its number, itself, and the colour image beside it."""
    roles = {topic: role for role, topic in topics.items()}
    with Bag(path) as bag:
        items = (
            (roles[topic], number, (message, Spot(path, f"{topic}, message {number}")))
            for topic, number, _, message in bag.messages(list(roles))
        )
        yield from together(items, pairs)


def encoding(message: Any) -> str:
    """The encoding of a raw or a compressed image: "rgb8", "16UC1", ..."""
    if hasattr(message, "encoding"):
        return str(message.encoding)
    return str(message.format).split(";")[0].strip()


def role_of(message: Any) -> Role | None:
    """What an image can be, by its encoding; None where neither colour nor depth."""
    if not hasattr(message, "encoding"):
        return "depth" if "compressedDepth" in message.format or encoding(message) in MILLIMETRES else "color"
    kind = encoding(message)
    return "color" if kind in COLORS else "depth" if kind in (*MILLIMETRES, METRES) else None


def depth_scale(message: Any) -> float:
    """Units per metre [1/m] that `depth` gives."""
    return FLOAT_SCALE if encoding(message) == METRES else MILLIMETRE_SCALE


def color(message: Any, spot: Spot) -> Image:
    """The image in RGB, shape (H, W, 3).

    Raises:
        FormatError: no colour, or damaged.
    """
    if not hasattr(message, "encoding"):
        return decode_color(bytes(message.data), spot.path, spot.place)
    kind = encoding(message)
    if kind not in COLORS:
        mend = f"name a topic with {', '.join(COLORS)}; is depth named as color?"
        raise spot.refusal(f"its encoding is {kind!r}", mend)
    image = _rows(message, np.dtype(np.uint8), kind.count("a") + 3, spot)
    turn = COLORS[kind]
    return np.ascontiguousarray(image if turn is None else cv2.cvtColor(image, turn))


def depth(message: Any, spot: Spot) -> Units:
    """The depth in units of 1 / `depth_scale`, shape (H, W), 0 where there is no reading.

    Raises:
        FormatError: no depth, or damaged.
    """
    if not hasattr(message, "encoding"):
        return _decompressed(message, spot)
    kind = encoding(message)
    if kind in MILLIMETRES:
        return np.asarray(_rows(message, np.dtype(np.uint16), 1, spot)[..., 0], dtype=np.uint16)
    if kind != METRES:
        mend = f"name a topic with {', '.join((*MILLIMETRES, METRES))}; is color named as depth?"
        raise spot.refusal(f"its encoding is {kind!r}", mend)
    return _units(_rows(message, np.dtype(np.float32), 1, spot)[..., 0].astype(np.float64))


def lenses(
    info: Any, rectified: Mapping[Role, bool], given: Mapping[str, float], spot: Spot
) -> dict[Role, Lens]:
    """The camera of a CameraInfo for each image, one pinhole for all: its projection where one is rectified.

    CameraInfo speaks of the whole sensor; the images may be a part of it, binned.

    What a person has given of fx, fy, cx, cy [px] stands in the pinhole's matrix; where no image is rectified
    the distortion is about it.

    Raises:
        FormatError: not calibrated, a lens whose model is not known, or one image turned by rectification.
    """
    part, bent = _part(info), _numbers(info, "D")
    matrix = part @ _numbers(info, "K").reshape(3, 3)
    raw = not all(rectified.values())
    pinhole = part @ _numbers(info, "P").reshape(3, 4)[:, :3] if any(rectified.values()) else matrix
    for name, place in PINHOLE.items():
        pinhole[place] = given.get(name, pinhole[place])
    for used in (pinhole, matrix) if raw else (pinhole,):
        if not np.isfinite(used).all() or used[0, 0] <= 0 or used[1, 1] <= 0:
            raise spot.refusal(
                "the camera is not calibrated: its focal length is 0", "calibrate it, or give camera.fx"
            )
    model = info.distortion_model
    unknown = bent.any() and (model not in (*UNDISTORTED, *OF_REALSENSE) or len(bent) not in (4, 5, 8))
    if raw and (unknown or any(word in model.lower() for word in NO_PINHOLE)):
        problem = f"its lens is {model!r} with {len(bent)} numbers"
        raise spot.refusal(problem, f"record the rectified image, or {' or '.join(UNDISTORTED[1:])}")
    turn = _numbers(info, "R").reshape(3, 3)
    if raw and any(rectified.values()) and turn.any() and not np.allclose(turn, np.eye(3), atol=TURN_RAD):
        problem = "its rectification turns the image, and only one of color and depth is rectified"
        raise spot.refusal(problem, "name the topics of two rectified images, or of two raw ones")
    straight, curved = Lens(pinhole, np.zeros(0)), Lens(matrix, bent, pinhole)
    return {role: straight if flat else curved for role, flat in rectified.items()}


def size(info: Any) -> tuple[int, int]:
    """Width and height [px] of the images of a CameraInfo: of its part of the sensor, binned."""
    wide, high = info.roi.width or info.width, info.roi.height or info.height
    return int(wide) // max(info.binning_x, 1), int(high) // max(info.binning_y, 1)


def _part(info: Any) -> Floats:
    """What turns the sensor's pixels into the image's (3, 3), after CameraInfo's definition.

    First the part is cut out, then neighbours become one pixel; an integer is the middle of a pixel.
    """
    across, down = max(info.binning_x, 1), max(info.binning_y, 1)
    left, top = info.roi.x_offset, info.roi.y_offset
    return np.array(
        [
            [1 / across, 0, (0.5 - left) / across - 0.5],
            [0, 1 / down, (0.5 - top) / down - 0.5],
            [0, 0, 1],
        ]
    )


def _numbers(info: Any, name: str) -> Floats:
    """A field of CameraInfo, which ROS 1 writes large and ROS 2 small."""
    return np.array(getattr(info, name if hasattr(info, name) else name.lower()), dtype=np.float64)


def _rows(message: Any, kind: np.dtype[Any], channels: int, spot: Spot) -> Any:
    """The pixels (H, W, channels) of a raw image, whose rows may be padded."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * channels * kind.itemsize
    if min(height, width) < 1 or step < row or len(message.data) != height * step:
        problem = f"holds {len(message.data)} bytes for {width} x {height} pixels in rows of {step}"
        raise spot.refusal(problem, "record or copy it again")
    rows = np.asarray(message.data, dtype=np.uint8).reshape(height, step)[:, :row]
    ordered = kind.newbyteorder(">" if message.is_bigendian else "<")
    return np.ascontiguousarray(rows).view(ordered).reshape(height, width, channels).astype(kind)


def _decompressed(message: Any, spot: Spot) -> Units:
    """Depth of compressed_depth_image_transport, a header and a PNG, floats stored inverted; or of
    compressed_image_transport, a PNG of 16 bits alone."""
    data = bytes(message.data)
    if "compressedDepth" not in message.format and encoding(message) in MILLIMETRES:
        return decode_depth(data, spot.path, spot.place)
    if "compressedDepth" not in message.format:
        raise spot.refusal(
            f"its format is {message.format!r}", "name a topic of depth; is color named as depth?"
        )
    if "rvl" in message.format.lower():
        raise spot.refusal("RVL compression is not known", "republish it with png, or raw")
    if len(data) <= HEADER.size:
        raise spot.refusal("is truncated", "record or copy it again")
    image = decode_png(data[HEADER.size :], spot.path, spot.place)
    if image.ndim != 2 or image.dtype != np.uint16:
        raise spot.refusal("is no 16-bit depth", "name a topic of depth; is color named as depth?")
    if encoding(message) != METRES:
        return np.asarray(image, dtype=np.uint16)
    _, a, b = HEADER.unpack_from(data)
    with np.errstate(divide="ignore", invalid="ignore"):
        metres = np.where(image > 0, a / (image.astype(np.float64) - b), np.nan)
    return _units(metres)


def _units(metres: Floats) -> Units:
    """Depth [m] in units of 0.1 mm; what is no number, not positive or too far is no reading."""
    with np.errstate(invalid="ignore"):
        units = np.rint(metres * FLOAT_SCALE)
        seen = (units > 0) & (units <= LARGEST)
    return np.where(seen, units, 0).astype(np.uint16)
