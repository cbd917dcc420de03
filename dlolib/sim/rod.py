"""The rod as its user sees it, and its discretisation: physical parameters, the same at any mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from dlolib.errors import ParameterError
from dlolib.sim import shapes
from dlolib.sim.effects import JOINT_WIDTH, applied, check, parameter
from dlolib.sim.effects.base import Setup, particle_lengths, tip
from dlolib.sim.profile import Profile, mean_compliance
from dlolib.sim.scene import DRAG, INERTIA, LENGTH, LOAD, REST, STIFFNESS, UNIFORM, Scene, contact_points
from dlolib.types import PER_DENSITY, Ends, Floats, Obstacle, Rope

# An inextensible rope stretches this much under its load: its weight, the tip's, and a bend of its length.
WEIGHT_STRAIN = 3e-5
# Euler's load of a rope that is clamped at both ends, over EI / L^2: what pushes on it once it is bent.
EULER = 4 * np.pi**2
# Contact force per length of rope and depth [N/m^2], over the load per length.
CONTACT_OVER_LOAD_1_M = 5e7
# The stiffest rope over its density: of steel, as thick as an arm. Beyond it nothing bends, and rounding
# errors are all that shows.
STIFFEST_M4_S2 = 1e6
# How far a difference for a derivative may look beyond a bound.
BEYOND = 1e-3
STIFFNESSES = {"bending_stiffness": "N m^2", "torsional_stiffness": "N m^2"}
NOTHING: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class Rod:
    """A rope's physics, the same at any discretisation.

    Args:
        rope: length [m], diameter [m], linear density [kg/m] (1 where not measured), tip mass [kg].
        bending_stiffness: EI [N m^2].
        torsional_stiffness: GJ [N m^2].
        effects: further physics, `<effect>.<parameter>` to value (see `dlolib.sim.effects`).
        particles: n, the number of particles.
        profile: stiffnesses as arrays along the rope. A changed EI or GJ scales its array; laws that refer to
            the rope's uniform EI take `bending_stiffness`.
    """

    rope: Rope
    bending_stiffness: float
    torsional_stiffness: float
    effects: Mapping[str, float] = field(default_factory=lambda: NOTHING)
    particles: int = 30
    profile: Profile = field(default_factory=Profile)

    def __post_init__(self) -> None:
        for name, value in (
            ("bending_stiffness", self.bending_stiffness),
            ("torsional_stiffness", self.torsional_stiffness),
            ("length_m", self.rope.length_m),
            ("linear_density", self.linear_density),
        ):
            if not (np.isfinite(value) and value > 0):
                raise ParameterError(f"{name} = {value:g} is not a positive number", mend="give one above 0")
        for name, value in (("diameter_m", 2 * self.rope.radius_m), ("tip_mass_kg", self.rope.tip_mass_kg)):
            if not (np.isfinite(value) and value >= 0):
                raise ParameterError(f"{name} = {value:g} is out of range", mend="give 0 or more")
        if self.rope.linear_density_kg_m is None and self.rope.tip_mass_kg > 0:
            problem = "the density of a rope with a mass at its tip is not known"
            raise ParameterError(problem, place="linear_density_kg_m", mend="weigh the rope and give it")
        stiffest = STIFFEST_M4_S2 * self.linear_density
        for name, value in (("bending", self.bending_stiffness), ("torsional", self.torsional_stiffness)):
            if value > (1 + BEYOND) * stiffest:
                problem = f"{name}_stiffness = {value:g} N m^2 is stiffer than any rope of this density"
                raise ParameterError(problem, mend=f"give {stiffest:g} or less")
        if self.particles < 3:
            raise ParameterError(f"particles = {self.particles}", mend="a rod needs 3 or more")
        for name, value in self.effects.items():
            check(name, value, BEYOND)

    @property
    def linear_density(self) -> float:
        """Mass per length [kg/m]; 1 where it was not measured (then stiffnesses are over density)."""
        return 1.0 if self.rope.linear_density_kg_m is None else self.rope.linear_density_kg_m

    @staticmethod
    def of(rope: Rope, values: Mapping[str, float], particles: int = 30) -> Rod:
        """The rod with these parameters by name; both stiffnesses must be among them."""
        ei, gj = (float(values[name]) for name in STIFFNESSES)
        return Rod(rope, ei, gj, {k: v for k, v in values.items() if k not in STIFFNESSES}, particles)

    def with_values(self, values: Mapping[str, float]) -> Rod:
        """A copy with parameters changed: the two stiffnesses and those of effects, by name."""
        effects = {name: float(value) for name, value in values.items() if name not in STIFFNESSES}
        ei = float(values.get("bending_stiffness", self.bending_stiffness))
        gj = float(values.get("torsional_stiffness", self.torsional_stiffness))
        profile = self.profile.scaled(ei / self.bending_stiffness, gj / self.torsional_stiffness)
        return Rod(self.rope, ei, gj, {**self.effects, **effects}, self.particles, profile)

    def value(self, name: str) -> float:
        """The parameter of that name; neutral where the rod has no such effect."""
        if name in STIFFNESSES:
            return float(getattr(self, name))
        return float(self.effects.get(name, parameter(name).neutral))

    def with_particles(self, particles: int) -> Rod:
        """The same rope, discretised otherwise."""
        return replace(self, particles=particles)


def unit_of(name: str, weighed: bool = True) -> str:
    """Unit of a stiffness or of an effect's parameter; of a rope whose density is not known (it is simulated
    as 1 kg/m), that of the ratio to it.

    Raises:
        ParameterError: there is no such parameter.
    """
    if name in STIFFNESSES:
        return STIFFNESSES[name] if weighed else "m^4/s^2"
    unit = parameter(name).unit
    of_weight = any(word in unit.split() for word in ("N", "N/m", "kg"))
    return f"{unit}{PER_DENSITY}" if of_weight and not weighed else unit


def setup(
    rod: Rod, gravity_m_s2: Floats, ends: Ends, obstacles: Sequence[Obstacle] = (), moving: bool = False
) -> Setup:
    """Discretise a rod and put its effects in.

    Args:
        rod: its physics.
        gravity_m_s2: shape (3,).
        ends: which are held.
        obstacles: what it may touch.
        moving: whether it is inert; a quasi-static rod is not, unless `inertia_drag` says so.
    """
    n, length = rod.particles, rod.rope.length_m
    clamped = np.array([ends.start == "clamped", ends.end == "clamped"])
    gravity = np.asarray(gravity_m_s2, float)
    share = particle_lengths(length, n)
    weight = rod.linear_density * share
    weight[tip(ends)] += rod.rope.tip_mass_kg
    particles = np.zeros((n, 5))
    particles[:, INERTIA] = weight
    particles[:, LOAD:] = weight[:, None] * gravity
    axial, contact = _penalties(rod, gravity)
    segments = np.full((n - 1, 4), axial)
    segments[:, 0] = length / (n - 1)
    arc = np.linspace(0, length, n)
    for values, columns in ((rod.profile.shear, slice(1, 3)), (rod.profile.axial, slice(3, 4))):
        if values is not None:
            own = mean_compliance(values, length, arc[:-1], arc[1:])[:, None]
            segments[:, columns] = 1.0 / (1.0 / segments[:, columns] + own)
    contacts = np.empty((contact_points(n), 2))
    contacts[:, 0] = contact * particle_lengths(length, len(contacts))
    contacts[:, 1] = rod.rope.radius_m
    joints = _joints(rod, clamped)
    made = Setup(
        rope=rod.rope, ends=ends, gravity_m_s2=gravity, arc_m=arc,
        joints=joints, segments=segments, particles=particles, contacts=contacts,
        obstacles=shapes.pack(obstacles) if obstacles else np.zeros((0, shapes.WIDTH)),
        grips=np.zeros((2, 3)), weight=weight, moving=moving,
    )  # fmt: skip
    return applied(made, rod.effects)


def _joints(rod: Rod, clamped: np.ndarray) -> Floats:
    n = rod.particles
    joints = np.zeros((n, JOINT_WIDTH))
    joints[:, STIFFNESS:REST] = (rod.bending_stiffness, rod.bending_stiffness, rod.torsional_stiffness)
    length = rod.rope.length_m
    middles = (np.arange(n - 1) + 0.5) * length / (n - 1)
    low, high = np.append(0.0, middles), np.append(middles, length)
    for values, columns in (
        (rod.profile.bending, slice(STIFFNESS, STIFFNESS + 2)),
        (rod.profile.torsional, slice(STIFFNESS + 2, REST)),
    ):
        if values is not None:
            joints[:, columns] = 1.0 / mean_compliance(values, length, low, high)[:, None]
    joints[[0, -1], STIFFNESS:REST] *= clamped[:, None]
    joints[:, LENGTH] = rod.rope.length_m / (n - 1)
    joints[[0, -1], LENGTH] /= 2
    joints[:, UNIFORM] = rod.bending_stiffness
    return joints


def _penalties(rod: Rod, gravity: Floats) -> tuple[float, float]:
    """Axial stiffness of an inextensible rope [N], and contact stiffness a length [N/m^2]."""
    length, weight = rod.rope.length_m, float(np.linalg.norm(gravity))
    bend = max(rod.bending_stiffness, *(rod.profile.bending or (0.0,))) / length**2
    load = rod.linear_density * max(weight, 9.81) * length + rod.rope.tip_mass_kg * weight
    axial = (load + EULER * bend) / WEIGHT_STRAIN
    # in powers of ten, so that it does not vary with the stiffness that a fit moves in: no derivative has it
    contact = (load + 10.0 ** np.ceil(np.log10(bend))) / length * CONTACT_OVER_LOAD_1_M
    return float(axial), float(contact)


def scene_of(setups: Sequence[Setup]) -> Scene:
    """Set-ups of one number of particles and obstacles as arrays for the kernels."""
    ends = setups[0].ends
    clamped = np.array([[ends.start == "clamped", ends.end == "clamped"]], np.int32)
    return Scene.stack(
        [
            Scene(
                s.joints[None], s.segments[None], s.particles[None], s.contacts[None], s.obstacles[None],
                s.grips[None], clamped, s.symmetric, s.path_dependent,
            )
            for s in setups
        ]
    )  # fmt: skip


def scene(rods: Sequence[Rod], gravity_m_s2: Floats, ends: Ends, obstacles: Sequence[Obstacle] = ()) -> Scene:
    """Discretise rods of one number of particles under one gravity, with the same ends and obstacles."""
    return scene_of([setup(rod, gravity_m_s2, ends, obstacles, moving=True) for rod in rods])


__all__ = ["DRAG", "Profile", "Rod", "Scene", "particle_lengths", "scene", "scene_of", "setup", "unit_of"]
