"""What one place of the rope would show if it were a little stiffer, curved at rest, or pushed."""

from __future__ import annotations

import numpy as np

from dlolib.sim.effects.base import Setup
from dlolib.sim.scene import REST, STIFFNESS
from dlolib.sim.sides import Sides
from dlolib.types import Floats

PLACES = 12
PROBES = {
    "stiffness": "",
    "curvature_1": "1/m",
    "curvature_2": "1/m",
    "force_x": "N",
    "force_y": "N",
    "force_z": "N",
}
FORCES = tuple(name for name in PROBES if name.startswith("force"))


def places(length_m: float) -> Floats:
    """Where a rope is probed, (PLACES,) [m]."""
    return np.asarray((np.arange(PLACES) + 0.5) / PLACES * length_m)


def probe(made: Setup, name: str, s_m: float, width_m: float) -> Sides:
    """The set-up with one place a little stiffer, more curved or pushed, either way."""
    sides, size = [], {"stiffness": 1e-3, "curvature_1": 1e-3, "curvature_2": 1e-3}.get(name, 1e-5)
    for sign in (1, -1):
        if name == "stiffness":
            share = _bump((np.sum(made.joint_arc_m(), axis=0)) / 2, s_m, width_m)[:, None]
            columns = slice(STIFFNESS, REST)
            sides.append(made.with_joints(columns, made.joints[:, columns] * (1 + sign * size * share)))
        elif name.startswith("curvature"):
            share = _bump((np.sum(made.joint_arc_m(), axis=0)) / 2, s_m, width_m)
            column = REST + int(name[-1]) - 1
            sides.append(made.with_joints(column, made.joints[:, column] + sign * size * share))
        else:
            share = _bump(made.arc_m, s_m, width_m)
            force = np.zeros((len(share), 3))
            force[:, "xyz".index(name[-1])] = sign * size * share / share.sum()
            sides.append(made.with_load(force))
    return sides[0], sides[1], 2 * size


def _bump(at_m: Floats, s_m: float, width_m: float) -> Floats:
    """1 at s, 0 from a width away on."""
    return np.maximum(1 - np.abs(at_m - s_m) / width_m, 0.0)


__all__ = ["FORCES", "PLACES", "PROBES", "places", "probe"]
