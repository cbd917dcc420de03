"""How many poses a recording shows: with few a bootstrap over frames would tell how well one was measured."""

from dataclasses import replace

import numpy as np
import pytest
from sim.test_recording import recording

from dlolib.identify.intervals import FEWEST_POSES, poses
from dlolib.sim.recording import RecordingModel
from dlolib.types import Motion, Recording


def with_motion(end_m: np.ndarray) -> RecordingModel:
    made: Recording = recording()
    first = {name: np.tile(getattr(made.motion, name)[0], (len(end_m), 1)) for name in ("start_q", "end_q")}
    motion = Motion(
        np.linspace(0, 6, len(end_m)), np.zeros_like(end_m), first["start_q"], end_m, first["end_q"]
    )
    return RecordingModel(replace(made, motion=motion), 30, None)


@pytest.mark.parametrize("jitter_m", [0.0, 2e-6, 5e-5])
def test_an_arm_that_stands_still_shows_one_pose(jitter_m: float) -> None:
    still = np.tile([0.4, 0.0, 0.0], (200, 1))
    jitter = np.random.default_rng(1).normal(0.0, jitter_m, still.shape)
    assert poses(with_motion(still + jitter)) == 1
    moved = still + jitter
    moved[100:, 0] += 0.01
    assert poses(with_motion(moved)) == 2


def test_of_an_arm_that_moves_many_poses_are_shown() -> None:
    way = np.linspace(0.0, 0.05, 200)[:, None] * np.array([0.0, 0.0, 1.0])
    assert poses(with_motion(np.array([0.4, 0.0, 0.0]) + way)) == FEWEST_POSES
