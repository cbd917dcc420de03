"""A rod's parameters as two set-ups each, a little to either side: what derivatives are taken from."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Protocol

import numpy as np

from dlolib.sim.effects import LAWS, parameter
from dlolib.sim.effects.base import Camera, Setup, sizes
from dlolib.sim.observe import seen, turned
from dlolib.sim.rod import STIFFNESSES, Rod
from dlolib.types import Floats

# A difference for a derivative is no smaller a share of the value than this; a law's trace, in differences.
LEAST_DIFFERENCE, TRACE = 1e-9, 10.0

Sides = tuple[Setup, Setup, float]


@dataclass(frozen=True)
class Prediction:
    """Simulated points (P, 3) [m] and their derivatives (P, 3, N) by the N parameters asked for."""

    xyz_m: Floats
    by_parameter: Floats


class Settable(Protocol):
    """What puts a rod into its surroundings."""

    def setup(self, rod: Rod) -> Setup: ...


def sides_of(model: Settable, rod: Rod, name: str) -> Sides:
    """The set-ups with a parameter a little more and a little less, and how much lies between."""
    value = rod.value(name)
    step = 1e-4 * value
    if name not in STIFFNESSES:
        known = parameter(name)
        step = max(known.difference * known.scale, LEAST_DIFFERENCE * abs(value))
    ahead, behind = value + step, value - step
    made = (model.setup(rod.with_values({name: side})) for side in (ahead, behind))
    return (*made, ahead - behind)  # type: ignore[return-value]


def traced(rod: Rod, parameters: Sequence[str]) -> Rod:
    """The rod with a trace of every law whose size is one of the parameters and neutral.

    A law that is not there remembers nothing, and what a little of it would remember is most of its
    derivative.
    """
    traces = {}
    for law in LAWS:
        for part in sizes(law):
            name = f"{law.NAME}.{part}"
            known = parameter(name)
            if name in parameters and rod.value(name) == known.neutral and np.isfinite(known.neutral):
                traces[name] = known.neutral + TRACE * known.difference * known.scale
    return rod.with_values(traces) if traces else rod


def as_seen(
    xyz_m: Floats,
    camera: Camera,
    axis: Floats,
    sides: Sequence[Sides],
    moved: Callable[[Sequence[Sides]], Floats],
    moves: Callable[[Setup], Hashable] = attrgetter("mechanics"),
) -> Prediction:
    """True points (P, 3) [m] as the camera shows them, and their derivatives by what tells each two sides.

    `moved` gives the true points' derivatives (P, C, 3) by those that move the rope, which `moves` tells
    apart; what moves the camera alone needs no simulation.
    """
    moving = [k for k, (one, other, _) in enumerate(sides) if moves(one) != moves(other)]
    by = np.zeros((*xyz_m.shape, len(sides)))
    if moving:
        by[:, :, moving] = np.moveaxis(turned(moved([sides[k] for k in moving]), camera), 1, 2)
    for k, (one, other, width) in enumerate(sides):
        by[:, :, k] += (seen(xyz_m, one.camera, axis) - seen(xyz_m, other.camera, axis)) / width
    return Prediction(seen(xyz_m, camera, axis), by)
