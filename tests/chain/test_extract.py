"""The chain against tubes whose axis is known exactly; the score is by arc length."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chain.tubes import (
    PILLAR,
    Scene,
    along,
    errors,
    rms,
    seen_by,
    wave,
    without_diameter,
    write_capture,
)

from dlolib.captures import open_capture
from dlolib.chain import ChainSettings, chain_frame, extract_chain
from dlolib.errors import ChainError
from dlolib.formats import read_recording, write_recording
from dlolib.types import Floats


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


def test_one_bright_speck_is_no_rope() -> None:
    frame, index = seen_by(wave(0.5), Scene(rope_level=12))
    assert frame.color is not None
    color = frame.color.copy()
    color[280:286, 300:330] = 230
    with pytest.raises(ChainError, match="% of the rope is seen, chain.min_seen is 20.0%"):
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
