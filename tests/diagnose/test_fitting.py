"""One model and its fit: starts that can move, and nuisances that stay near."""

from dataclasses import replace

import numpy as np
import pytest
from diagnose.test_diagnose import QUICK, made
from scipy.spatial.transform import Rotation

from dlolib.diagnose.diagnose import raw_study
from dlolib.diagnose.fitting import UNSOLVED, awake, covariance_of, hypothesis
from dlolib.diagnose.nuisances import mounted_otherwise
from dlolib.diagnose.search import _nested
from dlolib.diagnose.study import Study
from dlolib.diagnose.tasks import Task, as_it_was, refit
from dlolib.identify.parameters import Unknown
from dlolib.types import Recording

FORM = {"end_angle": ("start_1", "start_2")}


def flat() -> Recording:
    """The rope in a plane, seen in it: where it lies across nobody knows."""
    whole = made({})
    motion = replace(whole.motion, end_m=whole.motion.end_m * [1, 0, 1])
    return replace(whole, motion=motion, planar="xz")


def woken(study: Study) -> dict[str, float]:
    model = hypothesis(study, FORM, [np.zeros_like(one.recording.points.xyz_m) for one in study.seen])
    theta = np.array([u.inward(3e-4) if u.stiffness else 0.0 for u in model.unknowns])
    start = awake(model, theta)
    if start is None:
        return {}
    return {u.name: new for u, old, new in zip(model.unknowns, theta, start, strict=True) if new != old}


def test_what_bends_the_rope_out_of_its_plane_is_woken() -> None:
    moved = woken(raw_study([flat()], QUICK))
    assert len(moved) == 1 and abs(next(iter(moved.values()))) == 0.1
    assert not woken(raw_study([made({})], QUICK))


def test_a_trial_that_an_effect_has_no_part_in_is_far_off() -> None:
    """No derivative leads back from an obstacle that the rope does not touch."""
    study = raw_study([made({})], QUICK)
    recording = study.seen[0].recording
    places = {"hidden_obstacle": ("x", "y", "z", "radius")}

    def trial(model, depth_m):  # type: ignore[no-untyped-def]
        middle = recording.points.xyz_m[len(recording.points.xyz_m) // 2]
        sphere = [*(middle - [0.0, 0.0, 0.02 + recording.rope.radius_m - depth_m]), 0.02]
        return np.array([u.inward(3e-4) if u.stiffness else sphere.pop(0) for u in model.unknowns])

    def fresh():  # type: ignore[no-untyped-def]
        return hypothesis(study, places, [np.zeros_like(recording.points.xyz_m)])

    model = fresh()
    touching = model.residuals(trial(model, 0.005))
    apart = model.residuals(trial(model, -0.1))
    assert np.abs(touching).max() < UNSOLVED
    assert np.all(apart == UNSOLVED)
    # a fit that begins apart is not refused for it
    model = fresh()
    assert np.abs(model.residuals(trial(model, -0.1))).max() < UNSOLVED


def test_a_larger_form_that_fits_worse_than_a_smaller_is_fitted_again_from_there() -> None:
    study = raw_study([made({"end_angle.start_2": 0.1})], QUICK)
    offsets = tuple(np.zeros_like(one.recording.points.xyz_m) for one in study.seen)
    begin = {Unknown("bending_stiffness"): 3e-4, Unknown("torsional_stiffness"): 2e-4}
    far = {**begin, Unknown("end_angle.start_1"): 0.3, Unknown("end_angle.end_2"): -0.3}
    small = refit(study, Task({"end_angle": ("start_1", "start_2")}, (begin,), offsets, 1))
    whole = ("start_1", "start_2", "end_1", "end_2")
    large = as_it_was(study, Task({"end_angle": whole}, (far,), offsets, 1))
    assert small is not None and large is not None and large.chi2 > small.chi2

    def run(function, tasks, _what):  # type: ignore[no-untyped-def]
        return [function(study, task) for task in tasks]

    first, second, again = _nested(study, [small, large], run)  # type: ignore[arg-type]
    assert (first, second) == (small, large)
    assert again.unknowns == large.unknowns and again.chi2 < small.chi2 + 1e-3
    # where the larger one is no worse nothing is done
    assert _nested(study, [small, again], run) == [small, again]  # type: ignore[arg-type]


def test_a_nuisance_stays_within_its_deviations() -> None:
    recording = made({})
    study = raw_study([recording, replace(recording, name="again")], QUICK)
    for unknown, deviation in study.nuisances.items():
        low, high = study.bounds(unknown)
        wide = unknown.name.startswith(("end_angle", "end_twist", "camera_pose.shift"))
        assert (high > 3.1 * deviation) if wide else (-low == high == 3 * deviation)
    assert Unknown("camera_pose.rotation_1", 1) in study.nuisances


@pytest.mark.parametrize("away_m", [0.0, 1.5])
def test_a_camera_turned_about_the_rope_is_as_likely_wherever_the_origin_lies(away_m: float) -> None:
    """The effect turns about the origin: what lies far from it must be shifted back by far."""
    first = made({})
    aside = np.array([away_m, 0.3 * away_m, -0.2 * away_m])
    motion = replace(first.motion, start_m=first.motion.start_m + aside, end_m=first.motion.end_m + aside)
    points = replace(first.points, xyz_m=first.points.xyz_m + aside)
    recording = replace(first, motion=motion, points=points)
    study = raw_study([recording, replace(recording, name="again")], QUICK)
    model = hypothesis(study, {}, [np.zeros_like(points.xyz_m)] * 2)
    turn = np.deg2rad([0.5, -2.0, 1.0])
    pivot = points.xyz_m.mean(axis=0)
    shift = pivot - Rotation.from_rotvec(turn).apply(pivot)
    theta = np.zeros(len(model.unknowns))
    for k in range(3):
        for name, value in (("rotation", turn[k]), ("shift", shift[k])):
            unknown = Unknown(f"camera_pose.{name}_{k + 1}", 1)
            theta[model.unknowns.index(unknown)] = value
            low, high = study.bounds(unknown)
            assert low <= value <= high
    prior, rows = model._priors(theta)
    expected = float(np.sum((turn / np.deg2rad(1.0)) ** 2))
    # turns of this size do not quite add up
    assert float(prior @ prior) == pytest.approx(expected, rel=0.05, abs=0.2)
    step = 1e-6 * np.arange(1, len(theta) + 1)
    np.testing.assert_allclose(model._priors(theta + step)[0] - prior, rows @ step, rtol=1e-6, atol=1e-12)


def test_an_end_that_is_mounted_otherwise_is_said_about_whichever_axes_and_against_any_recording() -> None:
    tilt, names = np.deg2rad(4.8), ["one", "two", "three"]
    across = {Unknown(f"end_angle.start_{axis}", 1): tilt for axis in (1, 2)}
    assert list(mounted_otherwise(across, names[:2])) == ["two is mounted 7 degrees otherwise than one."]
    apart = {Unknown("end_angle.start_1", k): sign * tilt for k, sign in ((1, 1), (2, -1))}
    assert list(mounted_otherwise(apart, names)) == ["three is mounted 10 degrees otherwise than two."]
    both_ends = {Unknown(f"end_angle.{end}_1", 1): tilt for end in ("start", "end")}
    assert not list(mounted_otherwise(both_ends, names[:2]))


def test_of_what_moves_nothing_nothing_is_known() -> None:
    moves = np.random.default_rng(0).normal(size=(50, 2))
    jacobian = np.stack([moves[:, 0], np.zeros(50), moves[:, 1], moves[:, 0]], axis=1)
    found = covariance_of(jacobian)
    assert found[1, 1] == np.inf and min(found[0, 0], found[3, 3]) > 1e6
    alone = covariance_of(moves)
    np.testing.assert_allclose(alone, np.linalg.inv(moves.T @ moves), rtol=1e-9)
    assert found[2, 2] == pytest.approx(alone[1, 1], rel=1e-6)
