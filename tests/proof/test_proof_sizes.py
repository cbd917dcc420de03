"""The sizes that count as found: a gain near 40 in the plain motion of data/practice."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dlolib.errors import SimulationError
from dlolib.proof.chain import Sizes
from dlolib.proof.gain import gain
from dlolib.proof.motions import Arc, Plan, make_motion
from dlolib.proof.place import find_place
from dlolib.proof.play import play
from dlolib.proof.sizes import FLATTEST, FOUND, LARGEST, NAMES, SMALLEST, draw_effect
from dlolib.proof.world import Experiment
from dlolib.types import Noise, Obstacle

PLAN = Plan("plain", 0.42, 0.12, Arc(np.radians(30), 2.09), Arc(np.radians(-70), 1.83), 2.0, 0.05)
# What a gain does as the size grows is no square for these: contact comes and goes.
TOUCHING = ("contact_friction", "hidden_obstacle")
# Sizes that were measured elsewhere, and are taken as they are whatever they gain in this laboratory.
GIVEN = (
    "rest_curvature", "internal_friction", "viscoelastic_bending", "stiffness_profile", "mass_profile",
    "end_angle", "lateral_load",
)  # fmt: skip


# How large what was drawn is, as `FOUND` counts it.
LARGE = {
    "rest_curvature": lambda v: np.hypot(v["kappa_1"], v["kappa_2"]),
    "internal_friction": lambda v: v["saturation_curvature"],
    "viscoelastic_bending": lambda v: v["modulus_ratio"],
    "stiffness_profile": lambda v: abs(np.log(v["factor"])),
    "end_angle": lambda v: np.hypot(*v.values()),
    "plastic_bending": lambda v: 1.25 * 9.0 / v["yield_curvature"] - 1.0,
    "nonlinear_bending": lambda v: abs(v["cubic"]),
    "axial_stretch": lambda v: 1 / v["axial_stiffness"],
    "end_compliance": lambda v: 1 / sum(v.values()),
    "end_twist": lambda v: abs(sum(v.values())),
    "anisotropic_bending": lambda v: abs(np.log(v["stiffness_ratio"])),
}


@pytest.mark.parametrize("name", LARGE)
def test_what_is_drawn_is_as_large_as_was_asked_for(name: str) -> None:
    place = cast(Any, SimpleNamespace(length_m=0.445, most_curvature_1_m=9.0))
    rng = np.random.default_rng(0)
    asked = [draw_effect(rng, name, place, 1.5)[name] for _ in range(60)]
    np.testing.assert_allclose([LARGE[name](values) for values in asked], 1.5 * FOUND[name], rtol=1e-9)
    logs = np.log([LARGE[name](draw_effect(rng, name, place)[name]) / FOUND[name] for _ in range(400)])
    low, high = np.log(SMALLEST), np.log(LARGEST)
    if name == "anisotropic_bending":  # no cable is flatter
        high = np.log(FLATTEST / FOUND[name])
        assert 0.1 < np.mean(np.isclose(logs, high)) < 0.5
    assert low <= logs.min() < low + 0.1 and high - 0.1 < logs.max() <= high + 1e-9


UPWARDS = {
    "nonlinear_bending": lambda v: v["cubic"] > 0,
    "anisotropic_bending": lambda v: v["stiffness_ratio"] > 1,
    "end_twist": lambda v: sum(v.values()) > 0,
    "stiffness_profile": lambda v: v["factor"] > 1,
}


@pytest.mark.parametrize("name", UPWARDS)
def test_what_has_two_signs_is_drawn_with_both(name: str) -> None:
    """As often; but for three soft spots for one splice."""
    place, rng = cast(Any, SimpleNamespace(length_m=0.445)), np.random.default_rng(1)
    upwards = [UPWARDS[name](draw_effect(rng, name, place, 1.0)[name]) for _ in range(300)]
    assert np.mean(upwards) == pytest.approx(0.25 if name == "stiffness_profile" else 0.5, abs=0.08)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in NAMES if name not in (*TOUCHING, *GIVEN)])
def test_the_gain_at_the_size_that_is_found(name: str) -> None:
    motion, frames = make_motion(PLAN, Sizes())
    experiment = Experiment(motion, frames, 3e-4, 3e-4)
    place, rng, found = find_place(experiment, PLAN.row_s), np.random.default_rng(1), []
    for _ in range(3):
        effects = draw_effect(rng, name, place, 1.5)
        truth = play(experiment, effects, bodies=29)
        found.append(gain(experiment, truth, {}, Noise(0.0015, 0.0, 0.0), bodies=29).value / 1.5**2)
    assert 8 < np.median(found) < 250


@pytest.mark.slow
def test_a_bar_in_the_way_is_told_from_a_rough_one() -> None:
    motion, frames = make_motion(PLAN, Sizes())
    free = Experiment(motion, frames, 3e-4, 3e-4)
    place, rng = find_place(free, PLAN.row_s), np.random.default_rng(0)
    for _ in range(5):
        center = place.obstacle_center(rng, 0.02, 0.005, np.array([0.0, 1.0, 0.0]))
        bar = {"center_m": tuple(center), "axis": (0.0, 1.0, 0.0), "radius_m": (0.02,), "height_m": (1.0,)}
        touching = replace(free, obstacles=(Obstacle("cylinder", bar),))
        try:
            truth = play(touching, {"contact_friction": {"coefficient": 0.3}}, bodies=29)
            rough = gain(touching, truth, {}, Noise(0.0015, 0, 0), bodies=29)
        except SimulationError:  # thrown over the bar: drawn anew
            continue
        assert rough.value > 10
        return
    pytest.fail("no bar was played")
