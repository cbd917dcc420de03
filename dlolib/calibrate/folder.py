"""A folder of frames for calibration: images, the camera's optics, what else lies beside them.

It is a capture's folder of which less is asked: no rope, no motion, and the camera's pose may be what is
sought.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.captures.base import Depth, Image
from dlolib.captures.pictures import read_color, read_depth
from dlolib.errors import FormatError

# The border's own readers, not yet among its public names.
from dlolib.formats._json import checked, existing, read_json
from dlolib.formats._schema import LARGEST_M, MILLIMETRES, UNIT_TOLERANCE, Strict
from dlolib.formats._table import Table, check_rising, check_whole, read_table
from dlolib.formats.capture import FORM
from dlolib.formats.given import GivenCamera
from dlolib.formats.recording import parse_view
from dlolib.types import Camera, Floats, Ints

OPTICS = ("width", "height", "fx", "fy", "cx", "cy")
# What the tool's columns may begin with: those of an end in motion.csv, or the tool's own.
PREFIXES = ("end_", "start_", "tool_", "")


class CameraOnly(Strict):
    """Of capture.json what calibration needs."""

    camera: GivenCamera


@dataclass(frozen=True)
class Shots:
    """The frames of a folder, images unread.

    camera: world_from_camera is the identity where nobody says it, `placed` whether somebody does.
    frame (F,); color, and depth where there is such a column: a path a frame.
    """

    folder: Path
    camera: Camera
    placed: bool
    frame: Ints
    color: tuple[Path, ...]
    depth: tuple[Path, ...] | None

    @property
    def matrix(self) -> Floats:
        """The camera's matrix (3, 3) [px]."""
        camera = self.camera
        return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], dtype=np.float64)

    def picture(self, row: int) -> Image:
        """The colour image (H, W, 3)."""
        return read_color(self.color[row], self.camera)

    def metres(self, row: int) -> Depth | None:
        """The depth image (H, W) [m], or None."""
        return None if self.depth is None else read_depth(self.depth[row], self.camera)


def read_shots(folder: Path) -> Shots:
    """Read capture.json and frames.csv of a calibration's folder; every image that they name exists.

    Raises:
        FormatError: names the file, its line or key, and the mend.
    """
    folder = Path(folder)
    path = folder / "capture.json"
    given = checked(CameraOnly, read_json(path, FORM), path).camera
    table = read_table(folder / "frames.csv", ["frame"], texts=("color", "depth"), optional=("depth",))
    check_rising(table, "frame")
    color, depth = _paths(table, "color", folder), None
    if any(table.texts.get("depth", ())):
        depth = _paths(table, "depth", folder)
    for name in (*OPTICS, *(["depth_scale"] if depth else [])):
        if getattr(given, name) is None:
            raise FormatError("is not given", file=path, place=f"camera.{name}", mend="add it")
    view = given.world_from_camera
    camera = Camera(
        np.eye(4) if view is None else parse_view(view, path),
        **{name: getattr(given, name) for name in (*OPTICS, "depth_scale")},
    )
    return Shots(folder, camera, view is not None, check_whole(table, "frame"), color, depth)


def read_tool_poses(csv: Path) -> dict[int, Floats]:
    """world_from_tool (4, 4) of each frame in robot_poses.csv.

    Raises:
        FormatError: names file, line and column.
    """
    header = (
        existing(csv, "the tool's poses").read_text(encoding="utf-8-sig", errors="replace").split("\n")[0]
    )
    names = [name.strip() for name in header.split(",")]
    prefix = next((p for p in PREFIXES if f"{p}x_m" in names), PREFIXES[0])
    place = [f"{prefix}{axis}_m" for axis in "xyz"]
    turn = [f"{prefix}q{axis}" for axis in "wxyz"]
    table = read_table(csv, ["frame", *place, *turn])
    frame = check_whole(table, "frame")
    check_rising(table, "frame")
    xyz, quaternion = table.stack(place), table.stack(turn)
    far = np.argwhere(np.abs(xyz) > LARGEST_M)
    if far.size:
        row, column = (int(index) for index in far[0])
        raise table.refusal(row, place[column], f"{xyz[row, column]:g} m", MILLIMETRES)
    bad = np.flatnonzero(np.abs(np.linalg.norm(quaternion, axis=1) - 1) > UNIT_TOLERANCE)
    if bad.size:
        problem = "the quaternion's length is not 1"
        raise table.refusal(int(bad[0]), turn[0], problem, "give (w, x, y, z) of length 1")
    poses = np.tile(np.eye(4), (len(frame), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    poses[:, :3, 3] = xyz
    return dict(zip(frame.tolist(), poses, strict=True))


def read_object(path: Path, what: str) -> dict[str, Any]:
    """The JSON object in a file that has no `format`.

    Raises:
        FormatError: no such file, or no JSON object.
    """
    try:
        content = json.loads(existing(path, what).read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"is not JSON: {error}"[:120], file=path, mend="mend it there") from error
    if not isinstance(content, dict):
        raise FormatError("holds no JSON object", file=path, mend="begin with {")
    return content


def _paths(table: Table, name: str, folder: Path) -> tuple[Path, ...]:
    """One existing file a frame, within the folder."""
    paths = []
    for row, cell in enumerate(table.texts[name]):
        if not cell or PurePosixPath(cell).is_absolute() or ".." in PurePosixPath(cell).parts:
            problem = f"{cell!r} is no path within the folder"
            raise table.refusal(row, name, problem, "give one relative to it")
        if not (folder / cell).is_file():
            raise table.refusal(row, name, f"no such file: {cell}", "add it or remove the row")
        paths.append(folder / cell)
    return tuple(paths)
