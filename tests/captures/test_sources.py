"""The same frames in every format give the same capture, bit for bit where the format is lossless."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from captures import foreign_samples as foreign
from captures.foreign_samples import Frames, Ros, files
from formats import samples
from scipy.spatial.transform import Rotation

from dlolib.captures import ingest, open_capture
from dlolib.captures.ingest import FORMATS
from dlolib.o3d import open3d
from dlolib.types import Camera

START = {"position_m": [0.0, 0.0, 0.0], "quaternion": samples.TANGENT_X.tolist()}
HELD = {"ends": {"start": "clamped", "end": "clamped"}, "start": START}
ROS = ("ros1", "ros2", "mcap")


def place(tmp_path: Path, kind: str) -> Path:
    """Where a bag of this kind lies."""
    return tmp_path / ("source.bag" if kind == "ros1" else "source")


def tum(tmp_path: Path, shot: Frames) -> tuple[Path, Frames]:
    shot = replace(shot, scale=5000.0, depth=shot.depth * 5)
    foreign.given(tmp_path / "object.json", camera=foreign.camera_of(5000.0))
    return foreign.tum(tmp_path / "source", shot), shot


def redwood(tmp_path: Path, shot: Frames) -> tuple[Path, Frames]:
    return foreign.redwood(tmp_path / "source", shot), shot


def ros(kind: str) -> Callable[[Path, Frames], tuple[Path, Frames]]:
    return lambda tmp_path, shot: (foreign.bag(place(tmp_path, kind), shot, Ros(kind)), shot)


@pytest.mark.parametrize("write", [tum, redwood, *map(ros, ROS)], ids=["tum", "redwood", *ROS])
def test_the_same_frames_give_the_same_capture(
    tmp_path: Path, write: Callable[[Path, Frames], tuple[Path, Frames]]
) -> None:
    foreign.given(tmp_path / "object.json")
    source, shot = write(tmp_path, foreign.frames())
    ingest(foreign.own(tmp_path / "own", shot), tmp_path / "expected")
    ingest(source, tmp_path / "out", object_json=tmp_path / "object.json")
    assert files(tmp_path / "out") == files(tmp_path / "expected")


def test_an_azure_kinect_gives_the_same_capture(tmp_path: Path) -> None:
    shot = foreign.frames(2, foreign.KINECT_WIDTH, foreign.KINECT_HEIGHT)
    # so even that nothing can hide anything
    shot = replace(shot, depth=np.minimum(shot.depth, 615))
    foreign.given(tmp_path / "object.json")
    source = foreign.kinect(tmp_path / "source.mkv", shot, foreign.calibration())
    ingest(source, tmp_path / "out", object_json=tmp_path / "object.json")
    unseen = shot.color.copy()
    unseen[shot.depth == 0] = 0
    camera = Camera(
        foreign.VIEW, foreign.KINECT_WIDTH, foreign.KINECT_HEIGHT, *foreign.KINECT.values(), 1000.0
    )
    ingest(foreign.own(tmp_path / "own", replace(shot, color=unseen), camera), tmp_path / "expected")
    got, expected = files(tmp_path / "out"), files(tmp_path / "expected")
    # the calibration is stored as parts of the sensor: its last bits are not the pixels'
    assert {k: v for k, v in got.items() if k != "capture.json"} == {
        k: v for k, v in expected.items() if k != "capture.json"
    }
    found = open_capture(tmp_path / "out").index.camera
    assert [found.fx, found.fy, found.cx, found.cy] == pytest.approx(list(foreign.KINECT.values()), abs=1e-9)


def test_optics_that_are_given_of_an_azure_kinect_are_those_of_its_images(tmp_path: Path) -> None:
    """Colour is found through them, and a capture's points are where the camera so described saw them."""
    shot = foreign.frames(1, foreign.KINECT_WIDTH, foreign.KINECT_HEIGHT)
    calibration = foreign.calibration()
    calibration["CalibrationInformation"]["Cameras"][0]["Intrinsics"]["ModelParameters"][4] = -0.3
    source = foreign.kinect(tmp_path / "source.mkv", shot, calibration)
    for name, camera in (("plain", {}), ("given", {"fx": 230.0, "cx": 150.0})):
        view = {"world_from_camera": foreign.VIEW.tolist()}
        foreign.given(tmp_path / "object.json", camera=view | camera)
        ingest(source, tmp_path / name, object_json=tmp_path / "object.json")
    plain, given = (open_capture(tmp_path / name) for name in ("plain", "given"))
    assert (given.index.camera.fx, given.index.camera.cx) == (230.0, 150.0)
    assert given.index.camera.fy == plain.index.camera.fy
    depths = [next(iter(source.frames())).depth_m for source in (plain, given)]
    assert not np.array_equal(*depths)  # straightened about another centre


def test_an_azure_kinect_s_usual_jpegs_are_read(tmp_path: Path) -> None:
    shot = foreign.frames(2, foreign.KINECT_WIDTH, foreign.KINECT_HEIGHT)
    smooth = np.full_like(shot.color, (200, 60, 20))
    about = foreign.given(tmp_path / "object.json")
    source = foreign.kinect(
        tmp_path / "source.mkv",
        replace(shot, color=smooth),
        foreign.calibration(),
        color=("mjpeg", "yuvj422p"),
    )
    ingest(source, tmp_path / "out", object_json=about)
    frames = list(open_capture(tmp_path / "out").frames())
    assert len(frames) == len(shot.ns)
    for frame in frames:
        assert frame.color is not None and frame.depth_m is not None
        middle = frame.color[10:-10, 10:-10][frame.depth_m[10:-10, 10:-10] > 0]
        np.testing.assert_allclose(middle.astype(int), np.broadcast_to((200, 60, 20), middle.shape), atol=3)


@pytest.mark.parametrize(
    "how",
    [
        Ros(color="bgr8", padding=5),
        Ros(color="bgra8", depth="big"),
        Ros(color="rgba8", depth="compressedDepth"),
        Ros(kind="ros2", color="png", depth="compressedDepth"),
        Ros(kind="ros2", color="png", depth="png"),
    ],
    ids=lambda how: f"{how.color}-{how.depth}",
)
def test_every_lossless_encoding_gives_the_same_frames(tmp_path: Path, how: Ros) -> None:
    shot = foreign.frames()
    about = foreign.given(tmp_path / "object.json")
    ingest(foreign.own(tmp_path / "own", shot), tmp_path / "expected")
    ingest(foreign.bag(place(tmp_path, how.kind), shot, how), tmp_path / "out", object_json=about)
    assert files(tmp_path / "out") == files(tmp_path / "expected")


def test_depth_in_metres_keeps_a_tenth_of_a_millimetre(tmp_path: Path) -> None:
    shot = foreign.frames()
    about = foreign.given(tmp_path / "object.json")
    index = ingest(
        foreign.bag(tmp_path / "source.bag", shot, Ros(depth="32FC1")), tmp_path / "out", object_json=about
    )
    assert index.camera.depth_scale == 10_000 and index.depth is not None
    stored = cv2.imread(str(index.depth[1]), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(stored, shot.depth[1] * 10)


def test_inverted_depth_is_turned_back(tmp_path: Path) -> None:
    """compressed_depth_image_transport stores metres as A / depth + B: here to 0.05 mm at 0.7 m."""
    shot = foreign.frames()
    about = foreign.given(tmp_path / "object.json")
    source = foreign.bag(tmp_path / "source.bag", shot, Ros(depth="inverse"))
    ingest(source, tmp_path / "out", object_json=about)
    found = [frame.depth_m for frame in open_capture(tmp_path / "out").frames()]
    np.testing.assert_allclose(found, shot.depth / 1000, atol=1e-4)


def test_jpegs_are_read(tmp_path: Path) -> None:
    shot = foreign.frames()
    smooth = np.full_like(shot.color, (200, 60, 20))
    about = foreign.given(tmp_path / "object.json")
    source = foreign.bag(tmp_path / "source.bag", replace(shot, color=smooth), Ros(color="jpeg"))
    ingest(source, tmp_path / "out", object_json=about)
    found = [frame.color for frame in open_capture(tmp_path / "out").frames()]
    np.testing.assert_allclose(np.array(found, dtype=int), smooth, atol=3)


@pytest.mark.parametrize("kind", ROS)
@pytest.mark.parametrize("topic", [foreign.TOOL, "/tf:tool", "/tf:/tool"])
def test_the_motion_of_the_moved_end_comes_from_a_topic(tmp_path: Path, kind: str, topic: str) -> None:
    shot = foreign.frames()
    moved = foreign.motion(shot)
    about = foreign.given(tmp_path / "object.json", **HELD)
    source = foreign.bag(place(tmp_path, kind), shot, Ros(kind), moved)
    index = ingest(source, tmp_path / "out", topics={"motion": topic}, object_json=about)
    assert index.motion is not None
    np.testing.assert_array_equal(index.motion.t_s, moved.t_s)
    for name in ("start_m", "start_q", "end_m", "end_q"):
        np.testing.assert_allclose(getattr(index.motion, name), getattr(moved, name), atol=1e-8)


def test_a_motion_is_the_grasp_s_and_its_quaternions_do_not_jump(tmp_path: Path) -> None:
    shot = foreign.frames()
    rows = len(foreign.motion(shot).t_s)
    # past half a turn, and with signs as a logger may choose them
    turns = Rotation.from_rotvec(np.linspace(0, 5.2, rows)[:, None] * [1, 0, 0])
    turned = (turns * Rotation.from_quat(samples.TANGENT_X, scalar_first=True)).as_quat(scalar_first=True)
    turned[1::2] *= -1
    moved = replace(foreign.motion(shot), end_q=turned)
    grasp = np.eye(4)
    grasp[2, 3] = 0.05
    about = foreign.given(tmp_path / "object.json", **HELD, tool_from_grasp=grasp.tolist())
    source = foreign.bag(tmp_path / "source.bag", shot, Ros(), moved)
    index = ingest(source, tmp_path / "out", topics={"motion": foreign.TOOL}, object_json=about)
    assert index.motion is not None
    # TANGENT_X turns the third axis to +x
    np.testing.assert_allclose(index.motion.end_m, moved.end_m + np.array([0.05, 0, 0]), atol=1e-8)
    assert (np.sum(index.motion.end_q[1:] * index.motion.end_q[:-1], axis=1) > 0.7).all()


def test_a_motion_from_elsewhere_is_copied_byte_for_byte(tmp_path: Path) -> None:
    shot = foreign.frames()
    csv = foreign.elsewhere(tmp_path, foreign.motion(shot))
    about = foreign.given(tmp_path / "object.json", ends=HELD["ends"])
    ingest(foreign.redwood(tmp_path / "source", shot), tmp_path / "out", csv, object_json=about)
    assert (tmp_path / "out/motion.csv").read_bytes() == csv.read_bytes()


def test_the_camera_s_pose_comes_from_the_source(tmp_path: Path) -> None:
    shot = foreign.frames()
    optics = {name: value for name, value in foreign.camera_of().items() if name != "world_from_camera"}
    about = foreign.given(tmp_path / "object.json", camera=optics)
    folder = foreign.tum(tmp_path / "tum", shot)
    foreign.ground_truth(folder, shot)
    tracked = ingest(folder, tmp_path / "a", object_json=about)
    bagged = foreign.bag(tmp_path / "source.bag", shot, Ros())
    by_tf = ingest(bagged, tmp_path / "b", topics={"camera_pose": "/tf_static:eye"}, object_json=about)
    for index in (tracked, by_tf):
        np.testing.assert_allclose(index.camera.world_from_camera, foreign.VIEW, atol=1e-9)


def test_what_a_person_says_goes_before_what_the_source_says(tmp_path: Path) -> None:
    about = foreign.given(tmp_path / "object.json", camera=foreign.camera_of(fx=29.0))
    index = ingest(
        foreign.redwood(tmp_path / "source", foreign.frames()), tmp_path / "out", object_json=about
    )
    assert (index.camera.fx, index.camera.fy) == (29.0, 31.0)


def test_images_of_the_empty_scene_come_along(tmp_path: Path) -> None:
    shot = foreign.frames()
    source = foreign.redwood(tmp_path / "source", shot)
    (tmp_path / "empty").mkdir()
    for name, image in (("color", shot.color[0]), ("depth", shot.depth[0])):
        cv2.imwrite(str(tmp_path / f"empty/{name}.png"), image)
    named = {f"background_{name}": f"empty/{name}.png" for name in ("color", "depth")}
    about = foreign.given(tmp_path / "object.json", **named)
    index = ingest(source, tmp_path / "out", object_json=about)
    assert index.background_color is not None and index.background_depth is not None
    assert index.background_color.read_bytes() == (tmp_path / "empty/color.png").read_bytes()
    assert index.background_depth.read_bytes() == (tmp_path / "empty/depth.png").read_bytes()
    # the copy is a capture of this project's, which takes them along as well
    assert files(ingest(tmp_path / "out", tmp_path / "again").folder) == files(tmp_path / "out")


def test_the_object_may_lie_beside_the_source(tmp_path: Path) -> None:
    bag = foreign.bag(tmp_path / "source.bag", foreign.frames(), Ros())
    foreign.given(tmp_path / "source.json")
    assert ingest(bag, tmp_path / "a").name == "tiny"
    folder = foreign.redwood(tmp_path / "source", foreign.frames())
    foreign.given(folder / "capture.json")
    assert ingest(folder, tmp_path / "b").name == "tiny"


def test_times_come_from_the_rate_where_names_have_none(tmp_path: Path) -> None:
    folder = foreign.redwood(tmp_path / "source", foreign.frames(), fps=20.0)
    for path in [*folder.glob("*/*.png")]:
        path.rename(path.with_name(f"{path.stem[:7]}.png"))
    about = foreign.given(tmp_path / "object.json")
    index = ingest(folder, tmp_path / "out", object_json=about)
    np.testing.assert_array_equal(index.t_s, [0.05, 0.1, 0.15])


def test_times_in_names_pair_what_was_counted_apart(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The first colour image is lost, and the others are numbered anew."""
    shot = foreign.frames(4)
    folder = foreign.redwood(tmp_path / "source", shot)
    for row, path in enumerate(sorted(folder.glob("color/*.png"))):
        path.rename(path.with_name(f"{row:07d}{path.name[7:]}")) if row else path.unlink()
    index = ingest(folder, tmp_path / "out", object_json=foreign.given(tmp_path / "object.json"))
    np.testing.assert_array_equal(index.t_s, [ns / 10**9 for ns in shot.ns[1:]])
    for row, frame in enumerate(open_capture(tmp_path / "out").frames(), 1):
        np.testing.assert_array_equal(frame.color, shot.color[row])
        np.testing.assert_array_equal(frame.depth_m, shot.depth[row] / np.float32(1000))
    assert "depth: 1 of 4 depth images have no color image at their time" in caplog.text
    next(folder.glob("depth/0000003*")).unlink()
    assert len(ingest(folder, tmp_path / "less", object_json=tmp_path / "object.json").t_s) == 2
    assert "color: 1 of 3 color images have no depth image at their time" in caplog.text


def test_a_depth_image_without_its_color_is_left_out(tmp_path: Path) -> None:
    shot = foreign.frames()
    folder = foreign.tum(tmp_path / "source", shot)
    lines = (folder / "rgb.txt").read_text().splitlines()
    (folder / "rgb.txt").write_text("\n".join([lines[0], lines[1], lines[3]]) + "\n")
    about = foreign.given(tmp_path / "object.json", camera=foreign.camera_of(1000.0))
    index = ingest(folder, tmp_path / "out", object_json=about)
    np.testing.assert_array_equal(index.t_s, [shot.ns[0] / 10**9, shot.ns[2] / 10**9])
    for row, frame in zip((0, 2), open_capture(tmp_path / "out").frames(), strict=True):
        np.testing.assert_array_equal(frame.color, shot.color[row])


def test_clouds_survive(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    for row in range(2):
        points = np.random.default_rng(row).uniform(0.4, 0.5, (20, 3))
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
        open3d.io.write_point_cloud(str(tmp_path / f"source/{row:06d}.ply"), cloud)
    about = foreign.given(tmp_path / "object.json", rate_hz=4.0)
    index = ingest(tmp_path / "source", tmp_path / "out", object_json=about)
    np.testing.assert_array_equal(index.t_s, [0, 0.25])
    assert index.camera.fx is None
    for row in range(2):
        name = f"{row:06d}.ply"
        assert (tmp_path / "out/cloud" / name).read_bytes() == (tmp_path / "source" / name).read_bytes()


def test_every_source_is_taken_for_what_it_is(tmp_path: Path) -> None:
    shot = foreign.frames()
    sources = {
        "TumFolder": foreign.tum(tmp_path / "tum", shot),
        "RedwoodFolder": foreign.redwood(tmp_path / "redwood", shot),
        "RosBag": foreign.bag(tmp_path / "two", shot, Ros("ros2")),
        "RealSense": foreign.bag(tmp_path / "one.bag", shot, Ros(root="/device_0/sensor_0")),
    }
    for name, path in sources.items():
        assert next(kind for kind in FORMATS if kind.matches(path)).__name__ == name


def test_the_readers_of_bags_and_videos_load_where_they_are_needed() -> None:
    code = "import sys, dlolib.captures; print(sorted({'rosbags', 'av'} & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
