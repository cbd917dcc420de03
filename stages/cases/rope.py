"""The rope of all cases and how it is held: in SI, in the x-z plane with z up, bent about the second axis."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.sim.rod import Rod, scene
from dlolib.sim.scene import Scene
from dlolib.sim.simulate import Path, Rollout
from dlolib.sim.start import first_shape, settle
from dlolib.types import Ends, Floats, Pose, Rope

GRAVITY = np.array([0.0, 0.0, -9.81])
NONE = np.zeros(3)
# A frame whose third axis is +x and whose second is +y: the paper's clamps.
LEVEL = Rotation.from_matrix(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))
CANTILEVER = Ends(end="free")
LENGTH, EI, GJ, DENSITY = 0.445, 3e-4, 2e-4, 0.04
ROPE = Rope("rope", LENGTH, 0.008, DENSITY)


def pose(x: float, z: float, angle: float = 0.0) -> Pose:
    """A frame in the x-z plane whose tangent rises by `angle` [rad] from +x."""
    turned = Rotation.from_rotvec([0.0, -angle, 0.0]) * LEVEL
    return Pose(np.array([x, 0.0, z]), turned.as_quat(scalar_first=True))


def held(start: list[Pose], end: list[Pose] | None = None) -> Path:
    """A path of both ends, the end's entries unread where it is free."""
    pairs = list(zip(start, end or start, strict=True))
    x = np.array([[p.position_m for p in pair] for pair in pairs])
    q = np.array([[p.quaternion for p in pair] for pair in pairs])
    return Path(x[None], q[None])


def rest(rod: Rod, start: Pose, end: Pose | None, gravity: Floats = GRAVITY) -> tuple[Scene, Rollout]:
    """The rod's equilibrium between two clamps, or from one."""
    ends = Ends() if end is not None else CANTILEVER
    made = scene([rod], gravity, ends)
    state = first_shape(rod.rope.length_m, rod.particles, start, end, gravity)
    return made, settle(made, state, held([start], [end or start]))


def arc_end(curvature: float, length: float = LENGTH) -> Pose:
    """The end of a rope that starts level at the origin and is an arc of this curvature [1/m]."""
    if curvature == 0:
        return pose(length, 0)
    angle = curvature * length
    return pose(np.sin(angle) / curvature, (1 - np.cos(angle)) / curvature, angle)
