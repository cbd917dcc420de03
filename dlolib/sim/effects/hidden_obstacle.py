"""Contact with something that was not recorded, as a frictionless sphere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dlolib.sim.effects.base import Parameter, Setup, Touch
from dlolib.sim.shapes import pack
from dlolib.types import Obstacle

NAME = "hidden_obstacle"
SAYS = "the rope touches something that was not recorded"
OF_RECORDING = True
# A larger one would be no thing that the rope touches but a wall along which it lies, which could guide
# it anywhere. Where a wall is touched in one place a sphere of this size is as flat as the rope can tell.
LARGEST_M = 0.1
PARAMETERS = (
    *(Parameter(axis, "m", f"{axis} of its centre", 0.0, -10.0, 10.0, 0.005, (), 1e-6) for axis in "xyz"),
    Parameter(
        "radius", "m", "its radius, without the rope's", 0.0, 0.0, 1.0, 0.005, (0.02,), 1e-6, fitted=LARGEST_M
    ),
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


def guess(touch: Touch) -> dict[str, float]:
    """That sphere."""
    return dict(zip(("x", "y", "z", "radius"), (*touch.center_m, touch.radius_m), strict=True))
