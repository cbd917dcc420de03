"""What the chain says of a capture that is not as it is said to be, and what does not count."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from chain.tubes import (
    PILLAR,
    Scene,
    along,
    wave,
    without_diameter,
    write_capture,
)
from scipy.spatial.transform import Rotation

from dlolib.captures import open_capture
from dlolib.captures.image_folder import ImageFolder
from dlolib.chain import ChainSettings, extract_chain
from dlolib.chain.anchor import Anchor
from dlolib.chain.join import from_held_ends, may_be_joined
from dlolib.chain.sheet import write_sheet
from dlolib.chain.view import View
from dlolib.errors import ChainError, ParameterError
from dlolib.types import CaptureIndex


def test_what_lies_on_the_skin_is_said_once_and_its_ellipsoids_reach_the_axis(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    axes = [wave(0.5), wave(0.8)]
    write_capture(tmp_path / "skin", axes, Scene(diameter_m=0.012))
    index = without_diameter(open_capture(tmp_path / "skin").index)
    for axis, chain in zip(axes, extract_chain(ImageFolder(index)).frames, strict=True):
        assert chain.covariance_m2 is not None
        assert chain.skin_m == pytest.approx(0.006, abs=1e-3)
        # the camera looks along +y
        before = (chain.xyz_m - along(axis, chain.s_m))[:, 1]
        assert (np.abs(before) < 1.5 * np.sqrt(chain.covariance_m2[:, 1, 1])).all()
    said = re.findall(r"object.diameter_m is not given: .*, about (.*) mm before the axis", caplog.text)
    assert len(said) == 1 and float(said[0]) == pytest.approx(6.0, abs=1.0)
    assert "is logged" not in caplog.text


def test_frames_without_a_rope_are_left_out_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_capture(tmp_path / "gone", [wave(0.4)] * 4, Scene(noisy=False))
    for frame in (1, 3):
        cv2.imwrite(str(tmp_path / f"gone/color/00000{frame}.png"), np.zeros((576, 640, 3), np.uint8))
    result = extract_chain(open_capture(tmp_path / "gone"))
    assert set(result.recording.points.frame) == {0, 2} and result.without_rope == 2
    assert result.metrics()["frames"] == 4 and result.metrics()["frames_left_out"] == 2
    assert "left out: " in caplog.text and "frame 1: no rope" in caplog.text
    assert "and 1 more frame like it" in caplog.text
    write_sheet(result, open_capture(tmp_path / "gone"), tmp_path / "sheet.png")


def test_more_pieces_than_can_be_put_in_order_do_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Boxes cut one rope of two into pieces: with two at most, their order may be any."""
    boxes = tuple(((x, -0.05, -0.3), (0.01, 0.02, 0.6)) for x in (0.1, 0.2, 0.3))
    monkeypatch.setattr("dlolib.chain.order.MOST_STRANDS", 2)
    write_capture(tmp_path / "cut", [wave(0.4), wave(0.5)], Scene(noisy=False, boxes=boxes))
    with pytest.raises(
        ChainError, match="more stretches of rope are seen than can be put in order in frames 0, 1"
    ):
        extract_chain(open_capture(tmp_path / "cut"))


def test_a_rope_of_which_only_its_lit_edge_is_found_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    index = write_capture(tmp_path / "edge", [wave(0.4)], Scene(noisy=False))
    picture = cv2.imread(str(tmp_path / "edge/color/000000.png"))
    rope = (picture[..., 0] > 100).astype(np.uint8)
    edge = rope - cv2.erode(rope, np.array([[0], [1], [1]], np.uint8))
    (tmp_path / "edge/mask").mkdir()
    cv2.imwrite(str(tmp_path / "edge/mask/000000.png"), 255 * edge)
    masked = replace(index, mask=(tmp_path / "edge/mask/000000.png",))
    extract_chain(ImageFolder(masked))
    assert "mm wide, object.diameter_m says 8.0" in caplog.text


def seen_from_elsewhere(index: CaptureIndex, by_m: tuple[float, float, float]) -> CaptureIndex:
    """The same capture, its camera said to stand so far from where it stood."""
    pose = index.camera.world_from_camera.copy()
    pose[:3, 3] += by_m
    return replace(index, camera=replace(index.camera, world_from_camera=pose))


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize(
    "by_m", [(0.008, 0.0, 0.0), (-0.02, 0.0, 0.0), (0.0, 0.0, 0.008), (0.0, 0.02, 0.0), (0.0, 0.0, 0.02)]
)
def test_a_wrong_pose_of_the_camera_is_said_and_not_blamed_on_the_length(
    by_m: tuple[float, float, float], hidden: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Whether the camera looks on past the rope's true ends, or grippers stand there."""
    axis = wave(0.5)
    end = axis[-1] - 0.02
    grippers = (
        ((-0.04, -0.02, -0.02), (0.04, 0.04, 0.04)),
        ((end[0] + 0.02, -0.02, end[2]), (0.04, 0.04, 0.04)),
    )
    write_capture(tmp_path / "held", [axis], Scene(boxes=grippers if hidden else ()))
    index = seen_from_elsewhere(open_capture(tmp_path / "held").index, by_m)
    try:
        extract_chain(ImageFolder(index))
        said = caplog.text
    except ChainError as error:
        said = str(error)
        assert error.place == "camera.world_from_camera"
    off = round(1e3 * float(np.linalg.norm(by_m)))
    held = "(the held (start|end) is|both held ends are)"
    assert re.search(rf"{held} logged ({off - 1}|{off}|{off + 1}) mm from where", said)
    assert (
        "check camera.world_from_camera, motion.csv and its clock" in said and "object.length_m" not in said
    )


@pytest.mark.parametrize("by_m", [(0.08, 0.0, 0.0), (0.0, 0.0, -0.15), (0.0, 0.3, 0.0)])
def test_a_pose_of_the_camera_that_is_far_off_is_not_blamed_on_the_length(
    by_m: tuple[float, float, float], tmp_path: Path
) -> None:
    write_capture(tmp_path / "held", [wave(0.5), wave(0.6)], Scene())
    index = seen_from_elsewhere(open_capture(tmp_path / "held").index, by_m)
    with pytest.raises(ChainError, match="both held ends are logged") as refused:
        extract_chain(ImageFolder(index))
    assert refused.value.place == "camera.world_from_camera"
    told = re.search(r"logged (\d+) mm", refused.value.problem)
    assert told and int(told[1]) == pytest.approx(1e3 * float(np.linalg.norm(by_m)), abs=3)
    assert str(refused.value).startswith(str(tmp_path / "held/capture.json"))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("boxes", [(), (PILLAR,)], ids=["in view", "hidden"])
@pytest.mark.parametrize("from_camera_m", [0.0, -0.1], ids=["in the camera", "behind it"])
def test_a_pose_of_the_camera_that_nobody_gave_is_refused_with_its_mend(
    boxes: tuple[Any, ...], from_camera_m: float, tmp_path: Path
) -> None:
    """Held ends then lie in the camera's own plane or behind it, where it sees nothing."""
    index = write_capture(tmp_path / "held", [wave(0.6)], Scene(boxes=boxes))
    pose = np.eye(4)
    pose[2, 3] = -from_camera_m
    unposed = replace(index, camera=replace(index.camera, world_from_camera=pose))
    with pytest.raises(ChainError, match=r"from where a held end is logged.*camera\.world_from_camera"):
        extract_chain(ImageFolder(unposed))


def test_a_held_end_behind_the_camera_is_not_sought_in_the_image() -> None:
    """There it would come out mirrored."""
    mask = np.zeros((60, 100), np.bool_)
    mask[28:33] = True
    view = View(mask, mask.astype(np.float32), mask.astype(np.float32), 100.0, 100.0, 0.0, 0.0)
    line = np.stack([np.arange(40.0, 100.0), np.full(60, 30.0)], axis=-1)
    before = Anchor(np.array([0.1, 0.3, 1.0]), np.array([1.0, 0.0, 0.0]))
    mirrored = Anchor(-before.place_m, -before.tangent)
    np.testing.assert_allclose(view.pixel(mirrored.place_m[None]), view.pixel(before.place_m[None]))
    for anchor, is_sought in ((before, True), (mirrored, False)):
        assert bool(from_held_ends([line], 5.0, view, anchor, None)) == is_sought
        assert may_be_joined([line], 5.0, view, anchor, None) == is_sought


def test_a_gripper_that_hides_the_rope_beside_its_clamp_is_no_wrong_pose(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    axes = [wave(0.9), wave(1.2)]
    grippers = tuple(
        ((x - 0.03, -0.04, -0.05), (0.06, 0.02, 0.1)) for x in (0.0, float(np.mean([a[-1, 0] for a in axes])))
    )
    write_capture(tmp_path / "held", axes, Scene(boxes=grippers))
    extract_chain(open_capture(tmp_path / "held"))
    assert "is logged" not in caplog.text


@pytest.mark.parametrize("name", ["start", "end"])
@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("angle", [90, 180])
def test_a_held_end_that_is_logged_to_point_another_way_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str, axis: str, angle: int
) -> None:
    write_capture(tmp_path / "held", [wave(0.5)], Scene())
    index = open_capture(tmp_path / "held").index
    extract_chain(ImageFolder(index))
    assert "another direction" not in caplog.text
    assert index.motion is not None
    logged = Rotation.from_quat(getattr(index.motion, f"{name}_q"), scalar_first=True)
    turned = (logged * Rotation.from_euler(axis, angle, degrees=True)).as_quat(scalar_first=True)
    extract_chain(ImageFolder(replace(index, motion=replace(index.motion, **{f"{name}_q": turned}))))
    assert f"at its held {name} the rope is seen to run by" in caplog.text
    off = int(re.search(r"by (\d+) degrees in another direction", caplog.text)[1])  # type: ignore[index]
    assert abs(off - angle) < 15


@pytest.mark.parametrize(
    ("share", "said"), [(1.0, False), (0.8, False), (1.25, False), (0.5, True), (2.0, True)]
)
def test_a_diameter_that_the_pictures_do_not_bear_out_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, share: float, said: bool
) -> None:
    write_capture(tmp_path / "wide", [wave(0.5)], Scene())
    index = open_capture(tmp_path / "wide").index
    rope = replace(index.rope, diameter_m=0.008 * share)
    try:
        extract_chain(ImageFolder(replace(index, rope=rope)))
        told = caplog.text
    except ChainError as error:
        told = str(error)
    assert ("object.diameter_m" in told) == said


def test_a_frame_without_rope_names_itself_and_the_mend(tmp_path: Path) -> None:
    capture = tmp_path / "empty"
    write_capture(capture, [wave(0.5), wave(0.5)], Scene(rope_level=12))
    with pytest.raises(ChainError, match=r"empty/color/000000\.png: frame 0: no rope.*; remove the frame"):
        extract_chain(open_capture(capture))


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"chain\.points: 1 is out of range; valid: 2 or more"):
        ChainSettings(points=1)
