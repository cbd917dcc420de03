"""Two bending stiffnesses (a flat cable): EI about the first material axis, ratio x EI about the second."""

from __future__ import annotations

from collections.abc import Mapping

from dlolib.sim.effects.base import Parameter, Setup
from dlolib.sim.scene import STIFFNESS

NAME = "anisotropic_bending"
SAYS = "the rope is stiffer about one axis than about the other"
SIDED = True
# A rope that gives way where it is soft is nearest, in the mean, to one that is too stiff to do so anywhere.
STIFFENS = True
PARAMETERS = (
    Parameter(
        "stiffness_ratio", "", "EI about the second axis over the first", 1.0, 0.02, 50.0, 0.05, (0.5, 2.0)
    ),
)


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """The second stiffness of every joint times the ratio."""
    second = STIFFNESS + 1
    return setup.with_joints(second, setup.joints[:, second] * values["stiffness_ratio"])
