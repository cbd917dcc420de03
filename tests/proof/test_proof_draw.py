"""The draw: the same from the same seed, even over the effects, in the style of data/practice."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlolib.errors import SimulationError
from dlolib.formats import read_recording
from dlolib.proof import place, play
from dlolib.proof.chain import Sizes
from dlolib.proof.draw import draw_case, draw_names
from dlolib.proof.gain import gain
from dlolib.proof.motions import KINDS, RAMP_S, Arc, Plan, make_motion
from dlolib.proof.noise import draw_noise, whiten
from dlolib.proof.play import seen_times
from dlolib.proof.sizes import FOUND, NAMES, SAMPLERS
from dlolib.proof.world import Effects, Experiment, free_length
from dlolib.proof.write import recording, truth, write_case
from dlolib.types import Motion, Noise, Obstacle

WHITE = Noise(0.0015, 0.0, 0.0)


def plan(kind: str = "plain") -> Plan:
    """The motion of data/practice."""
    return Plan(kind, 0.42, 0.12, Arc(np.radians(30), 2.09), Arc(np.radians(-70), 1.83), 2.0, 0.05)


def small(kind: str = "plain") -> Experiment:
    """A few frames of it."""
    motion, frames = make_motion(plan(kind), Sizes())
    return Experiment(motion, frames[[0, 40, 60, 80, 113]], 3e-4, 3e-4)


def twisting(frames: Sequence[int], ratio: float = 0.521) -> tuple[Experiment, Effects]:
    """A rope so weak about one axis that it all but twists over in the middle of its motion."""
    experiment = draw_case(5335539873960795634, 24, ()).experiment
    weak = {"anisotropic_bending": {"stiffness_ratio": ratio}}
    return replace(experiment, frame_t_s=experiment.frame_t_s[list(frames)]), weak


def test_every_effect_has_a_size_and_a_sampler() -> None:
    assert set(SAMPLERS) == set(FOUND) == set(NAMES)
    assert len(NAMES) == 20


def test_names_go_round_all_effects() -> None:
    names = draw_names(5, 50)
    assert names == draw_names(5, 50) != draw_names(6, 50)
    assert sum(not one for one in names) == 25
    alone = [one[0] for one in names if len(one) == 1]
    assert len(alone) == len(set(alone)) == 14
    assert all(len(set(one)) == len(one) for one in names)


def test_a_seed_draws_the_same_case(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(place, "play", lambda experiment: play.play(experiment, bodies=29))
    monkeypatch.setattr(play, "CHAINS", (29, 58))
    monkeypatch.setattr(play, "LEFT", np.inf)
    first, again = (draw_case(7, 3, ("mass_profile", "clock_offset")) for _ in range(2))
    np.testing.assert_array_equal(first.points_m, again.points_m)
    np.testing.assert_array_equal(first.noise_m, again.noise_m)
    assert truth(first) == truth(again)
    write_case(first, "000", tmp_path / "recordings", tmp_path / "answers")
    read = read_recording(tmp_path / "recordings/000")
    assert len(np.unique(read.points.frame)) == 114
    assert read.static_frames == (0, 29)
    assert read.noise is None and read.position_noise_m is None
    assert "mass_profile" not in (tmp_path / "recordings/000/recording.json").read_text()
    assert recording(first, "000").points.xyz_m.shape == read.points.xyz_m.shape
    sealed = json.loads((tmp_path / "answers/000.json").read_text())["points_sha256"]
    assert sealed == hashlib.sha256((tmp_path / "recordings/000/points.csv").read_bytes()).hexdigest()


@pytest.mark.parametrize("kind", KINDS)
def test_motions_are_smooth_and_start_standing(kind: str) -> None:
    motion, frames = make_motion(plan(kind), Sizes())
    assert len(frames) == 114
    assert np.isin(frames, motion.t_s).all()
    assert np.linalg.norm(np.diff(motion.end_m, axis=0), axis=1).max() < 2e-3
    assert np.ptp(motion.end_m[30:60], axis=0).max() == 0
    assert (np.sum(motion.end_q[1:] * motion.end_q[:-1], axis=1) > 0.99).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("row_s", [0.05, 0.0125])
def test_the_gripper_never_leaps_in_speed(kind: str, row_s: float) -> None:
    """It would ring the rope in modes that no steps resolve; a row takes it to its share of full speed."""
    motion, _ = make_motion(replace(plan(kind), row_s=row_s), Sizes())
    turns = Rotation.from_quat(motion.end_q, scalar_first=True)
    rolled = (turns[1:] * turns[:-1].inv()).as_rotvec()
    for went in (np.diff(motion.end_m, axis=0), rolled):
        speed = went / np.diff(motion.t_s)[:, None]
        fastest = np.linalg.norm(speed, axis=1).max()
        leaps = np.linalg.norm(np.diff(speed, axis=0), axis=1)
        assert leaps.max() <= 1.05 * fastest * row_s / RAMP_S


def test_whitened_noise_is_white() -> None:
    noise = Noise(0.0015, 1.5, 0.7)
    drawn = draw_noise(np.random.default_rng(0), noise, (300, 30, 3))
    assert drawn.std() == pytest.approx(0.0015, rel=0.05)
    assert np.mean(drawn[:, 1:] * drawn[:, :-1]) / 0.0015**2 == pytest.approx(np.exp(-1 / 1.5), rel=0.1)
    white = whiten(drawn, noise)
    assert np.mean(white**2) == pytest.approx(1, rel=0.03)
    assert abs(np.mean(white[:, 1:] * white[:, :-1])) < 0.03


def test_measurement_effects_are_as_the_formats_say() -> None:
    experiment = small()
    np.testing.assert_allclose(
        seen_times(experiment, {"clock_offset": {"time": 0.2}})[1:], experiment.frame_t_s[1:] - 0.2
    )
    slip = {"grasp_slip": {"length": 0.004, "time": 20.0, "duration": 1.0}}
    assert [free_length(experiment, slip, t) for t in (0.0, 20.0, 40.0)] == pytest.approx(
        [0.445, 0.443, 0.441]
    )
    base = play.play(experiment, bodies=29)
    pose = {"rotation_1": 0.0, "rotation_2": 0.0, "rotation_3": 0.001, "depth": 0.002}
    seen = play.play(experiment, {"camera_pose": pose}, bodies=29)
    np.testing.assert_allclose(seen[:, 0], base[:, 0] + [0, 0.002, 0], atol=1e-12)
    np.testing.assert_allclose(seen[:, -1, 1] - base[:, -1, 1] - 0.002, 0.001 * base[:, -1, 0], rtol=1e-3)


def test_frames_in_which_chains_agree_are_of_the_continuous_rope_whatever_others_do() -> None:
    """This rope may twist either way in the middle of its motion, and does with other numbers of bodies."""
    shown, finer = (play.play(*twisting([0, 43, 50]), bodies) for bodies in (58, 174))
    off = np.abs(shown - finer).max(axis=(1, 2))
    assert off.max() > play.OTHERWISE_M
    # a chain of 58 bodies itself is 123 um off there
    assert off[0] < 1e-5


def test_a_rope_that_moves_more_than_others_is_played_by_a_finer_chain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Near to that a chain of 116 bodies still lacks too much of what finer ones show."""
    some, weak = twisting([0, 40, 44, 48], 0.54)
    known = play.LEFT
    monkeypatch.setattr(play, "LEFT", 0.2)
    (easy, few), (hard, many) = (play.settled(some, effects, WHITE.sigma_m) for effects in ({}, weak))
    assert few == 116 < many
    np.testing.assert_array_equal(easy, play.play(some, bodies=few))
    np.testing.assert_array_equal(hard, play.play(some, weak, bodies=many))
    finer = play.play(some, weak, bodies=2 * many)
    assert np.sum(((hard - finer) / WHITE.sigma_m) ** 2) < known
    monkeypatch.setattr(play, "CHAINS", play.CHAINS[:2])
    with pytest.raises(SimulationError, match="finer chains show other shapes"):
        play.settled(some, weak, WHITE.sigma_m)


def test_chains_are_not_compared_with_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coarse chains catch on a bar and agree on it; the coarsest one goes yet another way."""
    some = small()

    def chain(experiment: Experiment, effects: Effects, bodies: int, finer: int) -> np.ndarray:
        return np.full((len(some.frame_t_s), 30, 3), 9e-3 if bodies < 58 else 1e-3 if bodies < 116 else 0.0)

    monkeypatch.setattr(play, "_played", chain)
    points, bodies = play.settled(some, {}, WHITE.sigma_m)
    assert bodies > 116
    np.testing.assert_array_equal(points, 0.0)


def test_a_rope_that_is_pulled_into_a_bar_is_not_played() -> None:
    """As one that is too short for its way round the bar: before, it was recorded 7 mm deep."""
    some = small()
    stands = Motion(*(getattr(some.motion, field.name)[:5] for field in fields(Motion)))
    some = replace(some, motion=stands, frame_t_s=stands.t_s[-1:])
    lowest_m = play.play(some, bodies=29)[..., 2].min()
    center = (0.21, 0.0, lowest_m - 0.032)
    bar = Obstacle("cylinder", {"center_m": center, "axis": (0.0, 1.0, 0.0), "radius_m": (0.03,)})
    lies = replace(some, obstacles=(bar,))
    assert play.play(lies, bodies=29)[..., 2].min() > lowest_m + 1e-3
    with pytest.raises(SimulationError, match="it would tear"):
        play.play(replace(lies, hardness=1e3), bodies=29)


def test_a_gain_is_nothing_for_what_an_elastic_rope_can_be() -> None:
    experiment = small()
    lump = {"mass_profile": {"s": 0.2, "mass": 0.004, "gradient": 0.0}}
    plain, lumpy = (play.play(experiment, effects, bodies=29) for effects in ({}, lump))
    assert gain(experiment, plain, {}, WHITE, bodies=29).value == 0
    assert gain(experiment, lumpy, lump, WHITE, bodies=29).value == 0
    found = gain(experiment, lumpy, {}, WHITE, bodies=29)
    assert found.value > 5
    softer = replace(experiment, bending_stiffness=2.8e-4)
    miss = play.play(softer, bodies=29) - lumpy
    assert found.value < np.sum(whiten(miss, WHITE) ** 2)
