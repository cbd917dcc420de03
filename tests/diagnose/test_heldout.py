"""Held-out frames: cut from a recording, they are still of its motion."""

from dataclasses import replace

import numpy as np
import pytest
from diagnose.test_diagnose import QUICK, made
from formats import samples
from scipy.spatial.transform import Rotation
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE

from dlolib.diagnose.diagnose import FIRST_NOISE, raw_study
from dlolib.diagnose.heldout import Foretold, _left, black_box, foretell
from dlolib.diagnose.search import baseline
from dlolib.diagnose.study import acting_only
from dlolib.identify.identify import FIRST_STIFFNESS_M4_S2
from dlolib.sim.continuum import simulated
from dlolib.sim.effects import EFFECTS
from dlolib.sim.mesh import FINER
from dlolib.sim.poses import PosesModel, model_of
from dlolib.sim.rod import Rod
from dlolib.types import Ends, Motion, Points, Recording

ALONE = replace(QUICK, without=tuple(EFFECTS))
SEEN = 15


def test_settled_poses_stay_so_when_some_are_held_out():
    """The ways between them are unknown, however many of them are looked at."""
    frames = 12
    rng = np.random.default_rng(3)
    end = np.array([0.3, 0.0, 0.1]) + rng.uniform(-0.05, 0.05, (frames, 3))
    turns = Rotation.from_quat(LEVEL, scalar_first=True) * Rotation.from_rotvec(
        np.outer(rng.uniform(-2, 2, frames), [0, 0, 1])
    )
    held = np.tile(LEVEL, (frames, 1))
    t = 10.0 * np.arange(frames)
    motion = Motion(t, np.zeros((frames, 3)), held, end, turns.as_quat(scalar_first=True))
    frame = np.repeat(np.arange(frames), SEEN)
    s = np.tile(np.linspace(0, ROPE.length_m, SEEN), frames)
    poses = Recording(
        "poses", ROPE, GRAVITY, Ends(), motion, Points(frame, t[frame], s, np.zeros((len(s), 3)))
    )
    assert isinstance(model_of(poses, 20, None), PosesModel)
    study = raw_study([poses], replace(ALONE, heldout_share=0.25))
    assert all(isinstance(one.model, PosesModel) for one in (*study.seen, *study.ahead.values()))
    assert [len(np.unique(one.recording.points.frame)) for one in (*study.seen, study.ahead[0])] == [9, 3]


def test_what_is_left_counts_in_deviations_of_the_noise():
    """Points off by one deviation in each axis, in some frames by two: χ² of each frame, and distances."""
    study = raw_study([replace(samples.recording(), obstacles=())], ALONE)
    (seen,) = study.seen
    frame = seen.recording.points.frame
    far = frame == frame[-1]
    left = _left(study, [FIRST_NOISE.sigma_m * np.outer(1.0 + far, np.ones(3))])
    counts = np.unique(frame, return_counts=True)[1]
    assert left.chi2 == pytest.approx(
        3.0 * counts * np.where(np.arange(len(counts)) == len(counts) - 1, 4, 1)
    )
    assert left.distances_m == pytest.approx(np.sqrt(3) * FIRST_NOISE.sigma_m * (1.0 + far))
    assert left.rmse_m == pytest.approx(np.sqrt(np.mean(left.distances_m**2)))


def test_a_rope_in_flight_goes_on_in_the_heldout_frames():
    """It was released once, where the first frame saw it, and not again where the held-out ones begin."""
    frames = 24
    nowhere, turned = np.full((2, 3), np.nan), np.full((2, 4), np.nan)
    motion = Motion(np.array([0.0, 0.4]), nowhere, turned, nowhere, turned)
    frame, at = np.repeat(np.arange(frames), SEEN), np.linspace(0, 0.4, frames)
    s = np.linspace(0, ROPE.length_m, SEEN)
    arc = np.stack([0.15 * np.sin(s / 0.15), 0 * s, 0.15 * (1 - np.cos(s / 0.15))], axis=1)
    points = Points(frame, at[frame], np.tile(s, frames), np.tile(arc, (frames, 1)))
    free = Recording("fall", ROPE, GRAVITY, Ends("free", "free"), motion, points, quasi_static=False)
    clean = simulated(free, Rod(ROPE, EI, GJ, {}, particles=20), finer=FINER)
    noise = np.random.default_rng(0).normal(0, 1e-3, clean.points.xyz_m.shape)
    seen = replace(clean.points, xyz_m=clean.points.xyz_m + noise)
    thrown = replace(clean, position_noise_m=None, points=seen)
    study = acting_only(raw_study([thrown], ALONE), FIRST_STIFFNESS_M4_S2)
    told = foretell(study, baseline(study))
    assert told is not None and told.rmse_m < 3e-3


def test_heldout_frames_that_cannot_be_simulated_are_told_by_nothing():
    """Pulled longer than it is recorded to be, the elastic rod tears there, and the black box has no base."""
    whole = made({})
    motion = whole.motion
    late = np.clip((motion.t_s - 16) / 3, 0, 1)[:, None]
    far = 0.480 * motion.end_m / np.linalg.norm(motion.end_m, axis=1, keepdims=True)
    pulled = replace(whole, motion=replace(motion, end_m=motion.end_m + (far - motion.end_m) * late))
    study = acting_only(raw_study([pulled], ALONE), FIRST_STIFFNESS_M4_S2)
    elastic = baseline(study)
    assert foretell(study, elastic) is None and black_box(study, (elastic, 0)) is None


@pytest.mark.parametrize("held", [(997, 999), (2, 999), (0, 996)])
def test_of_many_frames_some_are_looked_at_on_either_side(held: tuple[int, int]):
    whole, frames = made({}), 1000
    frame = np.repeat(np.arange(frames), 3)
    s = np.tile(np.linspace(0, ROPE.length_m, 3), frames)
    points = Points(frame, np.linspace(0.5, 19.8, frames)[frame], s, np.zeros((len(s), 3)))
    many = replace(whole, points=points, heldout_frames=held, static_frames=None)
    study = raw_study([many], ALONE)
    fitted, out = (np.unique(one.recording.points.frame) for one in (study.seen[0], study.ahead[0]))
    declared = np.arange(held[0], held[1] + 1)
    assert set(out) <= set(declared) and not set(fitted) & set(declared)
    assert 2 <= len(fitted) <= 200 and 2 <= len(out) <= 200


def test_a_black_box_counts_what_it_takes_up() -> None:
    study = acting_only(raw_study([made({})], ALONE), FIRST_STIFFNESS_M4_S2)
    elastic = baseline(study)
    box = black_box(study, (elastic, 0))
    assert box is not None
    assert len(elastic.unknowns) + 3 < box.parameters < 0.5 * elastic.coordinates
    assert box.energy < 2.0 and box.bic(study.frames) > elastic.bic(study.frames)


def test_the_error_of_a_sum_knows_that_neighbours_are_alike() -> None:
    """Of an autoregression the variance of the sum is (1 + r) / (1 - r) times that of as many alone."""
    frames, alike, rng = 400, 0.3, np.random.default_rng(0)
    sums, errors = [], []
    for _ in range(400):
        values = np.zeros(frames)
        for k, own in enumerate(rng.normal(size=frames)):
            values[k] = alike * values[k - 1] + own
        change, error = Foretold(values, values).against(Foretold(0 * values, values))
        sums.append(change)
        errors.append(error)
    assert np.std(sums) == pytest.approx(np.median(errors), rel=0.15)
