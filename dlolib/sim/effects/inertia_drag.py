"""Inertia or air drag that a quasi-static model leaves out: a force per length - inertia ρ a - drag v."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dlolib.sim.effects.base import Parameter, Setup
from dlolib.sim.scene import DRAG, INERTIA

NAME = "inertia_drag"
SAYS = "the rope's inertia or the drag of the air shows"
PARAMETERS = (
    Parameter(
        "inertia", "", "share of the rope's mass that is inert; 0: quasi-static", 0.0, 0.0, 3.0, 0.05, (1.0,)
    ),
    Parameter("drag", "N s/m^2", "drag per length and speed", 0.0, 0.0, 100.0, 0.005, (0.0, 0.05)),
)
# What inertia is where the effect is named and it is not.
NAMED = {"inertia": 1.0}
SIZES = ("drag",)
FORMS = (("drag",), ("inertia", "drag"))
# A rope that swings about its equilibrium is nearest, in the mean, to one that hardly moves.
STIFFENS = True


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """Inertial mass and drag of every particle; a quasi-static rod that has neither stays one."""
    if not setup.moving and values["inertia"] == 0.0 and values["drag"] == 0.0:
        return setup
    particles = setup.particles.copy()
    particles[:, INERTIA] = values["inertia"] * setup.weight
    particles[:, DRAG] += values["drag"] * setup.particles_m
    return replace(setup, particles=particles, moving=True)
