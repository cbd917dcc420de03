"""A capture folder with segmented point clouds (PLY, metres, camera axes)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import numpy as np

from dlolib.captures.base import Frame
from dlolib.errors import FormatError
from dlolib.types import CaptureIndex, Floats

FURTHEST_M = 30.0
BYTES = {"char": 1, "uchar": 1, "short": 2, "ushort": 2, "int": 4, "uint": 4, "float": 4, "double": 8}
BYTES |= {"int8": 1, "uint8": 1, "int16": 2, "uint16": 2, "int32": 4, "uint32": 4, "float32": 4, "float64": 8}


@dataclass(frozen=True)
class CloudFolder:
    """Frames with a cloud [m] (N, 3)."""

    index: CaptureIndex

    def frames(self) -> Iterator[Frame]:
        """Read one frame after the other; a `FormatError` names the cloud that cannot be used."""
        index = self.index
        assert index.cloud is not None
        for row, frame in enumerate(index.frame):
            path = index.cloud[row]
            yield Frame(int(frame), float(index.t_s[row]), path, cloud_m=read_cloud(path))


def read_cloud(path: Path) -> Floats:
    """Points [m] of a PLY in camera axes, shape (N, 3), N ≥ 1; points that are not finite are left out.

    Raises:
        FormatError: no PLY, truncated, empty, behind the camera, or not in metres.
    """
    # It takes a second to load.
    from dlolib.o3d import open3d

    count = _promised(path.read_bytes(), path)
    points = np.asarray(open3d.io.read_point_cloud(path, format="ply").points, dtype=np.float64)
    if len(points) != count or count == 0:
        problem = f"holds {len(points)} points where its header promises {count}"
        raise FormatError(problem, file=path, mend="record or copy it again")
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        raise FormatError("holds no finite point", file=path, mend="remove the frame from frames.csv")
    if np.median(points[:, 2]) <= 0:
        mend = "give camera axes: x right, y down, z forward"
        raise FormatError("the points lie behind the camera (z ≤ 0)", file=path, mend=mend)
    if np.median(points[:, 2]) > FURTHEST_M:
        problem = f"the points are {np.median(points[:, 2]):.4g} m away"
        raise FormatError(problem, file=path, mend="looks like millimetres; divide by 1000")
    return points[points[:, 2] > 0]


def _promised(data: bytes, path: Path) -> int:
    """The number of vertices in a PLY that is long enough for them: Open3D fills up a short one."""
    end = re.search(rb"end_header\r?\n", data)
    header = data[: end.start()].decode("ascii", errors="replace").split("\n") if end else []
    words = [line.split() for line in header]
    counts = [int(w[2]) for w in words if w[:2] == ["element", "vertex"] and len(w) == 3 and w[2].isdigit()]
    if not data.startswith(b"ply") or end is None or len(counts) != 1:
        raise FormatError("is no PLY with vertices", file=path, mend="save the cloud as PLY")
    first = next(number for number, word in enumerate(words) if word[:2] == ["element", "vertex"])
    properties = list(takewhile(lambda word: word[:1] == ["property"], words[first + 1 :]))
    odd = next((word for word in properties if len(word) != 3 or word[1] not in BYTES), None)
    lacking = [axis for axis in "xyz" if axis not in [word[-1] for word in properties]]
    if odd or lacking:
        problem = f"no number {lacking[0]}" if lacking else f"{' '.join(odd or ())!r} is no number"
        mend = "save the points as x, y and z"
        raise FormatError(f"{problem} of its vertices", file=path, place="header", mend=mend)
    sizes = [BYTES[word[1]] for word in properties]
    binary = any(word[:1] == ["format"] and word[1].startswith("binary") for word in words if len(word) > 1)
    body = data[end.end() :]
    held = len(body) // max(sum(sizes), 1) if binary else len(body.split()) // max(len(sizes), 1)
    if held < counts[0]:
        raise FormatError(
            f"is truncated: {held} points where its header promises {counts[0]}",
            file=path,
            mend="record or copy it again",
        )
    return counts[0]
