"""The rope that the tests of the rod share: the paper's, held at a wall and by a gripper."""

import numpy as np

from dlolib.sim.rod import Rod
from dlolib.sim.simulator import RodSimulator
from dlolib.types import Floats, Obstacle, Pose, Rope

ROPE = Rope("rope", 0.445, 0.008, 0.04)
LEVEL = np.array([0.5, 0.5, 0.5, 0.5])
GRAVITY = np.array([0.0, 0.0, -9.81])
EI, GJ = 3e-4, 2e-4


def pose(x: float, y: float, z: float) -> Pose:
    """A clamp whose tangent points along +x."""
    return Pose(np.array([x, y, z]), LEVEL)


def simulator(
    particles: int = 30, end: Pose | None = None, obstacles: tuple[Obstacle, ...] = ()
) -> RodSimulator:
    """The rope between the wall at the origin and a gripper, sagging."""
    rod = Rod(ROPE, EI, GJ, particles=particles)
    return RodSimulator(rod, pose(0, 0, 0), end or pose(0.33, 0.0, 0.02), GRAVITY, obstacles)


def cylinder(x: float, z: float) -> Obstacle:
    """A cylinder of the paper's layouts: 60 mm wide and high, its axis along y."""
    values = {"center_m": (x, 0.0, z), "axis": (0.0, 1.0, 0.0), "radius_m": (0.03,), "height_m": (0.06,)}
    return Obstacle("cylinder", values)


def swing(steps: int = 60) -> Floats:
    """A way of the gripper through space, (steps, 3) [m]."""
    u = np.linspace(0, 1, steps)[:, None]
    return (
        np.array([0.33, 0.0, 0.02])
        + u * np.array([-0.09, 0.03, 0.02])
        + np.sin(3 * u) * np.array([0.0, 0.0, 0.02])
    )
