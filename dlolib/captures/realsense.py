"""RealSense recordings (.bag) through Open3D, which aligns depth to colour."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from dlolib.captures.foreign import Asked, FramesAlone, Shot
from dlolib.errors import FormatError

# Of the file's first bytes: librealsense names its topics by device.
MAGIC, TOPIC, HEAD = b"#ROSBAG V2.0", b"/device_0/", 1 << 20


@dataclass(frozen=True)
class RealSense(FramesAlone):
    """The first colour and depth stream, as one camera."""

    kind: ClassVar[str] = "RealSense recording (.bag)"

    path: Path
    count: int
    optics: Mapping[str, float]

    @classmethod
    def matches(cls, path: Path) -> bool:
        """A ROS 1 bag whose topics are librealsense's."""
        if not path.is_file() or path.suffix != ".bag":
            return False
        with path.open("rb") as file:
            head = file.read(HEAD)
        return head.startswith(MAGIC) and TOPIC in head

    @classmethod
    def open(cls, path: Path, asked: Asked) -> Self:
        """Read what librealsense says of the streams."""
        reader = _reader(path)
        about = reader.metadata
        reader.close()
        matrix = np.asarray(about.intrinsics.intrinsic_matrix)
        optics = {"width": float(about.width), "height": float(about.height)}
        optics |= {"fx": float(matrix[0, 0]), "fy": float(matrix[1, 1])}
        optics |= {"cx": float(matrix[0, 2]), "cy": float(matrix[1, 2])}
        optics["depth_scale"] = float(about.depth_scale)
        return cls(path, round(about.stream_length_usec * 1e-6 * about.fps), optics)

    def shots(self) -> Iterator[Shot]:
        """One aligned pair after the other, at librealsense's time."""
        reader = _reader(self.path)
        number = 0
        while not reader.is_eof():
            frame = reader.next_frame()
            if reader.is_eof() or frame.is_empty():
                break
            color = np.ascontiguousarray(frame.color.as_tensor().numpy(), dtype=np.uint8)
            depth = np.ascontiguousarray(frame.depth.as_tensor().numpy()[..., 0], dtype=np.uint16)
            t_s = reader.get_timestamp() / 10**6
            yield Shot(t_s, self.path, f"frame {number}", color, depth)
            number += 1
        reader.close()


def _reader(path: Path) -> Any:
    """Open3D's reader; it throws or answers False at what it cannot read."""
    from dlolib.o3d import open3d

    reader = open3d.t.io.RSBagReader()
    try:
        opened = reader.open(str(path))
    except RuntimeError:
        opened = False
    if not opened:
        mend = "record 8-bit RGB and 16-bit depth at one rate, or copy it again"
        raise FormatError("librealsense cannot read it", file=path, place="streams", mend=mend)
    return reader
