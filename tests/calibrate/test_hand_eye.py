"""The camera's pose from a board on the tool, against the pose it was rendered from."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from calibrate import boards
from scipy.spatial.transform import Rotation

from dlolib.calibrate import calibrate_hand_eye, draw_hand_eye, put_into_capture, write_calibration
from dlolib.captures import open_capture
from dlolib.errors import DloError
from dlolib.types import Camera


def recorded(
    path: Path,
    board: dict[str, Any],
    arm: boards.Arm,
    tools: list[np.ndarray] | None = None,
    prefix: str = "end_",
) -> Path:
    """A calibration's folder of this arm, the robot's poses as they are or as given."""
    rng, ink = np.random.default_rng(1), boards.printed(board)
    folder = boards.folder(path, [boards.photograph([(ink, seen)], rng) for seen in arm.camera_from_board])
    (folder / "board.json").write_text(json.dumps(board))
    boards.write_poses(folder / "robot_poses.csv", tools or arm.tool, prefix)
    return folder


def off(found: np.ndarray, truth: np.ndarray, middle: np.ndarray) -> tuple[float, float]:
    """By how much two poses differ: a point of the camera's axes [mm], and the turn [degrees]."""
    place = np.linalg.norm(((found - truth) @ np.append(middle, 1.0))[:3])
    turn = Rotation.from_matrix(found[:3, :3].T @ truth[:3, :3]).magnitude()
    return 1e3 * float(place), float(np.degrees(turn))


@pytest.mark.parametrize(
    ("board", "limit_mm"), [(boards.CHARUCO, 0.15), (boards.GRID, 0.1)], ids=["charuco", "aruco"]
)
@pytest.mark.parametrize("prefix", ["end_", "tool_", ""])
def test_the_pose_that_was_rendered_comes_out(
    tmp_path: Path, board: dict[str, Any], limit_mm: float, prefix: str
) -> None:
    found = calibrate_hand_eye(recorded(tmp_path / "c", board, boards.arm(10), prefix=prefix))
    place, turn = off(found.world_from_camera, boards.VIEW, np.array([0, 0, 0.62]))
    assert place < limit_mm and turn < 0.03
    assert place < 5e3 * found.sd_m and found.residual_px.max() < 0.3
    assert found.doubts == () and found.unseen == () and len(found.frame) == 10


def test_prints_of_an_older_opencv_are_known_by_their_key(tmp_path: Path) -> None:
    """With an even number of rows the pattern of before 4.6 is another one."""
    board = boards.CHARUCO | {"squares": [6, 4], "legacy_pattern": True}
    folder = recorded(tmp_path / "c", board, boards.arm(6))
    found = calibrate_hand_eye(folder)
    assert off(found.world_from_camera, boards.VIEW, np.array([0, 0, 0.62]))[0] < 0.5
    (folder / "board.json").write_text(json.dumps(board | {"legacy_pattern": False}))
    with pytest.raises(DloError, match=r"found in 0 of 6 frames .*legacy_pattern for old prints"):
        calibrate_hand_eye(folder)


def test_the_robot_s_noise_shows_in_the_residual_and_in_the_deviation(tmp_path: Path) -> None:
    arm, rng = boards.arm(16), np.random.default_rng(5)
    tools = [tool @ boards.pose(rng.normal(0, 1e-3, 3), rng.normal(0, 2e-3, 3)) for tool in arm.tool]
    found = calibrate_hand_eye(recorded(tmp_path / "c", boards.GRID, arm, tools))
    place, turn = off(found.world_from_camera, boards.VIEW, np.array([0, 0, 0.62]))
    assert 1e-3 < np.sqrt(np.mean(found.residual_m**2)) < 4e-3
    assert place < 3e3 * found.sd_m and turn < 3 * np.degrees(found.sd_rad)
    assert 0.1e-3 < found.sd_m < 2e-3 and found.doubts == ()


@pytest.mark.parametrize(
    ("file", "wrong", "says"),
    [
        (
            "board.json",
            ('"square_m": 0.03', '"square_m": 0.0303'),
            r"board.json: square_m: .* with 0\.0(2999|3) m, -1\.0",
        ),
        (
            "capture.json",
            ("504.0", "514.08"),
            r"capture.json: camera.fx: .* with 50[345](\.\d)? pixels, -[12]\.\d",
        ),
    ],
)
def test_a_wrong_size_or_focal_length_is_doubted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, file: str, wrong: tuple[str, str], says: str
) -> None:
    """By one and by two percent: the camera then is 4 and 12 mm off, at a deviation of less than 1 mm."""
    folder = recorded(tmp_path / "c", boards.CHARUCO, boards.arm(10))
    (folder / file).write_text((folder / file).read_text().replace(*wrong))
    (doubt,) = calibrate_hand_eye(folder).doubts
    assert re.match(says, doubt) and doubt in caplog.text


def test_one_wrong_pose_spoils_its_own_frame_alone(tmp_path: Path) -> None:
    arm = boards.arm(14)
    tools = [*arm.tool[:5], boards.pose([0.01, 0, 0.01]) @ arm.tool[5], *arm.tool[6:]]
    found = calibrate_hand_eye(recorded(tmp_path / "c", boards.GRID, arm, tools))
    assert off(found.world_from_camera, boards.VIEW, np.array([0, 0, 0.62]))[0] < 1.0
    assert int(np.argmax(found.residual_m)) == 5 and found.doubts == ()


def test_it_is_written_into_a_capture(tmp_path: Path) -> None:
    from captures import foreign_samples

    found = calibrate_hand_eye(recorded(tmp_path / "c", boards.GRID, boards.arm(6)))
    capture = foreign_samples.own(tmp_path / "capture", foreign_samples.frames())
    before = json.loads((capture / "capture.json").read_text())
    put_into_capture(capture, found.world_from_camera)
    after = json.loads((capture / "capture.json").read_text())
    np.testing.assert_array_equal(
        open_capture(capture).index.camera.world_from_camera, found.world_from_camera
    )
    after["camera"]["world_from_camera"] = before["camera"]["world_from_camera"]
    assert after == before
    write_calibration(tmp_path / "calibration.json", found)
    written = json.loads((tmp_path / "calibration.json").read_text())
    assert written["camera"]["residual"]["mm"] < 0.3 and len(written["camera"]["frames"]) == 6
    draw_hand_eye(found, tmp_path / "camera.png")
    draw_hand_eye(found, tmp_path / "again.png")
    assert (tmp_path / "camera.png").read_bytes() == (tmp_path / "again.png").read_bytes()
    assert cv2.imread(str(tmp_path / "camera.png")).std() > 20


@pytest.mark.parametrize(
    ("pixels", "focal", "other"),
    [((32, 24), 30.0, False), ((64, 48), 60.0, False), ((64, 36), 60.0, False), ((64, 48), 46.0, True)],
    ids=["same", "finer", "cut", "other"],
)
def test_a_capture_of_another_camera_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, pixels: tuple[int, int], focal: float, other: bool
) -> None:
    """As where the board was seen in colour and the capture is of the depth camera beside it."""
    from captures import foreign_samples

    capture = foreign_samples.own(tmp_path / "capture", foreign_samples.frames())
    seen_by = Camera(np.eye(4), *pixels, focal, focal * 31 / 30)
    put_into_capture(capture, boards.VIEW, seen_by=seen_by)
    said = [record.getMessage() for record in caplog.records]
    assert len(said) == other and all("camera.fx: is 30 of 32 pixels, and 46 of 64 in" in one for one in said)


def change_board(**changes: Any) -> Callable[[Path], object]:
    return lambda folder: (folder / "board.json").write_text(json.dumps(boards.GRID | changes))


def change_poses(change: Callable[[str], str]) -> Callable[[Path], object]:
    path = "robot_poses.csv"
    return lambda folder: (folder / path).write_text(change((folder / path).read_text()))


def blind(folder: Path) -> None:
    for path in (folder / "color").iterdir():
        cv2.imwrite(str(path), np.full((boards.HEIGHT, boards.WIDTH, 3), 90, np.uint8))


def uncalibrated(folder: Path) -> None:
    text = (folder / "capture.json").read_text()
    (folder / "capture.json").write_text(text.replace('"fx": 504.0, ', ""))


def distorted(folder: Path) -> None:
    text = (folder / "capture.json").read_text()
    (folder / "capture.json").write_text(text.replace('"fx":', '"distortion": {"k1": -0.3}, "fx":'))


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (
            blind,
            "board.json: the board: the board is found in 0 of 6 frames that have a pose, 4 are needed",
        ),
        (change_board(dictionary="DICT_7X7_50"), "the board is found in 0 of 6 frames"),
        (
            change_board(dictionary="DICT_9X9"),
            "board.json: dictionary: unknown 'DICT_9X9'; choose from DICT_4X4_",
        ),
        (change_board(type="chess"), "board.json: type: Input should be 'charuco' or 'aruco', got 'chess'"),
        (change_board(squares=[4]), "board.json: squares"),
        (
            change_board(type="charuco", squares=[2, 6]),
            "board.json: squares: 5 inner corners are too few for a pose; give",
        ),
        (change_board(square_m=0.04, marker_m=0.0399999999), "is not less than square_m = 0.04; measure"),
        (change_board(square_m=50), "board.json: square_m"),
        (change_board(marker_m=1e-300), "board.json: marker_m"),
        (
            change_board(marker_m=0.06),
            "board.json: marker_m: 0.06 m is not less than square_m = 0.05; measure",
        ),
        (
            change_board(square_m=0.1, marker_m=0.08),
            "robot_poses.csv: residual: robot and camera disagree by",
        ),
        (lambda folder: (folder / "board.json").unlink(), "board.json: no such file (the board); add it"),
        (lambda folder: (folder / "robot_poses.csv").unlink(), "robot_poses.csv: no such file"),
        (
            change_poses(lambda text: text.replace("end_", "hand_")),
            "robot_poses.csv: line 1: no column end_x_m",
        ),
        (
            change_poses(lambda text: text.replace("\n0,", "\nzero,")),
            "line 2, column frame: 'zero' in a number's",
        ),
        (
            change_poses(lambda text: "\n".join(text.split("\n")[:3])),
            "is found in 2 of 2 frames that have a pose, 4",
        ),
        (uncalibrated, "capture.json: camera.fx: is not given; add it"),
        (distorted, "capture.json: camera.distortion: a capture's camera is a pinhole"),
    ],
)
def test_what_cannot_be_used_is_named(
    tmp_path: Path, taken: Path, spoil: Callable[[Path], object], says: str
) -> None:
    spoil(taken)
    with pytest.raises(DloError) as refusal:
        calibrate_hand_eye(taken)
    assert says in str(refusal.value) and "; " in str(refusal.value) and "\n" not in str(refusal.value)


@pytest.fixture
def taken(tmp_path: Path) -> Path:
    return recorded(tmp_path / "c", boards.GRID, boards.arm(6))


def test_turns_about_one_axis_are_not_enough(tmp_path: Path) -> None:
    with pytest.raises(DloError, match=r"about one axis and 0\.0° about a second; add frames"):
        calibrate_hand_eye(recorded(tmp_path / "c", boards.GRID, boards.arm(6, axes=1)))


def test_a_camera_on_the_tool_is_refused(tmp_path: Path) -> None:
    """The format knows one pose of a camera: here the tool carries it past a board that stands still."""
    arm = boards.arm(8)
    board, hand = boards.pose([0.3, 0.1, 0.2], [0.3, 0, 0.1]), boards.pose([0.02, 0.05, 0.03], [0, 0.2, 0])
    tools = [board @ np.linalg.inv(hand @ seen) for seen in arm.camera_from_board]
    with pytest.raises(
        DloError, match=r"arrangement: the camera rides on the tool and the board stands still"
    ):
        calibrate_hand_eye(recorded(tmp_path / "c", boards.GRID, arm, tools))


def test_poses_the_wrong_way_round_are_said_to_be_so(tmp_path: Path) -> None:
    """A camera that stands, the world's poses in the tool's axes: no equation tells this from the above."""
    arm = boards.arm(6)
    tools = [np.asarray(np.linalg.inv(tool)) for tool in arm.tool]
    with pytest.raises(DloError, match=r"or the poses are the wrong way round .* give the tool's poses in"):
        calibrate_hand_eye(recorded(tmp_path / "c", boards.GRID, arm, tools))
