"""Clamps whose roll was not measured hold the rope's direction and let it turn about itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE, swing

from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.types import Ends, Floats, Motion, Points, Recording

# Between level clamps a set that is the same all along has two shapes, each stable, and the roll with which a
# rope begins decides between them; an uneven one has one.
SET = {"rest_curvature.wave_1_2": 3.0, "rest_curvature.wave_2_1": 1.0}
UNMEASURED = Ends(start_roll_known=False, end_roll_known=False)


def rolled(start: float, end: float, ends: Ends = UNMEASURED, quasi_static: bool = True) -> RecordingModel:
    """A rope with a set under a motion whose recorded frames are rolled by these angles [rad]."""
    t_s, way = np.linspace(0, 6, 61), swing(61)
    level = Rotation.from_quat(LEVEL, scalar_first=True)

    def held(angle: float) -> Floats:
        frame = (level * Rotation.from_rotvec([0.0, 0.0, angle])).as_quat(scalar_first=True)
        return np.tile(frame, (61, 1))

    motion = Motion(t_s, np.zeros((61, 3)), held(start), way, held(end))
    frame, s = np.repeat(np.arange(3), 12), np.tile(np.linspace(0.01, 0.43, 12), 3)
    points = Points(frame, 2.0 * (1 + frame), s, np.zeros((36, 3)))
    made = Recording("rolled", ROPE, GRAVITY, ends, motion, points, quasi_static=quasi_static)
    return RecordingModel(made, 30, None if quasi_static else 0.01)


@pytest.mark.parametrize("quasi_static", [True, False])
@pytest.mark.parametrize("turn", [0.3, -1.0, 2.0])
def test_an_unmeasured_roll_does_not_matter(turn: float, quasi_static: bool) -> None:
    rod = Rod(ROPE, EI, GJ, particles=30).with_values(SET)
    first = rolled(0.0, 0.0, quasi_static=quasi_static).predict(rod).xyz_m
    other = rolled(turn, 0.7 * turn, quasi_static=quasi_static).predict(rod).xyz_m
    assert np.abs(other - first).max() < 1e-5


def test_a_measured_one_does() -> None:
    rod = Rod(ROPE, EI, GJ, particles=30).with_values(SET)
    first, other = (rolled(turn, 0.0, Ends()).predict(rod).xyz_m for turn in (0.0, 1.0))
    assert np.abs(other - first).max() > 1e-2


def test_a_clamp_of_unmeasured_roll_bends_as_one_of_measured_roll_does() -> None:
    rod = Rod(ROPE, EI, GJ, particles=30)
    flat = rolled(0.0, 0.0).recording.motion
    flat = replace(flat, end_m=flat.end_m * [1, 0, 1])
    xyz = []
    for ends in (Ends(), UNMEASURED):
        model = rolled(0.0, 0.0, ends)
        xyz.append(replace(model, recording=replace(model.recording, motion=flat)).predict(rod).xyz_m)
    # the clamp gives way by a thousandth of what half a segment does
    assert np.abs(xyz[1] - xyz[0]).max() < 1e-5


@pytest.mark.parametrize("quasi_static", [True, False])
@pytest.mark.parametrize("name", ["bending_stiffness", "rest_curvature.wave_1_2", "end_angle.start_1"])
def test_derivatives_hold_where_the_roll_is_free(name: str, quasi_static: bool) -> None:
    model = rolled(0.5, -0.5, quasi_static=quasi_static)
    rod = Rod(ROPE, EI, GJ, particles=30).with_values(SET | {"end_angle.start_1": 0.05})
    found = model.predict(rod, [name]).by_parameter[:, :, 0]
    step = 1e-4 * max(abs(rod.value(name)), 0.1 * (name != "bending_stiffness"))
    sides = [model.predict(rod.with_values({name: rod.value(name) + k * step})).xyz_m for k in (-2, -1, 1, 2)]
    true = (sides[0] - 8 * sides[1] + 8 * sides[2] - sides[3]) / (12 * step)
    assert found == pytest.approx(true, rel=1e-6, abs=1e-6 * np.abs(true).max())
