"""Friction: the rope round a rough cylinder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlolib.sim.rod import Rod, scene
from dlolib.sim.simulate import Clock, State, roll_out
from dlolib.sim.start import settle
from dlolib.types import Floats, Obstacle, Rope
from stages.cases.rope import CANTILEVER, GRAVITY, held, pose


@dataclass(frozen=True)
class Capstan:
    """Tension of every segment [N] over its angle on the cylinder [rad], and the ratio of both sides."""

    angle: Floats
    tension: Floats
    ratio: float
    theory: float


def capstan(coefficient: float = 0.3, particles: int = 80, steps: int = 60) -> Capstan:
    """Half round a rough cylinder, a mass on one side, drawn down on the other: T2 / T1 = e^(μ π).

    Euler and Eytelwein; the rope's weight is 1/500 of the mass a radius, its bending force T / 5000.
    """
    radius, hanging, drawn, moved_m = 0.05, 0.15, 0.1, 0.05
    thick, density, mass = 0.004, 0.02, 0.5
    axis = radius + thick / 2
    length = hanging + drawn + np.pi * axis
    rope = Rope("capstan", length, thick, density, mass)
    rod = Rod(rope, 5e-6, 5e-6, {"contact_friction.coefficient": coefficient}, particles)
    values = {
        "center_m": (0.0, 0.0, 0.0), "axis": (0.0, 1.0, 0.0), "radius_m": (radius,), "height_m": (0.2,)
    }  # fmt: skip
    made = scene([rod], GRAVITY, CANTILEVER, (Obstacle("cylinder", values),))

    def at(s: Floats) -> tuple[Floats, Floats]:
        turn = np.clip((s - drawn) / axis, 0, np.pi)
        x, z = -axis * np.cos(turn), axis * np.sin(turn)
        z += np.minimum(s - drawn, 0) - np.maximum(s - drawn - np.pi * axis, 0)
        return np.stack([x, 0 * x, z], axis=1), np.pi / 2 - turn

    nodes = np.linspace(0, length, particles)
    x, _ = at(nodes)
    _, angles = at(np.concatenate([[0.0], (nodes[1:] + nodes[:-1]) / 2, [length]]))
    q = np.array([pose(0, 0, angle).quaternion for angle in angles])
    start = [pose(-axis, -drawn - down, np.pi / 2) for down in np.linspace(0, moved_m, steps)]
    still = settle(made, State(x[None], x[None].copy(), q[None]), held(start[:1])).final
    last = roll_out(made, still, held(start), Clock(None)).final.x[0]
    across = np.diff(last, axis=0)
    strain = np.linalg.norm(across, axis=1) / made.segment_l[0] - 1
    tension = made.segments[0, :, 3] * strain
    middle = (last[1:] + last[:-1]) / 2
    angle = (np.arctan2(middle[:, 2], -middle[:, 0]) + 1.0) % (2 * np.pi) - 1.0
    free = (middle[:, 2] < -0.2 * axis) & (middle[:, 2] > -axis)
    one, other = (tension[free & side].mean() for side in (middle[:, 0] < 0, middle[:, 0] > 0))
    return Capstan(angle, tension, float(one / other), float(np.exp(coefficient * np.pi)))
