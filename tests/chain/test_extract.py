"""The chain against tubes whose axis is known exactly; the score is by arc length."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from chain.test_clouds import distances
from chain.tubes import (
    FOCAL,
    WIDTH,
    Scene,
    along,
    index_of,
    photograph,
    wave,
    without_diameter,
    write_capture,
)
from scipy.spatial.transform import Rotation

from dlolib.captures import open_capture
from dlolib.captures.base import Frame
from dlolib.captures.image_folder import ImageFolder
from dlolib.chain import ChainSettings, chain_frame, extract_chain
from dlolib.chain.sheet import write_sheet
from dlolib.errors import ChainError, ParameterError
from dlolib.formats import read_recording, write_recording
from dlolib.types import CaptureIndex, Ends, Floats

NOWHERE = Path("tube")
# A pillar before the middle, a gripper before the end.
PILLAR = ((0.15, -0.05, -0.3), (0.04, 0.02, 0.6))


def seen_by(axis: Floats, scene: Scene, clamped: bool = True, seed: int = 0) -> tuple[Frame, CaptureIndex]:
    color, depth = photograph(axis, scene, seed)
    frame = Frame(0, 0.0, NOWHERE, color=color, depth_m=depth.astype(np.float32) / 1000)
    return frame, index_of(NOWHERE, [axis], scene, clamped)


def errors(axis: Floats, s_m: Floats, xyz_m: Floats) -> Floats:
    """Distance [m] (K,) from where the rope is at these arc lengths."""
    return np.linalg.norm(xyz_m - along(axis, s_m), axis=1)


def of_length(index: CaptureIndex, share: float) -> CaptureIndex:
    """The same capture of a rope that was measured to be so many times as long."""
    return replace(index, rope=replace(index.rope, length_m=share * index.rope.length_m))


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize(
    ("axis", "scene", "largest_m"),
    [
        pytest.param(wave(0.3), Scene(), 0.6e-3, id="nearly straight"),
        pytest.param(wave(1.2), Scene(), 0.6e-3, id="much bent"),
        pytest.param(wave(0.8, 0.6), Scene(), 0.6e-3, id="in space"),
        pytest.param(wave(0.8), Scene(plate_y_m=0.03), 0.6e-3, id="plate close behind"),
        pytest.param(wave(0.8), Scene(diameter_m=0.004), 1.0e-3, id="4 mm"),
        pytest.param(wave(0.8), Scene(diameter_m=0.016), 1.0e-3, id="16 mm"),
        pytest.param(wave(0.8), Scene(camera_m=(0.2, -1.1, 0.0)), 1.0e-3, id="far"),
    ],
)
def test_points_lie_on_the_axis_at_their_arc_length(axis: Floats, scene: Scene, largest_m: float) -> None:
    chain = chain_frame(*seen_by(axis, scene), ChainSettings())
    assert len(chain.s_m) == 30
    np.testing.assert_allclose(chain.s_m, np.linspace(0, 0.445, 30), atol=1e-5)
    off = errors(axis, chain.s_m, chain.xyz_m)
    assert rms(off) < largest_m and off.max() < 3 * largest_m
    true_step = np.linalg.norm(np.diff(along(axis, chain.s_m), axis=0), axis=1)
    step = np.linalg.norm(np.diff(chain.xyz_m, axis=0), axis=1)
    assert np.abs(step / true_step - 1).max() < 0.03 if scene.diameter_m == 0.008 else True


def test_axis_where_the_diameter_is_known_and_skin_where_it_is_not() -> None:
    axis = wave(0.8)
    frame, index = seen_by(axis, Scene(diameter_m=0.016))
    on_axis = chain_frame(frame, index, ChainSettings())
    on_skin = chain_frame(frame, without_diameter(index), ChainSettings())
    assert abs(np.mean(on_axis.xyz_m[:, 1])) < 0.4e-3
    # The skin is 8 mm nearer to the camera, which looks along +y; its readings average to a little less.
    assert -8.2e-3 < np.mean(on_skin.xyz_m[:, 1]) < -6.8e-3


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


def test_a_gap_leaves_no_rows_and_keeps_the_arc_length() -> None:
    axis = wave(0.8)
    chain = chain_frame(*seen_by(axis, Scene(boxes=(PILLAR,))), ChainSettings())
    true = along(axis, np.linspace(0, 0.445, 30))
    # Seen from the camera the pillar, which stands nearer, hides a little more than its own width.
    behind = (true[:, 0] > 0.149) & (true[:, 0] < 0.191)
    rows = np.round(chain.s_m / (0.445 / 29)).astype(int)
    assert behind.sum() >= 3 and not behind[rows].any()
    assert len(rows) >= (~behind).sum() - 2
    assert rms(errors(axis, chain.s_m, chain.xyz_m)) < 1.0e-3


def test_a_gripper_before_the_end_hides_its_points() -> None:
    axis = wave(0.6)
    end = axis[-1]
    gripper = ((end[0] - 0.03, -0.03, end[2] - 0.03), (0.06, 0.06, 0.06))
    chain = chain_frame(*seen_by(axis, Scene(boxes=(gripper,))), ChainSettings())
    assert 0.40 < chain.s_m[-1] < 0.42 and chain.s_m[0] == 0
    assert rms(errors(axis, chain.s_m, chain.xyz_m)) < 0.6e-3


def test_the_start_is_the_held_start_whichever_way_the_rope_lies() -> None:
    axis = wave(0.6) * np.array([-1, 1, 1]) + np.array([0.4, 0, 0])
    frame, index = seen_by(axis, Scene())
    assert index.motion is not None
    back = np.tile([0.5, 0.5, -0.5, -0.5], (1, 1))
    index = replace(index, motion=replace(index.motion, start_q=back, end_q=back))
    chain = chain_frame(frame, index, ChainSettings())
    assert (np.diff(chain.xyz_m[:, 0]) < 0).all()
    assert rms(errors(axis, chain.s_m, chain.xyz_m)) < 0.6e-3


def test_with_free_ends_the_start_stays_the_start(tmp_path: Path) -> None:
    # The rope slides past its own length from frame to frame: only nearness tells the tips apart.
    axes = [wave(0.6), wave(0.6) + np.array([0.02, 0, 0]), wave(0.6) + np.array([-0.02, 0, 0.03])]
    write_capture(tmp_path / "free", axes, Scene(), clamped=False)
    for chain, axis in zip(extract_chain(open_capture(tmp_path / "free")).frames, axes, strict=True):
        # Nothing but the mask's own edge tells where a free end is: arc length is less certain than the axis.
        assert rms(distances(chain.xyz_m, axis)) < 0.6e-3
        assert rms(errors(axis, chain.s_m, chain.xyz_m)) < 3.0e-3


def test_arc_lengths_of_a_free_rope_that_is_seen_in_part_go_from_tip_to_tip(tmp_path: Path) -> None:
    """Its length was measured a little wrongly, or a tip is out of sight: it is readable all the same."""
    write_capture(tmp_path / "free", [wave(0.4)], Scene(noisy=False), clamped=False)
    result = extract_chain(ImageFolder(of_length(open_capture(tmp_path / "free").index, 1.08)))
    write_recording(result.recording, tmp_path / "out")
    s_m = read_recording(tmp_path / "out").points.s_m
    assert not result.frames[0].fitted
    assert len(s_m) == 30 and s_m[-1] == pytest.approx(0.445, abs=3e-3)
    seen = result.recording.points.xyz_m
    assert np.linalg.norm(np.diff(seen, axis=0), axis=1).sum() == pytest.approx(0.445, abs=3e-3)


def test_of_a_free_rope_of_which_a_third_is_out_of_sight_nobody_knows_where_it_begins(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    index = write_capture(tmp_path / "free", [wave(0.4), wave(0.4)], Scene(noisy=False), clamped=False)
    picture = cv2.imread(str(tmp_path / "free/color/000001.png"))
    picture[:, 400:] = 12
    cv2.imwrite(str(tmp_path / "free/color/000001.png"), picture)
    result = extract_chain(open_capture(tmp_path / "free"))
    assert [chain.counts for chain in result.frames] == [True, False]
    assert "m were measured in frame 1, so a tip was not seen; left out" in caplog.text
    with pytest.raises(ChainError, match="and in every frame 0.332 to 0.446 m were measured"):
        extract_chain(ImageFolder(of_length(index, 1.5)))


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
    assert re.search(rf"tube: the held (start|end) is logged ({off - 1}|{off}|{off + 1}) mm from where", said)
    assert (
        "check camera.world_from_camera, motion.csv and its clock" in said and "object.length_m" not in said
    )


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


HELD = {"start": Ends("clamped", "free"), "end": Ends("free", "clamped")}


@pytest.mark.parametrize("ends", [Ends("free", "free"), *HELD.values()])
def test_more_than_the_rope_does_not_count(
    ends: Ends, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """As where another cable lies beyond a free tip; but a length may be known roughly."""
    write_capture(tmp_path / "long", [wave(0.6), 1.07 * wave(0.6), 1.2 * wave(0.6)], Scene(noisy=False))
    index = replace(open_capture(tmp_path / "long").index, ends=ends)
    result = extract_chain(ImageFolder(index))
    assert [chain.counts for chain in result.frames] == [True, True, False]
    assert set(result.recording.points.frame) == {0, 1}
    assert result.recording.points.s_m.max() <= index.rope.length_m
    assert "m were measured in frame 1; check object.length_m" in caplog.text
    assert "m were measured in frame 2, so something else is taken for a part of it; left out" in caplog.text
    assert "only" not in caplog.text
    with pytest.raises(ChainError, match="in every frame 0.445 to") as told:
        extract_chain(ImageFolder(of_length(index, 0.8)))
    assert told.value.place == "object.length_m"


@pytest.mark.parametrize("held", HELD)
def test_a_free_tip_out_of_sight_stretches_no_arc_length(held: str) -> None:
    """8 mm of 445 lie outside the image: what is seen counts from the end that is held."""
    axis = wave(0.5)
    half = 0.5 * WIDTH / FOCAL * 0.75
    middle = axis[-1, 0] - 0.008 - half if held == "start" else axis[0, 0] + 0.008 + half
    frame, index = seen_by(axis, Scene(camera_m=(middle, -0.75, -0.02)))
    chain = chain_frame(frame, replace(index, ends=HELD[held]), ChainSettings())
    assert not chain.fitted and chain.counts
    assert errors(axis, chain.s_m, chain.xyz_m).max() < 1.2e-3
    # the seen part's own end is a point, too
    tip = chain.s_m[-1] if held == "start" else 0.445 - chain.s_m[0]
    assert tip == pytest.approx(0.4365, abs=1.5e-3)


@pytest.mark.parametrize("held", HELD)
@pytest.mark.parametrize("share", [0.98, 1.02])
def test_a_length_that_was_measured_wrong_stretches_no_arc_length(held: str, share: float) -> None:
    """Arc length counts from the end that is held: to the tip, or to the known length where that is less."""
    axis = wave(0.5)
    frame, index = seen_by(axis, Scene())
    known = share * 0.445
    chain = chain_frame(frame, replace(of_length(index, share), ends=HELD[held]), ChainSettings())
    assert not chain.fitted
    true_s = chain.s_m + (0.445 - known if held == "end" else 0.0)
    assert errors(axis, true_s, chain.xyz_m).max() < 1.2e-3
    assert len(chain.s_m) >= 29 and chain.s_m[0] >= 0 and chain.s_m[-1] <= known
    assert np.ptp(chain.s_m) == pytest.approx(min(known, 0.445), abs=1.5e-3)


def test_a_frame_in_which_the_rope_has_not_its_length_is_said_and_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Held at both ends it is all there: what is missing was not found, and arc lengths are off."""
    axes = [wave(0.6), 0.8 * wave(0.6), wave(0.6)]
    write_capture(tmp_path / "held", axes, Scene(noisy=False))
    source = open_capture(tmp_path / "held")
    index = replace(source.index, static_frames=(1, 1), heldout_frames=(1, 2))
    result = extract_chain(ImageFolder(index))
    says = "tube: the rope is 0.445 m long, and 0.356 m were measured in frame 1, so its held ends"
    assert says in caplog.text
    write_recording(result.recording, tmp_path / "out")
    read = read_recording(tmp_path / "out")
    assert set(read.points.frame) == {0, 2}
    assert read.static_frames is None and read.heldout_frames == (1, 2)
    assert result.metrics()["frames_left_out"] == 1 and len(result.frames) == 3


def test_a_rope_that_never_has_its_length_is_refused(tmp_path: Path) -> None:
    write_capture(tmp_path / "held", [wave(0.6)], Scene(noisy=False))
    index = of_length(open_capture(tmp_path / "held").index, 1.2)
    with pytest.raises(ChainError, match="tube: the rope is 0.534 m .* in every frame 0.445 m were") as told:
        extract_chain(ImageFolder(index))
    assert told.value.place == "object.length_m"


def test_a_length_that_every_frame_measures_otherwise_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Within 3 % it is taken for an error of each frame; but no such error is the same in all."""
    write_capture(tmp_path / "held", [wave(0.5), wave(0.8)], Scene(noisy=False))
    index = open_capture(tmp_path / "held").index
    extract_chain(ImageFolder(of_length(index, 1.005)))
    hidden = replace(index, ends=Ends("clamped", "free"))
    extract_chain(ImageFolder(of_length(hidden, 1.02)))
    assert "every frame" not in caplog.text
    extract_chain(ImageFolder(of_length(index, 1.02)))
    assert "tube: every frame measures 0.445 m, object.length_m says 0.454 m; correct it" in caplog.text


def test_rope_by_its_colour_and_by_a_mask_from_outside() -> None:
    axis = wave(0.6)
    frame, index = seen_by(axis, Scene(rope_level=90))
    assert frame.color is not None
    rope = frame.color[..., 0] > 50
    red = np.where(rope[..., None], (200, 30, 30), (190, 190, 190)).astype(np.uint8)
    colour = replace(index, rope_color_hsv=((0, 120, 80), (10, 255, 255)))
    for seen, where in ((replace(frame, color=red), colour), (replace(frame, color=red, mask=rope), index)):
        chain = chain_frame(seen, where, ChainSettings())
        assert len(chain.s_m) == 30 and rms(errors(axis, chain.s_m, chain.xyz_m)) < 0.6e-3


def test_a_bright_block_is_no_rope() -> None:
    axis = wave(0.6)
    frame, index = seen_by(axis, Scene())
    assert frame.color is not None
    color = frame.color.copy()
    color[300:380, 100:200] = 230
    chain = chain_frame(replace(frame, color=color), index, ChainSettings())
    assert rms(errors(axis, chain.s_m, chain.xyz_m)) < 0.6e-3


def test_uneven_light() -> None:
    axis = wave(0.6)
    frame, index = seen_by(axis, Scene())
    assert frame.color is not None
    light = np.linspace(1.0, 0.4, frame.color.shape[1])[None, :, None]
    chain = chain_frame(replace(frame, color=(frame.color * light).astype(np.uint8)), index, ChainSettings())
    assert len(chain.s_m) == 30 and rms(errors(axis, chain.s_m, chain.xyz_m)) < 1.0e-3


def test_a_short_piece_between_two_pillars_is_part_of_the_chain() -> None:
    axis = wave(0.3)
    pillars = (((0.12, -0.05, -0.3), (0.04, 0.02, 0.6)), ((0.18, -0.05, -0.3), (0.04, 0.02, 0.6)))
    chain = chain_frame(*seen_by(axis, Scene(boxes=pillars)), ChainSettings())
    between = (chain.xyz_m[:, 0] > 0.16) & (chain.xyz_m[:, 0] < 0.18)
    hidden = (chain.xyz_m[:, 0] > 0.125) & (chain.xyz_m[:, 0] < 0.155)
    assert between.any() and not hidden.any()
    assert rms(errors(axis, chain.s_m, chain.xyz_m)) < 1.5e-3


def test_lost_depth_is_a_gap() -> None:
    axis = wave(0.3)
    frame, index = seen_by(axis, Scene())
    assert frame.depth_m is not None
    depth = frame.depth_m.copy()
    depth[:, 300:340] = 0
    chain = chain_frame(replace(frame, depth_m=depth), index, ChainSettings())
    column = chain.pixel[:, 0]
    assert not ((column > 303) & (column < 336)).any()
    assert rms(errors(axis, chain.s_m, chain.xyz_m)) < 0.6e-3


def test_a_frame_without_rope_names_itself_and_the_mend(tmp_path: Path) -> None:
    capture = tmp_path / "empty"
    write_capture(capture, [wave(0.5), wave(0.5)], Scene(rope_level=12))
    with pytest.raises(ChainError, match=r"empty/color/000000\.png: frame 0: no rope.*; remove the frame"):
        extract_chain(open_capture(capture))


def test_one_bright_speck_is_no_rope() -> None:
    frame, index = seen_by(wave(0.5), Scene(rope_level=12))
    assert frame.color is not None
    color = frame.color.copy()
    color[280:286, 300:330] = 230
    with pytest.raises(ChainError, match="of the rope is seen"):
        chain_frame(replace(frame, color=color), index, ChainSettings())


def test_the_recording_carries_what_the_capture_said_and_survives_its_format(tmp_path: Path) -> None:
    axes = [wave(0.5), wave(0.7)]
    index = write_capture(tmp_path / "tube", axes, Scene())
    result = extract_chain(open_capture(tmp_path / "tube"), ChainSettings(points=12))
    write_recording(result.recording, tmp_path / "recording")
    back = read_recording(tmp_path / "recording")
    assert back.rope == index.rope and back.ends == index.ends and len(back.points.s_m) == 24
    np.testing.assert_allclose(back.points.xyz_m, result.recording.points.xyz_m, atol=1e-9)
    np.testing.assert_array_equal(back.points.frame, np.repeat([0, 1], 12))
    metrics = result.metrics()
    assert metrics["frames"] == metrics["frames_at_known_length"] == 2
    assert metrics["seen_share_min"] > 0.98 and metrics["spacing_error_max"] < 0.03


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"chain\.points: 1 is out of range; valid: 2 or more"):
        ChainSettings(points=1)
