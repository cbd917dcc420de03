"""Which parameters a set of recordings can tell, and how the fit moves in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlolib.sim.effects import EFFECTS, parameter
from dlolib.sim.effects.base import sizes
from dlolib.sim.rod import STIFFEST_M4_S2
from dlolib.sim.upright import ROLL, unrolled
from dlolib.types import Floats, Recording

STIFFNESSES = ("bending_stiffness", "torsional_stiffness")
END_ANGLES = ("end_angle.start_1", "end_angle.start_2", "end_angle.end_1", "end_angle.end_2")
# A photograph shows the vertical as well as its camera was levelled: gravity has a part along the picture.
TILT = "lateral_load.x"
REST_CURVATURES = ("rest_curvature.kappa_1", "rest_curvature.kappa_2")
# A parameter that moves no point by this much when it changes by its scale does not act.
ACTS_M = 1e-5
# The softest rope over its density: a hair.
SOFTEST_M4_S2 = 1e-8
# The weight over EI / L² of a rope that it does not bend.
UNBENT = 0.01
# What counts as a change of one in what is fitted by its logarithm: a tenth.
LOGARITHM_SCALE = 0.1


@dataclass(frozen=True)
class Unknown:
    """One number of the fit: its name, and the recording it belongs to (None: shared by all)."""

    name: str
    recording: int | None = None

    @property
    def logarithmic(self) -> bool:
        """What is positive may be off by decades: the fit moves in its logarithm."""
        return self.stiffness or parameter(self.name).low > 0

    @property
    def stiffness(self) -> bool:
        """Whether it is EI or GJ."""
        return self.name in STIFFNESSES

    @property
    def size(self) -> bool:
        """Whether it says how large an effect is, not where, when or how."""
        name, _, part = self.name.partition(".")
        return not self.stiffness and part in sizes(EFFECTS[name])

    @property
    def scale(self) -> float:
        """A change of one, in the fit's own coordinate."""
        return LOGARITHM_SCALE if self.logarithmic else parameter(self.name).scale

    @property
    def bounds(self) -> tuple[float, float]:
        """Of the fit's own coordinate; those of a stiffness depend on the rope (`within`)."""
        if self.stiffness:
            return -np.inf, np.inf
        known = parameter(self.name)
        return self.inward(known.low), self.inward(min(known.high, known.fitted))

    def inward(self, value: float) -> float:
        """From the parameter to the fit's coordinate."""
        return float(np.log(value)) if self.logarithmic else value

    def outward(self, coordinate: float) -> float:
        """From the fit's coordinate to the parameter."""
        return float(np.exp(coordinate)) if self.logarithmic else coordinate


def within(density_kg_m: float | None) -> tuple[float, float]:
    """Least and largest stiffness of a rope of that density, in the fit's own coordinate."""
    density = density_kg_m or 1.0
    return float(np.log(SOFTEST_M4_S2 * density)), float(np.log(STIFFEST_M4_S2 * density))


def unbent(recording: Recording, stiffness: float) -> bool:
    """Whether a rope of this EI [N m²] is so stiff that its weight does not bend it, and no speed either."""
    rope = recording.rope
    mass_kg = (rope.linear_density_kg_m or 1.0) * rope.length_m + rope.tip_mass_kg
    weight_n = mass_kg * float(np.linalg.norm(recording.gravity_m_s2))
    return recording.quasi_static and stiffness > weight_n * rope.length_m**2 / UNBENT


def candidates(recordings: Sequence[Recording]) -> tuple[Unknown, ...]:
    """EI and GJ of the object, rest curvature where an end is free, and the angles of each one's clamps; and
    how one end is rolled against the other, where that was not recorded.

    Where only a picture's plane was seen, the vertical in it is each recording's own, too.
    Uniform rest curvature cannot be told between two clamps (the integral of curvature is fixed), so it is
    a candidate only where an end is free.
    """
    free = any("free" in (r.ends.start, r.ends.end) for r in recordings)
    rolls = (ROLL,) if any(map(unrolled, recordings)) else ()
    shared = [Unknown(name) for name in (*STIFFNESSES, *rolls, *(REST_CURVATURES if free else ()))]
    own = [
        Unknown(name, k)
        for k, recording in enumerate(recordings)
        for name in END_ANGLES
        if getattr(recording.ends, name.partition(".")[2][:-2]) == "clamped"
    ]
    tilts = [Unknown(TILT, k) for k, recording in enumerate(recordings) if recording.planar]
    return (*shared, *own, *tilts)


def acting(unknowns: Sequence[Unknown], jacobian: Floats) -> list[int]:
    """Positions of the unknowns that move some point; jacobian (R, N) in the fit's coordinates."""
    moves = np.abs(jacobian).max(axis=0) * np.array([u.scale for u in unknowns])
    return [k for k, move in enumerate(moves) if move > ACTS_M]
