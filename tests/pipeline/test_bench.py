"""What `make bench` times: scenes that come to the same elastica, and our rod by cosseratbench's rules."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from stages import bench, peers, speed
from stages.timing import Figure


def test_mujocos_flex_and_our_rod_come_to_the_same_elastica() -> None:
    exact = peers.exact_shapes()
    for make in (peers.ours, peers.mujoco_flex):
        errors = []
        for particles in (15, 30):
            race = make(particles)
            race.go()
            errors.append(100 * peers.error_of(race, exact))
        assert errors[1] < min(speed.EXACT_PERCENT, errors[0])


def test_every_key_is_measured_once() -> None:
    measured = [key for keys, _ in bench.MEASURES for key in keys]
    assert sorted(measured) == sorted(bench.GOALS)


@pytest.mark.parametrize("key", bench.WHY)
def test_what_misses_its_goal_says_why_and_what_meets_it_does_not(key: str) -> None:
    goal = bench.GOALS[key]
    better = goal.goal * (2.0 if goal.at_least else 0.5)
    assert bench._how(key, Figure(better, "so")) == "so"
    assert bench.WHY[key] in bench._how(key, Figure(goal.goal**2 / better, "so"))
    assert bench._how(key, Figure(None, "not here")) == "not here"


def test_our_rod_hangs_and_bends_as_cosseratbench_wants_it() -> None:
    pytest.importorskip("cosseratbench", reason="in the extra `bench`")
    from cosseratbench import registry
    from cosseratbench.experiment import run

    from dlolib.bench.cosserat import RodSolver

    for name, metric in (("catenary", "shape_error"), ("cantilever", "tip_deflection_error")):
        result = run(registry.load_experiment(name), RodSolver())
        assert result.outcome == "completed" and result.metrics[metric] < 2e-3


def test_a_peer_is_held_against_our_time_of_the_same_round(monkeypatch: pytest.MonkeyPatch) -> None:
    """The machine is twice as fast when the second peer's turn comes."""
    seconds = iter(({"ours": 2.0, "MuJoCo": 8.0}, {"ours": 1.0, "PyElastica": 90.0}))
    off = {15: 0.5, 16: 0.5, 30: 0.2, 60: 0.1}

    def race(name: str) -> Callable[..., peers.Race]:
        return lambda n=30, *_: peers.Race(lambda: name, lambda: np.zeros(0), np.full(1, off[n]))

    def timed(jobs: list[Callable[[], str]], *_: int) -> list[float]:
        now = next(seconds)
        return [now[job()] for job in jobs]

    for name, made in (("ours", "ours"), ("mujoco_flex", "MuJoCo"), ("pyelastica", "PyElastica")):
        monkeypatch.setattr(peers, name, race(made))
    monkeypatch.setattr(peers, "exact_shapes", lambda: np.zeros(0))
    monkeypatch.setattr(peers, "error_of", lambda one, _: float(one.arc_m[0]) / 100)
    monkeypatch.setattr(speed, "find_spec", lambda _: True)
    monkeypatch.setattr(speed, "in_turn", timed)
    assert [figure.value for figure in speed.forward()] == [4.0, 90.0]


def test_learning_s_time_is_that_of_all_the_iterations_that_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = SimpleNamespace(goal=SimpleNamespace(mean_m=2e-4), min_clearance_m=9.7e-3)
    done = SimpleNamespace(kept=kept, curve=range(130), iterations_total=181, starts=2)
    monkeypatch.setattr(speed, "learn", lambda *_: done)
    (figure,) = speed.learning()
    assert "181 iterations in all, starts tried: 2; goal error 0.2 mm" in figure.how
