"""Curvature at rest (coil memory): M = EI (κ - κ0), uniform along the rope."""

from __future__ import annotations

from collections.abc import Mapping

from dlolib.sim.effects.base import Parameter, Setup
from dlolib.sim.scene import REST

NAME = "rest_curvature"
SAYS = "the rope is curved where nothing bends it"
PARAMETERS = (
    Parameter("kappa_1", "1/m", "curvature at rest about the first axis", 0.0, -40.0, 40.0, 0.1, (0.0,)),
    Parameter("kappa_2", "1/m", "curvature at rest about the second axis", 0.0, -40.0, 40.0, 0.1, (0.0,)),
)
FORMS = (("kappa_1",), ("kappa_2",), ("kappa_1", "kappa_2"))


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """The same curvature at rest in every joint."""
    return setup.with_joints(slice(REST, REST + 2), [values["kappa_1"], values["kappa_2"]])
