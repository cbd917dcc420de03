"""Where and when something is missing: the local probes themselves, and what the ends do meanwhile."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from formats import samples
from scipy.spatial.transform import Rotation
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE

from dlolib.diagnose.locate import (
    _beyond,
    _gains,
    _pairs,
    _phase,
    _windows,
)
from dlolib.diagnose.probes import PROBES, probe
from dlolib.sim.rod import Rod, setup
from dlolib.sim.scene import LOAD, REST, STIFFNESS
from dlolib.types import Ends, Motion, Points, Recording

FRAMES = 40


def moved() -> Recording:
    """Out in ten frames and still for ten; a turn in ten; back in ten."""
    t_s = np.arange(float(FRAMES))
    out = np.interp(t_s, [0, 9, 30, 39], [0.0, 0.1, 0.1, 0.0])
    angle = np.interp(t_s, [19, 29], [0.0, 1.0])
    turns = Rotation.from_quat(LEVEL, scalar_first=True) * Rotation.from_rotvec(np.outer(angle, [0, 0, 1.0]))
    end_m = np.array([0.4, 0.0, 0.0]) - np.outer(out, [1.0, 0.0, 0.0])
    held = np.tile(LEVEL, (FRAMES, 1))
    motion = Motion(t_s, np.zeros((FRAMES, 3)), held, end_m, turns.as_quat(scalar_first=True))
    points = Points(np.arange(FRAMES), t_s, np.full(FRAMES, 0.2), np.zeros((FRAMES, 3)))
    return replace(samples.recording(), motion=motion, points=points)


@pytest.mark.parametrize(
    ("frames", "phase"),
    [((0, 10), "out"), ((10, 19), "rest"), ((20, 29), "turn"), ((31, 40), "back"), ((5, 30), "all")],
)
def test_what_the_ends_do_in_these_frames(frames: tuple[int, int], phase: str) -> None:
    assert _phase(moved(), *frames) == phase


def test_frames_of_one_pose_are_those_of_the_way_out_and_back() -> None:
    """Not while the wrist is turned, nor one of the frames at rest, from which the rope never went away."""
    recording = moved()
    still = replace(recording.motion, end_q=recording.motion.start_q)
    assert _pairs(replace(recording, motion=still)) == [(a, 39 - a) for a in range(9)]
    assert _pairs(recording) == []


def test_the_windows_are_all_frames_and_parts_of_them_half_over_each_other() -> None:
    assert _windows(2) == [(0, 2)]
    windows = _windows(16)
    assert sorted({b - a for a, b in windows}) == [2, 4, 8, 16]
    assert [one for one in windows if one[1] - one[0] == 8] == [(0, 8), (4, 12), (8, 16)]
    assert all(0 <= a < b <= 16 for a, b in windows)


@pytest.mark.parametrize("name", PROBES)
def test_a_probe_changes_one_place_by_its_size(name: str) -> None:
    made = setup(Rod(ROPE, EI, GJ, particles=46), GRAVITY, Ends())
    up, down, size = probe(made, name, 0.2, 0.05)
    particles = cast(np.ndarray, up.particles - down.particles)
    joints = cast(np.ndarray, up.joints - down.joints)
    place_m = np.sum(made.joint_arc_m(), axis=0) / 2
    if name.startswith("force"):
        load = particles[:, LOAD : LOAD + 3]
        assert load.sum(axis=0) == pytest.approx(size * np.eye(3)["xyz".index(name[-1])], abs=1e-12)
        assert load.sum(axis=1) @ made.arc_m == pytest.approx(0.2 * size, rel=1e-3)
        assert not joints.any()
        return
    columns = slice(STIFFNESS, REST) if name == "stiffness" else REST + int(name[-1]) - 1
    share = joints[:, columns] / (made.joints[:, columns] if name == "stiffness" else 1.0) / size
    near = np.abs(place_m - 0.2) < 0.05
    assert 0.8 < share.max() <= 1.0 and share[near].min() > 0 and not share[~near].any()
    assert not particles.any()


def test_what_was_put_at_one_place_is_found_in_its_own_size() -> None:
    """Less what the baseline's own parameters take up; in the window in which it was there."""
    rng = np.random.default_rng(0)
    columns, own = rng.normal(size=(12, 5, 3, 4)), rng.normal(size=(12, 5, 3, 2))
    there = np.where(np.arange(12) < 6, 0.3, 0.0)[:, None, None]
    # residuals are simulated less observed: what the probe would add is lacking
    residual = -there * columns[..., 2] + own @ [5.0, -7.0]
    windows = [(0, 6), (0, 12), (6, 12)]
    gains, sizes = _gains(columns, own, residual[None], windows)
    assert np.unravel_index(gains[0].argmax(), gains[0].shape) == (2, 0)
    assert sizes[2, 0] == pytest.approx(0.3)
    white = rng.normal(size=(2000, 12, 5, 3))
    drawn, _ = _gains(columns, own, white, windows)
    assert drawn.mean(axis=0) == pytest.approx(np.ones((4, 3)), abs=0.15)


@pytest.mark.parametrize(("unsure", "left"), [(0.0, 9.0), (4.0, 1.0), (16.0, 0.0)])
def test_a_gain_counts_beyond_what_the_mesh_may_have_added(unsure: float, left: float) -> None:
    assert _beyond(np.array([[1.0, 9.0], [4.0, 0.0]]), unsure) == pytest.approx(left)
