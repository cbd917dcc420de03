"""Contact with something that was not recorded, as a frictionless sphere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dlolib.sim.effects.base import Hint, Parameter, Setup
from dlolib.sim.shapes import pack
from dlolib.types import Obstacle

NAME = "hidden_obstacle"
SAYS = "the rope touches something that was not recorded"
OF_RECORDING = True
PARAMETERS = (
    *(Parameter(axis, "m", f"{axis} of its centre", 0.0, -10.0, 10.0, 0.005, (), 1e-6) for axis in "xyz"),
    Parameter("radius", "m", "its radius, without the rope's", 0.0, 0.0, 1.0, 0.005, (0.02,), 1e-6),
)
# How large it must be to be seen depends on where it is.
SIZES: tuple[str, ...] = ()


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """A further obstacle."""
    if values["radius"] == 0.0:
        return setup
    centre = (values["x"], values["y"], values["z"])
    row = pack([Obstacle("sphere", {"center_m": centre, "radius_m": (values["radius"],)})])
    return replace(setup, obstacles=np.concatenate([setup.obstacles, row]))


def guess(hint: Hint, radius_m: float) -> list[dict[str, float]]:
    """Spheres that push the rope's axis from the other side of where it is off; `radius_m` is the rope's."""
    way = hint.off_m / np.linalg.norm(hint.off_m)
    centres = [(hint.place_m - (radius + radius_m) * way, radius) for radius in (0.01, 0.03)]
    return [
        dict(zip(("x", "y", "z", "radius"), (*centre, radius), strict=True)) for centre, radius in centres
    ]
