"""95 % intervals: how often they hold the truth, and how many poses a recording shows.

With few poses a jackknife over frames would tell how well one was measured.
"""

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import pytest
from sim.test_recording import recording

from dlolib.identify.intervals import BLOCKS, FEWEST_POSES, blocks, jackknife, poses
from dlolib.sim.recording import RecordingModel
from dlolib.types import Floats, Motion, Points, Recording


def with_motion(end_m: np.ndarray) -> RecordingModel:
    made: Recording = recording()
    first = {name: np.tile(getattr(made.motion, name)[0], (len(end_m), 1)) for name in ("start_q", "end_q")}
    motion = Motion(
        np.linspace(0, 6, len(end_m)), np.zeros_like(end_m), first["start_q"], end_m, first["end_q"]
    )
    return RecordingModel(replace(made, motion=motion), 30, None)


def seen(model: RecordingModel, first_s: float = 0.0) -> int:
    """How many poses fifty frames from a time on show."""
    return poses(model.recording, np.linspace(first_s, 6.0, 50))


@pytest.mark.parametrize("jitter_m", [0.0, 2e-6, 5e-5])
def test_an_arm_that_stands_still_shows_one_pose(jitter_m: float) -> None:
    still = np.tile([0.4, 0.0, 0.0], (200, 1))
    jitter = np.random.default_rng(1).normal(0.0, jitter_m, still.shape)
    assert seen(with_motion(still + jitter)) == 1
    moved = still + jitter
    moved[100:, 0] += 0.01
    assert seen(with_motion(moved)) == 2


def test_of_an_arm_that_moves_many_poses_are_shown() -> None:
    way = np.linspace(0.0, 0.05, 200)[:, None] * np.array([0.0, 0.0, 1.0])
    assert seen(with_motion(np.array([0.4, 0.0, 0.0]) + way)) == FEWEST_POSES


def test_what_an_arm_did_before_the_first_frame_is_no_pose_that_was_seen() -> None:
    way = np.minimum(np.linspace(0.0, 0.1, 200), 0.05)[:, None] * np.array([0.0, 0.0, 1.0])
    model = with_motion(np.array([0.4, 0.0, 0.0]) + way)
    assert seen(model) == FEWEST_POSES
    assert seen(model, first_s=3.5) == 1


def test_what_is_left_out_is_frames_or_where_few_poses_are_shown_stretches_of_the_rope() -> None:
    still = with_motion(np.tile([0.4, 0.0, 0.0], (200, 1)))
    points, length_m = still.recording.points, still.recording.rope.length_m
    whole = replace(points, s_m=np.linspace(0.0, length_m, len(points.s_m)))
    still = replace(still, recording=replace(still.recording, points=whole))
    found = blocks(still, whole.s_m > 0.25 * length_m)
    assert np.unique(found).tolist() == list(range(BLOCKS // 4, BLOCKS))
    sizes = np.bincount(found)[BLOCKS // 4 :]
    assert sizes.max() - sizes.min() <= 1
    moved = with_motion(np.linspace([0.4, 0.0, 0.0], [0.4, 0.0, 0.05], 200))
    frames = np.arange(3 * BLOCKS)
    many = replace(points, frame=7 * frames, t_s=np.linspace(0, 6, len(frames)), s_m=0.1 + 0.0 * frames)
    moved = replace(moved, recording=replace(moved.recording, points=many))
    assert blocks(moved, frames >= 0).tolist() == (frames // 3).tolist()


MOVED = np.linspace(0.0, 0.05, 50)[:, None] * np.array([0.0, 0.0, 1.0]) + [0.4, 0.0, 0.0]
PLACES = np.linspace(0.0, 0.5, 20)


@dataclass
class Linear:
    """What the jackknife asks of a problem, of a model whose residuals go with its parameters."""

    models: tuple[RecordingModel]
    used: tuple[np.ndarray]
    left: Floats
    slopes: Floats

    def residuals(self, _theta: Floats) -> Floats:
        return self.left

    def jacobian(self, _theta: Floats) -> Floats:
        return self.slopes


def fitted(model: RecordingModel, tells: Floats, rng: np.random.Generator) -> tuple[Linear, Floats]:
    """Two parameters that are 0, fitted to noise; `tells` says how much each frame tells of them (F, 2)."""
    frames = len(tells)
    points = Points(
        np.repeat(np.arange(frames), len(PLACES)),
        np.repeat(np.linspace(0.0, 6.0, frames), len(PLACES)),
        np.tile(PLACES, frames),
        np.zeros((frames * len(PLACES), 3)),
    )
    model = replace(model, recording=replace(model.recording, points=points))
    waves = np.sin(np.outer(PLACES / PLACES[-1], np.pi * np.arange(1, 3)))
    slopes = np.einsum("fn,sn,an->fsan", tells, waves, rng.normal(size=(3, 2))).reshape(-1, 2)
    noise = rng.normal(size=len(slopes))
    theta = -np.linalg.lstsq(slopes, noise)[0]
    used = np.ones(len(points.frame), dtype=bool)
    return Linear((model,), (used,), noise + slopes @ theta, slopes), theta


@pytest.mark.parametrize("frames", [4, 6, 12, 40])
@pytest.mark.parametrize("even", [True, False])
def test_intervals_hold_the_truth_in_some_95_percent(frames: int, even: bool) -> None:
    rng = np.random.default_rng(frames)
    tells = np.ones((frames, 2)) if even else np.linspace(0.1, 1.0, frames)[:, None] ** 2 * np.ones(2)
    model, held = with_motion(MOVED), []
    for _ in range(500):
        problem, theta = fitted(model, tells, rng)
        low, high = jackknife(cast(Any, problem), theta)
        held.append((low < 0.0) & (high > 0.0))
    # of four frames that tell unlike much, how much they differ is guesswork
    assert (0.91 if even or frames > 4 else 0.88) < np.mean(held) < 0.985


def test_of_what_one_block_alone_tells_there_is_no_interval() -> None:
    tells = np.ones((BLOCKS, 2))
    tells[1:, 1] = 0.0
    problem, theta = fitted(with_motion(MOVED), tells, np.random.default_rng(0))
    low, high = jackknife(cast(Any, problem), theta)
    assert np.isfinite([low[0], high[0]]).all()
    assert np.isnan([low[1], high[1]]).all()
