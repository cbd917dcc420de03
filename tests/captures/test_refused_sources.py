"""Foreign recordings that cannot be used: status 2, one line with file, place and mend, nothing written."""

from __future__ import annotations

import itertools
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from captures import foreign_samples as foreign
from captures.foreign_samples import Ros
from captures.refusals import Refusals

from dlolib.cli import run

Spoil = Callable[[Path], object]
ROS = ("ros1", "ros2", "mcap")


def told(value: object) -> str:
    """The id of a case: what the line must say."""
    return value if isinstance(value, str) else ""


def cut(name: str, share: float = 0.5) -> Spoil:
    def spoil(folder: Path) -> None:
        path = sorted(folder.glob(name))[1] if "*" in name else folder / name
        path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])

    return spoil


def line(name: str, row: int, text: str) -> Spoil:
    def spoil(folder: Path) -> None:
        lines = (folder / name).read_text().splitlines()
        lines[row] = text
        (folder / name).write_text("\n".join(lines) + "\n")

    return spoil


def missing(name: str) -> Spoil:
    return lambda folder: (folder / name).unlink()


def small(name: str) -> Spoil:
    return lambda folder: cv2.imwrite(str(sorted(folder.glob(name))[1]), np.full((12, 16), 700, np.uint16))


def dark(name: str) -> Spoil:
    return lambda folder: cv2.imwrite(str(sorted(folder.glob(name))[1]), np.zeros((24, 32), np.uint16))


def swapped(first: str, second: str) -> Spoil:
    def spoil(folder: Path) -> None:
        (folder / first).rename(folder / "between")
        (folder / second).rename(folder / first)
        (folder / "between").rename(folder / second)

    return spoil


def outside(name: str) -> Spoil:
    """A list that names a picture beside its folder, which exists."""

    def spoil(folder: Path) -> None:
        shutil.copyfile(next(folder.glob("depth/*.png")), folder.parent / "secret.png")
        line(name, 1, "1700000000.123000 ../secret.png")(folder)

    return spoil


def drifting(folder: Path) -> None:
    foreign.ground_truth(folder, foreign.frames(), drift_m=0.02)


TUM: list[tuple[Spoil, str]] = [
    (cut("depth/*.png"), "is truncated"),
    (cut("rgb/*.png"), "is truncated"),
    (missing("rgb.txt"), "rgb.txt: no such file"),
    (missing("depth.txt"), "depth.txt: no such file"),
    (outside("depth.txt"), "depth.txt: line 2: '../secret.png' is no path within the folder"),
    (line("rgb.txt", 2, "1700000000.227 /etc/hostname"), "rgb.txt: line 3: '/etc/hostname' is no path"),
    (line("rgb.txt", 2, "1700000000.227 rgb/none.png"), "rgb.txt: line 3: no such file: rgb/none.png"),
    (line("rgb.txt", 2, "1700000000.227"), "rgb.txt: line 3: '' is no path within the folder"),
    (line("rgb.txt", 2, "soon rgb/a.png"), "rgb.txt: line 3: 'soon' is no time"),
    (line("depth.txt", 2, "1600000000.0 depth/a.png"), "depth.txt: line 3: time goes back from 17"),
    (
        small("depth/*.png"),
        "the camera 32 x 24; give the camera's width, height, fx, fy, cx and cy of this size, or correct",
    ),
    (dark("depth/*.png"), "depth is zero everywhere"),
    (swapped("rgb.txt", "depth.txt"), "is depth named as color?"),
    (lambda folder: (folder / "rgb.txt").write_text("# nothing\n"), "rgb.txt: has no rows"),
    (lambda folder: (folder / "rgb.txt").write_bytes(b"\xff\xfe\x00"), "rgb.txt: is not text in UTF-8"),
]


@pytest.mark.parametrize(("spoil", "says"), TUM, ids=told)
def test_tum(tmp_path: Path, refused: Refusals, spoil: Spoil, says: str) -> None:
    spoil(foreign.tum(tmp_path / "source", foreign.frames()))
    refused(tmp_path / "source", says)


def test_a_camera_that_moves(tmp_path: Path, refused: Refusals) -> None:
    folder = foreign.tum(tmp_path / "source", foreign.frames())
    optics = {name: value for name, value in foreign.camera_of().items() if name != "world_from_camera"}
    foreign.given(refused.about, camera=optics)
    refused(folder, "camera.world_from_camera: the recording does not say where the camera stands; add it")
    drifting(folder)
    refused(folder, "groundtruth.txt: poses: the camera moves by 0.02 m")
    line("groundtruth.txt", 2, "1700000000.2 2.0 3.0")(folder)
    refused(folder, "groundtruth.txt: line 3: is no pose")


def test_color_and_depth_of_two_clocks(tmp_path: Path, refused: Refusals) -> None:
    folder = foreign.tum(tmp_path / "source", foreign.frames())
    text = (folder / "rgb.txt").read_text()
    (folder / "rgb.txt").write_text(text.replace("\n170", "\n180"))
    refused(folder, "the nearest color and depth images are 1e+08 s apart; bring both to one clock")


@pytest.mark.parametrize("write", [foreign.tum, foreign.redwood])
def test_a_missing_calibration(tmp_path: Path, refused: Refusals, write: Callable[..., Path]) -> None:
    folder = write(tmp_path / "source", foreign.frames())
    for path in folder.glob("*.json"):
        path.unlink()
    foreign.given(refused.about)
    refused(
        folder, "object.json: camera.width: the recording does not say width, height, fx, fy, cx, cy; add"
    )


def intrinsics(**changes: Any) -> Spoil:
    def spoil(folder: Path) -> None:
        path = folder / "camera_intrinsic.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | changes))

    return spoil


def unnamed(folder: Path) -> None:
    for path in [*folder.glob("*/*.png")]:
        path.rename(path.with_name(f"{path.stem[:7]}.png"))


def unnumbered(folder: Path) -> None:
    unnamed(folder)
    (folder / "color/0000002.png").unlink()


def late(folder: Path) -> None:
    """The colour images are of half a second later."""
    for path in [*folder.glob("color/*.png")]:
        path.rename(path.with_name(f"{path.stem[:8]}{int(path.stem[8:]) + 500_000}.png"))


def truncated_jpeg(folder: Path) -> None:
    path = sorted(folder.glob("color/*.png"))[1]
    data = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (24, 32, 3), np.uint8))[1].tobytes()
    path.with_suffix(".jpg").write_bytes(data[:-20])
    path.unlink()


REDWOOD: list[tuple[Spoil, str]] = [
    (cut("color/*.png"), "is truncated"),
    (truncated_jpeg, "is a damaged JPEG"),
    (swapped("color", "depth"), "is depth named as color?"),
    (small("depth/*.png"), "is 16 x 12 pixels, the camera 32 x 24"),
    (intrinsics(width=31), "is 32 x 24 pixels, the camera 31 x 24"),
    (intrinsics(intrinsic_matrix=[1, 2, 3]), "camera_intrinsic.json: is no camera of Open3D"),
    (
        intrinsics(intrinsic_matrix=[0] * 8 + [1]),
        "camera_intrinsic.json: a number in it is none, or not posi",
    ),
    (
        intrinsics(intrinsic_matrix=[30, 0, 15.5, 0, 31, 11.25, 0, 0, 1]),
        "intrinsic_matrix: the last row of the camera's matrix is [15.5, 11.25, 1.0], not [0, 0, 1]; give",
    ),
    (intrinsics(fps="fast"), "camera_intrinsic.json: a number in it is none, or not positive"),
    (cut("camera_intrinsic.json"), "camera_intrinsic.json: is no camera of Open3D"),
    (
        lambda folder: (folder / "camera_intrinsic.json").write_text("[" * 200000),
        "camera_intrinsic.json: is no camera of Open3D",
    ),
    (intrinsics(depth_scale=1.0), "with depth_scale 1; correct camera.depth_scale"),
    (unnumbered, "color: no image with the number of 0000002.png"),
    (late, "source: the nearest color and depth images are 0.3 s apart; bring both to one clock"),
    (unnamed, "object.json: rate_hz: when 0000001.png was taken is not recorded"),
]


@pytest.mark.parametrize(("spoil", "says"), REDWOOD, ids=told)
def test_redwood(tmp_path: Path, refused: Refusals, spoil: Spoil, says: str) -> None:
    foreign.given(refused.about)
    spoil(foreign.redwood(tmp_path / "source", foreign.frames()))
    refused(tmp_path / "source", says)


def test_a_size_without_its_focal_length(tmp_path: Path, refused: Refusals) -> None:
    camera = foreign.camera_of()
    wrong = intrinsics(width=64, height=48)
    wrong(foreign.redwood(tmp_path / "source", foreign.frames()))
    foreign.given(refused.about, camera={name: camera[name] for name in camera if name not in foreign.OPTICS})
    says = "object.json: camera.fx: is the recording's, which is of another width and height than those given"
    refused(tmp_path / "source", says)
    foreign.given(refused.about, camera=camera)
    assert refused.status(tmp_path / "source")[0] == 0


def test_times_in_names_that_go_back(tmp_path: Path, refused: Refusals) -> None:
    shot = foreign.frames()
    refused(foreign.redwood(tmp_path / "source", replace(shot, ns=shot.ns[::-1])), "time goes back from 17")


def test_names_that_are_times_and_no_numbers(tmp_path: Path, refused: Refusals) -> None:
    foreign.given(refused.about, rate_hz=30.0)
    source = foreign.redwood(tmp_path / "source", foreign.frames())
    for row, folder in itertools.product(range(3), ("color", "depth")):
        (path,) = (source / folder).glob(f"{row + 1:07d}-*.png")
        path.rename(path.with_name(f"{1_700_000_000_123 + 33 * row}.png"))
    refused(source, "1700000000123.png: its name looks like a time, and not like the number")


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
