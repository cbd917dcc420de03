"""Gravity points elsewhere than recorded, or a steady wind (the same effect): a force per length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dlolib.sim.effects.base import Parameter, Setup
from dlolib.types import Recording

NAME = "lateral_load"
SAYS = "a steady force along the whole rope: wind, or gravity pointing elsewhere"
PARAMETERS = tuple(
    Parameter(axis, "N/m", f"force per length along {axis}", 0.0, -20.0, 20.0, 0.005, (0.0,))
    for axis in "xyz"
)
FORMS = (("y", "z"), ("x", "z"), ("x", "y"), ("x", "y", "z"))
# Directions of gravity (cosine) of which all recordings have one.
ONE_WAY = 0.999


def suits(form: Sequence[str], recordings: Sequence[Recording]) -> bool:
    """Whether these recordings tell of such a load.

    A rope in balance takes the same shapes where its stiffnesses and all that pulls at it are twice as large:
    a load along gravity is another stiffness there, unless a mass at its end or inertia tells how strong
    gravity is.
    """
    pulls = np.array([one.gravity_m_s2 for one in recordings])
    strengths = np.linalg.norm(pulls, axis=1)
    if len(form) == len(PARAMETERS):
        one_way = np.all(pulls @ pulls[0] > ONE_WAY * strengths * strengths[0])
        return not one_way or any(map(_weighs, recordings))
    return "xyz"[np.argmax(np.abs(pulls[0]))] not in form


def _weighs(recording: Recording) -> bool:
    free = "free" in (recording.ends.start, recording.ends.end)
    return not recording.quasi_static or (free and recording.rope.tip_mass_kg > 0.0)


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """The force on every particle's piece of the rope."""
    force = np.array([values["x"], values["y"], values["z"]])
    return setup.with_load(setup.particles_m[:, None] * force)
