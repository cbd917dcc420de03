"""Mass that varies along the rope: a point mass at s, and a gradient ρ (1 + gradient (2 s / L - 1)).

The point mass hangs on the particles around it by quadratic B-splines, which keep its weight and its moment,
and move it smoothly from particle to particle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dlolib.sim.effects.base import Parameter, Setup, tip
from dlolib.sim.scene import INERTIA, LOAD
from dlolib.types import Floats

NAME = "mass_profile"
SAYS = "the rope carries a lump, or is heavier towards one end"
PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)
PARAMETERS = (
    Parameter("s", "m", "where the point mass is", 0.0, 0.0, np.inf, 0.01, PLACES, along="rope"),
    Parameter("mass", "kg", "the point mass", 0.0, 0.0, 10.0, 1e-4, (0.002,)),
    Parameter(
        "gradient", "", "how much the density grows from the middle to the end", 0.0, -1.0, 1.0, 0.02, (0.0,)
    ),
)
SIZES = ("mass", "gradient")
FORMS = (("s", "mass"), ("gradient",), ("s", "mass", "gradient"))


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """Further weight and inertia on the particles."""
    arc = setup.arc_m
    length = arc[-1]
    rope = setup.weight.copy()
    rope[tip(setup.ends)] -= setup.rope.tip_mass_kg
    more = rope * values["gradient"] * (2 * _centres(arc) / length - 1)
    more = more + values["mass"] * shares(arc, values["s"])
    particles = setup.particles.copy()
    particles[:, INERTIA] += more
    particles[:, LOAD:] += more[:, None] * setup.gravity_m_s2
    return replace(setup, particles=particles, weight=setup.weight + more)


def _centres(arc_m: Floats) -> Floats:
    """Arc length of the middle of each particle's piece of the rope [m]."""
    centres = arc_m.copy()
    centres[0] += (arc_m[1] - arc_m[0]) / 4
    centres[-1] -= (arc_m[-1] - arc_m[-2]) / 4
    return centres


def shares(arc_m: Floats, place_m: float) -> Floats:
    """What each particle (n,) carries of a unit at the place; the sum is 1, and so is the first moment."""
    away = np.abs(arc_m - place_m) / (arc_m[1] - arc_m[0])
    share = np.where(away < 0.5, 0.75 - away**2, 0.5 * np.maximum(1.5 - away, 0.0) ** 2)
    # what would hang beyond an end is mirrored about it, so that the moment stays
    return _mirrored(share, arc_m, place_m)


def _mirrored(share: Floats, arc_m: Floats, place_m: float) -> Floats:
    step = arc_m[1] - arc_m[0]
    made = share.copy()
    for end, inner, beyond in ((0, 1, (place_m - arc_m[0]) / step), (-1, -2, (arc_m[-1] - place_m) / step)):
        outside = 0.5 * max(0.5 - beyond, 0.0) ** 2
        # a share at -1 is worth two at 0 less one at 1
        made[end] += 2 * outside
        made[inner] -= outside
    return made
