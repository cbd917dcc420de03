"""How `make chain-bench` scores: by arc length, so that a chain out of order does not pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dlolib.chain import ChainSettings, FrameChain, chain_frame
from dlolib.lab.camera import Sensor, default_camera
from dlolib.types import Floats
from stages.chain_bench import to_and_fro
from stages.chain_score import score
from stages.chain_views import CASES, DRAWN, LENGTH_M, Case, arcs, drawn, photograph

S = np.arange(0, LENGTH_M, 0.0005)
AXIS = np.stack([S, 0 * S, 0.05 * np.sin(10 * S)], axis=-1)
SEEN = np.ones(len(S), dtype=bool)


def chain(s_m: Floats, xyz_m: Floats) -> FrameChain:
    line = np.ones(len(s_m), dtype=bool)
    return FrameChain(0, 0.0, s_m, xyz_m, xyz_m[:, :2], s_m, xyz_m, line, LENGTH_M, True, 1.0, 1e-3)


def on_axis(s_m: Floats) -> Floats:
    return np.stack([np.interp(s_m, S, AXIS[:, k]) for k in range(3)], axis=-1)


def test_the_axis_itself_scores_full_marks() -> None:
    s = np.linspace(0, S[-1], 30)
    found = score(chain(s, on_axis(s)), S, AXIS, SEEN)
    assert found.ordered and found.covered == 1 and found.stray == found.invented == 0
    assert (
        found.off_m.max() < 3e-4 and np.abs(found.arc_m).max() < 3e-4 and np.abs(found.spacing).max() < 1e-9
    )


def test_the_wrong_way_round_lies_on_the_rope_and_is_wrong() -> None:
    s = np.linspace(0, S[-1], 30)
    found = score(chain(s, on_axis(s[::-1])), S, AXIS, SEEN)
    assert not found.ordered and np.abs(found.arc_m).max() > 0.1


def test_a_shift_along_the_rope_shows_in_the_arc_length_alone() -> None:
    s = np.linspace(0.01, S[-1] - 0.01, 28)
    found = score(chain(s, on_axis(s + 0.005)), S, AXIS, SEEN)
    assert np.median(found.arc_m) == pytest.approx(0.005, abs=5e-4) and found.off_m.max() < 5e-4


def test_what_is_invented_astray_or_missing_is_counted() -> None:
    s = np.linspace(0, S[-1], 30)
    hidden = (S > 0.1) & (S < 0.2)
    assert score(chain(s, on_axis(s)), S, AXIS, ~hidden).invented in (5, 6, 7)
    away = on_axis(s)
    away[3] += [0.0, 0.02, 0.0]
    assert score(chain(s, away), S, AXIS, SEEN).stray == 1
    half = s[:15]
    assert score(chain(half, on_axis(half)), S, AXIS, SEEN).covered == pytest.approx(0.5, abs=0.05)


def test_every_condition_of_the_table_has_a_case() -> None:
    names = {case.name for case in CASES}
    plain = {"clear", "clear_bias", "thin_4mm", "thick_16mm", "table", "far", "coloured", "uneven_light"}
    assert plain | {"pillar", "gripper", "crossing", "start_out_of_frame", "end_out_of_frame"} <= names


def test_what_is_drawn_is_the_same_every_time_and_of_every_kind() -> None:
    found = [drawn(number)[0] for number in range(DRAWN)]
    assert found == [drawn(number)[0] for number in range(DRAWN)]
    assert {case.hidden for case in found} == {"", "pillar", "gripper"}
    thick = np.array([case.diameter_m for case in found])
    assert thick.min() < 0.005 and thick.max() > 0.014
    # a crossing is there in every third
    bends = [drawn(number)[1] for number in (0, 1)]
    assert [(np.diff(shape[:, 0]) < 0).any() for shape in bends] == [True, False]


def test_a_long_capture_is_of_the_same_frames_and_poses() -> None:
    shots = [photograph(CASES[0], shape, default_camera(), number) for number, shape in enumerate(arcs(2))]
    frames, index = to_and_fro(shots, 4)
    assert [frame.frame for frame in frames] == [0, 1, 2, 3]
    for row, k in enumerate((0, 1, 1, 0)):
        alone = chain_frame(shots[k].frame, shots[k].index, ChainSettings())
        found = chain_frame(frames[row], index, ChainSettings())
        # Each shape is as long as its curve, to a hundredth of a millimetre.
        np.testing.assert_allclose(found.xyz_m, alone.xyz_m, atol=1e-5)


def test_without_noise_the_depth_is_that_of_the_axis_up_to_the_clamps() -> None:
    deep = []
    # steps of 1 mm, as such cameras store, would be noise of their own
    fine = replace(default_camera(), depth_scale=5e4)
    for number, shape in enumerate(arcs(6)):
        shot = photograph(Case("exact", sensor=Sensor(noise_m=0.0, edge_loss=0.0)), shape, fine, number)
        found = chain_frame(shot.frame, shot.index, ChainSettings())
        true = np.stack([np.interp(found.s_m, shot.s_m, shot.axis_m[:, k]) for k in range(3)], axis=-1)
        deep.append((found.xyz_m - true) @ shot.index.camera.world_from_camera[:3, 2])
    assert abs(np.mean(deep)) < 2e-5
    # what the clamp mixes into the last readings would pull them forward
    assert np.abs(np.array(deep)[:, [0, -1]]).max() < 1.5e-4
