"""The trajectory as the robot's tool path, and every check that it must pass before the first motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.errors import MotionRefused
from dlolib.execute.limits import LOOKAHEAD_S, ROUNDING, Limits, RobotConfig, outside
from dlolib.execute.stream import turn_between
from dlolib.formats.motion import interpolate_motion
from dlolib.types import Floats, Motion

SLOWER = "run it slower (time_scale in robot.json)"
# An hour: what lasts longer is a clock that jumped.
LONGEST_S = 3600.0
# Steps of a period are differences of nearly equal numbers.
SAMPLED_ROUNDING = 1e-6


def path_in_base(motion: Motion, config: RobotConfig) -> Motion:
    """The trajectory with its end as the pose of the tool (TCP) in the robot's base frame.

    tool = base_from_world · grasp · tool_from_grasp⁻¹; times are stretched by config.time_scale. Signs of
    the quaternions stay as stored.

    Raises:
        MotionRefused: fewer than two rows, or a free moved end.
    """
    if len(motion.t_s) < 2:
        raise MotionRefused("the trajectory has fewer than two rows", mend="give the whole motion")
    if not np.isfinite(motion.end_m).all() or not np.isfinite(motion.end_q).all():
        raise MotionRefused("the moved end has no pose", place="columns end_*", mend="give it in every row")
    base_from_world, tool_from_grasp = config.matrices()
    grasp_from_tool = np.linalg.inv(tool_from_grasp)
    grasp = Rotation.from_quat(motion.end_q, scalar_first=True)
    base = Rotation.from_matrix(base_from_world[:3, :3])
    turn = base * grasp * Rotation.from_matrix(grasp_from_tool[:3, :3])
    world_m = motion.end_m + grasp.apply(grasp_from_tool[:3, 3])
    tool_m = base.apply(world_m) + base_from_world[:3, 3]
    t_s = motion.t_s[0] + config.time_scale * (motion.t_s - motion.t_s[0])
    quaternion = np.asarray(turn.as_quat(scalar_first=True), dtype=np.float64)
    return Motion(t_s, motion.start_m, motion.start_q, np.asarray(tool_m, dtype=np.float64), quaternion)


def tool_vectors(path: Motion) -> Floats:
    """Poses as the controller takes them, shape (T, 6): position [m], rotation vector [rad]."""
    turn = Rotation.from_quat(path.end_q, scalar_first=True).as_rotvec()
    return np.hstack([path.end_m, turn])


def sampled(path: Motion, period_s: float) -> Floats:
    """The path every period_s [s] from its first row to its last, as `tool_vectors` (N, 6)."""
    steps = int(np.ceil((path.t_s[-1] - path.t_s[0]) / period_s - ROUNDING))
    return tool_vectors(interpolate_motion(path, path.t_s[0] + period_s * np.arange(steps + 1)))


def turn_as_stored(first: Floats, second: Floats) -> Floats:
    """Angles [rad], 0 to 2π, by which slerp turns from unit quaternions (N, 4) to others, signs as stored."""
    dot = np.sum(first * second, axis=-1)
    return np.asarray(2 * np.arccos(np.clip(dot, -1.0, 1.0)), dtype=np.float64)


def check_path(path: Motion, limits: Limits, file: Path | None = None) -> None:
    """Refuse a tool path that leaves the workspace or the reach, is too fast or too long, or sampled too
    coarsely.

    Args:
        path: from `path_in_base`.
        limits: of the robot.
        file: the trajectory's file, named in the refusal.

    Raises:
        MotionRefused: names the first offending row, its time, the value, the limit and the mend.
    """
    _check_place(path, limits, file)
    lasts_s = float(np.ptp(path.t_s))
    if lasts_s > LONGEST_S:
        mend = "look for a jump of the clock in column t_s, or give a smaller time_scale in robot.json"
        raise MotionRefused(f"it would last {lasts_s:g} s, {LONGEST_S:g} s at most", file=file, mend=mend)
    _check_steps(path, limits, file)
    _check_acceleration(path, limits, file)


def check_samples(poses: Floats, period_s: float, limits: Limits) -> None:
    """Refuse what is about to be streamed where a step of it is faster than the limits allow.

    Args:
        poses: from `sampled`, one controller period apart (N, 6).
        period_s: the controller's period [s].
        limits: of the robot.

    Raises:
        MotionRefused: names the first offending step's time, the value and the limit.
    """
    speed = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1) / period_s
    turning = turn_between(poses[:-1, 3:], poses[1:, 3:]) / period_s
    for value, limit, unit, what in (
        (speed, limits.speed_m_s, "m/s", "the tool would move at"),
        (turning, limits.angular_speed_rad_s, "rad/s", "the tool would turn at"),
    ):
        bad = np.flatnonzero(value > limit * (1 + SAMPLED_ROUNDING))
        if bad.size:
            at = int(bad[0])
            problem = f"{what} {value[at]:.3g} {unit}, the limit is {limit:g} {unit}"
            place = f"{at * period_s:.3f} s after the path's beginning"
            raise MotionRefused(problem, place=place, mend=SLOWER)


def _refuse(path: Motion, row: int, problem: str, mend: str, file: Path | None) -> MotionRefused:
    place = f"row {row + 1} (t_s = {path.t_s[row]:g})"
    return MotionRefused(problem, file=file, place=place, mend=mend)


def _check_place(path: Motion, limits: Limits, file: Path | None) -> None:
    if (problem := outside(path.end_m, limits)) is not None:
        row, what = problem
        mend = "correct base_from_world or the trajectory, or widen the limit in robot.json"
        raise _refuse(path, row, what, mend, file)


def _check_steps(path: Motion, limits: Limits, file: Path | None) -> None:
    poses = tool_vectors(path)
    gap_s = np.diff(path.t_s)
    if (bad := np.flatnonzero(~(gap_s > 0))).size:
        raise _refuse(path, int(bad[0]) + 1, "t_s does not rise", "sort the rows by t_s", file)
    move_m = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    turn_rad = turn_as_stored(path.end_q[:-1], path.end_q[1:])
    finer = "sample the trajectory more finely"
    for value, limit, unit, what, mend in (
        (move_m / gap_s, limits.speed_m_s, "m/s", "the tool moves at", SLOWER),
        (turn_rad / gap_s, limits.angular_speed_rad_s, "rad/s", "the tool turns at", SLOWER),
        (move_m, limits.step_m, "m", "the step to this row is", finer),
        (turn_rad, limits.step_rad, "rad", "the turn to this row is", finer),
    ):
        bad = np.flatnonzero(value > limit * (1 + ROUNDING))
        if bad.size:
            row = int(bad[0])
            problem = f"{what} {value[row]:.3g} {unit}, the limit is {limit:g} {unit}"
            if unit.startswith("rad") and turn_rad[row] > np.pi:
                problem += f" (the quaternions' signs tell to turn the long way, by {turn_rad[row]:.3g} rad)"
                mend = "give the quaternions of neighbouring rows one sign"
            raise _refuse(path, row + 1, problem, mend, file)


def _check_acceleration(path: Motion, limits: Limits, file: Path | None) -> None:
    """How much the velocity changes within the servo's look-ahead, to and fro added up, at rest before and
    after the path.

    A path of straight pieces has unbounded acceleration at its rows; what reaches the arm is what the
    servo's look-ahead leaves of it. Shaking that is over within the look-ahead reaches it all the same.
    """
    gap_s = np.diff(path.t_s)[:, None]
    turn = Rotation.from_quat(path.end_q, scalar_first=True)
    mend = "run it slower (time_scale in robot.json) or smooth it"
    for velocity, limit, unit, what in (
        (np.diff(path.end_m, axis=0) / gap_s, limits.acceleration_m_s2, "m/s^2", "accelerates"),
        (
            (turn[1:] * turn[:-1].inv()).as_rotvec() / gap_s,
            limits.angular_acceleration_rad_s2,
            "rad/s^2",
            "speeds up its turn",
        ),
    ):
        value, begins_s = _largest_change(path.t_s, velocity)
        if value > limit * (1 + SAMPLED_ROUNDING):
            row = int(np.clip(np.searchsorted(path.t_s, begins_s), 0, len(path.t_s) - 1))
            problem = f"the tool {what} at {value:.3g} {unit}, the limit is {limit:g} {unit}"
            raise _refuse(path, row, problem, mend, file)


def _largest_change(t_s: Floats, velocity: Floats) -> tuple[float, float]:
    """The largest sum of changes of the velocities (T - 1, 3) between rows at times (T,) [s] within a
    look-ahead, over its length, and when that begins [s].

    A change at a row is spread evenly over the time between two rows, but for no longer than a look-ahead.
    """
    still = np.zeros((1, 3))
    change = np.linalg.norm(np.diff(np.concatenate([still, velocity, still]), axis=0), axis=1)
    gap_s = np.diff(t_s)
    wide_s = np.minimum(0.5 * (np.append(gap_s[:1], gap_s) + np.append(gap_s, gap_s[-1:])), LOOKAHEAD_S)
    edges = np.concatenate([t_s - 0.5 * wide_s, t_s + 0.5 * wide_s])
    rate = np.concatenate([change / wide_s, -change / wide_s])
    order = np.argsort(edges, kind="stable")
    edges, rate = edges[order], np.cumsum(rate[order])
    summed = np.concatenate([[0.0], np.cumsum(rate[:-1] * np.diff(edges))])
    # the sum within a window is largest where the window begins or ends at an edge
    begins = np.concatenate([edges, edges - LOOKAHEAD_S])
    within = np.interp(begins + LOOKAHEAD_S, edges, summed) - np.interp(begins, edges, summed)
    most = int(np.argmax(within))
    return float(within[most]) / LOOKAHEAD_S, float(begins[most])
