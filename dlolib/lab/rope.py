"""The laboratory's rope: a chain of bodies in MuJoCo, which is not the rod that is identified."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.errors import ParameterError
from dlolib.lab.turn import from_z
from dlolib.types import Floats, Obstacle

Law = Literal["elastic", "plastic"]

TIME_STEP_S = 0.002
# A joint's damping and armature go with its spring, so that the time step suits any stiffness and any
# number of bodies: spring times a relaxation time, and over the square of the highest frequency. A soft
# rope needs the least values all the same, for what stretches and swings does not soften with it.
RELAXATION_S, FASTEST_1_S = 0.0025, 200.0
LEAST_DAMPING_N_M_S, LEAST_ARMATURE_KG_M2 = 1e-4, 1e-6
GRIPPER_KG, GRIPPER_RADIUS_M = 0.02, 0.02
# The weld to the gripper and the contacts: as stiff as the time step lets them be; a contact that is as
# hard as the weld would chatter. The rope enters an obstacle by up to 0.4 mm where it strikes it.
STIFF = [2 * TIME_STEP_S, 1.0]
WELD, CONTACT = [0.9999, 0.9999, 0.001, 0.5, 2.0], [0.9, 0.95, 0.001, 0.5, 2.0]


@dataclass(frozen=True)
class LabRope:
    """A rope of the laboratory.

    The torsional stiffness equals the bending stiffness, since a ball joint has one spring.

    Args:
        length_m, diameter_m: of the free rope between its clamps [m].
        linear_density_kg_m: [kg/m].
        bending_stiffness_n_m2: EI [N m²].
        law: "elastic", or "plastic" as in formats.md, `plastic_bending`.
        yield_curvature_1_m: κy [1/m].
        hardening_ratio: H, linear kinematic.
        bodies: of the chain; 60 agree with the exact elastica within 0.3 mm on the default arc.
        friction: Coulomb's coefficient against the obstacles.
        drag_1_s: linear drag over mass [1/s], which calms the swinging rope.
    """

    length_m: float = 0.445
    diameter_m: float = 0.008
    linear_density_kg_m: float = 0.04
    bending_stiffness_n_m2: float = 3e-4
    law: Law = "plastic"
    yield_curvature_1_m: float = 8.0
    hardening_ratio: float = 0.2
    bodies: int = 60
    friction: float = 0.1
    drag_1_s: float = 2.0

    @property
    def joint_lengths_m(self) -> Floats:
        """Length of rope that each joint stands for [m], shape (bodies + 1,): half a body at the clamps."""
        lengths = np.full(self.bodies + 1, self.length_m / self.bodies)
        lengths[[0, -1]] /= 2
        return lengths


def build(rope: LabRope, start_m: Floats, start_q: Floats, obstacles: tuple[Obstacle, ...]) -> mujoco.MjModel:
    """The chain, clamped at its start pose, straight along its tangent, welded to a gripper that is moved.

    Bodies are joined by ball joints with springs EI / l, and 2 EI / l at both clamps, where a joint
    stands for half a body: without that the rod would be clamped half a body off. Bodies 2 to N + 2 begin
    at the chain's points; body 1 is the gripper. The rope touches obstacles but not itself.

    Raises:
        ParameterError: an obstacle's shape is unknown.
    """
    spec = mujoco.MjSpec()
    spec.option.timestep = TIME_STEP_S
    spec.option.solver = mujoco.mjtSolver.mjSOL_PGS
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER  # damping is implicit in it, and it is cheap
    spec.option.tolerance = 1e-10
    size = rope.length_m / rope.bodies
    tip = start_m + rope.length_m * Rotation.from_quat(start_q, scalar_first=True).as_matrix()[:, 2]
    spec.worldbody.add_body(name="gripper", mocap=True, pos=tip, quat=start_q)
    body = spec.worldbody
    for index, share in enumerate(rope.joint_lengths_m):
        first, spring = index == 0, rope.bending_stiffness_n_m2 / share
        body = body.add_body(
            name=f"body{index}",
            pos=start_m if first else [0, 0, size],
            quat=start_q if first else [1, 0, 0, 0],
        )
        body.add_joint(
            type=mujoco.mjtJoint.mjJNT_BALL,
            stiffness=[spring, 0, 0],
            damping=[max(spring * RELAXATION_S, LEAST_DAMPING_N_M_S), 0, 0],
            armature=max(spring / FASTEST_1_S**2, LEAST_ARMATURE_KG_M2),
        )
        if index < rope.bodies:
            _capsule(body, rope, size)
    _weld(spec, body)
    for obstacle in obstacles:
        _add_obstacle(spec.worldbody, obstacle, rope.friction)
    return spec.compile()


def drag_viscosity(model: mujoco.MjModel, drag_1_s: float) -> float:
    """MuJoCo's viscosity [Pa s] under which a body of the chain feels the force -drag · mass · velocity.

    MuJoCo drags a body by 3 π d · viscosity · velocity, where d is the mean side of the box with the
    body's inertia (its documentation, "Inertia-based fluid model").
    """
    inertia, mass = model.body_inertia[2], model.body_mass[2]
    sides = np.sqrt(6 * (inertia.sum() - 2 * inertia) / mass)
    return float(drag_1_s * mass / (3 * np.pi * sides.mean()))


def _capsule(body: mujoco.MjsBody, rope: LabRope, size: float) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[rope.diameter_m / 2, size / 2, 0],
        pos=[0, 0, size / 2],
        mass=rope.linear_density_kg_m * size,
        contype=1,
        conaffinity=0,
        friction=[rope.friction, 0, 0],
        solref=STIFF,
        solimp=CONTACT,
    )


def _weld(spec: mujoco.MjSpec, tip: mujoco.MjsBody) -> None:
    """Hold the last body at the gripper; it is as heavy as a jaw, or the rope's moment would turn it."""
    tip.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[GRIPPER_RADIUS_M, 0, 0],
        mass=GRIPPER_KG,
        contype=0,
        conaffinity=0,
    )
    weld = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1="gripper", name2=tip.name
    )
    weld.data[:11] = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]  # same place, same turn, torque scale 1
    weld.solref[:2], weld.solimp[:] = STIFF, WELD


def _add_obstacle(world: mujoco.MjsBody, obstacle: Obstacle, friction: float) -> None:
    if obstacle.shape not in GEOMS:
        raise ParameterError(
            f"the laboratory has no obstacle {obstacle.shape!r}", mend=f"use one of {', '.join(GEOMS)}"
        )
    values = {name: np.array(value, dtype=float) for name, value in obstacle.values.items()}
    kind, size, quaternion = GEOMS[obstacle.shape](values)
    world.add_geom(
        type=kind,
        size=size,
        pos=values["point_m" if "point_m" in values else "center_m"],
        quat=quaternion,
        contype=0,
        conaffinity=1,
        friction=[friction, 0, 0],
        solref=STIFF,
        solimp=CONTACT,
    )


def _along(direction: Floats) -> list[float]:
    """The quaternion that turns +z into this direction."""
    return [float(value) for value in from_z(direction).as_quat(scalar_first=True)]


Values = Mapping[str, Floats]
NO_TURN = [1.0, 0.0, 0.0, 0.0]
GEOMS: dict[str, Callable[[Values], tuple[mujoco.mjtGeom, list[float], list[float]]]] = {
    "cylinder": lambda of: (mujoco.mjtGeom.mjGEOM_CYLINDER, _round(of), _along(of["axis"])),
    "sphere": lambda of: (mujoco.mjtGeom.mjGEOM_SPHERE, [of["radius_m"][0], 0, 0], NO_TURN),
    "plane": lambda of: (mujoco.mjtGeom.mjGEOM_PLANE, [0, 0, 1], _along(of["normal"])),
    "box": lambda of: (mujoco.mjtGeom.mjGEOM_BOX, list(of["size_m"] / 2), list(of["quaternion"])),
    "capsule": lambda of: (mujoco.mjtGeom.mjGEOM_CAPSULE, _round(of), _along(of["axis"])),
}
"""MuJoCo's kind, size and quaternion of each shape."""


def _round(values: Values) -> list[float]:
    return [values["radius_m"][0], values["height_m"][0] / 2, 0]
