"""Moves a connected robot along a checked path, and ends the motion on the first sign of trouble."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from dlolib.errors import MotionRefused
from dlolib.execute.limits import Limits, outside
from dlolib.execute.robots.base import Robot
from dlolib.execute.surroundings import Surroundings
from dlolib.progress import track
from dlolib.types import Floats

ARRIVED_M, ARRIVED_RAD = 5e-4, 5e-3
POLL_S = 0.02
PATIENCE = 3.0
PATIENCE_S = 5.0
SETTLE_S = 2.0
# The controller is asked about poses no further apart than this.
CHECKED_M, CHECKED_RAD = 0.005, 0.05
THERE = "on the way to the first pose"
MOVE = "move the path or the base"
ROUND = "jog it to the trajectory's start, round the obstacles"
DENIES = "the robot denies even the pose in which it stands, so that it was not asked about any other"
NOTHING_KNOWN = Surroundings()
# Ctrl-C, an end from outside, a terminal that was closed or a line that dropped.
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
DONE = "the end of the trajectory was reached"


@dataclass(frozen=True)
class Outcome:
    """How a motion ended, and the controller's time [s] when the path began, None where it did not."""

    completed: bool
    reason: str
    streamed_from_s: float | None


def check_robot(
    robot: Robot, poses: Floats, limits: Limits, around: Surroundings = NOTHING_KNOWN
) -> list[str]:
    """Everything that only the robot can tell; nothing moves.

    Args:
        robot: connected, not yet armed; it is armed here.
        poses: rows of the path (T, 6), in the base frame.
        limits: of the robot.
        around: what the held end must not enter.

    Returns:
        What could not be asked, for a person.

    Raises:
        MotionRefused: it is stopped or not running, stands outside the limits (the way to the first pose
            is straight, box and reach are convex, so its two ends decide), would take the held end into an
            obstacle, or forbids a pose itself, of the path or on the way to it.
    """
    if (problem := robot.trouble()) is not None:
        raise MotionRefused(problem, place="the robot", mend="clear it on the pendant, then try again")
    if (left := outside(robot.pose()[None, :3], limits)) is not None:
        raise MotionRefused(left[1], place="where the robot stands", mend="jog it to the trajectory's start")
    there, way = _way_there(robot.pose(), poses[0]), _way(poses)
    even = np.linspace(0.0, way[-1], int(np.ceil(way[-1])) + 1)
    asked, places = np.concatenate([there, _at(poses, way, even)]), _places(there, way, even)
    if (entered := around.entered(asked)) is not None:
        number, why = entered
        raise MotionRefused(why, place=places[number], mend=ROUND if number < len(there) else MOVE)
    robot.arm()
    answers = robot.answers()
    if answers and (forbidden := robot.forbids(asked)) is not None:
        number, why = forbidden
        raise MotionRefused(f"the pose is outside {why}", place=places[number], mend=MOVE)
    if limits.joints_rad is not None:
        each = np.union1d(way, even)
        asked = np.concatenate([there, _at(poses, way, each)])
        _check_joints(robot, asked, _places(there, way, each), np.array(limits.joints_rad))
    return [] if answers else [DENIES]


def _way_there(here: Floats, first: Floats) -> Floats:
    """Poses (N, 6) on the straight way from where the tool is to the first of the path, without that one."""
    ends = np.stack([here, first])
    way = _way(ends)
    return _at(ends, way, np.linspace(0.0, way[-1], int(way[-1]) + 2)[:-1])


def _at(poses: Floats, way: Floats, asked: Floats) -> Floats:
    """The poses (N, 6) at so much of the way (N,) along a path (T, 6)."""
    ways, rows = np.unique(way, return_index=True)
    if len(ways) == 1:
        return np.repeat(poses[:1], len(asked), axis=0)
    places = np.stack([np.interp(asked, way, column) for column in poses[:, :3].T], axis=-1)
    turns = Slerp(ways, Rotation.from_rotvec(poses[rows, 3:]))(asked)
    return np.hstack([places, turns.as_rotvec()])


def _places(there: Floats, way: Floats, asked: Floats) -> list[str]:
    """What to call each pose (N, 6) on the way to the path, and those at so much of its way: the row that the
    path comes to there."""
    rows = np.searchsorted(way, asked)
    return [THERE] * len(there) + [f"row {row + 1}" for row in rows]


def _way(poses: Floats) -> Floats:
    """The way along poses (T, 6) up to each, in units of what may lie between two that are checked."""
    moved = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1) / CHECKED_M
    turned = turn_between(poses[:-1, 3:], poses[1:, 3:]) / CHECKED_RAD
    return np.concatenate([[0.0], np.cumsum(np.maximum(moved, turned))])


def _check_joints(robot: Robot, poses: Floats, places: list[str], joints_rad: Floats) -> None:
    near: Floats | None = None
    for pose, place in zip(poses, places, strict=True):
        near = robot.joints(pose, near)
        if near.shape != (6,) or not np.isfinite(near).all():
            raise MotionRefused("no joint angles reach it", place=place, mend=MOVE)
        bad = np.flatnonzero((near < joints_rad[0]) | (near > joints_rad[1]))
        if bad.size:
            joint = int(bad[0])
            problem = f"joint {joint + 1} at {near[joint]:.3f} rad leaves {joints_rad[:, joint].tolist()}"
            raise MotionRefused(problem, place=place, mend=f"{MOVE}, or widen joints_rad")


def drive(
    robot: Robot,
    path: Floats,
    limits: Limits,
    interrupted: threading.Event,
    begins: Callable[[float], None],
) -> Outcome:
    """Approach the first pose slowly, stream the path, wait for the arm to arrive; then stop it in any case.

    Args:
        robot: armed and checked.
        path: poses one controller period apart (N, 6).
        limits: speeds and accelerations.
        interrupted: set to end the motion.
        begins: told the controller's time [s] when the path begins.
    """
    began: float | None = None
    try:
        reason = _approach(robot, path[0], limits, interrupted)
        if reason is None:
            began = robot.clock_s()
            begins(began)
            reason = _stream(robot, path, interrupted) or _settle(robot, path[-1], interrupted)
    finally:
        robot.stop(limits.acceleration_m_s2)
    return Outcome(reason is None, reason or DONE, began)


def _stopped(robot: Robot, interrupted: threading.Event, taken: bool) -> str | None:
    """Why to stop now, or None. `taken`: whether the robot took the last command."""
    if (problem := robot.trouble()) is not None:
        return problem
    if interrupted.is_set():
        return "interrupted (Ctrl-C, SIGTERM or a closed terminal)"
    return None if taken else "the robot did not take the command"


def _approach(robot: Robot, first: Floats, limits: Limits, interrupted: threading.Event) -> str | None:
    if (reason := _stopped(robot, interrupted, True)) is not None:
        return reason
    distance_m = float(np.linalg.norm(robot.pose()[:3] - first[:3]))
    turn_rad = float(turn_between(robot.pose()[3:], first[3:]))
    speed = limits.approach_speed_m_s
    seconds = distance_m / speed + turn_rad / limits.angular_speed_rad_s
    until = time.monotonic() + PATIENCE * seconds + PATIENCE_S
    taken = robot.approach(first, speed, limits.acceleration_m_s2)
    while (reason := _stopped(robot, interrupted, taken)) is None:
        if _arrived(robot, first):
            return None
        if time.monotonic() > until:
            return "the robot did not arrive at the trajectory's first pose"
        time.sleep(POLL_S)
        taken = robot.keep_alive()
    return reason


def _stream(robot: Robot, path: Floats, interrupted: threading.Event) -> str | None:
    """One pose a period, never two: a late computer makes the motion later, not faster."""
    for pose in track(path, "moving the robot", total=len(path)):
        taken = robot.servo(pose)
        if (reason := _stopped(robot, interrupted, taken)) is not None:
            return reason
    return None


def _settle(robot: Robot, last: Floats, interrupted: threading.Event) -> str | None:
    """Hold the last pose until the arm, which follows with a delay, is there."""
    until = time.monotonic() + SETTLE_S
    while not _arrived(robot, last):
        if (reason := _stopped(robot, interrupted, robot.servo(last))) is not None:
            return reason
        if time.monotonic() > until:
            away = 1e3 * float(np.linalg.norm(robot.pose()[:3] - last[:3]))
            return f"the robot stayed {away:.1f} mm away from the trajectory's end"
    return None


def _arrived(robot: Robot, goal: Floats) -> bool:
    pose = robot.pose()
    near = float(np.linalg.norm(pose[:3] - goal[:3])) < ARRIVED_M
    return near and float(turn_between(pose[3:], goal[3:])) < ARRIVED_RAD


def turn_between(first: Floats, second: Floats) -> Floats:
    """Angles [rad] between rotation vectors (..., 3) and (..., 3)."""
    between = Rotation.from_rotvec(first).inv() * Rotation.from_rotvec(second)
    return np.asarray(between.magnitude(), dtype=np.float64)
