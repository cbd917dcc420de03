"""Boards and markers as a known camera sees them in a known pose: a yardstick of the tests' own."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT, FOCAL = 640, 576, 504.0
MATRIX = np.array([[FOCAL, 0, 319.5], [0, FOCAL, 287.5], [0, 0, 1]])
FINE, PER_M = 3, 4000.0
# Looks along +y from 0.75 m, as in the paper.
VIEW = np.array([[1.0, 0, 0, 0.2], [0, 0, 1, -0.75], [0, -1, 0, -0.02], [0, 0, 0, 1]])
CHARUCO = {
    "type": "charuco",
    "squares": [7, 5],
    "square_m": 0.03,
    "marker_m": 0.022,
    "dictionary": "DICT_4X4_50",
}
GRID = {"type": "aruco", "squares": [4, 3], "square_m": 0.05, "marker_m": 0.04, "dictionary": "4X4_50"}
CYLINDER = {"shape": "cylinder", "radius_m": 0.03, "height_m": 0.06}


def pose(place: Any, turn: Any = (0.0, 0.0, 0.0)) -> np.ndarray:
    """A pose (4, 4) from a place [m] and a rotation vector [rad]."""
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), place
    return made


@dataclass(frozen=True)
class Print:
    """A picture on paper, `origin_m` from its first corner (right, down) to where its axes begin.

    Its axes are x right, y down, z into it, as boards have them.
    """

    ink: np.ndarray
    origin_m: tuple[float, float] = (0.0, 0.0)


def printed(board: Any) -> Print:
    """A board with a white margin of 10 mm."""
    across, down = board["squares"]
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    if board["type"] == "charuco":
        drawn: Any = cv2.aruco.CharucoBoard((across, down), board["square_m"], board["marker_m"], words)
        drawn.setLegacyPattern(board.get("legacy_pattern", False))
        size = np.array([across, down]) * board["square_m"]
    else:
        gap = board["square_m"] - board["marker_m"]
        drawn = cv2.aruco.GridBoard((across, down), board["marker_m"], gap, words)
        size = np.array([across, down]) * board["square_m"] - gap
    ink = drawn.generateImage(tuple(np.round(size * PER_M).astype(int).tolist()))
    return Print(cv2.copyMakeBorder(ink, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255), (0.01, 0.01))


def marker(number: int, side_m: float) -> Print:
    """One marker with a white margin of 10 mm, its axes' origin in its middle."""
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    ink = cv2.aruco.generateImageMarker(words, number, round(side_m * PER_M))
    ink = cv2.copyMakeBorder(ink, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255)
    return Print(ink, (0.01 + side_m / 2,) * 2)


def photograph(
    things: list[tuple[Print, np.ndarray]], rng: np.random.Generator, noise: float = 4.0, back_m: float = 1.2
) -> tuple[np.ndarray, np.ndarray]:
    """Colour (H, W, 3), each pixel the mean over its area, and depth (H, W) [mm] of prints at their poses."""
    grey = np.full((HEIGHT * FINE, WIDTH * FINE), 60, np.uint8)
    depth = np.full((HEIGHT, WIDTH), back_m)
    fine = np.array([[FINE, 0, (FINE - 1) / 2], [0, FINE, (FINE - 1) / 2], [0, 0, 1]])
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    rays = np.stack(
        [(columns - MATRIX[0, 2]) / FOCAL, (rows - MATRIX[1, 2]) / FOCAL, np.ones(rows.shape)], -1
    )
    for thing, camera_from_print in things:
        # a pixel of the print, counted at its middle, in metres of its axes
        metres = np.array(
            [
                [1 / PER_M, 0, 0.5 / PER_M - thing.origin_m[0]],
                [0, 1 / PER_M, 0.5 / PER_M - thing.origin_m[1]],
                [0, 0, 1],
            ]
        )
        flat = fine @ MATRIX @ np.delete(camera_from_print[:3], 2, axis=1) @ metres
        size = (WIDTH * FINE, HEIGHT * FINE)
        cover = cv2.warpPerspective(np.full_like(thing.ink, 255), flat, size, flags=cv2.INTER_AREA)
        shown = cv2.warpPerspective(thing.ink, flat, size, flags=cv2.INTER_LINEAR)
        grey = np.where(cover > 127, shown, grey)
        normal = camera_from_print[:3, 2]
        plane = normal @ camera_from_print[:3, 3] / (rays @ normal)
        inside = cv2.resize(cover, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA) > 127
        depth = np.where(inside, plane, depth)
    small = cv2.resize(grey, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(float)
    small = cv2.GaussianBlur(small, (0, 0), 0.6) + rng.normal(0, noise, small.shape)
    color = np.repeat(np.clip(small, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    noisy = depth + rng.normal(size=depth.shape) * 8e-4 * (depth / 0.7) ** 2
    return color, np.round(1000 * noisy).astype(np.uint16)


def folder(path: Path, shots: list[tuple[np.ndarray, np.ndarray]], view: np.ndarray | None = None) -> Path:
    """A folder of frames; capture.json says nothing but the camera."""
    (path / "color").mkdir(parents=True)
    (path / "depth").mkdir()
    rows = ["frame,t_s,color,depth"]
    for number, (color, depth) in enumerate(shots):
        name = f"{number:06d}.png"
        cv2.imwrite(str(path / "color" / name), color)
        cv2.imwrite(str(path / "depth" / name), depth)
        rows.append(f"{number},{number},color/{name},depth/{name}")
    (path / "frames.csv").write_text("\n".join(rows) + "\n")
    camera: dict[str, Any] = {
        "width": WIDTH,
        "height": HEIGHT,
        "fx": FOCAL,
        "fy": FOCAL,
        "cx": 319.5,
        "cy": 287.5,
    }
    camera |= {"depth_scale": 1000.0}
    if view is not None:
        camera["world_from_camera"] = view.tolist()
    (path / "capture.json").write_text(json.dumps({"format": "dlo-capture/1", "camera": camera}))
    return path


def write_poses(path: Path, poses: list[np.ndarray], prefix: str = "end_") -> None:
    """robot_poses.csv."""
    names = [f"{prefix}{axis}_m" for axis in "xyz"] + [f"{prefix}q{axis}" for axis in "wxyz"]
    rows = [",".join(["frame", *names])]
    for number, one in enumerate(poses):
        turn = Rotation.from_matrix(one[:3, :3]).as_quat(scalar_first=True)
        rows.append(
            ",".join(repr(float(value)) for value in (number, *one[:3, 3], *turn)).replace(".0,", ",", 1)
        )
    path.write_text("\n".join(rows) + "\n")


@dataclass(frozen=True)
class Arm:
    """Poses of a tool that turns a board before the camera, and what carries what."""

    tool: list[np.ndarray]
    tool_from_board: np.ndarray
    camera_from_board: list[np.ndarray]


def arm(count: int, seed: int = 0, axes: int = 3, turn: float = 0.4) -> Arm:
    """A board on the tool before a camera at VIEW; turned about `axes` axes."""
    rng = np.random.default_rng(seed)
    tool_from_board = pose([-0.105, -0.06, 0.05], [0.1, -0.2, 0.3])
    facing = np.linalg.inv(tool_from_board)
    tools, seen = [], []
    for _ in range(count):
        vector = np.zeros(3)
        vector[:axes] = rng.uniform(-turn, turn, axes)
        middle = pose([0, 0, rng.uniform(0.5, 0.75)], vector)
        middle[:2, 3] = rng.uniform(-0.08, 0.08, 2)
        camera_from_board = middle @ pose([-0.105, -0.075, 0])
        tools.append(VIEW @ camera_from_board @ facing)
        seen.append(camera_from_board)
    return Arm(tools, tool_from_board, seen)
