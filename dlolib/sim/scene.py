"""A rod among obstacles as the kernels see it: arrays, one row a rope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlolib.types import Floats

# Columns of `Scene.joints`: stiffness EI1, EI2, GJ [N m^2]; curvatures and twist at rest [1/m]; length [m];
# the rope's uniform EI [N m^2], which some laws refer to; the curvatures [1/m] that it had before its first
# shape; then the parameters of the laws.
STIFFNESS, REST, LENGTH, UNIFORM, PRIOR, LAWS = 0, 3, 6, 7, 8, 10
# Columns of `Scene.particles`: inertial mass [kg], drag [N s/m], load [N].
INERTIA, DRAG, LOAD = 0, 1, 2
# Columns of `Scene.obstacles`: half the thickness [m], the coefficient of friction, radius [m] and axis of a
# hull; a shape's own values end before these.
THIN, FRICTION, HULL = 14, 15, 16
# Contact points a segment: between them a straight one of 15 mm dips 0.05 mm into a cylinder of 34 mm.
SAMPLES = 4


def contact_points(particles: int) -> int:
    """K, the number of contact points of a rope: `SAMPLES` a segment, and the last one."""
    return SAMPLES * (particles - 1) + 1


@dataclass(frozen=True)
class Scene:
    """B ropes of n particles, ready for the kernels.

    Args:
        joints: (B, n, W): see the columns above.
        segments: (B, n - 1, 4): length [m]; shear (twice) and axial stiffness GA, GA, EA [N].
        particles: (B, n, 5): see the columns above.
        contacts: (B, K, 2): contact stiffness [N/m] and the rope's radius [m] at its contact points.
        obstacles: (B, M, 20): see `dlolib.sim.shapes`, and the columns above.
        grips: (B, 2, 3): stiffness of the clamps about their axes [N m/rad]; 0: held fast.
        clamped: (B, 2): 1 where an end is held.
        symmetric: whether every law and contact has an energy, so that the Hessian is symmetric.
        path_dependent: whether the ropes remember their way: a law or a contact has a history.
    """

    joints: Floats
    segments: Floats
    particles: Floats
    contacts: Floats
    obstacles: Floats
    grips: Floats
    clamped: np.ndarray[tuple[int, ...], np.dtype[np.int32]]
    symmetric: bool
    path_dependent: bool

    def arrays(self) -> tuple[np.ndarray, ...]:
        """The arrays in the order in which every kernel takes them."""
        return (
            self.joints,
            self.segments,
            self.particles,
            self.contacts,
            self.obstacles,
            self.grips,
            self.clamped,
        )

    def of(self, rope: int) -> Scene:
        """One rope of the batch."""
        own = [part[[rope]] for part in self.arrays()]
        return Scene(
            own[0], own[1], own[2], own[3], own[4], own[5], own[6], self.symmetric, self.path_dependent
        )

    @property
    def slips(self) -> int:
        """K where the rope may rub against something, else 1: nothing needs room for more."""
        rubs = not self.symmetric and self.obstacles.shape[1] > 0
        return self.contacts.shape[1] if rubs else 1

    @property
    def has_laws(self) -> bool:
        """Whether any joint has a moment beside the elastic one."""
        return bool(self.joints[..., LAWS:].any())

    @staticmethod
    def stack(scenes: Sequence[Scene]) -> Scene:
        """Scenes of one number of particles and obstacles, one after another in the batch."""
        if len(scenes) == 1:
            return scenes[0]
        parts = zip(*(scene.arrays() for scene in scenes), strict=True)
        joined = [np.ascontiguousarray(np.concatenate(part)) for part in parts]
        return Scene(
            joined[0], joined[1], joined[2], joined[3], joined[4], joined[5], joined[6],
            symmetric=all(scene.symmetric for scene in scenes),
            path_dependent=any(scene.path_dependent for scene in scenes),
        )  # fmt: skip

    @property
    def joint_d(self) -> Floats:
        """Stiffness EI1, EI2, GJ of every joint [N m^2], (B, n, 3)."""
        return self.joints[..., STIFFNESS:REST]

    @property
    def joint_rest(self) -> Floats:
        """Curvatures and twist at rest [1/m], (B, n, 3)."""
        return self.joints[..., REST:LENGTH]

    @property
    def joint_l(self) -> Floats:
        """Length of rope between neighbouring frames [m], (B, n)."""
        return self.joints[..., LENGTH]

    @property
    def segment_l(self) -> Floats:
        """Length of every segment [m], (B, n - 1)."""
        return self.segments[..., 0]

    @property
    def mass(self) -> Floats:
        """Inertial mass of every particle [kg], (B, n)."""
        return self.particles[..., INERTIA]

    @property
    def drag(self) -> Floats:
        """Drag of every particle [N s/m], (B, n)."""
        return self.particles[..., DRAG]

    @property
    def force(self) -> Floats:
        """Load on every particle [N], (B, n, 3)."""
        return self.particles[..., LOAD:]
