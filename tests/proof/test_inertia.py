"""Inertia and drag in the laboratory: a mass on a spring by theory, and a rope in steps half as long."""

import numpy as np
import pytest

from dlolib.proof.chain import Sizes
from dlolib.proof.inertia import SHARES, STAGES, Inertia
from dlolib.proof.motions import Arc, Plan, make_motion
from dlolib.proof.play import LEFT, play
from dlolib.proof.world import Experiment, vertex_masses
from dlolib.types import Floats, Motion

SIGMA_M = 0.0015
# The fastest rows, and a drag that leaves the rope swinging.
FAST = Plan("plain", 0.42, 0.12, Arc(np.radians(30), 2.09), Arc(np.radians(-70), 1.83), 2.0, 0.0125)
SWINGS = {"inertia_drag": {"inertia": 1.0, "drag": 0.03}}
# Before the first arc, and from there to its top and beyond.
STOOD, ROWS = 60, 320


def swung(experiment: Experiment, steps: int, until_s: float, begin: Floats) -> Floats:
    """Springs to the origin, let go from places `begin` (3, 3) [m] at rest, after so many steps."""
    stiff = 4.0
    inertia = Inertia(experiment, SWINGS, len(begin) - 1, begin)
    step_s = until_s / steps
    for _ in range(steps):
        for _ in STAGES:
            drift = inertia.drift(step_s)
            place = drift.drift / (drift.rate + stiff)
            inertia.keep(place, step_s)
    return place


@pytest.fixture
def fast() -> Experiment:
    motion, frames = make_motion(FAST, Sizes())
    some = frames[(frames > motion.t_s[STOOD]) & (frames < motion.t_s[ROWS])]
    rows = (getattr(motion, name)[:ROWS] for name in ("t_s", "start_m", "start_q", "end_m", "end_q"))
    return Experiment(Motion(*rows), some, 2.4e-4, 2.4e-4)


def test_a_mass_on_a_spring_swings_by_theory_to_the_third_order(fast: Experiment) -> None:
    begin, until_s = np.diag([0.01, 0.02, -0.03]), 0.5
    mass = vertex_masses(fast, SWINGS, 2)
    decay = 0.03 * fast.sizes.length_m / 2 * np.array([0.5, 1.0, 0.5]) / (2 * mass)
    turn = np.sqrt(4.0 / mass - decay**2)
    fades = np.exp(-decay * until_s) * (np.cos(turn * until_s) + decay / turn * np.sin(turn * until_s))
    errors = [
        np.abs(swung(fast, steps, until_s, begin) - fades[:, None] * begin).max() for steps in (200, 400)
    ]
    assert errors[1] < 2e-5
    assert errors[0] / errors[1] == pytest.approx(8, rel=0.1)


def test_the_stages_end_with_the_step() -> None:
    assert [sum(stage) for stage in STAGES] == pytest.approx(SHARES)
    assert SHARES[-1] == 1.0


def test_half_the_steps_show_the_same_swinging_rope(fast: Experiment) -> None:
    shown = play(fast, SWINGS, bodies=29)
    lacks = play(fast, SWINGS, bodies=29, finer=2) - shown
    swings = shown - play(fast, bodies=29)
    assert np.sum((swings / SIGMA_M) ** 2) > 50 * LEFT
    assert np.sum((lacks / SIGMA_M) ** 2) < 0.5 * LEFT
