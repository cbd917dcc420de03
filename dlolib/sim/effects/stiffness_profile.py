"""Stiffness that varies along the rope (a soft spot, a splice).

EI and GJ times 1 - (1 - factor) w(s), where w is a box of the width around the place, its edges
½ tanh(· / 6 mm). A joint bends with the mean compliance of its piece of the rope, since the pieces of a piece
are springs in series; so that a spot narrower than a segment counts as what it is.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dlolib.sim.effects.base import Parameter, Setup
from dlolib.sim.scene import REST, STIFFNESS
from dlolib.types import Floats

NAME = "stiffness_profile"
SAYS = "the rope is softer or stiffer at one place"
PLACES = (0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95)
PARAMETERS = (
    Parameter("s", "m", "where", 0.0, 0.0, np.inf, 0.01, PLACES, along="rope"),
    Parameter("factor", "", "stiffness there over that elsewhere", 1.0, 0.02, 50.0, 0.05, (0.5, 2.0)),
    Parameter("width", "m", "how long the place is", 0.04, 0.005, np.inf, 0.01, (0.04,)),
)
SIZES = ("factor",)
EDGE_M = 0.006
# Gauss-Legendre points of a joint's piece: it is up to 16 mm long, an edge 6 mm.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """Every joint's stiffnesses over the mean compliance of its piece."""
    if values["factor"] == 1.0:
        return setup
    low, high = setup.joint_arc_m()
    at = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * NODES
    mean = np.sum(WEIGHTS / 2 / profile(at, values["s"], values["factor"], values["width"]), axis=1)
    columns = slice(STIFFNESS, REST)
    return setup.with_joints(columns, setup.joints[:, columns] / mean[:, None])


def profile(s_m: Floats, place_m: float, factor: float, width_m: float) -> Floats:
    """EI at s over EI elsewhere."""
    left = np.tanh((s_m - place_m + width_m / 2) / EDGE_M)
    right = np.tanh((s_m - place_m - width_m / 2) / EDGE_M)
    return np.asarray(1.0 - (1.0 - factor) * (left - right) / 2)
