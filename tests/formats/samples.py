"""Small valid inputs, made anew in a test's own folder, for the test to spoil."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from dlolib.formats import write_capture_index, write_layout, write_recording
from dlolib.types import (
    Camera,
    CaptureIndex,
    Ends,
    Layout,
    Motion,
    Obstacle,
    Points,
    Pose,
    Recording,
    Rope,
)

ROPE = Rope("rope", 0.445, 0.008, 0.04)
GRAVITY = np.array([0.0, 0.0, -9.81])
TANGENT_X = np.array([0.5, 0.5, 0.5, 0.5])
CYLINDER = Obstacle(
    "cylinder",
    {"center_m": (0.2, 0.0, 0.15), "axis": (0.0, 1.0, 0.0), "radius_m": (0.03,), "height_m": (0.06,)},
)


def motion(rows: int = 5) -> Motion:
    """The end comes 40 mm nearer in `rows` seconds."""
    end = np.zeros((rows, 3))
    end[:, 0] = np.linspace(0.42, 0.38, rows)
    still = np.zeros((rows, 3))
    turns = np.tile(TANGENT_X, (rows, 1))
    return Motion(np.arange(rows, dtype=np.float64), still, turns, end, turns.copy())


def recording() -> Recording:
    """Three frames of ten points on an arc that sags."""
    share = np.linspace(0, 1, 10)
    frames = []
    for frame in range(3):
        span = 0.42 - 0.01 * frame
        frames.append(np.stack([span * share, 0 * share, -0.2 * share * (1 - share)], axis=-1))
    number = np.repeat(np.arange(3), 10)
    points = Points(number, number.astype(np.float64), np.tile(0.445 * share, 3), np.concatenate(frames))
    return Recording("small", ROPE, GRAVITY, Ends(), motion(), points, (CYLINDER,))


def recording_folder(folder: Path) -> Path:
    """A valid recording."""
    write_recording(recording(), folder)
    return folder


def layout() -> Layout:
    """A goal that hangs below a cylinder."""
    share = np.linspace(0, 1, 12)
    goal = np.stack([0.4 * share, 0 * share, -0.3 * share * (1 - share)], axis=-1)
    s_m = 0.445 * share
    start, grasp = Pose(np.zeros(3), TANGENT_X), Pose(np.array([0.42, 0.0, 0.05]), TANGENT_X)
    return Layout("small", ROPE, GRAVITY, Ends(), (CYLINDER,), start, grasp, s_m, goal)


def layout_folder(folder: Path) -> Path:
    """A valid layout."""
    write_layout(layout(), folder)
    return folder


def capture_folder(folder: Path, frames: int = 2) -> Path:
    """A valid capture of 360 x 160: a white arc 0.7 m away on black, its plate 30 mm behind."""
    (folder / "color").mkdir(parents=True)
    (folder / "depth").mkdir()
    view = np.array([[1.0, 0, 0, 0], [0, 0, 1, -0.7], [0, -1, 0, 0], [0, 0, 0, 1]])
    camera = Camera(view, 360, 160, 500.0, 500.0, 30.0, 40.0, 1000.0)
    share = np.linspace(0, 1, 60)
    names = [f"{frame:06d}.png" for frame in range(frames)]
    for frame, name in enumerate(names):
        x, z = (0.42 - 0.01 * frame) * share, -0.25 * share * (1 - share)
        pixels = np.stack([30 + 500 * x / 0.7, 40 - 500 * z / 0.7], axis=-1)
        drawn = np.zeros((160, 360), np.uint8)
        cv2.polylines(drawn, [np.round(pixels).astype(np.int32)], False, 255, 6)
        depth = np.where(drawn > 0, 696, 730).astype(np.uint16)
        cv2.imwrite(str(folder / "color" / name), np.repeat(drawn[:, :, None], 3, axis=2))
        cv2.imwrite(str(folder / "depth" / name), depth)
    index = CaptureIndex(
        name="small",
        folder=folder,
        rope=ROPE,
        gravity_m_s2=GRAVITY,
        ends=Ends(),
        camera=camera,
        frame=np.arange(frames),
        t_s=np.arange(frames, dtype=np.float64),
        color=tuple(folder / "color" / name for name in names),
        depth=tuple(folder / "depth" / name for name in names),
        motion=motion(),
    )
    write_capture_index(index, folder)
    return folder


def set_key(path: Path, key: str, value: Any) -> None:
    """Replace a dotted key of a JSON file."""
    content = json.loads(path.read_text())
    *parents, last = key.split(".")
    inner = content
    for parent in parents:
        inner = inner[int(parent)] if isinstance(inner, list) else inner[parent]
    inner[last] = value
    path.write_text(json.dumps(content))


def set_cell(path: Path, line: int, column: str, value: str) -> None:
    """Replace one cell of a CSV; the header is line 1."""
    lines = path.read_text().splitlines()
    cells = lines[line - 1].split(",")
    cells[lines[0].split(",").index(column)] = value
    lines[line - 1] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")


def scale_columns(path: Path, suffix: str, factor: float) -> None:
    """Multiply every column whose name ends so: metres become millimetres."""
    lines = [line.split(",") for line in path.read_text().splitlines()]
    for index, name in enumerate(lines[0]):
        if name.endswith(suffix):
            for row in lines[1:]:
                row[index] = repr(float(row[index]) * factor) if row[index] else ""
    path.write_text("\n".join(",".join(row) for row in lines) + "\n")
