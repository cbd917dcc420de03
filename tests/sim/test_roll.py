"""Clamps whose roll was not recorded are upright, and do not let the rope turn about itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE, swing

from dlolib.sim.begun import motion_model
from dlolib.sim.poses import model_of
from dlolib.sim.rod import Rod
from dlolib.sim.upright import about_axis, unrolled, upright
from dlolib.types import Ends, Floats, Motion, Points, Recording

SET = {"rest_curvature.wave_1_2": 3.0, "rest_curvature.wave_2_1": 1.0}
UNMEASURED = Ends(start_roll_known=False, end_roll_known=False)


def rolled(start: float, end: float, ends: Ends = UNMEASURED) -> Recording:
    """A rope with a set under a motion whose recorded frames are rolled by these angles [rad]."""
    t_s, way = np.linspace(0, 6, 61), swing(61)
    level = Rotation.from_quat(LEVEL, scalar_first=True)

    def held(angle: float) -> Floats:
        frame = (level * Rotation.from_rotvec([0.0, 0.0, angle])).as_quat(scalar_first=True)
        return np.tile(frame, (61, 1))

    motion = Motion(t_s, np.zeros((61, 3)), held(start), way, held(end))
    frame, s = np.repeat(np.arange(3), 12), np.tile(np.linspace(0.01, 0.43, 12), 3)
    points = Points(frame, 2.0 * (1 + frame), s, np.zeros((36, 3)))
    return Recording("rolled", ROPE, GRAVITY, ends, motion, points)


def predicted(recording: Recording, **more: float) -> Floats:
    rod = Rod(ROPE, EI, GJ, particles=30).with_values(
        {**SET, **{f"end_twist.{k}": v for k, v in more.items()}}
    )
    return model_of(recording, 30, None).predict(rod).xyz_m


@pytest.mark.parametrize("turn", [0.3, -1.0, 2.0])
def test_a_roll_in_the_file_does_not_matter_where_it_is_not_known(turn: float) -> None:
    assert np.abs(predicted(rolled(turn, 0.7 * turn)) - predicted(rolled(0.0, 0.0))).max() < 1e-9


def test_a_known_one_does() -> None:
    first, other = (predicted(rolled(turn, 0.0, Ends())) for turn in (0.0, 1.0))
    assert np.abs(other - first).max() > 1e-2


def test_an_unknown_roll_is_held() -> None:
    """A rope with a set that could turn about itself would lie as it likes however its end is rolled."""
    first, other = (predicted(rolled(0.0, 0.0), end=angle) for angle in (0.0, 1.0))
    assert np.abs(other - first).max() > 1e-2


def test_one_known_roll_stays() -> None:
    half = replace(UNMEASURED, start_roll_known=True)
    recording = rolled(0.4, 0.4, half)
    made = motion_model(recording, 30, None).recording
    np.testing.assert_array_equal(made.motion.start_q, recording.motion.start_q)
    assert not np.allclose(made.motion.end_q, recording.motion.end_q)
    assert unrolled(recording) and not unrolled(made)
    assert not unrolled(replace(recording, ends=replace(half, start="free")))


def test_an_upright_clamp_keeps_its_direction() -> None:
    recording = rolled(0.0, 0.0)
    motion = recording.motion
    tilted = np.tile([0.0, 0.96, 0.28, 0.0], (61, 1))  # points down
    both = [
        replace(recording, motion=replace(motion, start_q=about_axis(tilted, a), end_q=about_axis(tilted, b)))
        for a, b in ((0.0, 0.0), (2.0, -1.0))
    ]
    one, other = (upright(each).motion for each in both)
    same = np.abs(np.sum(one.start_q * other.start_q, axis=1))
    assert same == pytest.approx(1.0) and np.abs(np.sum(one.end_q * one.start_q, axis=1)) == pytest.approx(1)
    assert not np.allclose(both[1].motion.start_q, other.start_q)
    w, x, y, z = one.start_q[0]
    assert [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)] == pytest.approx([0, 0, -1])
