"""What a capture says about itself."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from formats import samples

from dlolib.errors import FormatError
from dlolib.formats import read_capture_index, write_capture_index


def test_round_trip(tmp_path: Path) -> None:
    index = read_capture_index(samples.capture_folder(tmp_path / "c"))
    assert index.color is not None and index.depth is not None and index.cloud is None
    assert [path.name for path in index.color] == ["000000.png", "000001.png"]
    before = {path.name: path.read_bytes() for path in index.folder.glob("*.*")}
    assert set(before) == {"capture.json", "frames.csv", "motion.csv"}
    write_capture_index(index, index.folder)
    assert before == {path.name: path.read_bytes() for path in index.folder.glob("*.*")}


def test_a_clock_that_counts_from_1970_is_kept(tmp_path: Path) -> None:
    index = read_capture_index(samples.capture_folder(tmp_path / "c"))
    assert index.motion is not None
    times = 1_700_000_000.123456 + np.array([0.0, 1 / 30])
    motion = dataclasses.replace(index.motion, t_s=1_700_000_000.1 + np.arange(5) / 500)
    write_capture_index(dataclasses.replace(index, t_s=times, motion=motion), index.folder)
    again = read_capture_index(index.folder)
    assert again.motion is not None
    np.testing.assert_array_equal(again.t_s, times)
    np.testing.assert_array_equal(again.motion.t_s, motion.t_s)


def test_optional_keys_survive(tmp_path: Path) -> None:
    plain = read_capture_index(samples.capture_folder(tmp_path / "c"))
    assert plain.color is not None
    index = dataclasses.replace(
        plain,
        background_color=plain.color[0],
        rope_color_hsv=((0, 0, 200), (179, 40, 255)),
        mask=plain.color,
        static_frames=(0, 0),
        heldout_frames=(1, 1),
        rate_hz=15.0,
        quasi_static=False,
    )
    write_capture_index(index, index.folder)
    again = read_capture_index(index.folder)
    for name in ("background_color", "rope_color_hsv", "mask", "static_frames", "rate_hz", "quasi_static"):
        assert getattr(again, name) == getattr(index, name), name


def refused(folder: Path, name: str) -> str:
    with pytest.raises(FormatError) as caught:
        read_capture_index(folder)
    line = str(caught.value)
    assert line.startswith(str(folder / name)) and "; " in line
    return line


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("camera.fx", 0, "camera.fx: Input should be greater than 0, got 0"),
        ("camera.fy", None, "camera.fy: null; images need it"),
        ("camera.width", 640.5, "camera.width"),
        ("camera.width", 10**400, "camera.width: Input should be less than or equal to 100000"),
        ("camera.distortion", [-0.3, 0.1, 0, 0, 0], "camera.distortion: a capture's camera is a pinhole"),
        ("camera.distortion", {"k1": -0.3}, "a capture's camera is a pinhole: undistort the images"),
        ("camera.depth_scale", 0.001, "looks like metres per unit; give 1000"),
        ("camera.world_from_camera", [[1, 0, 0, 0]] * 4, "camera.world_from_camera: is no 4 x 4"),
        ("camera.world_from_camera", [[1, 0, 0, 0], [0, 1, 0]], "camera.world_from_camera: is no 4 x 4"),
        ("camera.world_from_camera", np.diag([1.0, 1, -1, 1]).tolist(), "is no rotation"),
        ("camera.world_from_camera", (np.eye(4) + 700 * np.eye(4, k=3)).tolist(), "like millimetres"),
        ("background_color", "../secret.png", "background_color: '../secret.png' is no path within"),
        (
            "rope_color_hsv",
            [[0, 0, 0], [180, 0, 0]],
            "rope_color_hsv.1.0: Input should be less than or equal",
        ),
        (
            "rope_color_hsv",
            [[0, 0, 0], [0, 300, 0]],
            "rope_color_hsv.1.1: Input should be less than or equal",
        ),
        (
            "rope_color_hsv",
            [[170, 200, 0], [10, 100, 255]],
            "rope_color_hsv: the low saturation is above the high one: give [low, high]",
        ),
        ("rope_color_hsv", [[170, 0, 200], [10, 100, 100]], "the low value is above the high one"),
        ("static_frames", [1, 0], "static_frames: [1, 0] ends before it begins"),
        ("heldout_frames", [2, 60], "heldout_frames: [2, 60] names no frame of frames.csv"),
    ],
)
def test_a_bad_key_is_named(tmp_path: Path, key: str, value: Any, says: str) -> None:
    folder = samples.capture_folder(tmp_path / "c")
    samples.set_key(folder / "capture.json", key, value)
    assert says in refused(folder, "capture.json")


@pytest.mark.parametrize("none", [[0, 0, 0, 0, 0], {"k1": 0.0}, None])
def test_a_camera_may_say_that_it_has_no_distortion(tmp_path: Path, none: Any) -> None:
    folder = samples.capture_folder(tmp_path / "c")
    samples.set_key(folder / "capture.json", "camera.distortion", none)
    read_capture_index(folder)


@pytest.mark.parametrize(
    ("line", "column", "value", "says"),
    [
        (3, "color", "color/000009.png", "line 3, column color: no such file: color/000009.png"),
        (3, "color", "/etc/hostname", "is no path within the capture"),
        (3, "depth", "", "line 3, column depth: names no file; give one in every row, or in none"),
        (3, "t_s", "0", "two rows with the same t_s = 0"),
        (3, "frame", "0", "two rows with the same frame = 0"),
    ],
)
def test_a_bad_frame_is_named(tmp_path: Path, line: int, column: str, value: str, says: str) -> None:
    folder = samples.capture_folder(tmp_path / "c")
    samples.set_cell(folder / "frames.csv", line, column, value)
    assert says in refused(folder, "frames.csv")


def test_a_capture_without_pictures(tmp_path: Path) -> None:
    folder = samples.capture_folder(tmp_path / "c")
    (folder / "frames.csv").write_text("frame,t_s,color\n0,0,color/000000.png\n")
    assert "no column depth; give the columns color and depth, or cloud" in refused(folder, "frames.csv")


def test_only_free_ends_may_lack_a_motion(tmp_path: Path) -> None:
    folder = samples.capture_folder(tmp_path / "c")
    (folder / "motion.csv").unlink()
    assert "no such file" in refused(folder, "motion.csv")
    samples.set_key(folder / "capture.json", "ends", {"start": "free", "end": "free"})
    assert read_capture_index(folder).motion is None


def test_an_obstacle_around_a_clamp(tmp_path: Path) -> None:
    folder = samples.capture_folder(tmp_path / "c")
    sphere = {"shape": "sphere", "center_m": [0.0, 0.01, 0.0], "radius_m": 0.03}
    samples.set_key(folder / "capture.json", "obstacles", [sphere])
    assert "t_s = 0: the clamped start is 20.0 mm inside obstacle 0" in refused(folder, "motion.csv")
