"""Bags that cannot be used: status 2, one line with file, place and mend, nothing written."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from captures import foreign_samples as foreign
from captures.foreign_samples import Ros
from captures.refusals import Refusals, told

from dlolib.cli import run

Spoil = Callable[[Path], object]
ROS = ("ros1", "ros2", "mcap")


def place(tmp_path: Path, kind: str) -> Path:
    return tmp_path / ("source.bag" if kind == "ros1" else "source")


@pytest.mark.parametrize("kind", ROS)
@pytest.mark.parametrize(
    ("change", "options", "says"),
    [
        ({"backwards": True}, (), f"{foreign.COLOR}, image 1: time goes back from 17"),
        (
            {"color": "mono8"},
            (),
            "color: no topic has images of color: /camera/aligned_depth_to_color/image_raw has '16UC1', "
            "/camera/color/image_raw has 'mono8'; record one with rgb8, bgr8",
        ),
        (
            {"color": "mono8"},
            ("--topic", f"color={foreign.COLOR}"),
            "no topic of color: /camera/color/image_raw has 'mono8'; choose from none",
        ),
        (
            {"second_depth": True},
            (),
            f"depth: 2 topics can be depth; name one: --topic depth=NAME, of {foreign.DEPTH}, /other/depth",
        ),
        (
            {},
            ("--topic", "depth=/nowhere"),
            f"--topic depth=/nowhere: no topic of depth; choose from {foreign.DEPTH}",
        ),
        (
            {},
            ("--topic", f"depth={foreign.COLOR}", "--topic", f"color={foreign.DEPTH}"),
            f"no topic of color: {foreign.DEPTH} has '16UC1'; choose from {foreign.COLOR}",
        ),
        ({}, ("--topic", "camera_info=/info"), f"no topic of camera_info; choose from {foreign.INFO}"),
        ({}, ("--topic", "smell=/nose"), "no topic of 'smell'; choose from color, depth, camera_info"),
        ({}, ("--topic", "depth"), "--topic depth: no role or no name; write ROLE=NAME"),
        ({"info": False}, (), "object.json: camera.width: the recording does not say width"),
        ({"distortion": (0.1,) * 3}, (), "its lens is 'plumb_bob'"),
        ({"model": "equidistant", "distortion": (0.0,) * 4}, (), "its lens is 'equidistant' with 4 numbers"),
        (
            {},
            ("--topic", "camera_pose=/tf"),
            "no frame ''; choose from /tcp_pose, /tf:base, /tf:eye, /tf:tool",
        ),
        (
            {"info_frame": "wrist", "info_topic": "/wrist/camera_info"},
            (),
            "/wrist/camera_info: is of 'wrist', the images are of 'camera'; name it if it is right",
        ),
        (
            {"eye": "camera"},
            ("--topic", "camera_pose=/tf:base"),
            "the images are of the frame 'camera', which has other axes; name /tf:camera",
        ),
        (
            {},
            ("--topic", f"motion={foreign.TOOL}", "--motion", "motion.csv"),
            "--motion, --topic: the motion is given twice; give one of them",
        ),
        (
            {},
            ("--topic", f"motion={foreign.COLOR}"),
            "is of type sensor_msgs/msg/Image, no pose; choose from",
        ),
    ],
)
def test_bags(
    tmp_path: Path, refused: Refusals, kind: str, change: dict[str, Any], options: tuple[str, ...], says: str
) -> None:
    foreign.given(refused.about)
    shot = foreign.frames()
    source = foreign.bag(place(tmp_path, kind), shot, Ros(kind, **change), foreign.motion(shot))
    refused(source, says, *options)


@pytest.mark.parametrize(
    ("change", "motion", "says"),
    [
        (
            {"tool_links": ("base", "cart")},
            "/tf:tool",
            "tf, frame tool: hangs on several frames: 'base', 'cart'",
        ),
        (
            {"bases_link": "odom"},
            "/tf:tool",
            "motion=/tf:tool: the camera's pose is in 'world', the motion in 'odom'",
        ),
        (
            {"tool_frames": ("arm",)},
            foreign.TOOL,
            "the camera's pose is in 'world', the motion in 'arm'; name poses",
        ),
        (
            {"tool_frames": ("arm", "leg")},
            foreign.TOOL,
            "tcp_pose: its poses are in several frames: 'arm', 'leg'",
        ),
        (
            {"bodies": ("tool", "helmet")},
            foreign.BODY,
            "/mocap: its poses are of several bodies: 'helmet', 'tool'; record each on a topic of its own",
        ),
        ({"bodies": ("tool",)}, foreign.BODY, ""),
        ({"tool_frames": ("",)}, foreign.TOOL, ""),
        ({}, foreign.TOOL, ""),
    ],
    ids=told,
)
def test_poses_in_two_frames(
    tmp_path: Path, refused: Refusals, change: dict[str, Any], motion: str, says: str
) -> None:
    foreign.given(refused.about, ends={"start": "free", "end": "clamped"}, camera={})
    shot = foreign.frames()
    source = foreign.bag(tmp_path / "source.bag", shot, Ros(**change), foreign.motion(shot))
    status, line = refused.status(source, "--topic", "camera_pose=/tf:eye", "--topic", f"motion={motion}")
    assert status == (2 if says else 0) and says in line


def test_frames_that_differ_by_a_slash_are_the_same(tmp_path: Path, refused: Refusals) -> None:
    foreign.given(refused.about)
    how = Ros(depth_frame="/camera", info_frame="/camera", info_topic="/elsewhere/camera_info")
    bag = foreign.bag(tmp_path / "source.bag", foreign.frames(), how)
    assert refused.status(bag)[0] == 0


def test_a_motion_in_millimetres(tmp_path: Path, refused: Refusals) -> None:
    foreign.given(refused.about, ends={"start": "free", "end": "clamped"})
    shot = foreign.frames()
    moved = foreign.motion(shot)
    far = replace(moved, end_m=1000 * moved.end_m)
    source = foreign.bag(tmp_path / "source.bag", shot, Ros(), far)
    says = "source.bag: as motion.csv, line 2, column end_x_m: 420 m; looks like millimetres; divide by 1000"
    refused(source, says, "--topic", f"motion={foreign.TOOL}")


def test_depth_of_another_viewpoint(tmp_path: Path, refused: Refusals) -> None:
    shot = foreign.frames()
    source = foreign.bag(tmp_path / "source.bag", replace(shot, depth=shot.depth[:, ::2, ::2]), Ros())
    refused(source, "depth is 16 x 12 from 'camera', color 32 x 24 from 'camera': they have different viewp")
    source = foreign.bag(tmp_path / "infrared.bag", foreign.frames(), Ros(depth_frame="infrared"))
    refused(
        source, "depth is 32 x 24 from 'infrared', color 32 x 24 from 'camera': they have different viewp"
    )


@pytest.mark.parametrize("kind", ROS)
def test_truncated_bags(tmp_path: Path, refused: Refusals, kind: str) -> None:
    source = foreign.bag(place(tmp_path, kind), foreign.frames(), Ros(kind))
    file = source if kind == "ros1" else next(path for path in source.iterdir() if path.suffix != ".yaml")
    whole = file.read_bytes()
    for share in (0.0, 0.001, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99):
        file.write_bytes(whole[: int(share * len(whole))])
        refused(source, str(source))


@pytest.mark.parametrize("kind", ROS)
def test_damaged_bags_never_end_in_a_traceback(tmp_path: Path, refused: Refusals, kind: str) -> None:
    source = foreign.bag(place(tmp_path, kind), foreign.frames(2), Ros(kind))
    rng = np.random.default_rng(3)
    ends = []
    for file in [source] if kind == "ros1" else sorted(source.iterdir()):
        whole = file.read_bytes()
        for _ in range(12):
            spoilt = bytearray(whole)
            for at in rng.integers(0, len(whole), 8):
                spoilt[at] ^= int(rng.integers(1, 256))
            file.write_bytes(bytes(spoilt))
            ends.append(refused.status(source)[0])
        file.write_bytes(whole)
    assert 2 in ends
    assert refused.status(source)[0] == 0


def test_metadata_that_points_outside(tmp_path: Path, refused: Refusals) -> None:
    source = foreign.bag(tmp_path / "source", foreign.frames(), Ros("ros2"))
    stored = next(source.glob("*.db3"))
    stored.rename(tmp_path / "secret.db3")
    text = (source / "metadata.yaml").read_text()
    (source / "metadata.yaml").write_text(text.replace(stored.name, "../secret.db3"))
    refused(source, f"{source}: the bag: cannot be read: Some database files are missing")


def test_what_is_no_recording(tmp_path: Path, refused: Refusals) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    refused(tmp_path / "notes.txt", "notes.txt: is in no known format; give a capture folder, or one of: TUM")
    refused(tmp_path / "nowhere", "")
    (tmp_path / "folder/images").mkdir(parents=True)
    refused(tmp_path / "folder", "folder: is in no known format; give a capture folder, or one of: TUM")
    (tmp_path / "empty").mkdir()
    refused(tmp_path / "empty", "")


def test_a_recording_is_not_replaced_by_another(tmp_path: Path, refused: Refusals) -> None:
    """A capture.json may lie beside a camera's images, too."""
    source, raw = foreign.tum(tmp_path / "source", foreign.frames()), tmp_path / "out"
    foreign.redwood(raw, foreign.frames())
    (raw / "capture.json").write_text("{}")
    refused(source, "out: holds files, and no frames.csv of an earlier run; write to a folder of its own")
    shutil.rmtree(raw)
    for _ in range(2):
        assert run(["ingest", str(source), "--out", str(raw), "--object", str(refused.about)]) == 0


def test_two_sensors_of_a_realsense(tmp_path: Path, refused: Refusals) -> None:
    color, depth = "/device_0/sensor_1/Color_0/image/data", "/device_0/sensor_0/Depth_0/image/data"
    how = Ros(kind="ros2", topics=(color, depth))
    source = foreign.bag(tmp_path / "sdk", foreign.frames(), how)
    refused(source, f"depth: {depth} and {color} are of two sensors; record depth that is aligned to color")


@pytest.mark.parametrize("kind", ["ros2", "mcap"])
def test_a_recording_cut_off_before_its_metadata(tmp_path: Path, refused: Refusals, kind: str) -> None:
    source = foreign.bag(tmp_path / "cut", foreign.frames(), Ros(kind=kind))
    (source / "metadata.yaml").unlink()
    assert refused.status(source)[0] == 0
    (one,) = (path for path in source.iterdir() if path.suffix in (".db3", ".mcap"))
    shutil.copyfile(one, source / f"another{one.suffix}")
    refused(source, "cut: has no metadata.yaml, and 2 files; make one: ros2 bag reindex")


def test_poses_that_never_moved_are_poses(tmp_path: Path, refused: Refusals) -> None:
    source = foreign.bag(tmp_path / "source.bag", foreign.frames(), Ros())
    foreign.given(refused.about, camera={})
    refused(source, "or --topic camera_pose=NAME: /tf_static:base, /tf_static:eye")
