"""Logged poses: the one place of a camera that stands still, and the motion of a held end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.errors import FormatError
from dlolib.formats import Given
from dlolib.types import Floats, Motion

# What a tracker's noise may be; a camera that moves more would bend every rope.
STILL_M, STILL_RAD = 0.005, 0.01


def transforms(position_m: Floats, quaternion_wxyz: Floats, path: Path, place: str) -> Floats:
    """Poses (T, 4, 4) from positions (T, 3) [m] and quaternions (T, 4), which need not be unit.

    Raises:
        FormatError: a number that is not finite, or a zero quaternion.
    """
    bad = ~np.isfinite(position_m).all(axis=1) | ~np.isfinite(quaternion_wxyz).all(axis=1)
    bad |= ~(np.linalg.norm(quaternion_wxyz, axis=1) > 1e-6)
    if bad.any():
        problem = f"pose {int(np.argmax(bad))} is none: a number is not finite or the quaternion zero"
        raise FormatError(problem, file=path, place=place, mend="leave it out")
    poses = np.tile(np.eye(4), (len(position_m), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternion_wxyz, scalar_first=True).as_matrix()
    poses[:, :3, 3] = position_m
    return poses


def one_pose(poses: Floats, path: Path, place: str) -> Floats:
    """The mean (4, 4) of the poses (T, 4, 4) of a camera that stands still.

    Raises:
        FormatError: it moves.
    """
    turns = Rotation.from_matrix(poses[:, :3, :3])
    mean = turns.mean()
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = mean.as_matrix(), poses[:, :3, 3].mean(axis=0)
    away = float(np.linalg.norm(poses[:, :3, 3] - view[:3, 3], axis=1).max())
    turned = float((mean.inv() * turns).magnitude().max())
    if away > STILL_M or turned > STILL_RAD:
        problem = (
            f"the camera moves by {away:.3g} m and {np.degrees(turned):.3g}°; a capture knows one pose of it"
        )
        mend = "hold it still, or give camera.world_from_camera where it did"
        raise FormatError(problem, file=path, place=place, mend=mend)
    return view


def end_motion(t_s: Floats, poses: Floats, given: Given) -> Motion:
    """The motion of the ends where one of them was logged as poses (T, 4, 4) at t_s (T,) [s].

    The moved end is the rope's end where that is held, else its start; a second held end stands still.
    Signs of quaternions are chosen so that neighbours are near, since loggers choose them at will.

    Raises:
        FormatError: no pose of the end that stands still, or no end is held.
    """
    start, end = given.ends.start == "clamped", given.ends.end == "clamped"
    if not (start or end):
        mend = 'call the end that it moves "clamped", or leave --topic motion out'
        raise FormatError(
            "both ends are free, but a motion is given", file=given.file, place="ends", mend=mend
        )
    grasped = poses @ given.tool_from_grasp
    quaternion = Rotation.from_matrix(grasped[:, :3, :3]).as_quat(scalar_first=True)
    flips = np.sign(np.sum(quaternion[1:] * quaternion[:-1], axis=1))
    quaternion[1:] *= np.cumprod(np.where(flips == 0, 1.0, flips))[:, None]
    moved = (grasped[:, :3, 3], quaternion)
    if not (start and end):
        nothing = (np.full((len(t_s), 3), np.nan), np.full((len(t_s), 4), np.nan))
        return Motion(t_s, *nothing, *moved) if end else Motion(t_s, *moved, *nothing)
    if given.start is None:
        problem = "the motion needs the pose of the start, which is held too"
        mend = 'add "start": {"position_m": [x, y, z], "quaternion": [w, x, y, z]}, or give --motion CSV'
        raise FormatError(problem, file=given.file, place="start", mend=mend)
    still = (np.tile(given.start.position_m, (len(t_s), 1)), np.tile(given.start.quaternion, (len(t_s), 1)))
    return Motion(t_s, *still, *moved)
