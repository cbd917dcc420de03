"""Ends that turned often have twisted the rope as often, though no single pose shows it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE

from dlolib.sim.poses import PosesModel, model_of
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.sim.winding import twists
from dlolib.types import Ends, Floats, Motion, Points, Recording

ROWS, POSES, SEEN, ONCE_AND_A_HALF = 161, 9, 7, 3 * np.pi
ROD, STIFF = Rod(ROPE, EI, GJ), Rod(ROPE, 1e-3, 7e-4)


def turning(axis: Floats, angle: float, rows: int) -> Motion:
    """The end, 0.2 m from the start, turned about an axis of the world evenly in 16 s."""
    angles = np.linspace(0, angle, rows)[:, None] * axis
    turned = Rotation.from_rotvec(angles) * Rotation.from_quat(LEVEL, scalar_first=True)
    end_q = turned.as_quat(scalar_first=True)
    end_m, start_q = np.tile([0.2, 0.0, 0.0], (rows, 1)), np.tile(LEVEL, (rows, 1))
    return Motion(np.linspace(0, 16, rows), 0 * end_m, start_q, end_m, end_q)


def seen_on_the_way(motion: Motion, rod: Rod = ROD) -> Recording:
    """At nine times, of which each is a row, as a rope that follows all rows."""
    t_s, s_m = np.linspace(0, 16, POSES), np.linspace(0.05, 0.4, SEEN)
    frame = np.repeat(np.arange(POSES), SEEN)
    points = Points(frame, t_s[frame], np.tile(s_m, POSES), np.zeros((POSES * SEEN, 3)))
    made = Recording("turned", ROPE, GRAVITY, Ends(), motion, points)
    xyz_m = RecordingModel(made, rod.particles, None).predict(rod).xyz_m
    return replace(made, points=replace(points, xyz_m=xyz_m))


def at_poses(made: Recording) -> Recording:
    """The same of which only the rows of the frames are known."""
    rows, motion = np.linspace(0, ROWS - 1, POSES).astype(int), made.motion
    parts = (motion.t_s, motion.start_m, motion.start_q, motion.end_m, motion.end_q)
    return replace(made, motion=Motion(*(part[rows] for part in parts)))


@pytest.mark.parametrize("axis", np.eye(3), ids="xyz")
@pytest.mark.parametrize("angle", [ONCE_AND_A_HALF, -ONCE_AND_A_HALF])
def test_settled_poses_of_an_end_that_turned_often_are_those_of_the_way(axis: Floats, angle: float) -> None:
    whole = seen_on_the_way(turning(axis, angle, ROWS))
    model = model_of(at_poses(whole), ROD.particles, None)
    assert isinstance(model, PosesModel)
    assert np.abs(model.predict(ROD).xyz_m - whole.points.xyz_m).max() < 1e-6


@pytest.mark.parametrize("seed", [1, 8, 9])
def test_settled_poses_of_ends_that_turn_anyhow_are_those_of_the_way(seed: int) -> None:
    """In space, tilted and rolled from pose to pose: the rope is twisted by more than half a turn."""
    rng = np.random.default_rng(seed)
    end_m = np.array([0.25, 0.0, 0.05]) + rng.uniform(-0.08, 0.08, (POSES, 3))
    turned = {}
    for end, tilt, roll in (("end_q", 0.8, 2.0), ("start_q", 0.5, 1.0)):
        tilted = Rotation.from_rotvec(rng.uniform(-tilt, tilt, (POSES, 3)))
        rolled = Rotation.from_rotvec(np.outer(rng.uniform(-roll, roll, POSES), [0.0, 0.0, 1.0]))
        q = (tilted * Rotation.from_quat(LEVEL, scalar_first=True) * rolled).as_quat(scalar_first=True)
        flips = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0))
        turned[end] = np.concatenate([q[:1], flips[:, None] * q[1:]])
    made = seen_on_the_way(Motion(np.linspace(0, 16, POSES), 0 * end_m, end_m=end_m, **turned), STIFF)
    found = model_of(made, STIFF.particles, None).predict(STIFF).xyz_m
    assert np.abs(found - made.points.xyz_m).max() < 1e-6


def test_the_last_poses_alone_are_as_often_turned() -> None:
    """Of frames that are held out the rows before them tell."""
    poses = at_poses(seen_on_the_way(turning(np.array([1.0, 0, 0]), ONCE_AND_A_HALF, ROWS)))
    late = poses.points.frame >= POSES - 2
    parts = (poses.points.frame, poses.points.t_s, poses.points.s_m, poses.points.xyz_m)
    points = Points(*(part[late] for part in parts))
    found = PosesModel(replace(poses, points=points), ROD.particles).predict(ROD).xyz_m
    assert np.abs(found - points.xyz_m).max() < 1e-6


@pytest.mark.parametrize("rows", [3, 9])
@pytest.mark.parametrize("frames", [[1.0, 7.0, 16.0], [16.0]], ids=str)
def test_a_straight_rope_is_twisted_by_the_roll_of_its_end(rows: int, frames: list[float]) -> None:
    """In rows of three quarters of a turn, too."""
    straight = np.linspace([0.0, 0, 0], [0.2, 0, 0], 20)
    motion = turning(np.array([1.0, 0, 0]), ONCE_AND_A_HALF, rows)
    found = twists(motion, np.array(frames), np.tile(straight, (len(frames), 1, 1)))
    assert found == pytest.approx(ONCE_AND_A_HALF * np.array(frames) / 16, abs=1e-9)
