"""What a person gives beside a recording made elsewhere and does not fit it: refused in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from captures import foreign_samples as foreign
from captures.foreign_samples import Ros
from captures.refusals import Refusals

from dlolib.cli import run

FREE = {"ends": {"start": "free", "end": "free"}}
HELD = {"ends": {"start": "clamped", "end": "clamped"}}


@pytest.mark.parametrize("depth", ["32FC1", "inverse"])
def test_units_of_depth_that_is_in_metres(tmp_path: Path, refused: Refusals, depth: str) -> None:
    source = foreign.bag(tmp_path / "source.bag", foreign.frames(), Ros(depth=depth))
    says = "camera.depth_scale: 1000 units per metre, but this source's depth is in metres; leave it out"
    refused(source, says)
    foreign.given(refused.about, camera=foreign.camera_of(10_000.0))
    assert refused.status(source)[0] == 0


def test_ends_whose_motion_nobody_gives(tmp_path: Path, refused: Refusals) -> None:
    foreign.given(refused.about, **HELD)
    shot = foreign.frames()
    source = foreign.bag(tmp_path / "source.bag", shot, Ros(), foreign.motion(shot))
    refused(
        source,
        "motion: does not say how the held ends move; give --motion CSV, or --topic motion=NAME: /tcp_pose",
    )
    refused(
        source,
        "object.json: start: the motion needs the pose of the start",
        "--topic",
        f"motion={foreign.TOOL}",
    )
    foreign.given(refused.about, **FREE)
    refused(source, "ends: both ends are free, but a motion is given", "--topic", f"motion={foreign.TOOL}")


def test_an_obstacle_around_a_clamp(tmp_path: Path, refused: Refusals) -> None:
    sphere = {"shape": "sphere", "center_m": [0.0, 0.01, 0.0], "radius_m": 0.03}
    foreign.given(refused.about, **HELD, obstacles=[sphere])
    shot = foreign.frames()
    csv = foreign.elsewhere(tmp_path, foreign.motion(shot))
    says = "robot.csv: t_s = 1700000000.02: the clamped start is 20.0 mm inside obstacle 0 (sphere)"
    refused(foreign.redwood(tmp_path / "source", shot), says, "--motion", str(csv))


def test_a_lens_that_distorts(tmp_path: Path, refused: Refusals) -> None:
    foreign.given(refused.about, camera={**foreign.camera_of(), "distortion": [-0.3, 0.1, 0, 0, 0]})
    says = "object.json: camera.distortion: a capture's camera is a pinhole: undistort the images"
    refused(foreign.tum(tmp_path / "source", foreign.frames()), says)


def test_options_that_do_not_fit(tmp_path: Path, refused: Refusals) -> None:
    source = foreign.tum(tmp_path / "source", foreign.frames())
    refused(source, "has no topic of 'depth'; leave it out", "--topic", "depth=/depth")
    refused(foreign.own(tmp_path / "own", foreign.frames()), "--object: a capture folder has no topics")


def test_nobody_says_what_was_recorded(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    source = foreign.redwood(tmp_path / "source", foreign.frames())
    assert run(["ingest", str(source), "--out", str(tmp_path / "out")]) == 2
    assert (
        "source: object: does not say which object was recorded; give --object FILE" in capfd.readouterr().err
    )
    assert sorted(tmp_path.iterdir()) == [source]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"object": {"name": "rope"}}, "object.json: object.length_m"),
        ({"camera": {"fx": 0}}, "object.json: camera.fx"),
        ({"camera": {"world_from_camera": [[1]]}}, "object.json: camera.world_from_camera: is no 4 x 4"),
        ({"tool_from_grasp": [[2]]}, "object.json: tool_from_grasp: is no 4 x 4"),
        ({"start": {"position_m": [0, 0, 0], "quaternion": [0, 0, 0, 0]}}, "object.json: start.quaternion"),
        ({"format": "dlo-layout/1"}, "object.json: format"),
    ],
)
def test_an_object_that_is_none(
    tmp_path: Path, refused: Refusals, changes: dict[str, Any], says: str
) -> None:
    foreign.given(refused.about, **changes)
    refused(foreign.redwood(tmp_path / "source", foreign.frames()), says)


def test_images_of_the_empty_scene_that_do_not_fit(tmp_path: Path, refused: Refusals) -> None:
    source = foreign.redwood(tmp_path / "source", foreign.frames())
    foreign.given(refused.about, background_depth="empty.png")
    refused(source, "empty.png: no such file (background_depth of object.json)")
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((12, 16), 700, np.uint16))
    refused(source, "empty.png: is 16 x 12 pixels, the camera 32 x 24")
    outside = tmp_path / "scene"
    outside.mkdir()
    foreign.given(outside / "object.json", background_depth="empty.png")
    (outside / "empty.png").symlink_to(tmp_path / "empty.png")
    refused.about = outside / "object.json"
    refused(source, "scene/empty.png: is a link that leads out of the folder")
    foreign.given(refused.about, background_color="../empty.png")
    refused(source, "object.json: background_color: '../empty.png' is no path within its folder")


@pytest.mark.parametrize(
    ("optics", "says"),
    [
        ({"fx": 0.9}, "camera.fx: 0.9 for 32 pixels would be a view of 174 degrees; give it in pixels"),
        ({"fy": 1e6}, "camera.fy: 1e+06 for 24 pixels"),
        ({"cx": 1e4}, "camera.cx: 10000 is far outside of 32 pixels"),
    ],
)
def test_optics_that_no_camera_has(
    tmp_path: Path, refused: Refusals, optics: dict[str, float], says: str
) -> None:
    shot = foreign.frames()
    foreign.given(refused.about, **FREE, camera=foreign.camera_of(**optics))
    refused(foreign.redwood(tmp_path / "source", shot), says)
    own = foreign.own(tmp_path / "own", shot)
    index = json.loads((own / "capture.json").read_text())
    index["camera"] |= optics
    (own / "capture.json").write_text(json.dumps(index))
    for command in ("ingest", "chain"):
        assert run([command, str(own), "--out", str(tmp_path / "out")]) == 2
        assert says in refused.capfd.readouterr().err


def test_a_tool_beside_a_table_of_the_ends_poses(tmp_path: Path, refused: Refusals) -> None:
    shot = foreign.frames()
    moved = foreign.motion(shot)
    grasp = np.eye(4)
    grasp[2, 3] = 0.1
    foreign.given(refused.about, **HELD, camera=foreign.camera_of(), tool_from_grasp=grasp.tolist())
    csv = foreign.elsewhere(tmp_path, moved)
    says = "object.json: tool_from_grasp: counts with --topic motion=NAME alone: robot.csv holds the poses"
    refused(foreign.tum(tmp_path / "source", shot), says, "--motion", str(csv))
