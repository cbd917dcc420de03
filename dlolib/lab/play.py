"""Play a motion with the laboratory's rope: the true shapes, the clearance, the gripper's log."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from dlolib.errors import ParameterError, SimulationError
from dlolib.formats.geometry import nearest_distance
from dlolib.formats.motion import interpolate_motion
from dlolib.lab.plastic import return_mapping, rotation_vectors
from dlolib.lab.rope import STIFF, TIME_STEP_S, LabRope, build, drag_viscosity
from dlolib.progress import track
from dlolib.types import Floats, Motion, Obstacle

APPROACH_S, CALM_S, CALM_DRAG_1_S = 2.0, 2.0, 20.0
CHECK_EVERY, LOG_EVERY = 250, 4
NEAREST, PIECES = 4, 8
# A critically damped weld follows a steady motion by twice its time constant; the target leads by as much.
WELD_LAG_S = 2 * STIFF[0]
STILL_M, MOST_REACH = 1e-6, 0.999
# A rope that rests on an obstacle in its first shape sinks in by a few tenths of this.
SUNK_M = 1e-3


@dataclass(frozen=True)
class LabRun:
    """What happened in the laboratory: the truth that no camera sees.

    t_s (F,); xyz_m (F, M, 3), points of the axis, the clamps included, at arc lengths s_m (M,);
    plastic_1_m (F, M, 2), plastic curvature at those points; min_clearance_m, of the rope's surface to
    the obstacles over every step from the first row on, infinite without obstacles; clearance_m (F,) at
    the samples. The gripper's log at 125 Hz: log_t_s (K,), log_m (K, 3), log_q (K, 4).
    """

    t_s: Floats
    s_m: Floats
    xyz_m: Floats
    plastic_1_m: Floats
    min_clearance_m: float
    clearance_m: Floats
    log_t_s: Floats
    log_m: Floats
    log_q: Floats


def play(
    rope: LabRope,
    motion: Motion,
    obstacles: tuple[Obstacle, ...] = (),
    gravity_m_s2: Floats | tuple[float, float, float] = (0.0, 0.0, -9.81),
    sample_times_s: Floats | None = None,
    settle_s: float = 0.0,
) -> LabRun:
    """Hold the rope at the motion's start, bring it to the first row, then move its end along the rows.

    The rope begins straight and without history. On the way to the first row every curvature counts as
    grown in a straight line, at once (formats.md), and obstacles are not there yet.

    Args:
        rope: the rope; its length is free rope between the clamps.
        motion: poses of both ends; the start must not move.
        obstacles: what the rope may touch, at most with the rope's friction.
        gravity_m_s2: [m/s²], shape (3,).
        sample_times_s: when to report the shape [s], within the motion and the settling; by default the
            motion's own times.
        settle_s: how long the last pose is held [s].

    Raises:
        ParameterError: an end is free, the start moves, a sample lies outside, the ends are too far apart,
            or an obstacle stands in the rope's first shape.
        SimulationError: the chain became unstable.
    """
    samples = motion.t_s if sample_times_s is None else np.asarray(sample_times_s, dtype=float)
    _check(rope, motion, samples, settle_s)
    chain = _Chain(rope, motion, obstacles, np.asarray(gravity_m_s2, dtype=float))
    chain.approach(motion.end_m[0], motion.end_q[0])
    _check_first(chain.axis(), rope, obstacles)

    steps = round((motion.t_s[-1] - motion.t_s[0] + settle_s) / TIME_STEP_S)
    times = motion.t_s[0] + TIME_STEP_S * np.arange(steps + 1)
    path = interpolate_motion(motion, times + WELD_LAG_S)
    xyz = np.empty((steps + 1, rope.bodies + 1, 3))
    plastic = np.empty((steps + 1, rope.bodies + 1, 2))
    poses = np.empty((steps + 1, 7))
    for step in track(range(steps + 1), "laboratory"):
        if step:
            chain.step(path.end_m[step], path.end_q[step])
        xyz[step], plastic[step], poses[step] = chain.axis(), chain.plastic, chain.gripper()
        if step % CHECK_EVERY == 0 or step == steps:
            chain.check(times[step])
    # half a step more or less may round otherwise than the whole
    at = np.minimum(np.rint((samples - motion.t_s[0]) / TIME_STEP_S).astype(int), steps)
    clearance = _clearance(xyz, obstacles) - rope.diameter_m / 2
    return LabRun(
        t_s=samples,
        s_m=np.linspace(0, rope.length_m, rope.bodies + 1),
        xyz_m=xyz[at],
        plastic_1_m=plastic[at],
        min_clearance_m=float(clearance.min()),
        clearance_m=clearance[at],
        log_t_s=times[::LOG_EVERY],
        log_m=poses[::LOG_EVERY, :3],
        log_q=poses[::LOG_EVERY, 3:],
    )


class _Chain:
    """The chain in MuJoCo and the plastic curvature of its joints, which MuJoCo does not know."""

    def __init__(
        self, rope: LabRope, motion: Motion, obstacles: tuple[Obstacle, ...], gravity_m_s2: Floats
    ) -> None:
        # MuJoCo would leave a MUJOCO_LOG.TXT in the working folder; `check` reads its warnings instead.
        mujoco.set_mju_user_warning(lambda _: None)
        self.rope = rope
        self.model = build(rope, motion.start_m[0], motion.start_q[0], obstacles)
        self.model.opt.gravity[:] = gravity_m_s2
        self.data = mujoco.MjData(self.model)
        self.lengths = rope.joint_lengths_m[:, None]
        self.plastic = np.zeros((rope.bodies + 1, 2))
        self.virgin = True

    def approach(self, end_m: Floats, end_q: Floats) -> None:
        """From straight to the first pose, calmly, without obstacles; afterwards history counts."""
        opt, data = self.model.opt, self.data
        opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        opt.viscosity = drag_viscosity(self.model, CALM_DRAG_1_S)
        first_m, first_q = data.mocap_pos[0].copy(), data.mocap_quat[0].copy()
        turns = Slerp([0.0, 1.0], Rotation.from_quat([first_q, end_q], scalar_first=True))
        share = np.clip(np.arange(0, APPROACH_S + CALM_S, TIME_STEP_S) / APPROACH_S, 0, 1)
        share = share**2 * (3 - 2 * share)
        quaternions = turns(share).as_quat(scalar_first=True)
        for part, quaternion in zip(share, quaternions, strict=True):
            self.step(first_m + part * (end_m - first_m), quaternion)
        self.check(0.0)
        opt.viscosity = drag_viscosity(self.model, self.rope.drag_1_s)
        opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.virgin = False

    def step(self, end_m: Floats, end_q: Floats) -> None:
        """One time step with the gripper at this pose."""
        data = self.data
        data.mocap_pos[0], data.mocap_quat[0] = end_m, end_q
        if self.rope.law == "plastic":
            self._flow()
        mujoco.mj_step(self.model, data)

    def _flow(self) -> None:
        """Update the plastic curvature; its moment EI κp joins the springs' -EI κ on the bending axes."""
        rope = self.rope
        curvature = rotation_vectors(self.data.qpos.reshape(-1, 4))[:, :2] / self.lengths
        before = np.zeros_like(self.plastic) if self.virgin else self.plastic
        self.plastic = return_mapping(curvature, before, rope.yield_curvature_1_m, rope.hardening_ratio)
        self.data.qfrc_applied.reshape(-1, 3)[:, :2] = rope.bending_stiffness_n_m2 * self.plastic

    def axis(self) -> Floats:
        """Points of the axis (bodies + 1, 3): the joints."""
        return np.asarray(self.data.xpos[2:])

    def gripper(self) -> Floats:
        """The pose of the end that is held (7,): position, quaternion."""
        return np.concatenate([self.data.xpos[-1], self.data.xquat[-1]])

    def check(self, t_s: float) -> None:
        """Raise SimulationError where MuJoCo warned of a bad state."""
        if any(warning.number for warning in self.data.warning) or not np.isfinite(self.data.qpos).all():
            raise SimulationError(
                f"the laboratory's rope became unstable at {t_s:.3f} s",
                mend="move slower, or use fewer bodies",
            )


def _clearance(xyz: Floats, obstacles: tuple[Obstacle, ...]) -> Floats:
    """Distance of the axis (S, M, 3) from the obstacles at each step [m], shape (S,).

    Measured at the joints, and closely along the few bodies that are nearest: exact to 0.03 mm at the
    edge of a box, and better at round obstacles.
    """
    if not obstacles:
        return np.full(len(xyz), np.inf)
    coarse = nearest_distance(obstacles, xyz)
    nearest = np.argsort(coarse[:, 1:] + coarse[:, :-1], axis=1)[:, :NEAREST, None]
    first = np.take_along_axis(xyz[:, :-1], nearest, axis=1)[:, :, None]
    last = np.take_along_axis(xyz[:, 1:], nearest, axis=1)[:, :, None]
    fine = nearest_distance(obstacles, first + np.linspace(0, 1, PIECES + 1)[:, None] * (last - first))
    return np.asarray(np.minimum(coarse.min(axis=1), fine.min(axis=(1, 2))))


def _check_first(xyz: Floats, rope: LabRope, obstacles: tuple[Obstacle, ...]) -> None:
    """Refuse an obstacle in the first shape (M, 3): the rope came there as if there were none."""
    for number, obstacle in enumerate(obstacles):
        clearance = float(_clearance(xyz[None], (obstacle,))[0]) - rope.diameter_m / 2
        if clearance < -SUNK_M:
            raise ParameterError(
                f"the rope's first shape is {-1e3 * clearance:.1f} mm inside it",
                place=f"obstacle {number} ({obstacle.shape})",
                mend="move the obstacle, or begin the motion elsewhere",
            )


def _check(rope: LabRope, motion: Motion, samples: Floats, settle_s: float) -> None:
    if not np.isfinite(motion.end_m).all() or not np.isfinite(motion.start_m).all():
        raise ParameterError("the laboratory holds both ends", mend="give a motion of two clamped ends")
    if np.ptp(motion.start_m, axis=0).max() > STILL_M or np.ptp(motion.start_q, axis=0).max() > STILL_M:
        raise ParameterError("the start of the rope moves", mend="move the end only")
    reach = np.linalg.norm(motion.end_m - motion.start_m, axis=1).max()
    if reach > MOST_REACH * rope.length_m:
        raise ParameterError(
            f"the ends are {reach:.3f} m apart and the rope is {rope.length_m:.3f} m long",
            mend=f"keep them within {MOST_REACH * rope.length_m:.3f} m, or lengthen it (lab.rope.length_m)",
        )
    if samples.min() < motion.t_s[0] - STILL_M or samples.max() > motion.t_s[-1] + settle_s + STILL_M:
        raise ParameterError("a sample lies outside the motion", mend="sample within it, or settle longer")
