"""Coulomb friction against the known obstacles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dlolib.sim.effects.base import Parameter, Setup
from dlolib.sim.scene import FRICTION

NAME = "contact_friction"
SAYS = "the rope rubs against an obstacle"
PARAMETERS = (Parameter("coefficient", "", "friction over normal force", 0.0, 0.0, 3.0, 0.05, (0.3,)),)
IDEAL = True
# Where it holds the rope fast it does not slide, and how it would shows in no derivative.
ABRUPT = True


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """The coefficient of every recorded obstacle."""
    if values["coefficient"] == 0.0 or not len(setup.obstacles):
        return setup
    obstacles = setup.obstacles.copy()
    obstacles[:, FRICTION] = values["coefficient"]
    return replace(setup, obstacles=obstacles, symmetric=False, path_dependent=True)
