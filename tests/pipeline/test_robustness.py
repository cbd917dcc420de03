"""Random roll-outs: solved or refused by name; a rope that snaps is followed, and keeps its gradient."""

from dataclasses import replace

import numpy as np
import pytest

from dlolib.errors import SimulationError
from dlolib.sim import simulate
from dlolib.sim.differentiate import gradient
from dlolib.sim.simulate import Clock, roll_out
from stages.robustness import STEPS, _begun, outcome, scene_of_number, summary

# Quasi-static and free of contact; Newton's method alone does not follow it.
SNAPS = 142


def test_a_number_is_one_roll_out() -> None:
    first, second = scene_of_number(11), scene_of_number(11)
    assert first.label == second.label
    assert np.array_equal(first.path.x, second.path.x) and np.array_equal(first.begin.x, second.begin.x)


def test_every_roll_out_is_solved_or_refused_by_name() -> None:
    found = [outcome(number) for number in range(10)]
    assert {one["outcome"] for one in found} <= {"solved", "refused"}
    counted = summary(found)
    assert counted["rollouts"] == 10 == counted["solved"] + counted["refused"]
    assert sum(sum(kind.values()) for kind in counted["by_kind"].values()) == 5 * 10
    assert sum(one["outcome"] == "solved" for one in found) >= 9


def test_what_is_refused_says_where_and_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulate, "MOST_ITERATIONS", 2)
    monkeypatch.setattr(simulate, "MOST_RELAXING", 1)
    drawn = scene_of_number(0)
    with pytest.raises(SimulationError, match="before the first step: rope 0 does not come to rest; "):
        _begun(drawn)


@pytest.mark.parametrize("number", [263, 832])  # free of contact, and with friction
def test_a_soft_rope_comes_to_rest_however_often_its_steps_must_be_shortened(number: int) -> None:
    drawn = scene_of_number(number)
    begun = _begun(drawn)
    again = roll_out(drawn.made, begun, drawn.path.still(1), Clock(None, fresh=True))
    assert np.abs(again.x[:, 1] - begun.x).max() < 1e-6


def test_a_rope_that_snaps_is_followed() -> None:
    drawn = scene_of_number(SNAPS)
    begin = _begun(drawn)
    _, status = simulate._launch(drawn.made, begin, drawn.path, drawn.clock)
    assert status.any()
    moved = roll_out(drawn.made, begin, drawn.path, drawn.clock)
    assert moved.x[0, 1:, -1] == pytest.approx(drawn.path.x[0, :, 1])
    # every shape is an equilibrium of its own pose
    for step in range(STEPS):
        here = simulate.State(moved.x[:, step + 1], moved.x[:, step + 1].copy(), moved.q[:, step + 1])
        again = roll_out(drawn.made, here, drawn.path.of(0, step).still(1), drawn.clock)
        assert np.abs(again.x[0, 1] - moved.x[0, step + 1]).max() < 1e-6
    # and a batch of it gives the same
    twice = [np.repeat(part, 2, axis=0) for part in (begin.x, begin.before, begin.q)]
    path = replace(drawn.path, x=np.repeat(drawn.path.x, 2, axis=0), q=np.repeat(drawn.path.q, 2, axis=0))
    both = roll_out(type(drawn.made).stack([drawn.made] * 2), simulate.State(*twice), path, drawn.clock)
    assert np.array_equal(both.x[1], moved.x[0])


def test_past_a_snap_the_gradient_is_that_of_the_new_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulate, "TOLERANCE", 1e-11)
    drawn = scene_of_number(SNAPS)
    moved = roll_out(drawn.made, _begun(drawn), drawn.path, drawn.clock)
    weights = np.zeros_like(moved.x)
    weights[0, -1] = np.random.default_rng(0).normal(size=weights.shape[2:])
    found = gradient(moved, weights).end_x[0, -1, 1]
    here = simulate.State(moved.x[:, -1], moved.x[:, -1].copy(), moved.q[:, -1])

    def loss(shift: np.ndarray) -> float:
        path = drawn.path.of(0, STEPS - 1)
        path.x[0, 0, 1] += shift
        value = float(np.sum(roll_out(drawn.made, here, path, drawn.clock).x[0, -1] * weights[0, -1]))
        path.x[0, 0, 1] -= shift
        return value

    step = 1e-6
    by = [(loss(step * e) - loss(-step * e)) / (2 * step) for e in np.eye(3)]
    assert found == pytest.approx(by, rel=1e-4, abs=1e-4 * np.abs(found).max())
