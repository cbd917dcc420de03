"""A rope in MuJoCo: straight bodies on hinges, two to bend and one to twist at every joint."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dlolib.types import Floats

AXES = np.eye(3)
# What a degree of freedom is: a hinge of the rope about axis 0, 1, 2, a slide, a clamp's hinge about 0, 1.
SLIDE, CLAMP = 5, (6, 7)


@dataclass(frozen=True)
class Sizes:
    """The rope as it was measured: what recording.json says of it. Lengths [m], density [kg/m]."""

    length_m: float = 0.445
    diameter_m: float = 0.008
    linear_density_kg_m: float = 0.04


class Chain:
    """Kinematics of N bodies between N + 1 joints, by MuJoCo; the last joint carries the gripper.

    Three hinges in a row do not turn as one rotation vector does: the product of two of their angles is a
    third one's. The order x, y, z changes to z, y, x from joint to joint, and what is left is of second
    order in the bodies' length. With `stretches` each body slides along the one before it.

    MuJoCo's masses are dummies: weights and masses are the laboratory's, at the vertices.

    After `move(q)`: axes (D, 3) of all degrees of freedom, turns (D, 3), the same but zero where one
    slides, anchors (D, 3), vertices (N + 1, 3) and the gripper's turn (3, 3).
    """

    def __init__(
        self, bodies: int, start_m: Floats, start_q: Floats, stretches: bool = False, yields: bool = False
    ) -> None:
        spec = mujoco.MjSpec()
        body, self.bodies = spec.worldbody, bodies
        kinds: list[tuple[int, int]] = []
        for index in range(bodies + 1):
            first = index == 0
            body = body.add_body(
                pos=start_m if first else [0, 0, 1.0],
                quat=start_q if first else [1, 0, 0, 0],
                mass=1.0,
                inertia=[1.0, 1.0, 1.0],
                ipos=[0.0, 0.0, 0.0],
                explicitinertial=True,
            )
            for kind in _order(index, bodies, stretches, yields):
                hinge = kind != SLIDE
                body.add_joint(
                    type=mujoco.mjtJoint.mjJNT_HINGE if hinge else mujoco.mjtJoint.mjJNT_SLIDE,
                    axis=AXES[kind % 3] if hinge else AXES[2],
                    armature=1.0,  # or MuJoCo takes the dummies for singular
                )
                kinds.append((index, kind))
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.joint, self.kind = np.array(kinds).T
        self.hinges = self.kind != SLIDE
        # Where the angle about axis a of joint j stands among the degrees of freedom: (N + 1, 3).
        self.place: NDArray[np.int64] = np.empty((bodies + 1, 3), dtype=np.int64)
        own = np.flatnonzero(self.kind < 3)
        self.place[self.joint[own], self.kind[own]] = own
        self.slides = np.flatnonzero(~self.hinges)
        # The clamps' two hinges each, the start's first: (4,) or none.
        self.clamps = np.flatnonzero(self.kind > SLIDE)
        self.above = np.triu(np.ones((len(kinds), len(kinds)), dtype=bool), 1)

    @property
    def freedoms(self) -> int:
        """Number D of degrees of freedom."""
        return len(self.joint)

    def lengthen(self, length_m: float) -> None:
        """Give every body the same share of this length [m]."""
        self.model.body_pos[2:, 2] = length_m / self.bodies

    def move(self, q: Floats) -> None:
        """Put the chain there: q (D,), angles [rad] and slides [m]."""
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)
        self.axes = self.data.xaxis
        self.turns = np.where(self.hinges[:, None], self.axes, 0.0)
        self.anchors = self.data.xanchor
        self.vertices = self.data.xpos[1:]
        self.gripper = self.data.xmat[-1].reshape(3, 3)

    def jacobians(self, body: NDArray[np.int64], points_m: Floats) -> Floats:
        """How points (C, 3) of these bodies (C,) move with every degree of freedom, (C, D, 3)."""
        lever = points_m[:, None] - self.anchors
        moved = np.where(self.hinges[:, None], cross(self.axes, lever), self.axes)
        moved[self.joint > body[:, None]] = 0.0
        return np.asarray(moved)

    def jacobian(self, vertex: int) -> Floats:
        """How a vertex moves with every degree of freedom, (3, D)."""
        # The hinges of its own joint leave a vertex where it is: there the lever is zero.
        return np.asarray(self.jacobians(np.array([vertex]), self.vertices[vertex][None])[0].T)

    def forces(self, at_vertices: Floats) -> Floats:
        """Generalised forces (D,) of forces at the vertices (N + 1, 3) [N]."""
        total = _from_here_on(at_vertices)[self.joint]
        moment = _from_here_on(cross(self.vertices, at_vertices))[self.joint]
        return np.asarray(
            np.where(
                self.hinges,
                np.sum(self.axes * (moment - cross(self.anchors, total)), axis=1),
                np.sum(self.axes * total, axis=1),
            )
        )

    def force_slopes(self, at_vertices: Floats) -> Floats:
        """How the generalised forces of constant forces change with q, (D, D).

        For an ancestor i of j a point moves by ∂²x/∂qi∂qj = ai x (aj x (x - pj)), or ai x aj where j slides:
        a product of rank three above the diagonal, mirrored below it.
        """
        total = _from_here_on(at_vertices)[self.joint]
        spread = _from_here_on(self.vertices[:, :, None] * at_vertices[:, None, :])[self.joint]
        spread = spread - self.anchors[:, :, None] * total[:, None, :]
        trace = np.trace(spread, axis1=1, axis2=2)[:, None]
        along = np.where(
            self.hinges[:, None],
            np.einsum("dij,dj->di", spread, self.axes) - trace * self.axes,
            cross(self.axes, total),
        )
        return self._mirrored(self.turns @ along.T)

    def masses(self, at_vertices: Floats) -> Floats:
        """Σ m JᵀJ over the vertices' masses (N + 1,), (D, D): the composite rigid bodies' inertia.

        (Featherstone, Rigid Body Dynamics Algorithms, section 6.2.) For i before j the sum over what both
        move is ai · Σ m x × vj - (ai × pi) · Σ m vj, where vj is what j makes the vertex move.
        """
        weighted = at_vertices[:, None] * self.vertices
        mass = _from_here_on(at_vertices)[self.joint, None]
        first = _from_here_on(weighted)[self.joint]
        second = _from_here_on(self.vertices[:, :, None] * weighted[:, None, :])[self.joint]
        spread = second - first[:, :, None] * self.anchors[:, None, :]
        trace = np.trace(spread, axis1=1, axis2=2)[:, None]
        hinge = self.hinges[:, None]
        momentum = np.where(hinge, cross(self.axes, first - mass * self.anchors), mass * self.axes)
        turning = np.where(
            hinge,
            trace * self.axes - np.einsum("dji,dj->di", spread, self.axes),
            cross(first, self.axes),
        )
        shift = np.where(hinge, -cross(self.axes, self.anchors), self.axes)
        return self._mirrored(self.turns @ turning.T + shift @ momentum.T)

    def moment_slopes(self, moment: Floats) -> Floats:
        """How the generalised forces of a constant moment (3,) at the gripper change with q, (D, D)."""
        return np.where(self.above.T, self.turns @ cross(moment, self.turns).T, 0.0)

    def _mirrored(self, upper: Floats) -> Floats:
        """What stands on and above the diagonal, the same below it, (D, D)."""
        return np.where(self.above.T, upper.T, upper)


def _order(index: int, bodies: int, stretches: bool, yields: bool) -> list[int]:
    """The degrees of freedom of one joint from the rope's start on."""
    own = [0, 1, 2] if index % 2 == 0 else [2, 1, 0]
    before = [*CLAMP] if yields and index == 0 else [SLIDE] if stretches and index else []
    return [*before, *own, *(CLAMP if yields and index == bodies else ())]


def turn_between(turn: Floats, target: Floats) -> Floats:
    """The rotation vector (3,) [rad] in world axes that takes `target` to `turn`, both (3, 3)."""
    return np.asarray(Rotation.from_matrix(turn @ target.T, assume_valid=True).as_rotvec())


def cross(a: Floats, b: Floats) -> Floats:
    """a x b over the last axis, as `numpy.cross`, which takes several times as long for arrays this small."""
    found = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return found


def _from_here_on(values: Floats) -> Floats:
    """Sums from each row to the last one."""
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1])
