"""Friction: every step ends in an equilibrium of the equations themselves, whatever the way to it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE, settled, swing, way_of
from sim.test_recording import recording

from dlolib.sim import simulate
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod, scene
from dlolib.sim.simulate import Clock, Path, roll_out
from dlolib.types import Ends, Motion, Obstacle, Points
from stages import gradients, peers, speed


@pytest.mark.parametrize("coefficient", [0.1, 0.3, 0.6])
def test_a_soft_rope_moves_over_two_rough_cylinders(coefficient: float) -> None:
    rod = Rod(peers.ROPE, speed.SOFT, speed.SOFT, {"contact_friction.coefficient": coefficient})
    made, start = speed.laid(rod, speed.CYLINDERS)
    arc = peers.arc_path()
    rollout = roll_out(made, start, Path(arc.x[:, :60], arc.q[:, :60]), Clock(peers.STEP_S))
    touches = rollout.slip[0, 1:].any(axis=2)
    assert touches.sum(axis=1).min() >= 10
    assert 0 < (touches & (rollout.sliding[0, 1:] == 1)).sum() < touches.sum()


@pytest.mark.parametrize("coefficient", [0.1, 0.3, 0.6])
def test_strands_that_rub_may_lie_over_what_is_rough(coefficient: float) -> None:
    """Neither force has a potential then; a Newton step is good by the forces that it leaves."""
    bar = {"center_m": (0.16, 0.0, -0.1), "axis": (0.0, 1.0, 0.0), "radius_m": (0.02,), "height_m": (0.3,)}
    over = (Obstacle("cylinder", bar),)
    laws = {"contact_friction.coefficient": coefficient, "internal_friction.saturation_curvature": 1.0}
    rod = Rod(ROPE, EI, GJ, laws)
    start = settled(rod, obstacles=over)
    rollout = roll_out(scene([rod], GRAVITY, Ends(), over), start, way_of(swing()), Clock(None))
    assert rollout.slip.any() and rollout.past.any()


def test_a_shape_is_solved_for_as_sharply_as_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """A parameter that next to nothing changes moves nothing, though the rope lies on a saddle at first."""
    monkeypatch.setattr(simulate, "TOLERANCE", gradients.SHARP_M)
    scenes = {name: (recording, rod) for name, recording, rod, _ in gradients.scenes()}
    recording, rod = scenes["rough cylinder"]
    model = RecordingModel(recording, gradients.PARTICLES, peers.STEP_S)
    near = rod.with_values({"torsional_stiffness": rod.torsional_stiffness * (1 + 1e-12)})
    one, other = (model.roll_out(each) for each in (rod, near))
    assert one.slip.any()
    assert np.abs(one.x - other.x).max() < 10 * gradients.SHARP_M


def test_a_rope_that_remembers_goes_on_after_it_fell_off_something() -> None:
    """Its next step does not go as far as it fell."""
    turned = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_quat(scalar_first=True)
    values = {"center_m": (0.16, 0.01, -0.13), "quaternion": tuple(turned), "size_m": (0.1, 0.12, 0.06)}
    t_s, made = np.linspace(0.0, 4.0, 41), recording()
    u = np.sin(np.pi * t_s / 4.0)[:, None]
    turns = Rotation.from_rotvec(u * [0.3, 0.5, 0.4]) * Rotation.from_quat(LEVEL, scalar_first=True)
    start, nowhere = u * [-0.1, 0.05, 0.04], np.full((41, 3), np.nan)
    motion = Motion(t_s, start, turns.as_quat(scalar_first=True), nowhere, np.full((41, 4), np.nan))
    frame = np.arange(5)
    points = Points(frame, 1.0 * frame, np.full(5, ROPE.length_m), np.zeros((5, 3)))
    over = replace(made, motion=motion, points=points, ends=Ends("clamped", "free"))
    over = replace(over, obstacles=(Obstacle("box", values),))
    loads = {"lateral_load.x": 0.01, "lateral_load.y": 0.05, "lateral_load.z": 0.02}
    friction = {
        "internal_friction.saturation_curvature": 1.36,
        "internal_friction.transition_curvature": 2.16,
    }
    tips = [
        RecordingModel(over, 30, None).predict(Rod(ROPE, EI, GJ, effects)).xyz_m[-1]
        for effects in (loads, loads | friction)
    ]
    assert np.linalg.norm(tips[1] - tips[0]) < 0.01
