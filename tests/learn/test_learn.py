"""Algorithm 2 on the real rod: the gradient through all sub-trajectories, and that learning learns."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dlolib.errors import ParameterError, SimulationError
from dlolib.formats import read_layout, read_motion
from dlolib.learn import LearnSettings, ablate, learn, write_learned
from dlolib.learn.arcs import PARAMETERS
from dlolib.learn.goal import GoalError, goal_at_particles
from dlolib.learn.learn import _rank
from dlolib.learn.policy import Policy, xavier
from dlolib.learn.rope import HeldRope, Piece
from dlolib.learn.train import Learner
from dlolib.learn.write import result
from dlolib.sim.rod import Rod
from dlolib.sim.simulate import State
from dlolib.types import Floats, Layout, Obstacle

LAYOUT = read_layout(Path("data/layouts/layout_2"))
ROD = Rod(LAYOUT.rope, 3e-4, 3e-4)
SMALL = LearnSettings(steps=60, segments=3, hidden=(8, 6), particles=20, iterations=20, starts=1, rate=0.01)


def learner(settings: LearnSettings) -> Learner:
    goal = goal_at_particles(LAYOUT, settings.particles)
    weights = xavier(goal.size + PARAMETERS, settings.hidden, settings.seed)
    policy = Policy(weights, np.array(settings.bounds), goal, LAYOUT.rope.length_m)
    return Learner(LAYOUT, HeldRope(LAYOUT, ROD, settings, settings.contact_margin_m), policy, settings)


@pytest.mark.parametrize("share", [(np.arange(30) + 0.5) / 30, np.linspace(0.019, 0.981, 60)])
def test_a_goal_that_does_not_reach_the_ends_keeps_its_arc_lengths(share: Floats) -> None:
    whole = goal_at_particles(LAYOUT, 1001)
    s_m = share * LAYOUT.rope.length_m
    some = np.stack([np.interp(share, np.linspace(0, 1, 1001), column) for column in whole.T], axis=1)
    found = goal_at_particles(replace(LAYOUT, goal_s_m=s_m, goal_m=some), 1001)
    assert np.linalg.norm(found - whole, axis=1).max() < 2e-4


def test_without_obstacles_the_nearest_shape_is_kept() -> None:
    episode = learner(SMALL).episode(learner(SMALL).flat, want_gradient=False)
    near, nearer = (
        replace(episode, min_clearance_m=np.inf, goal=GoalError(mean_m, mean_m, mean_m))
        for mean_m in (9e-4, 1e-5)
    )
    assert _rank(nearer, SMALL) < _rank(near, SMALL)


def test_gradient_through_controller_and_rope() -> None:
    made = learner(SMALL)
    found = made.episode(made.flat).gradient
    rng = np.random.default_rng(0)
    for _ in range(3):
        way = rng.normal(size=found.size)
        h = 1e-5
        ahead, behind = (made.episode(made.flat + s * h * way, want_gradient=False).loss for s in (1, -1))
        assert found @ way == pytest.approx((ahead - behind) / (2 * h), rel=1e-5)


class Leaping:
    """A rope that takes its end from one side of an obstacle to the other in a step, and is free at each."""

    def start(self) -> tuple[None, Floats]:
        return None, self._straight(-0.05)

    def forward(self, state: None, end_m: Floats) -> Piece:
        return Piece(np.stack([self._straight(x) for x in (-0.05, -0.05, 0.05)]), None, None)

    def _straight(self, x: float) -> Floats:
        return np.stack([np.full(20, x), np.zeros(20), np.linspace(0.1, 0.5, 20)], axis=1)


def test_an_end_that_goes_through_an_obstacle_between_two_steps_is_not_free() -> None:
    made = learner(SMALL)
    way = {"center_m": (0.0, 0.0, 0.5), "axis": (0.0, 1.0, 0.0), "radius_m": (0.02,), "height_m": (0.06,)}
    made.layout = replace(made.layout, obstacles=(Obstacle("cylinder", way),))
    episode = made.episode(made.flat, want_gradient=False)
    leapt = made.replayed(replace(episode, end_m=np.zeros((2, 3))), Leaping())
    assert leapt.min_clearance_m == pytest.approx(-0.02 - LAYOUT.rope.radius_m, abs=2e-3)


def test_the_first_path_is_an_arc_on_the_side_that_was_asked_for() -> None:
    across = LAYOUT.goal_m[-1] - LAYOUT.grasp.position_m
    beside = np.cross(across, (0.0, 1.0, 0.0))
    goal = goal_at_particles(LAYOUT, SMALL.particles)
    furthest = []
    for side in (-0.75, 0.75):
        made = learner(SMALL)
        weights = xavier(goal.size + PARAMETERS, SMALL.hidden, 1, side)
        made = Learner(LAYOUT, made.rope, Policy(weights, made.policy.bounds, goal, 0.445), SMALL)
        way = made.episode(made.flat, want_gradient=False).end_m - LAYOUT.grasp.position_m
        furthest.append(float((way @ beside)[np.abs(way @ beside).argmax()]))
    assert furthest[0] * furthest[1] < 0


def test_learning_lowers_the_loss_and_writes_it_down(tmp_path: Path) -> None:
    learned = learn(LAYOUT, ROD, SMALL)
    assert learned.curve["loss"].min() < 0.8 * learned.curve["loss"].iloc[0]
    content = write_learned(learned, tmp_path / "out")
    assert content["min_clearance_m"] == pytest.approx(learned.kept.min_clearance_m)
    motion = read_motion(tmp_path / "out" / "trajectory.csv")
    assert motion.end_m[0] == pytest.approx(LAYOUT.grasp.position_m, abs=1e-6)
    assert motion.end_m[1:] == pytest.approx(learned.kept.end_m, abs=1e-8)


def test_without_an_obstacle_there_is_no_clearance(tmp_path: Path) -> None:
    learned = learn(replace(LAYOUT, obstacles=()), ROD, replace(SMALL, iterations=2))
    assert write_learned(learned, tmp_path / "out")["min_clearance_m"] is None


class Torn(HeldRope):
    """A rope that tears on the first path of the first initial weights."""

    starts = 0

    def start(self) -> tuple[State, Floats]:
        self.starts += 1
        return super().start()

    def forward(self, state: State, end_m: Floats) -> Piece:
        if self.starts == 1:
            raise SimulationError("it would tear", mend="do not")
        return super().forward(state, end_m)


def test_weights_whose_first_path_tears_the_rope_are_left_for_others() -> None:
    few = replace(SMALL, iterations=2, starts=2)
    learned = learn(LAYOUT, ROD, few, Torn(LAYOUT, ROD, few, 0.0))
    assert len(learned.curve) == 2
    assert (learned.starts, learned.iterations_total) == (2, 2)
    one = replace(few, starts=1)
    with pytest.raises(SimulationError, match="it would tear"):
        learn(LAYOUT, ROD, one, Torn(LAYOUT, ROD, one, 0.0))


def test_each_initial_weights_are_tried_with_the_first_arc_on_either_side(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried: list[tuple[int, float]] = []

    def torn(layout: Layout, rope: HeldRope, policy: Policy, settings: LearnSettings) -> Learner:
        tried.append((settings.seed, settings.first_arc))
        assert np.sign(policy.weights[-1][1][0]) == np.sign(settings.first_arc)
        raise SimulationError("it would tear", mend="do not")

    monkeypatch.setattr(import_module("dlolib.learn.learn"), "Learner", torn)
    with pytest.raises(SimulationError, match="it would tear"):
        learn(LAYOUT, ROD, replace(SMALL, seed=3, starts=5, first_arc=0.6))
    assert tried == [(3, -0.6), (3, 0.6), (4, -0.6), (4, 0.6), (5, -0.6)]
    tried.clear()
    with pytest.raises(SimulationError, match="it would tear"):
        learn(LAYOUT, ROD, replace(SMALL, seed=3, starts=2, first_arc=0.0))
    assert tried == [(3, 0.0), (4, 0.0)]


def test_the_iterations_of_every_start_are_counted() -> None:
    learned = learn(LAYOUT, ROD, replace(SMALL, iterations=2, starts=3))
    content = result(learned)
    assert (content["starts"], content["iterations"], content["iterations_total"]) == (3, 2, 6)


def test_same_seed_same_path() -> None:
    first, again = (learn(LAYOUT, ROD, SMALL).kept.end_m for _ in range(2))
    assert np.array_equal(first, again)


def test_ablation_keeps_every_run() -> None:
    table = ablate(LAYOUT, ROD, LearnSettings(steps=20, segments=2, particles=10, iterations=2), (1, 2))
    runs = pd.MultiIndex.from_frame(table[["loss", "seed"]]).unique()
    assert len(runs) == 4
    assert len(table) == 8
    assert set(table["contact_margin_m"]) == {LearnSettings().contact_margin_m}


def test_settings_that_do_not_fit_together_are_refused() -> None:
    with pytest.raises(ParameterError, match="do not divide"):
        LearnSettings(steps=100, segments=7)
    with pytest.raises(ParameterError, match="learn.contact_zone_m: a zone of 0.003 m is within the margin"):
        LearnSettings(contact_zone_m=0.003)
    with pytest.raises(ParameterError, match="rate of turn"):
        LearnSettings(first_arc=1.0)
