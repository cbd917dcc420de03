"""Length that changes with tension: strain = tension / stiffness (neutral: infinite)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dlolib.sim.effects.base import Parameter, Setup

NAME = "axial_stretch"
SAYS = "the rope grows longer under tension"
PARAMETERS = (
    Parameter("axial_stiffness", "N", "tension over strain", np.inf, 0.05, np.inf, 1.0, (20.0, 200.0)),
)


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """The segments' axial stiffness, in series with the one that stands for an inextensible rope."""
    segments = setup.segments.copy()
    segments[:, 3] = 1.0 / (1.0 / segments[:, 3] + 1.0 / values["axial_stiffness"])
    return setup if np.isinf(values["axial_stiffness"]) else replace(setup, segments=segments)
