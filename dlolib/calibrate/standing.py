"""Obstacles from AR markers: where each marker is seen, what stands where it sits is known.

The paper (Section V.B): "We used AR markers to predetermine the positions of the cylinders and removed them
before moving the rope." Here markers.json says what each marker sits on, in the marker's own axes: x right,
y up, z out of its face, the origin in its middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from dlolib.calibrate.board import BOARD, LARGEST_M, dictionary, family, read_board
from dlolib.calibrate.folder import Shots, read_object, read_shots
from dlolib.calibrate.marker import markers
from dlolib.calibrate.plane_pose import PlanePose, plane_pose
from dlolib.errors import FormatError
from dlolib.formats._json import checked
from dlolib.formats._schema import Strict, parse_obstacle
from dlolib.progress import track
from dlolib.types import Floats, Obstacle

MARKERS = "markers.json"
# A marker that wanders more between frames was moved; corners that fit worse are no square of this size.
STILL_PX, WORST_PX = 3.0, 2.0
# Off the marker's outline, where depth mixes with what is behind; fewer readings tell no plane.
MARGIN, LEAST_READINGS = 0.15, 30
POINTS, DIRECTIONS = ("center_m", "point_m"), ("axis", "normal")


class MarkerModel(Strict):
    """One marker: its number, and the obstacle that it sits on, in its axes."""

    id: int = Field(ge=0)
    obstacle: dict[str, Any]


class MarkersModel(Strict):
    """markers.json."""

    dictionary: str
    marker_m: float = Field(gt=0, le=LARGEST_M)
    markers: list[MarkerModel] = Field(min_length=1)


@dataclass(frozen=True)
class FoundObstacle:
    """An obstacle in world axes, and how well its marker was seen.

    world_from_marker (4, 4); frames: in how many it was found; corner_px: RMS of its corners; scatter_m and
    scatter_rad: RMS over the frames, each on its own, None with one frame; depth_m: RMS of the face's depth
    readings about the marker's plane, None without depth. pixel (4, 2): its corners, the frames' mean.
    """

    marker: int
    obstacle: Obstacle
    world_from_marker: Floats
    frames: int
    corner_px: float
    scatter_m: float | None
    scatter_rad: float | None
    depth_m: float | None
    pixel: Floats


def find_obstacles(folder: Path, world_from_camera: Floats | None = None) -> tuple[FoundObstacle, ...]:
    """Find the obstacles of markers.json in a folder of frames whose camera and markers stand still.

    Args:
        folder: frames, capture.json and markers.json.
        world_from_camera: the camera's pose (4, 4); None takes that of capture.json.

    Raises:
        FormatError: a file that cannot be used, a marker that is not found, was moved, is no square of this
            size, or has two poses that show it alike; names the file, the place and the mend.
    """
    shots, path = read_shots(folder), Path(folder) / MARKERS
    if world_from_camera is None and not shots.placed:
        mend = "add it, or calibrate the camera first (robot_poses.csv and board.json)"
        place = "camera.world_from_camera"
        raise FormatError("is not given", file=shots.folder / "capture.json", place=place, mend=mend)
    view = shots.camera.world_from_camera if world_from_camera is None else world_from_camera
    model = checked(MarkersModel, read_object(path, "the markers"), path)
    for number, marker in enumerate(model.markers):
        if marker in model.markers[:number]:
            # a line that was copied for the next marker: that one's obstacle would be missing
            problem, mend = f"marker {marker.id} has this obstacle already", "correct its id, or remove it"
            raise FormatError(problem, file=path, place=f"markers.{number}", mend=mend)
    obstacles = [_in_marker(marker, number, path) for number, marker in enumerate(model.markers)]
    corners = _corners(shots, model, path)
    face = _depth(shots)
    return tuple(
        _placed(marker.id, own, corners[marker.id], face, shots, model.marker_m, view, path)
        for marker, own in zip(model.markers, obstacles, strict=True)
    )


def _in_marker(marker: MarkerModel, number: int, path: Path) -> Obstacle:
    """The obstacle in the marker's axes; a cylinder has the marker on its top's middle unless it says so."""
    given = dict(marker.obstacle)
    height = given.get("height_m")
    try:
        # one of the two alone tells of a marker elsewhere, and nothing of the other
        unsaid = not {"center_m", "axis"} & given.keys()
        if given.get("shape") == "cylinder" and unsaid and isinstance(height, int | float):
            given |= {"center_m": [0.0, 0.0, -height / 2], "axis": [0.0, 0.0, 1.0]}
        return parse_obstacle(given, "")
    except (ValueError, OverflowError) as error:
        problem, _, mend = str(error).partition("; ")
        place = f"markers.{number}.obstacle"
        raise FormatError(problem, file=path, place=place, mend=mend or "correct the value") from error


def _corners(shots: Shots, model: MarkersModel, path: Path) -> dict[int, Floats]:
    """The corners (frames, 4, 2) [px] of each marker, in the frames where it is found."""
    words = dictionary(model.dictionary, path)
    _check_board(shots.folder / BOARD, model, path)
    seen: dict[int, list[Floats]] = {marker.id: [] for marker in model.markers}
    others: set[int] = set()
    for row in track(range(len(shots.frame)), "finding the markers", len(shots.frame)):
        for number, corners in markers(shots.picture(row), words).items():
            if number in seen:
                seen[number].append(corners)
            else:
                others.add(number)
    for number, listed in seen.items():
        if not listed:
            also = f", others are: {', '.join(map(str, sorted(others)))}" if others else ""
            problem = f"marker {number} is in none of the {len(shots.frame)} frames{also}"
            mend = "check dictionary and id, or record it nearer, sharper, with its white margin and but once"
            raise FormatError(problem, file=path, place="markers", mend=mend)
    return {number: np.array(listed) for number, listed in seen.items()}


def _check_board(board: Path, model: MarkersModel, path: Path) -> None:
    """Refuse a marker that the folder's board has, too: nobody knows which of the two is seen."""
    if not board.is_file():
        return
    there = read_board(board)
    printed = {family(there.model.dictionary): set(there.drawn.getIds().ravel().tolist())}
    taken = printed.get(family(model.dictionary), set()) & {marker.id for marker in model.markers}
    if taken:
        problem = f"marker {min(taken)} is on the board of {board.name}, too"
        mend = f"print one above {max(printed[family(model.dictionary)])}, or of another dictionary"
        raise FormatError(problem, file=path, place="markers", mend=mend)


def _depth(shots: Shots) -> Floats | None:
    """The median depth (H, W) [m] over the frames, NaN where there is no reading; None without depth."""
    images = [image for row in range(len(shots.frame)) if (image := shots.metres(row)) is not None]
    if not images:
        return None
    stack = np.where(np.array(images) > 0, images, np.nan)
    seen = np.isfinite(stack).any(axis=0)
    median = np.full(seen.shape, np.nan)
    median[seen] = np.nanmedian(stack[:, seen], axis=0)
    return median


def _placed(
    number: int,
    own: Obstacle,
    corners: Floats,
    depth: Floats | None,
    shots: Shots,
    side_m: float,
    view: Floats,
    path: Path,
) -> FoundObstacle:
    """One marker's pose from all frames, and the obstacle in world axes."""
    place = f"marker {number}"
    mean = corners.mean(axis=0)
    moved = float(np.linalg.norm(corners - mean, axis=2).max())
    if moved > STILL_PX:
        problem = f"moves by {moved:.1f} px between the frames"
        raise FormatError(problem, file=path, place=place, mend="leave markers and camera where they stand")
    face = None if depth is None else _face(mean, depth, shots.matrix)
    pose = _pose(mean, side_m, shots.matrix, face)
    if pose is None or pose.corner_px > WORST_PX:
        fits = "no pose" if pose is None else f"corners that are off by {pose.corner_px:.1f} px"
        problem = f"as a square of {side_m:g} m has {fits}"
        raise FormatError(
            problem, file=path, place=place, mend="measure marker_m, its black square's side; check camera.fx"
        )
    # More frames do not tell: what draws a corner aside draws it the same way in all.
    if not pose.is_clear:
        problem = f"two poses, turned by {np.degrees(pose.apart_rad):.0f} degrees, show the same corners"
        raise FormatError(problem, file=path, place=place, mend="give depth, or record it nearer")
    each = [one.camera_from_target for c in corners if (one := _pose(c, side_m, shots.matrix, face))]
    scatter_m, scatter_rad = _scatter(np.array(each))
    world = view @ pose.camera_from_target
    return FoundObstacle(
        number,
        in_world(own, world),
        world,
        len(corners),
        pose.corner_px,
        scatter_m,
        scatter_rad,
        pose.depth_m,
        mean,
    )


def _pose(corners: Floats, side_m: float, matrix: Floats, face: Floats | None) -> PlanePose | None:
    half = side_m / 2
    # OpenCV goes round from the first corner, top left, as the eye does
    square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    return plane_pose(square, corners, matrix, face)


def _face(corners: Floats, depth: Floats, matrix: Floats) -> Floats | None:
    """Points (N, 3) [m] on a marker's face; None where there are too few readings."""
    inner = corners.mean(axis=0) + (1 - 2 * MARGIN) * (corners - corners.mean(axis=0))
    mask = np.zeros(depth.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round(inner).astype(np.int32), 1)
    rows, columns = np.nonzero((mask > 0) & np.isfinite(depth))
    if len(rows) < LEAST_READINGS:
        return None
    z = depth[rows, columns]
    near = np.abs(z - np.median(z)) < 0.5 * np.median(z)
    rows, columns, z = rows[near], columns[near], z[near]
    rays = [(columns - matrix[0, 2]) / matrix[0, 0], (rows - matrix[1, 2]) / matrix[1, 1], np.ones(len(z))]
    return np.stack(rays, axis=-1) * z[:, None]


def _scatter(poses: Floats) -> tuple[float | None, float | None]:
    """RMS over the frames of place [m] and of the face's direction [rad]."""
    if len(poses) < 2:
        return None, None
    away = poses[:, :3, 3] - poses[:, :3, 3].mean(axis=0)
    turns = Rotation.from_matrix(poses[:, :3, :3])
    turned = (turns.mean().inv() * turns).magnitude()
    return float(np.sqrt(np.mean(np.sum(away**2, axis=1)))), float(np.sqrt(np.mean(turned**2)))


def in_world(own: Obstacle, world_from_marker: Floats) -> Obstacle:
    """An obstacle from its marker's axes to the world's: points, directions and quaternions turn with it."""
    turn, place = world_from_marker[:3, :3], world_from_marker[:3, 3]
    values: dict[str, tuple[float, ...]] = {}
    for name, given in own.values.items():
        numbers = np.array(given)
        if name in POINTS:
            numbers = turn @ numbers + place
        elif name in DIRECTIONS:
            numbers = turn @ numbers
        elif name == "quaternion":
            turned = Rotation.from_matrix(turn) * Rotation.from_quat(numbers, scalar_first=True)
            numbers = turned.as_quat(scalar_first=True)
        values[name] = tuple(float(number) for number in numbers)
    return Obstacle(own.shape, values)
