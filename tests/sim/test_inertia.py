"""Inertia's differences in time: of second order from the first step on, stable at any step."""

from dataclasses import replace

import numpy as np
import pytest
from sim.ropes import EI, GJ, GRAVITY, ROPE, moved, settled, swing, way_of

from dlolib.sim import simulate
from dlolib.sim.differentiate import Case, Variation, gradient, sensitivities
from dlolib.sim.inertia import ACCELERATION, BACK, VELOCITY, of_positions
from dlolib.sim.rod import Rod, scene
from dlolib.sim.simulate import ALL, Clock, State
from dlolib.types import Ends, Floats


@pytest.mark.parametrize("t", range(1, 2 * BACK))
def test_what_falls_is_followed_from_the_first_step(t: int) -> None:
    """x = 0.3 t + 0.35 t², before the first step as fast as in it."""
    x = {index: 0.3 * index + 0.35 * index**2 for index in range(t + 1)} | {-1: -0.3}
    behind = [x[t - back] for back in range(min(t + 2, BACK + 1))]
    assert of_positions(ACCELERATION, t) @ behind == pytest.approx(0.7, abs=1e-12)
    assert of_positions(VELOCITY, t) @ behind == pytest.approx(0.3 + 0.7 * t, abs=1e-12)


@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_no_mode_grows_at_any_step(damping: float) -> None:
    for omega in np.logspace(-2, 4, 200):
        powers = ACCELERATION.copy()
        powers[: len(VELOCITY)] += 2 * damping * omega * VELOCITY
        powers[0] += omega**2
        assert np.abs(np.roots(powers)).max() < 1 + 1e-9


def test_modes_that_no_step_resolves_die_out() -> None:
    powers = ACCELERATION.copy()
    powers[0] += 1e6
    assert np.abs(np.roots(powers)).max() ** 5 < 1e-3


@pytest.mark.parametrize("euler", [0, 10, ALL])
@pytest.mark.parametrize("cut", [1, 3, 20])
def test_a_roll_out_in_two_parts_is_differentiated_as_one(
    cut: int, euler: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second begins with the first one's velocity."""
    monkeypatch.setattr(simulate, "TOLERANCE", 1e-11)
    rod = Rod(ROPE, EI, GJ, {"inertia_drag.drag": 0.05})
    start, way, clock = settled(rod), swing(), Clock(0.01, euler)
    weights = np.random.default_rng(0).normal(size=(1, len(way) - cut + 1, 30, 3))

    def parts(state: State, way: Floats) -> tuple[simulate.Rollout, simulate.Rollout]:
        first = moved(rod, state, way[:cut], clock)
        return first, moved(rod, first.final, way[cut:], clock)

    first, second = parts(start, way)
    later = gradient(second, weights)
    found = gradient(first, np.zeros_like(first.x), later.initial)
    push = np.random.default_rng(1).normal(size=start.before.shape)

    def loss(width: float, step: float) -> float:
        ahead = np.zeros_like(way)
        ahead[cut - 1] = step * np.array([0.3, 0.5, 0.8])
        state = replace(start, before=start.before + width * push)
        return float(np.sum(parts(state, way + ahead)[1].x * weights))

    by_before = (loss(1e-6, 0.0) - loss(-1e-6, 0.0)) / 2e-6
    by_way = (loss(0.0, 1e-6) - loss(0.0, -1e-6)) / 2e-6
    assert np.sum(found.initial.before * push) == pytest.approx(by_before, rel=1e-5)
    assert found.end_x[0, cut - 1, 1] @ [0.3, 0.5, 0.8] == pytest.approx(by_way, rel=1e-5)


@pytest.mark.parametrize("euler", [0, 10, ALL])
@pytest.mark.parametrize("cut", [1, 3, 20])
def test_and_is_so_forwards(cut: int, euler: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulate, "TOLERANCE", 1e-11)
    start, way, clock = settled(Rod(ROPE, EI, GJ)), swing(), Clock(0.01, euler)

    def second(drag: float) -> simulate.Rollout:
        rod = Rod(ROPE, EI, GJ, {"inertia_drag.drag": drag})
        return moved(rod, moved(rod, start, way[:cut], clock).final, way[cut:], clock)

    def by_drag(part: Floats) -> list[Variation]:
        rods = [Rod(ROPE, EI, GJ, {"inertia_drag.drag": 0.05 + width}) for width in (1e-5, -1e-5)]
        ahead, behind = (Case(scene([rod], GRAVITY, Ends()), way_of(part)) for rod in rods)
        return [Variation(ahead, behind, 2e-5)]

    rod = Rod(ROPE, EI, GJ, {"inertia_drag.drag": 0.05})
    first = moved(rod, start, way[:cut], clock)
    tangent = sensitivities(first, by_drag(way[:cut]), np.array([cut]))[1]
    last = len(way) - cut
    found = sensitivities(second(0.05), by_drag(way[cut:]), np.array([last]), tangent)[0][0, 0, 0]
    true = (second(0.05 + 1e-4).x[0, -1] - second(0.05 - 1e-4).x[0, -1]) / 2e-4
    assert np.linalg.norm(found - true) < 1e-5 * np.linalg.norm(true)
