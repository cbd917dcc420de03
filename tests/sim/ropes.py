"""The rope that the tests of the rod share: the paper's, held at a wall and by a gripper."""

from dataclasses import replace

import numpy as np

from dlolib.sim.rod import Rod, scene
from dlolib.sim.scene import LOAD, REST, STIFFNESS, Scene
from dlolib.sim.simulate import Clock, Path, Rollout, State, roll_out
from dlolib.sim.start import first_shape, settle
from dlolib.types import Ends, Floats, Obstacle, Pose, Rope

ROPE = Rope("rope", 0.445, 0.008, 0.04)
LEVEL = np.array([0.5, 0.5, 0.5, 0.5])
GRAVITY = np.array([0.0, 0.0, -9.81])
EI, GJ = 3e-4, 2e-4
COLUMNS = {"joint_d": slice(STIFFNESS, REST), "joint_rest": slice(REST, REST + 3), "force": slice(LOAD, None)}


def pose(x: float, y: float, z: float) -> Pose:
    """A clamp whose tangent points along +x."""
    return Pose(np.array([x, y, z]), LEVEL)


def settled(
    rod: Rod | None = None, end: Pose | None = None, obstacles: tuple[Obstacle, ...] = (), particles: int = 30
) -> State:
    """The rope between the wall at the origin and a gripper, sagging, at rest."""
    rod = rod or Rod(ROPE, EI, GJ, particles=particles)
    start, end = pose(0, 0, 0), end or pose(0.33, 0.0, 0.02)
    guess = first_shape(rod.rope.length_m, rod.particles, start, end, GRAVITY)
    made = scene([rod], GRAVITY, Ends(), obstacles)
    return settle(made, guess, way_of(end.position_m[None])).final.at_rest()


def way_of(end_m: Floats) -> Path:
    """The gripper's way (T, 3) as a path, the start at the origin; neither turns."""
    x = np.zeros((1, len(end_m), 2, 3))
    x[0, :, 1] = end_m
    return Path(x, np.tile(LEVEL, (1, len(end_m), 2, 1)))


def moved(rod: Rod, start: State, way: Floats, clock: Clock, obstacles: tuple[Obstacle, ...] = ()) -> Rollout:
    """The rope after its gripper went a way (T, 3) [m]."""
    return roll_out(scene([rod], GRAVITY, Ends(), obstacles), start, way_of(way), clock)


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


def changed(made: Scene, field: str, by: Floats) -> Scene:
    """A scene with `by` added to joint_d, joint_rest or force."""
    name = "particles" if field == "force" else "joints"
    array = getattr(made, name).copy()
    array[..., COLUMNS[field]] += by
    return replace(made, **{name: array})
