"""The rod under a recording's own motion, at the recording's own points, with derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from dlolib.errors import ParameterError
from dlolib.formats import interpolate_motion
from dlolib.sim import iterative
from dlolib.sim.rod import Rod, Scene, scene
from dlolib.sim.simulate import Clock, Directions, Path, Rollout, State, roll_out, sensitivities
from dlolib.sim.start import first_shape, settle
from dlolib.types import Ends, Floats, Motion, Points, Pose, Recording

# Between two quasi-static steps an end moves and turns at most this much, so that the rope follows its
# branch where several equilibria exist.
LARGEST_MOVE_M, LARGEST_TURN_RAD = 0.01, 0.1
# Where a clamp's roll was not measured it carries this share of the torsional stiffness.
FREE_ROLL = 1e-6

UNITS = {
    "bending_stiffness": "N m^2",
    "torsional_stiffness": "N m^2",
    "end_angle.start_1": "rad",
    "end_angle.start_2": "rad",
    "end_angle.end_1": "rad",
    "end_angle.end_2": "rad",
    "rest_curvature.kappa_1": "1/m",
    "rest_curvature.kappa_2": "1/m",
}


def with_parameter(rod: Rod, name: str, value: float) -> Rod:
    """A copy of the rod with one of the parameters of `UNITS` changed."""
    group, _, part = name.partition(".")
    if name in ("bending_stiffness", "torsional_stiffness"):
        return rod.with_values(**{name: float(value)})
    if group == "end_angle" and name in UNITS:
        turns = list(rod.end_turns)
        turns[("start_1", "start_2", "end_1", "end_2").index(part)] = float(value)
        return rod.with_values(end_turns=tuple(turns))
    if name in UNITS:
        rest = list(rod.rest_curvature)
        rest[("kappa_1", "kappa_2").index(part)] = float(value)
        return rod.with_values(rest_curvature=tuple(rest))
    raise ParameterError(f"unknown parameter {name}", mend=f"choose from {', '.join(UNITS)}")


@dataclass(frozen=True)
class Prediction:
    """Simulated points (P, 3) [m] and their derivatives (P, 3, N) by the N parameters asked for."""

    xyz_m: Floats
    by_parameter: Floats


@dataclass(frozen=True)
class RecordingModel:
    """A recording made ready to be simulated again and again with different rods.

    Args:
        recording: ends, motion and points.
        particles: n.
        step_s: time step of the dynamic clock; a quasi-static recording needs none.
        sweeps: None for the direct solver; the paper's iterative one with so many iterations a step, which
            knows no quasi-static clock and has no forward sensitivities.
    """

    recording: Recording
    particles: int
    step_s: float | None
    sweeps: int | None = None

    @cached_property
    def _motion(self) -> Motion:
        """The held poses at every step."""
        times = _step_times(self.recording, self.step_s, self._static)
        return interpolate_motion(self.recording.motion, times)

    @cached_property
    def _weights(self) -> Floats:
        return point_weights(self.recording.points, self.recording.rope.length_m, self.particles)

    @cached_property
    def _brackets(self) -> tuple[np.ndarray, np.ndarray, Floats]:
        return _brackets(self.recording.points.t_s, self._motion.t_s)

    @property
    def _static(self) -> bool:
        return self.recording.quasi_static and self.sweeps is None

    def roll_out(self, rod: Rod) -> Rollout:
        """The whole motion, from the equilibrium at its first pose; step k is at index k + 1."""
        return self._moved(self.at_rest(rod), rod)

    def at_rest(self, rod: Rod) -> Rollout:
        """The equilibrium at the first pose: a roll-out of one step."""
        motion = self._motion
        rec = self.recording
        made = self._scene(rod)
        path = held_path(motion, rod.end_turns)
        poses = [Pose(path.x[0, 0, k], path.q[0, 0, k]) for k in range(2)]
        state = first_shape(
            rec.rope.length_m,
            rod.particles,
            rec.ends,
            poses[0] if rec.ends.start == "clamped" else None,
            poses[1] if rec.ends.end == "clamped" else None,
            rec.gravity_m_s2,
        )
        return settle(made, state, path)

    def _moved(self, rest: Rollout, rod: Rod) -> Rollout:
        motion = self._motion
        path, state = held_path(motion, rod.end_turns), rest.final
        still = State(state.x, state.x.copy(), state.q)
        if self.sweeps is not None:
            return iterative.roll_out(rest.scene, still, path, Clock(self.step_s), self.sweeps)
        return roll_out(rest.scene, still, path, Clock(None if self._static else self.step_s))

    def predict(self, rod: Rod, parameters: Sequence[str] = ()) -> Prediction:
        """Simulate the recording's points and, by forward sensitivities, their derivatives."""
        rest = self.at_rest(rod)
        rollout = self._moved(rest, rod)
        before, after, share = self._brackets
        weights = self._weights

        def at_points(field: Floats, first: Floats, second: Floats) -> Floats:
            mixed = (1 - share)[:, None, None] * field[first] + share[:, None, None] * field[second]
            return np.asarray(np.einsum("pn,pnk->pk", weights, mixed))

        x = rollout.x[0, 1:]
        xyz = at_points(x, before, after)
        if not parameters:
            return Prediction(xyz, np.zeros((*xyz.shape, 0)))
        steps = np.unique(np.concatenate([before, after]))
        slot = np.searchsorted(steps, np.arange(len(x)))
        ways = directions(rod, rollout.scene, parameters)
        initial = sensitivities(rest, ways, np.array([1]))[:, 0]
        out = sensitivities(rollout, ways, steps + 1, initial)[0]
        columns = [at_points(out[:, k], slot[before], slot[after]) for k in range(len(parameters))]
        return Prediction(xyz, np.stack(columns, axis=2))

    def _scene(self, rod: Rod) -> Scene:
        rec = self.recording
        made = scene([rod], rec.gravity_m_s2, rec.ends, rec.obstacles)
        return replace(made, joint_d=made.joint_d * roll_share(rec.ends, rod.particles))


def roll_share(ends: Ends, n: int) -> Floats:
    """Factors (1, n, 3) on the joints' stiffness: an unmeasured roll carries next to no twist."""
    share = np.ones((1, n, 3))
    share[0, 0, 2] = 1.0 if ends.start_roll_known else FREE_ROLL
    share[0, -1, 2] = 1.0 if ends.end_roll_known else FREE_ROLL
    return share


def held_path(motion: Motion, end_turns: Sequence[float]) -> Path:
    """The poses of the held ends as a path (1, T, 2, ...), each frame turned by its constant angles."""
    positions = np.nan_to_num(np.stack([motion.start_m, motion.end_m], axis=1))
    frames = np.stack([motion.start_q, motion.end_q], axis=1)
    frames[np.isnan(frames).any(axis=2)] = (1.0, 0.0, 0.0, 0.0)
    turned = frames.copy()
    for end in range(2):
        turn = Rotation.from_rotvec([*end_turns[2 * end : 2 * end + 2], 0.0])
        turned[:, end] = (Rotation.from_quat(frames[:, end], scalar_first=True) * turn).as_quat(
            scalar_first=True
        )
    return Path(positions[None], turned[None])


def directions(rod: Rod, made: Scene, parameters: Sequence[str]) -> Directions:
    """Each parameter as a direction in the scene's arrays."""
    n, count = rod.particles, len(parameters)
    joint_d, joint_rest, force = (np.zeros((1, count, n, 3)) for _ in range(3))
    frame = np.zeros((1, count, 2, 3))
    for k, name in enumerate(parameters):
        part = name.partition(".")[2]
        if name == "bending_stiffness":
            joint_d[0, k, :, :2] = made.joint_d[0, :, :2] / rod.bending_stiffness
        elif name == "torsional_stiffness":
            joint_d[0, k, :, 2] = made.joint_d[0, :, 2] / rod.torsional_stiffness
        elif name.startswith("rest_curvature."):
            joint_rest[0, k, :, int(part[-1]) - 1] = 1.0
        elif name.startswith("end_angle."):
            end = 0 if part.startswith("start") else 1
            turn = np.array([*rod.end_turns[2 * end : 2 * end + 2], 0.0])
            frame[0, k, end] = _right_jacobian(turn)[:, int(part[-1]) - 1]
        else:
            raise ParameterError(f"unknown parameter {name}", mend=f"choose from {', '.join(UNITS)}")
    return Directions(joint_d, joint_rest, force, frame)


def _right_jacobian(a: Floats) -> Floats:
    """d exp(a) in the turned frame's own axes, by a (Sola, Deray, Atchuthan 2018, equation 143)."""
    angle = float(np.linalg.norm(a))
    skew = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    if angle < 1e-6:
        return np.asarray(np.eye(3) - skew / 2)
    left = (1 - np.cos(angle)) / angle**2
    right = (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) - left * skew + right * skew @ skew)


def point_weights(points: Points, length_m: float, particles: int) -> Floats:
    """Cubic spline through the particles, as weights (P, n) that give each point at its arc length."""
    nodes = np.linspace(0, length_m, particles)
    spline = make_interp_spline(nodes, np.eye(particles), k=3)
    return np.asarray(spline(np.clip(points.s_m, 0, length_m)))


def _step_times(recording: Recording, step_s: float | None, static: bool) -> Floats:
    """When to solve: every dt, or without one at the frames, the rows and as many between."""
    rows, frames = recording.motion.t_s, np.unique(recording.points.t_s)
    if not static:
        if step_s is None:
            raise ParameterError("a dynamic recording needs a time step", mend="give rod.time_step_s")
        last = max(frames[-1], rows[0] + step_s)
        return np.asarray(rows[0] + step_s * np.arange(np.ceil((last - rows[0]) / step_s - 1e-9) + 1))
    times = [rows[:1], frames]
    keep = rows[rows <= frames[-1]]
    poses = interpolate_motion(recording.motion, keep)
    for a in range(len(keep) - 1):
        parts = int(np.ceil(_distance(poses, a)))
        times.append(np.linspace(keep[a], keep[a + 1], max(parts, 1) + 1))
    return _thinned(np.unique(np.concatenate(times)), frames, recording.motion)


def _distance(poses: Motion, a: int) -> float:
    """From row a to the next, in units of the largest step."""
    moved = [np.linalg.norm(m[a + 1] - m[a]) for m in (poses.start_m, poses.end_m)]
    dots = [np.clip(np.abs(q[a + 1] @ q[a]), 0, 1) for q in (poses.start_q, poses.end_q)]
    signs = [q[a + 1] @ q[a] for q in (poses.start_q, poses.end_q)]
    turned = [
        2 * np.arccos(d) if s >= 0 else 2 * np.pi - 2 * np.arccos(d) for d, s in zip(dots, signs, strict=True)
    ]
    return float(
        np.nanmax([*(np.array(moved) / LARGEST_MOVE_M), *(np.array(turned) / LARGEST_TURN_RAD), 0.0])
    )


def largest_step(motion: Motion) -> float:
    """The largest way between two rows of the motion, in units of the largest quasi-static step."""
    return max((_distance(motion, a) for a in range(len(motion.t_s) - 1)), default=0.0)


def _thinned(times: Floats, frames: Floats, motion: Motion) -> Floats:
    """Leave out steps between frames that move the ends less than the largest step."""
    poses = interpolate_motion(motion, times)
    wanted = np.isin(times, frames)
    kept = [0]
    travelled = 0.0
    for a in range(len(times) - 1):
        ahead = _distance(poses, a)
        if travelled + ahead > 1.0 and kept[-1] != a:
            kept.append(a)
            travelled = 0.0
        travelled += ahead
        if wanted[a + 1]:
            kept.append(a + 1)
            travelled = 0.0
    return times[np.unique(kept)]


def _brackets(at: Floats, times: Floats) -> tuple[np.ndarray, np.ndarray, Floats]:
    """For each time the steps before and after it and the share of the second."""
    after = np.clip(np.searchsorted(times, at - 1e-9), 0, len(times) - 1)
    before = np.where(times[after] <= at + 1e-9, after, np.maximum(after - 1, 0))
    span = times[after] - times[before]
    share = np.where(span > 0, (at - times[before]) / np.where(span > 0, span, 1.0), 0.0)
    return before, after, np.clip(share, 0.0, 1.0)


def simulated(
    recording: Recording, rod: Rod, step_s: float | None = 0.01, sweeps: int | None = None
) -> Recording:
    """The recording with its points replaced by the simulated ones, at the same times and arc lengths."""
    xyz = RecordingModel(recording, rod.particles, step_s, sweeps).predict(rod).xyz_m
    points = replace(recording.points, xyz_m=xyz, covariance_m2=None)
    told = f"dlo simulate {recording.name}"
    return replace(recording, points=points, source=told, position_noise_m=0.0, noise=None)
