"""Single messages of a bag: what their numbers come to, and what is none."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from captures import foreign_samples as foreign
from captures.foreign_samples import Ros
from captures.realsense_samples import UNITS, realsense
from captures.refusals import Refusals
from rosbags.rosbag1 import Reader, Writer

from dlolib.captures.poses import transforms
from dlolib.captures.ros_images import Spot, color, depth, depth_scale
from dlolib.errors import FormatError

SPOT = Spot(Path("source.bag"), "/depth, message 3")


def raw(pixels: np.ndarray, encoding: str, **changes: Any) -> Any:
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels).view(np.uint8).ravel()
    step = data.size // height
    fields = {"height": height, "width": width, "step": step, "is_bigendian": 0, "data": data}
    return SimpleNamespace(encoding=encoding, **(fields | changes))


def compressed(form: str, stored: np.ndarray, header: bytes = struct.pack("<iff", 0, 0.0, 0.0)) -> Any:
    data = header + cv2.imencode(".png", stored)[1].tobytes()
    return SimpleNamespace(format=form, data=np.frombuffer(data, np.uint8))


def test_a_depth_in_metres_is_read_as_far_as_its_units_reach() -> None:
    """Tenths of a millimetre in 16 bits; what is too near, behind or no number is none."""
    far_m = 6.5535
    metres = np.array([[far_m, 0.7, 1e-4, far_m + 1e-3, 0.0, -0.7, np.nan, np.inf, 4e-5]], np.float32)
    message = raw(metres, "32FC1")
    assert depth_scale(message) == 10_000.0
    assert depth(message, SPOT).tolist() == [[65535, 7000, 1, 0, 0, 0, 0, 0, 0]]
    assert depth_scale(raw(metres, "16UC1")) == 1000.0


def test_a_depth_that_was_stored_inverted_comes_back() -> None:
    a, b = 10100.0, -1009.0
    stored = np.array([[0, 2000, 60_000]], np.uint16)
    message = compressed("32FC1; compressedDepth png", stored, struct.pack("<iff", 0, a, b))
    expected = [0.0, *(1e4 * a / (stored[0, 1:] - b)).round()]
    assert depth(message, SPOT).tolist() == [expected]


GREY = np.full((4, 6), 700, np.uint16)


@pytest.mark.parametrize(
    ("read", "message", "says"),
    [
        (
            depth,
            raw(GREY, "rgb8"),
            "its encoding is 'rgb8'; name a topic with 16UC1, mono16, 32FC1; is color",
        ),
        (
            color,
            raw(GREY, "16UC1"),
            "its encoding is '16UC1'; name a topic with rgb8, bgr8, rgba8, bgra8; is",
        ),
        (
            depth,
            raw(GREY, "16UC1", data=np.zeros(47, np.uint8)),
            "holds 47 bytes for 6 x 4 pixels in rows of 12",
        ),
        (depth, raw(GREY, "16UC1", step=11, data=np.zeros(44, np.uint8)), "holds 44 bytes for 6 x 4 pixels"),
        (depth, raw(GREY, "16UC1", width=0, data=np.zeros(48, np.uint8)), "holds 48 bytes for 0 x 4 pixels"),
        (depth, compressed("rgb8; jpeg compressed bgr8", GREY), "is color named as depth?"),
        (depth, compressed("16UC1; compressedDepth rvl", GREY), "RVL compression is not known; republish it"),
        (
            depth,
            SimpleNamespace(format="16UC1; compressedDepth png", data=np.zeros(12, np.uint8)),
            "is truncated; record or copy it again",
        ),
        (
            depth,
            compressed("16UC1; compressedDepth png", GREY.astype(np.uint8)),
            "is no 16-bit depth; name a topic of depth; is color named as depth?",
        ),
    ],
)
def test_what_is_no_image_of_its_role(read: Any, message: Any, says: str) -> None:
    with pytest.raises(FormatError, match=re.escape(says)) as caught:
        read(message, SPOT)
    assert str(caught.value).startswith("source.bag: /depth, message 3: ")


@pytest.mark.parametrize("bad", [([np.nan, 0, 0], [1, 0, 0, 0]), ([0, 0, 0], [0, 0, 0, 0])])
def test_what_is_no_pose_is_counted(bad: tuple[list[float], list[float]]) -> None:
    places, turns = np.zeros((3, 3)), np.tile([2.0, 0.0, 0.0, 0.0], (3, 1))
    np.testing.assert_allclose(transforms(places, turns, SPOT.path, "tf"), np.tile(np.eye(4), (3, 1, 1)))
    places[1], turns[1] = bad
    with pytest.raises(FormatError, match="source.bag: tf: pose 1 is none: .*; leave it out"):
        transforms(places, turns, SPOT.path, "tf")


def test_images_of_one_time(tmp_path: Path, refused: Refusals) -> None:
    foreign.given(refused.about)
    shot = foreign.frames()
    stopped = foreign.Frames([shot.ns[0]] * 3, shot.color, shot.depth)
    refused(
        foreign.bag(tmp_path / "source.bag", stopped, Ros()), "image 1: time stands still at 1700000000.1"
    )


def test_frames_that_hang_on_each_other(tmp_path: Path, refused: Refusals) -> None:
    foreign.given(refused.about, ends={"start": "free", "end": "clamped"})
    shot = foreign.frames()
    source = foreign.bag(tmp_path / "source.bag", shot, Ros(bases_link="tool"), foreign.motion(shot))
    refused(source, "its frames form a ring; record tf anew", "--topic", "motion=/tf:tool")


def rewritten(source: Path, target: Path, change: Any) -> Path:
    """The same bag of ROS 1 with other messages: `change` takes topic, row and data to (topic, data)."""
    topics: dict[str, Any] = {}
    rows: dict[str, int] = {}
    with Reader(source) as reader, Writer(target) as writer:
        for connection, ns, data in reader.messages():
            row = rows[connection.topic] = rows.get(connection.topic, -1) + 1
            for topic, content in change(connection.topic, row, bytes(data)):
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, connection.msgtype, typestore=Ros().store)
                writer.write(topics[topic], ns, content)
    return target


def test_two_calibrations_of_which_none_is_beside_the_images(tmp_path: Path, refused: Refusals) -> None:
    foreign.given(refused.about)
    source = foreign.bag(tmp_path / "one.bag", foreign.frames(), Ros(info_topic="/left/camera_info"))
    assert refused.status(source)[0] == 0

    def twice(topic: str, row: int, data: bytes) -> Any:
        named = [topic, "/right/camera_info"] if topic == "/left/camera_info" else [topic]
        return [(name, data) for name in named]

    says = "camera_info: 2 topics can be camera_info; name one: --topic camera_info=NAME, of /left/"
    both = rewritten(source, tmp_path / "two.bag", twice)
    refused(both, says)
    assert refused.status(both, "--topic", "camera_info=/right/camera_info")[0] == 0


def test_poses_whose_clock_goes_back(tmp_path: Path, refused: Refusals) -> None:
    foreign.given(refused.about, ends={"start": "free", "end": "clamped"})
    shot = foreign.frames()
    moved = foreign.motion(shot)
    source = foreign.bag(tmp_path / "one.bag", shot, Ros(), moved)
    stamps = [struct.pack("<II", int(t), round(1e9 * (t - int(t)))) for t in moved.t_s]

    def back(topic: str, row: int, data: bytes) -> Any:
        # a header is its number, then its stamp
        return [(topic, data[:4] + stamps[1] + data[12:] if topic == foreign.TOOL and row == 3 else data)]

    refused(
        rewritten(source, tmp_path / "two.bag", back),
        "time goes back from 17",
        "--topic",
        f"motion={foreign.TOOL}",
    )


@pytest.mark.parametrize("metres", [0.0, 1.0, np.nan])
def test_a_unit_of_depth_that_is_none(tmp_path: Path, refused: Refusals, metres: float) -> None:
    shot = foreign.frames()
    source = realsense(tmp_path / "one.bag", shot)

    def other(topic: str, row: int, data: bytes) -> Any:
        return [(topic, struct.pack("<f", metres) if topic == UNITS else data)]

    spoilt = rewritten(source, tmp_path / "two.bag", other)
    foreign.given(refused.about, camera={"world_from_camera": foreign.VIEW.tolist()})
    refused(spoilt, f"{UNITS}: a unit of depth is {metres:g} m; give camera.depth_scale")
