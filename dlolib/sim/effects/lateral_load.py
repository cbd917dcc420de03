"""Gravity points elsewhere than recorded, or a steady wind (the same effect): a force per length."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dlolib.sim.effects.base import Parameter, Setup

NAME = "lateral_load"
SAYS = "a steady force along the whole rope: wind, or gravity pointing elsewhere"
PARAMETERS = tuple(
    Parameter(axis, "N/m", f"force per length along {axis}", 0.0, -20.0, 20.0, 0.005, (0.0,))
    for axis in "xyz"
)


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """The force on every particle's piece of the rope."""
    force = np.array([values["x"], values["y"], values["z"]])
    return setup.with_load(setup.particles_m[:, None] * force)
