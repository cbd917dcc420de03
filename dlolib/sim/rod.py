"""The rod as its user sees it, and as the kernels do: physical parameters, discretised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlolib.errors import ParameterError
from dlolib.sim import shapes
from dlolib.types import Ends, Floats, Obstacle, Rope

# An inextensible rope stretches this much under its own weight or a bend of its length, whichever is more.
WEIGHT_STRAIN = 3e-5
# Contact force per length of rope and depth [N/m^2], over the rod's weight per length.
CONTACT_OVER_WEIGHT_1_M = 3e6


@dataclass(frozen=True)
class Rod:
    """A rope's physics, the same at any discretisation.

    Args:
        rope: length [m], diameter [m], linear density [kg/m] (1 where not measured), tip mass [kg].
        bending_stiffness: EI [N m^2].
        torsional_stiffness: GJ [N m^2].
        rest_curvature: curvature at rest about the two material axes [1/m].
        end_turns: turns of the start's and the end's frame away from the recorded ones, about their first
            and second axis [rad]: (start_1, start_2, end_1, end_2).
        drag: air drag, force per length and speed [N s/m^2].
        particles: n, the number of particles.
    """

    rope: Rope
    bending_stiffness: float
    torsional_stiffness: float
    rest_curvature: tuple[float, float] = (0.0, 0.0)
    end_turns: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    drag: float = 0.0
    particles: int = 30

    def __post_init__(self) -> None:
        for name, value in (
            ("bending_stiffness", self.bending_stiffness),
            ("torsional_stiffness", self.torsional_stiffness),
            ("length_m", self.rope.length_m),
            ("linear_density", self.linear_density),
        ):
            if not (np.isfinite(value) and value > 0):
                raise ParameterError(f"{name} = {value:g} is not a positive number", mend="give one above 0")
        if self.particles < 3:
            raise ParameterError(f"particles = {self.particles}", mend="a rod needs 3 or more")

    @property
    def linear_density(self) -> float:
        """Mass per length [kg/m]; 1 where it was not measured (then stiffnesses are over density)."""
        return 1.0 if self.rope.linear_density_kg_m is None else self.rope.linear_density_kg_m

    def with_values(self, **changes: object) -> Rod:
        """A copy with some fields changed."""
        return replace(self, **changes)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Scene:
    """A rod among obstacles as arrays for the kernels, one row a rope (B ropes, n particles).

    joint_d (B, n, 3) [N m^2], joint_l (B, n) [m], joint_rest (B, n, 3) [1/m], segment_l (B, n - 1) [m],
    segment_k (B, n - 1, 3) [N], mass (B, n) [kg], force (B, n, 3) [N], drag (B, n) [N s/m],
    obstacles (B, K, 16), radius (B, 1) [m], contact (B, 2n - 1) [N/m], clamped (B, 2).
    """

    joint_d: Floats
    joint_l: Floats
    joint_rest: Floats
    segment_l: Floats
    segment_k: Floats
    mass: Floats
    force: Floats
    drag: Floats
    obstacles: Floats
    radius: Floats
    contact: Floats
    clamped: np.ndarray[tuple[int, ...], np.dtype[np.int32]]

    def arrays(self) -> tuple[np.ndarray, ...]:
        """The arrays in the order in which every kernel takes them."""
        return tuple(getattr(self, name) for name in self.__dataclass_fields__)


def particle_lengths(length_m: float, particles: int) -> Floats:
    """The length of rope that each particle stands for [m], shape (n,): half a segment at the ends."""
    share = np.full(particles, length_m / (particles - 1))
    share[[0, -1]] /= 2
    return share


def scene(rods: Sequence[Rod], gravity_m_s2: Floats, ends: Ends, obstacles: Sequence[Obstacle] = ()) -> Scene:
    """Discretise rods of one number of particles under one gravity, with the same ends and obstacles."""
    return _stack([_one(rod, gravity_m_s2, ends, obstacles) for rod in rods])


def _one(rod: Rod, gravity: Floats, ends: Ends, obstacles: Sequence[Obstacle]) -> dict[str, np.ndarray]:
    n, length = rod.particles, rod.rope.length_m
    segment = length / (n - 1)
    ei, gj = rod.bending_stiffness, rod.torsional_stiffness
    clamped = np.array([ends.start == "clamped", ends.end == "clamped"])
    if not clamped.any():
        raise ParameterError("both ends are free", mend="hold one: a free rope has no place to be")
    joint_l = np.full(n, segment)
    joint_l[[0, -1]] /= 2
    joint_d = np.tile([ei, ei, gj], (n, 1))
    joint_d[[0, -1]] *= clamped[:, None]
    share = particle_lengths(length, n)
    mass = rod.linear_density * share
    mass[-1] += rod.rope.tip_mass_kg
    weight = float(np.linalg.norm(gravity))
    load = rod.linear_density * max(weight, 9.81)
    # in powers of ten, so that it does not vary with the stiffness that a fit moves in
    bend = 10.0 ** np.ceil(np.log10(ei / length**2))
    axial = (load * length + rod.rope.tip_mass_kg * weight + bend) / WEIGHT_STRAIN
    # the particles' shares of the length, split between themselves and the segments' middles
    contact = np.empty(2 * n - 1)
    contact[0::2], contact[1::2] = share / 2, segment / 2
    return {
        "joint_d": joint_d,
        "joint_l": joint_l,
        "joint_rest": np.tile([*rod.rest_curvature, 0.0], (n, 1)),
        "segment_l": np.full(n - 1, segment),
        "segment_k": np.full((n - 1, 3), axial),
        "mass": mass,
        "force": mass[:, None] * np.asarray(gravity, float),
        "drag": rod.drag * share,
        "obstacles": shapes.pack(obstacles) if obstacles else np.zeros((0, shapes.WIDTH)),
        "radius": np.array([rod.rope.radius_m]),
        "contact": contact * load * CONTACT_OVER_WEIGHT_1_M,
        "clamped": clamped.astype(np.int32),
    }


def _stack(scenes: Sequence[dict[str, np.ndarray]]) -> Scene:
    return Scene(**{name: np.ascontiguousarray([one[name] for one in scenes]) for name in scenes[0]})
