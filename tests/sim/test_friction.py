"""Friction: every step ends in an equilibrium of the equations themselves, whatever the way to it."""

import numpy as np
import pytest
from sim.ropes import EI, GJ, GRAVITY, ROPE, settled, swing, way_of

from dlolib.sim import simulate
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod, scene
from dlolib.sim.simulate import Clock, Path, roll_out
from dlolib.types import Ends, Obstacle
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
