"""Draw what is to be recorded from a secret seed: effects, sizes, places, motions, contacts, noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlolib.proof.chain import Sizes
from dlolib.proof.motions import draw_plan, make_motion
from dlolib.proof.noise import draw_noise
from dlolib.proof.place import Place, find_place
from dlolib.proof.play import settled
from dlolib.proof.sizes import NAMES, draw_effect
from dlolib.proof.world import Effects, Experiment
from dlolib.types import Floats, Noise, Obstacle

# Of every recording: nothing missing, one effect, a pair.
NULLS, SINGLES = 0.5, 0.27
STIFFNESS_N_M2, TWIST_RATIO = (1.5e-4, 5e-4), (0.5, 1.5)
SIGMA_M, CORRELATIONS, LOST = 0.0015, (0.7, 1.5), (0.01, 0.03)
OBSTACLE_SHARE, OBSTACLE_RADIUS_M, OBSTACLE_DEPTH_M, BAR_M = 0.1, (0.015, 0.03), (0.002, 0.008), 1.0
# Two obstacles in one motion, of which one throws the rope off the other, are no pair to be told apart.
TOGETHER_NEVER = ({"contact_friction", "hidden_obstacle"},)


@dataclass(frozen=True)
class Case:
    """One recording of the proof, and all that is true of it.

    noise_m (F, 30, 3) [m]; seen (F, 30), False for a lost point; bodies of the chain that shows the points.
    """

    experiment: Experiment
    effects: Effects
    noise: Noise
    noise_m: Floats
    seen: np.ndarray
    points_m: Floats
    bodies: int


def draw_names(seed: int, size: int) -> list[tuple[str, ...]]:
    """The names of the effects in every recording of a shard, in random order.

    Singles go round all effects before one comes again, so that none is left out by chance.
    """
    rng = np.random.default_rng([seed, 0])
    nulls, singles = round(NULLS * size), round(SINGLES * size)
    rounds = [rng.permutation(NAMES) for _ in range(-(-singles // len(NAMES)))]
    alone = [(str(name),) for name in np.concatenate(rounds)[:singles]] if rounds else []
    pairs = [_pair(rng) for _ in range(size - nulls - len(alone))]
    names: list[tuple[str, ...]] = [() for _ in range(nulls)] + alone + pairs
    return [names[int(index)] for index in rng.permutation(size)]


def draw_case(
    seed: int,
    index: int,
    names: Sequence[str],
    multiple: float | None = None,
    attempt: int = 0,
    settled_m: float = SIGMA_M,
) -> Case:
    """The case of that number in a shard: everything but its names drawn independently of them.

    Args:
        seed: of the shard.
        index: of the recording.
        names: of its effects.
        multiple: of the size that is found, in place of a drawn one.
        attempt: a rope that could not be played is drawn anew.
        settled_m: noise of what will be shown [m], for which the laboratory's chain must be fine enough.

    Raises:
        SimulationError: it cannot be played: the rope is thrown over an obstacle, or does not settle.
    """
    rng = np.random.default_rng([seed, 1 + index, attempt])
    experiment, place = _draw_experiment(rng)
    noise = _draw_tracker(rng)
    touched = rng.random() < OBSTACLE_SHARE
    obstacle_rng, effect_rng, noise_rng = rng.spawn(3)
    if touched or "contact_friction" in names:
        experiment = replace(experiment, obstacles=(_draw_obstacle(obstacle_rng, place),))
    effects: dict[str, dict[str, float]] = {}
    for name in names:
        effects |= {key: dict(value) for key, value in draw_effect(effect_rng, name, place, multiple).items()}
    points, bodies = settled(experiment, effects, settled_m)
    lost = float(noise_rng.uniform(*LOST)) if noise_rng.random() < 0.5 else 0.0
    return Case(
        experiment,
        effects,
        noise,
        draw_noise(noise_rng, noise, points.shape),
        noise_rng.random(points.shape[:2]) >= lost,
        points,
        bodies,
    )


def _draw_experiment(rng: np.random.Generator) -> tuple[Experiment, Place]:
    stiffness = float(np.exp(rng.uniform(*np.log(STIFFNESS_N_M2))))
    ratio = float(np.exp(rng.uniform(*np.log(TWIST_RATIO))))
    plan = draw_plan(rng, Sizes())
    motion, frames = make_motion(plan, Sizes())
    experiment = Experiment(motion, frames, stiffness, ratio * stiffness)
    return experiment, find_place(experiment, plan.row_s)


def _draw_tracker(rng: np.random.Generator) -> Noise:
    if rng.random() < 0.5:
        return Noise(SIGMA_M, 0.0, 0.0)
    both = float(rng.choice(CORRELATIONS))
    return Noise(SIGMA_M, both, both)


def _draw_obstacle(rng: np.random.Generator, place: Place) -> Obstacle:
    """A level bar across the way, or nearly across."""
    radius = float(rng.uniform(*OBSTACLE_RADIUS_M))
    aside = rng.uniform(-0.4, 0.4)
    axis = np.array([np.sin(aside), np.cos(aside), 0.0])
    center = place.obstacle_center(rng, radius, float(rng.uniform(*OBSTACLE_DEPTH_M)), axis)
    return Obstacle(
        "cylinder",
        {
            "center_m": tuple(center.tolist()),
            "axis": tuple(axis.tolist()),
            "radius_m": (radius,),
            "height_m": (BAR_M,),
        },
    )


def _pair(rng: np.random.Generator) -> tuple[str, ...]:
    while True:
        pair = tuple(sorted(str(name) for name in rng.choice(NAMES, 2, replace=False)))
        if not any(banned <= set(pair) for banned in TOGETHER_NEVER):
            return pair
