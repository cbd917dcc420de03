"""Learn a layout: from its goal shape to a trajectory free of contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from autograd.misc.optimizers import adam

from dlolib.errors import SimulationError
from dlolib.learn.arcs import PARAMETERS
from dlolib.learn.goal import check_learnable, goal_at_particles
from dlolib.learn.policy import Policy, xavier
from dlolib.learn.rope import DifferentiableRope, HeldRope
from dlolib.learn.settings import LearnSettings
from dlolib.learn.train import Episode, Learner
from dlolib.progress import track
from dlolib.sim.rod import Rod
from dlolib.types import Floats, Layout

# Iterations without a better path after which one on the goal is taken.
PATIENCE = 20


@dataclass(frozen=True)
class Learned:
    """What learning found: the kept iterate, its controller, and the curve over the iterations of its start.

    starts, iterations_total: how many initial weights were tried, and the iterations of them all.
    curve: iteration, loss, goal_error_mean_m, goal_error_max_m, min_clearance_m (of the rope's own surface,
    while it touches obstacles contact_margin_m before), contacts, contact_margin_m.
    """

    layout: Layout
    settings: LearnSettings
    policy: Policy
    kept: Episode
    kept_iteration: int
    curve: pd.DataFrame
    starts: int
    iterations_total: int

    @property
    def free(self) -> bool:
        """Whether the kept path has the clearance that was asked for."""
        return self.kept.min_clearance_m >= self.settings.clearance_m


class Caught(Exception):  # noqa: N818
    """The path is caught behind an obstacle."""


def learn(
    layout: Layout, rod: Rod, settings: LearnSettings, rope: DifferentiableRope | None = None
) -> Learned:
    """Learn how to move the rope's end so that the rope comes to its goal: Section V.B, Algorithm 2.

    From some initial weights the path gets caught on the wrong side of an obstacle, where the gradient of
    (19) leads nowhere; then the first arc is turned to the other side, and other weights are tried.

    Args:
        layout: goal, obstacles, where the ends are.
        rod: the rope's physics, as identified; its number of particles comes from the settings.
        settings: see `LearnSettings`.
        rope: a stand-in for `HeldRope`, for tests.

    Raises:
        LayoutError: no path can be learned for this layout.
        SimulationError: the rope could not be simulated.
    """
    check_learnable(layout, settings.clearance_m)
    goal_m = goal_at_particles(layout, settings.particles)
    inputs = goal_m.size + PARAMETERS
    held = rope or HeldRope(layout, rod, settings, settings.contact_margin_m)
    bare = rope or HeldRope(layout, rod, settings, 0.0)
    best: Learned | None = None
    failed: SimulationError | None = None
    tried_starts, iterations = 0, 0
    sides = (-1.0, 1.0) if settings.first_arc else (0.0,)
    for start in range(settings.starts):
        seed, side = settings.seed + start // len(sides), sides[start % len(sides)]
        tried = replace(settings, seed=seed, first_arc=side * settings.first_arc)
        weights = xavier(inputs, tried.hidden, seed, tried.first_arc, tried.bounds[1])
        policy = Policy(weights, np.array(tried.bounds), goal_m, layout.rope.length_m)
        tried_starts += 1
        try:
            learned = _train(Learner(layout, held, policy, tried), bare, tried)
        except SimulationError as error:
            failed = error  # these weights' first path is none that a rope could follow
            continue
        iterations += learned.iterations_total
        if best is None or _rank(learned.kept, settings) < _rank(best.kept, settings):
            best = learned
        if learned.free and learned.kept.goal.mean_m <= settings.near_goal_m:
            break
    if best is None:
        assert failed is not None
        raise failed
    return replace(best, starts=tried_starts, iterations_total=iterations)


class Settled(Exception):  # noqa: N818
    """The path is on the goal and has gained no clearance for a while."""


def _train(learner: Learner, bare: DifferentiableRope, settings: LearnSettings) -> Learned:
    """Lines 2 to 12 of Algorithm 2 with Adam, as the paper's rate suggests; keep the best iterate.

    What is ranked is the path driven with the rope as it is (`bare`), without the margin of learning.
    """
    rows: list[dict[str, float]] = []
    best: tuple[Floats, Episode, int] | None = None
    label = f"learn {learner.layout.name} ({settings.loss}, seed {settings.seed})"
    ticks = track(range(settings.iterations), label)

    def gradient(weights: Floats, iteration: int) -> Floats:
        nonlocal best
        next(ticks, None)
        episode = learner.episode(weights)
        rows.append(_row(iteration, episode))
        if best is None or _rank(episode, settings) < _rank(best[1], settings):
            replayed = learner.replayed(episode, bare)
            if best is None or _rank(replayed, settings) < _rank(best[1], settings):
                best = weights.copy(), replayed, iteration
        if _rank(best[1], settings)[0] == 0 and iteration - best[2] >= PATIENCE:
            raise Settled
        nearest_m = min(row["goal_error_mean_m"] for row in rows)
        if settings.starts > 1 and iteration >= settings.caught_after and nearest_m > settings.caught_m:
            raise Caught
        return episode.gradient

    try:
        adam(
            gradient,
            learner.flat,
            num_iters=settings.iterations,
            step_size=settings.rate,
            b2=settings.forgetting,
        )
    except Settled:
        pass
    except (Caught, SimulationError):
        # behind an obstacle, or where no rope can follow: these weights have come to their end
        if best is None:
            raise
    next(ticks, None)
    assert best is not None
    weights, kept, iteration = best
    curve = pd.DataFrame(rows).assign(contact_margin_m=settings.contact_margin_m)
    policy = learner.trained(weights)
    return Learned(learner.layout, settings, policy, kept, iteration, curve, 1, len(rows))


def _rank(episode: Episode, settings: LearnSettings) -> tuple[int, float, float]:
    """Order of preference, smallest first: free and on the goal by clearance, and by error where there is
    nothing to keep clear of; free by error; else by loss."""
    if episode.min_clearance_m < settings.clearance_m:
        return 2, episode.loss, 0.0
    if episode.goal.mean_m > settings.goal_tolerance_m:
        return 1, episode.goal.mean_m, 0.0
    return 0, -episode.min_clearance_m, episode.goal.mean_m


def _row(iteration: int, episode: Episode) -> dict[str, float]:
    return {
        "iteration": iteration,
        "loss": episode.loss,
        "goal_error_mean_m": episode.goal.mean_m,
        "goal_error_max_m": episode.goal.max_m,
        "min_clearance_m": episode.min_clearance_m,
        "contacts": episode.contacts,
    }


def ablate(layout: Layout, rod: Rod, settings: LearnSettings, seeds: Sequence[int]) -> pd.DataFrame:
    """Plain MSE against the contact loss from several initial weights: the paper's Fig. 11, all runs kept.

    The weights are Xavier's, as they come: with a first arc around the obstacle either loss may arrive.

    Returns:
        One row per loss, seed and iteration: loss ("mse" | "contact"), seed, iteration, value,
        goal_error_mean_m, min_clearance_m, contact_margin_m.
    """
    tables = []
    for seed in seeds:
        for loss in ("mse", "contact"):
            curve = learn(layout, rod, replace(settings, loss=loss, seed=seed, starts=1, first_arc=0.0)).curve
            tables.append(curve.assign(loss=loss, seed=seed, value=curve["loss"]))
    order = ["loss", "seed", "iteration", "value", "goal_error_mean_m", "min_clearance_m", "contact_margin_m"]
    return pd.concat(tables, ignore_index=True)[order]
