"""Obstacles from markers, against where they were rendered."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from calibrate import boards
from captures import foreign_samples
from scipy.spatial.transform import Rotation

from dlolib.calibrate import draw_obstacles, find_obstacles, put_into_capture, write_calibration
from dlolib.calibrate.folder import read_shots
from dlolib.calibrate.marker import markers
from dlolib.calibrate.plane_pose import projected
from dlolib.captures import open_capture
from dlolib.errors import DloError, FormatError

SIDE = 0.04
# A marker's axes (x right, y up, z out of it) where its print has x right, y down, z into it.
FLIP = np.diag([1.0, -1, -1, 1])
FACING = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def where(x: float, turn: Any = (0.2, 0.15, 0.1)) -> np.ndarray:
    """world_from_marker of one that faces the camera, turned a little."""
    pose = boards.pose([x, -0.06, -0.05])
    pose[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ FACING
    return pose


PLACES = {3: where(0.15), 4: where(0.25, (-0.1, 0.2, 0))}


def recorded(path: Path, count: int = 4, depth: bool = True, noise: float = 4.0, **changes: Any) -> Path:
    """Two cylinders of the paper, 100 mm apart, markers in the middle of their tops."""
    rng = np.random.default_rng(2)
    eye = np.linalg.inv(boards.VIEW)
    things = [(boards.marker(number, SIDE), eye @ pose @ FLIP) for number, pose in PLACES.items()]
    folder = boards.folder(path, [boards.photograph(things, rng, noise) for _ in range(count)], boards.VIEW)
    if not depth:
        without_depth(folder)
    return describe(folder, **changes)


def without_depth(folder: Path) -> None:
    lines = (folder / "frames.csv").read_text().splitlines()
    (folder / "frames.csv").write_text("\n".join(line.rsplit(",", 1)[0] for line in lines) + "\n")


def describe(folder: Path, **changes: Any) -> Path:
    listed = [{"id": number, "obstacle": boards.CYLINDER} for number in PLACES]
    content = {"dictionary": "DICT_4X4_50", "marker_m": SIDE, "markers": listed} | changes
    (folder / "markers.json").write_text(json.dumps(content))
    return folder


@pytest.mark.parametrize(
    ("depth", "limit_mm", "limit_degrees"), [(True, 0.5, 0.6), (False, 1.0, 1.0)], ids=["depth", "colour"]
)
def test_cylinders_stand_where_they_were_rendered(
    tmp_path: Path, depth: bool, limit_mm: float, limit_degrees: float
) -> None:
    obstacles = find_obstacles(recorded(tmp_path / "c", depth=depth))
    assert [found.marker for found in obstacles] == list(PLACES)
    for found in obstacles:
        truth = PLACES[found.marker]
        values = found.obstacle.values
        centre = (truth @ [0, 0, -boards.CYLINDER["height_m"] / 2, 1])[:3]
        assert 1e3 * np.linalg.norm(np.array(values["center_m"]) - centre) < limit_mm
        assert np.degrees(np.arccos(np.clip(truth[:3, 2] @ values["axis"], -1, 1))) < limit_degrees
        assert values["radius_m"] == (0.03,) and values["height_m"] == (0.06,)
        assert found.frames == 4 and found.corner_px < 0.1
        assert (found.depth_m is None) != depth and found.scatter_m is not None and found.scatter_m < 1e-3


def test_other_shapes_and_places_follow_their_marker(tmp_path: Path) -> None:
    turn = Rotation.from_rotvec([0, 0, 0.5]).as_quat(scalar_first=True).tolist()
    box = {"shape": "box", "center_m": [0.1, 0, 0], "quaternion": turn, "size_m": [0.1, 0.02, 0.03]}
    plane = {"shape": "plane", "point_m": [0, 0, -0.001], "normal": [0, 0, 1]}
    listed = [{"id": 3, "obstacle": box}, {"id": 4, "obstacle": plane}]
    first, second = (one.obstacle.values for one in find_obstacles(recorded(tmp_path / "c", markers=listed)))
    np.testing.assert_allclose(first["center_m"], (PLACES[3] @ [0.1, 0, 0, 1])[:3], atol=1e-3)
    got = Rotation.from_quat(first["quaternion"], scalar_first=True).as_matrix()
    own = Rotation.from_rotvec([0, 0, 0.5]).as_matrix()
    np.testing.assert_allclose(got, PLACES[3][:3, :3] @ own, atol=0.01)
    np.testing.assert_allclose(second["normal"], PLACES[4][:3, 2], atol=0.01)
    assert "center_m" not in second


def seen_from(distance_m: float, tilt_rad: float, path: Path, depth: bool, count: int = 1) -> Path:
    """A folder of one marker at this distance, tilted about the camera's vertical axis."""
    rng = np.random.default_rng(5)
    pose = boards.pose([0.25, boards.VIEW[1, 3] + distance_m, -0.05])
    pose[:3, :3] = Rotation.from_rotvec([0, 0.3 * tilt_rad, tilt_rad]).as_matrix() @ FACING
    thing = [(boards.marker(3, SIDE), np.linalg.inv(boards.VIEW) @ pose @ FLIP)]
    shots = [boards.photograph(thing, rng, back_m=distance_m + 0.2) for _ in range(count)]
    folder = boards.folder(path, shots, boards.VIEW)
    if not depth:
        without_depth(folder)
    return describe(folder, markers=[{"id": 3, "obstacle": boards.CYLINDER}])


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("tilt_rad", [-0.3, 0.2, 0.4])
def test_of_two_poses_that_show_the_same_corners_none_is_taken(
    tmp_path: Path, tilt_rad: float, count: int
) -> None:
    """Of a small marker from afar: more frames do not tell, depth does."""
    with pytest.raises(FormatError, match=r"marker 3: two poses, turned by \d+ degrees, show the same"):
        find_obstacles(seen_from(1.2, tilt_rad, tmp_path / "color", depth=False, count=count))
    (found,) = find_obstacles(seen_from(1.2, tilt_rad, tmp_path / "depth", depth=True, count=count))
    upright = Rotation.from_rotvec([0, 0.3 * tilt_rad, tilt_rad]).as_matrix() @ FACING[:, 2]
    assert np.degrees(np.arccos(np.clip(upright @ found.obstacle.values["axis"], -1, 1))) < 4


@pytest.mark.parametrize("tilt_rad", [-0.3, 0.0, 0.02, 0.2, 0.4])
def test_from_near_one_pose_is_clear_without_depth(tmp_path: Path, tilt_rad: float) -> None:
    """Also where both poses are nearly one, as the marker faces the camera."""
    (found,) = find_obstacles(seen_from(0.45, tilt_rad, tmp_path / "color", depth=False))
    upright = Rotation.from_rotvec([0, 0.3 * tilt_rad, tilt_rad]).as_matrix() @ FACING[:, 2]
    assert np.degrees(np.arccos(np.clip(upright @ found.obstacle.values["axis"], -1, 1))) < 2


def test_a_marker_s_corners_are_not_drawn_inwards() -> None:
    """OpenCV's own are off by half a pixel on these, inwards by a third."""
    rng, half = np.random.default_rng(0), SIDE / 2
    square = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    for _ in range(10):
        pose = boards.pose([*rng.uniform(-0.1, 0.1, 2), rng.uniform(0.5, 0.8)], rng.uniform(-0.5, 0.5, 3))
        color, _ = boards.photograph([(boards.marker(7, SIDE), pose)], rng)
        words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        found = markers(color, words)[7]
        assert np.linalg.norm(found - projected(pose, square, boards.MATRIX), axis=1).max() < 0.15


def test_it_is_written_into_a_capture_and_drawn(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "c", 2)
    found = find_obstacles(folder)
    capture = foreign_samples.own(tmp_path / "capture", foreign_samples.frames())
    put_into_capture(capture, None, found)
    index = open_capture(capture).index
    assert [obstacle.shape for obstacle in index.obstacles] == ["cylinder", "cylinder"]
    np.testing.assert_allclose(index.obstacles[0].values["center_m"], found[0].obstacle.values["center_m"])
    np.testing.assert_array_equal(index.camera.world_from_camera, foreign_samples.VIEW)
    write_calibration(tmp_path / "calibration.json", None, found)
    written = json.loads((tmp_path / "calibration.json").read_text())
    assert written["obstacles"][1]["residual"]["px"] < 0.1
    draw_obstacles(found, read_shots(folder), boards.VIEW, tmp_path / "obstacles.png")
    assert cv2.imread(str(tmp_path / "obstacles.png")).std() > 20


def test_a_capture_whose_camera_is_null_is_refused(tmp_path: Path) -> None:
    capture = foreign_samples.own(tmp_path / "capture", foreign_samples.frames())
    content = json.loads((capture / "capture.json").read_text())
    (capture / "capture.json").write_text(json.dumps(content | {"camera": None}))
    with pytest.raises(FormatError, match=r"capture\.json: camera: is null; give width, height"):
        put_into_capture(capture, foreign_samples.VIEW)


def moved(folder: Path) -> None:
    path = folder / "color/000001.png"
    cv2.imwrite(str(path), np.roll(cv2.imread(str(path)), 12, axis=1))


def beside_a_board(folder: Path) -> None:
    about = {"type": "charuco", "squares": [7, 5], "square_m": 0.03, "marker_m": 0.022}
    (folder / "board.json").write_text(json.dumps(about | {"dictionary": "4X4_100"}))


def unplaced(folder: Path) -> None:
    path = folder / "capture.json"
    content = json.loads(path.read_text())
    del content["camera"]["world_from_camera"]
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (
            lambda f: describe(f, dictionary="DICT_6X6_50"),
            "markers.json: markers: marker 3 is in none of the 2 frames",
        ),
        (
            lambda f: describe(f, markers=[{"id": 9, "obstacle": boards.CYLINDER}]),
            "marker 9 is in none of the 2 frames, others are: 3, 4; check dictionary and id",
        ),
        (
            lambda f: describe(f, markers=[{"id": 3, "obstacle": {"shape": "cone"}}]),
            "markers.0.obstacle: unknown shape",
        ),
        (
            lambda f: describe(f, markers=[{"id": 3, "obstacle": boards.CYLINDER | {"radius_m": -1}}]),
            "markers.0.obstacle: cylinder: radius_m = -1 is not positive; give a length in metres",
        ),
        (
            lambda f: describe(f, markers=[{"id": 3, "obstacle": boards.CYLINDER | {"axis": [0, 1, 0]}}]),
            "markers.0.obstacle: cylinder: center_m = None; give 3 numbers",
        ),
        (
            lambda f: describe(
                f, markers=[{"id": 3, "obstacle": boards.CYLINDER | {"center_m": [0, 0, -0.03]}}]
            ),
            "markers.0.obstacle: cylinder: axis = None; give 3 numbers",
        ),
        (
            lambda f: describe(f, markers=[{"id": 3, "obstacle": boards.CYLINDER}] * 2),
            "markers.json: markers.1: marker 3 has this obstacle already; correct its id",
        ),
        (lambda f: describe(f, marker_m=40), "markers.json: marker_m"),
        (lambda f: describe(f, marker_m=0.05), "marker 3: as a square of 0.05 m has corners that are off by"),
        (moved, "marker 3: moves by"),
        (unplaced, "capture.json: camera.world_from_camera: is not given; add it, or calibrate"),
        (lambda f: (f / "markers.json").write_text("{"), "markers.json: is not JSON"),
        (lambda f: (f / "markers.json").write_text("[" * 200000), "markers.json: is not JSON"),
        (
            beside_a_board,
            "markers.json: markers: marker 3 is on the board of board.json, too; print one",
        ),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path: Path, spoil: Callable[[Path], object], says: str) -> None:
    spoil(folder := recorded(tmp_path / "c", 2))
    with pytest.raises(DloError) as refusal:
        find_obstacles(folder)
    assert says in str(refusal.value) and "; " in str(refusal.value) and "\n" not in str(refusal.value)
