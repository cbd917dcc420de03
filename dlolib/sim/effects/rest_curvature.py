"""Curvature at rest (coil memory, a set that a cable has taken): M = EI (κ - κ0).

Along the rope κ0(s) = kappa + Σ wave_k cos(k π s / L) about each axis: a cable that has lain folded or was
pulled off a drum is bent unevenly. The waves are fitted all together; shorter bends than a quarter of the
length hardly show between points some centimetres apart.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dlolib.sim.effects.base import Parameter, Setup
from dlolib.sim.scene import REST

NAME = "rest_curvature"
SAYS = "the rope is curved where nothing bends it"
AXES, WAVES = {1: "first", 2: "second"}, range(1, 5)


def _uniform(axis: int) -> Parameter:
    says = f"curvature at rest about the {AXES[axis]} axis"
    return Parameter(f"kappa_{axis}", "1/m", says, 0.0, -40.0, 40.0, 0.1, (-1.0, 0.0, 1.0))


def _wave(axis: int, k: int) -> Parameter:
    says = f"its part about the {AXES[axis]} axis that varies along the rope as cos({k} π s/L)"
    return Parameter(f"wave_{axis}_{k}", "1/m", says, 0.0, -40.0, 40.0, 0.1, (0.0,))


PARAMETERS = (*map(_uniform, AXES), *(_wave(axis, k) for axis in AXES for k in WAVES))
SIZES = ("kappa_1", "kappa_2")
SIDED = True
FORMS = (("kappa_1",), ("kappa_2",), ("kappa_1", "kappa_2"), tuple(p.name for p in PARAMETERS))


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """Every joint's curvature at rest, its mean over the joint's piece of the rope."""
    low, high = setup.joint_arc_m()
    rest = np.empty((len(low), len(AXES)))
    for column, axis in enumerate(AXES):
        rest[:, column] = values[f"kappa_{axis}"]
        for k in WAVES:
            number = k * np.pi / setup.arc_m[-1]
            mean = (np.sin(number * high) - np.sin(number * low)) / (number * (high - low))
            rest[:, column] += values[f"wave_{axis}_{k}"] * mean
    return setup.with_joints(slice(REST, REST + len(AXES)), rest)
