"""The diagnosis as a whole on small recordings that our own rod made: planted, found; absent, not named."""

import itertools
import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE

from dlolib.cli import run
from dlolib.diagnose import DiagnoseSettings, Diagnosis, diagnose, locate, search, verdict, write_diagnosis
from dlolib.diagnose.detect import asked, gain_needed
from dlolib.diagnose.diagnose import _check, raw_study
from dlolib.diagnose.fitting import fit, hypothesis
from dlolib.diagnose.residuals import slow_modes
from dlolib.diagnose.study import Study
from dlolib.diagnose.verdict import verdict_of
from dlolib.errors import ParameterError
from dlolib.formats import read_fit, read_recording, read_verdict, write_recording
from dlolib.sim.continuum import simulated
from dlolib.sim.effects import EFFECTS
from dlolib.sim.rod import Rod
from dlolib.types import Ends, Motion, Obstacle, Points, Recording

SIGMA, FRAMES, SEEN, STILL = 1e-3, 40, 15, 10
# One effect of every kind: a law with history, a place, an end, a measurement.
KEPT = ("plastic_bending", "stiffness_profile", "end_angle", "clock_offset", "internal_friction")
QUICK = DiagnoseSettings(
    particles=20, longest_segment_m=1.0, workers=1, partners=2, without=tuple(set(EFFECTS) - set(KEPT))
)


def made(
    effects: Mapping[str, float], seed: int = 1, ends: Ends | None = None,
    obstacles: tuple[Obstacle, ...] = (), sigma_m: float = SIGMA,
) -> Recording:  # fmt: skip
    """The paper's rope on an arc out and back, with effects and noise; the last quarter held out."""
    t = np.linspace(0, 20, 201)
    share = np.clip((t - 2) / 18, 0, 1)
    way = 0.5 * (1 - np.cos(2 * np.pi * share))
    end = np.stack([0.40 - 0.13 * way, 0.06 * way * np.sin(np.pi * share), 0.10 * way], axis=1)
    held = np.tile(LEVEL, (len(t), 1))
    motion = Motion(t, np.zeros((len(t), 3)), held, end, held)
    at = np.concatenate([np.linspace(0.5, 1.8, STILL), np.linspace(2.2, 19.8, FRAMES - STILL)])
    frame = np.repeat(np.arange(FRAMES), SEEN)
    points = Points(frame, at[frame], np.tile(np.linspace(0, 0.445, SEEN), FRAMES), np.zeros((len(frame), 3)))
    base = Recording(
        "planted",
        ROPE,
        GRAVITY,
        ends or Ends(),
        motion,
        points,
        static_frames=(0, STILL - 1),
        obstacles=obstacles,
    )
    clean = simulated(base, Rod(ROPE, EI, GJ, effects, particles=121))
    noise = np.random.default_rng(seed).normal(0, sigma_m, clean.points.xyz_m.shape)
    seen = replace(clean.points, xyz_m=clean.points.xyz_m + noise)
    return replace(clean, points=seen, position_noise_m=None)


PLANTED: dict[str, dict[str, float]] = {
    "nothing": {},
    "plastic": {"plastic_bending.yield_curvature": 7.0, "plastic_bending.hardening_ratio": 0.2},
    "spot": {"stiffness_profile.s": 0.3, "stiffness_profile.factor": 0.5, "stiffness_profile.width": 0.05},
    "pair": {"clock_offset.time": 0.15, "end_angle.start_1": 0.06, "end_angle.start_2": 0.04},
}


@cache
def found(name: str) -> Diagnosis:
    return diagnose([made(PLANTED[name])], QUICK)


def test_nothing_missing_is_said_so() -> None:
    verdict = found("nothing").verdict
    assert verdict.status == "no_mismatch" and not verdict.effects and not verdict.where
    ei = verdict.baseline.parameters["bending_stiffness"]
    assert ei.low is not None and ei.high is not None
    assert abs(np.log(ei.value / EI)) < 1.5 * np.log(ei.high / ei.low) / 2
    assert verdict.noise.sigma_m == pytest.approx(SIGMA, rel=0.1)
    assert found("nothing").reversal.p_value is None or found("nothing").reversal.p_value > 0.001


def test_a_scan_finds_in_noise_what_is_likely() -> None:
    study, base = found("nothing").found.study, found("nothing").found.searched.baseline
    rng = np.random.default_rng(1)
    noise = [replace(base, residuals=(rng.normal(size=base.residuals[0].shape),)) for _ in range(24)]
    likely = [locate.scan(study, (one, 0, 7)).p_value for one in noise]
    assert kstest(likely, "uniform").pvalue > 0.01


def test_a_push_that_no_effect_explains_and_slow_modes_do_not_see_is_located() -> None:
    recording = made({})
    points = recording.points
    pushed = np.isin(points.frame, [20, 21]) & (np.abs(points.s_m - 0.22) < 0.07)
    xyz = points.xyz_m + pushed[:, None] * [0.0, 2.5 * SIGMA, 0.0]
    told = diagnose([replace(recording, points=replace(points, xyz_m=xyz))], QUICK)
    assert slow_modes(told.found.searched.baseline).p_value > 1e-3
    assert told.verdict.status == "unexplained" and not told.verdict.effects
    place = told.verdict.where[0]
    assert place.s_m[0] == pytest.approx(0.22, abs=0.05) and place.frames[0] <= 20 and place.frames[1] >= 21


def test_a_mesh_s_error_on_an_obstacle_is_not_told_as_physics(monkeypatch: pytest.MonkeyPatch) -> None:
    """Points as good as the mesh show it where the rope lies on something."""
    post = Obstacle(
        "cylinder",
        {"center_m": (0.2, 0.0, -0.12), "axis": (0.3, 1.0, 0.0), "radius_m": (0.03,), "height_m": (1.0,)},
    )
    seen = made({}, obstacles=(post,), sigma_m=SIGMA / 8)
    alone = replace(QUICK, without=tuple(EFFECTS))
    assert diagnose([seen], alone).verdict.status == "no_mismatch"
    # neither made finer for it, nor told of what it leaves
    monkeypatch.setattr(sys.modules[diagnose.__module__], "fine_enough", lambda study, *_: study)
    monkeypatch.setattr(locate, "left_by_meshes", lambda one, *_: np.zeros(one.whitener.shape[0]))
    assert diagnose([seen], alone).verdict.status == "unexplained"


def test_a_roll_that_nobody_recorded_is_no_physics() -> None:
    """It belongs to the elastic rod, and no effect is named for it."""
    unknown = Ends(start_roll_known=False, end_roll_known=False)
    twist = {"end_twist.end": -1.3}
    verdict = diagnose([made(twist, ends=unknown)], QUICK).verdict
    assert verdict.status == "no_mismatch"
    assert verdict.baseline.parameters["end_twist.end"].value == pytest.approx(-1.3, abs=0.1)
    assert verdict.baseline.parameters["bending_stiffness"].value == pytest.approx(EI, rel=0.05)
    plastic = diagnose([made({**PLANTED["plastic"], **twist}, ends=unknown)], QUICK).verdict
    assert [one.name for one in plastic.effects] == ["plastic_bending"]
    assert plastic.augmented.parameters["end_twist.end"].value == pytest.approx(-1.3, abs=0.1)


@pytest.mark.parametrize(
    ("name", "effects", "parameters"),
    [
        ("plastic", {"plastic_bending"}, {"plastic_bending.yield_curvature": 7.0}),
        ("spot", {"stiffness_profile"}, {"stiffness_profile.s": 0.3, "stiffness_profile.factor": 0.5}),
        ("pair", {"clock_offset", "end_angle"}, {"clock_offset.time": 0.15, "end_angle.start_1": 0.06}),
    ],
)
def test_what_was_planted_is_named(name: str, effects: set[str], parameters: dict[str, float]) -> None:
    verdict = found(name).verdict
    assert verdict.status == "explained" and {one.name for one in verdict.effects} == effects
    for key, true in parameters.items():
        value = verdict.augmented.parameters[key]
        assert value.low is not None and value.high is not None
        half = (value.high - value.low) / 2
        assert abs(value.value - true) < 2 * half
    ei = verdict.augmented.parameters["bending_stiffness"]
    assert ei.value == pytest.approx(EI, rel=0.1)
    assert verdict.augmented.rmse_m < verdict.baseline.rmse_m
    best = verdict.candidates[0]
    assert best.heldout_delta_chi2 is not None and best.heldout_delta_chi2 < 0
    assert {one.kind for one in verdict.candidates} >= {"library", "black_box"}


def test_a_second_effect_is_sought_where_the_first_leaves_but_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a second effect that hardly shows the slow modes need not tell."""
    monkeypatch.setattr(search, "amiss", lambda model: False)
    verdict = diagnose([made({**PLANTED["spot"], "clock_offset.time": 0.03})], QUICK).verdict
    assert {one.name for one in verdict.effects} == {"stiffness_profile", "clock_offset"}


@pytest.mark.parametrize("full", [False, True])
def test_in_full_every_pair_is_fitted_whatever_it_promises(full: bool) -> None:
    three = ("clock_offset", "end_angle", "plastic_bending")
    settings = replace(QUICK, partners=1, full=full, without=tuple(set(EFFECTS) - set(three)))
    done = diagnose([made(PLANTED["nothing"])], settings)
    pairs = {one.effects for one in done.found.searched.models if len(one.effects) == 2}
    every = set(itertools.combinations(three, 2))
    assert pairs == every if full else pairs < every
    assert done.verdict.status == "no_mismatch"


def test_of_many_frames_some_are_looked_at_evenly() -> None:
    settings = replace(QUICK, without=tuple(EFFECTS), most_frames=15)
    seen = diagnose([made({})], settings).found.study
    looked_at = [np.unique(one.recording.points.frame) for one in (*seen.seen, *seen.ahead.values())]
    assert np.concatenate(looked_at).tolist() == list(range(0, FRAMES, 3))
    assert looked_at[0][-1] < 0.75 * FRAMES <= looked_at[1][0]


def test_a_soft_spot_is_located_before_it_is_named() -> None:
    stiffness = [place for place in found("spot").verdict.where if place.probe == "stiffness"]
    assert any(place.s_m[0] - 0.02 < 0.3 < place.s_m[1] + 0.02 for place in stiffness)


def test_what_does_not_come_back_is_not_reversible() -> None:
    assert found("plastic").reversal.p_value is not None and found("plastic").reversal.p_value < 0.01
    p = found("spot").reversal.p_value
    assert p is not None and p > 1e-3


def test_without_the_effect_no_other_one_is_named_for_sure() -> None:
    settings = replace(QUICK, without=(*QUICK.without, "stiffness_profile"))
    assert diagnose([made(PLANTED["spot"])], settings).verdict.status in ("unexplained", "ambiguous")


def test_detectable_sizes_are_those_that_are_seen() -> None:
    """Planted at the size that is named, without noise, an elastic rod leaves the gain that is needed."""
    study, base = found("nothing").found.study, found("nothing").found.searched.baseline
    sizes = {(one.name, one.parameter): one.value for one in found("nothing").verdict.detectable}
    planted = {**base.values(0), "clock_offset.time": sizes[("clock_offset", "time")]}
    one = study.seen[0]
    xyz = one.model.predict(study.rod(0, planted)).xyz_m
    recording = replace(one.recording, points=replace(one.recording.points, xyz_m=xyz))
    seen = replace(study, seen=(replace(one, model=replace(one.model, recording=recording)),))
    left = fit(hypothesis(seen, {}, (np.zeros_like(xyz),)), base.theta).chi2
    assert left == pytest.approx(gain_needed(QUICK.chance, 1), rel=0.15)


def test_the_folder_is_written_and_read_again(tmp_path: Path) -> None:
    write_diagnosis(found("plastic"), tmp_path)
    assert read_verdict(tmp_path) == found("plastic").verdict
    assert read_verdict(tmp_path).fit.rope == ROPE
    assert {path.name for path in tmp_path.iterdir()} == {
        "verdict.json", "shapes.csv", "scan.csv", "moments.csv", "tests.json",
    }  # fmt: skip
    tests = json.loads((tmp_path / "tests.json").read_text())
    assert tests["scan"]["p_value"]["planted"] < 1e-5 and tests["reversal"]["p_value"] < 0.01


def test_the_command_and_what_takes_its_verdict(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_recording(replace(made({"clock_offset.time": 0.2}), name="007"), tmp_path / "recording")
    left_out = [word for name in sorted(set(EFFECTS) - {"clock_offset"}) for word in ("--without", name)]
    given = [str(tmp_path / "recording"), "--out", str(tmp_path / "verdict"), "--workers", "1", *left_out]
    assert run(["diagnose", *given]) == 0
    verdict = read_verdict(tmp_path / "verdict")
    assert capfd.readouterr().out.splitlines()[0] == verdict.summary
    assert [one.name for one in verdict.effects] == ["clock_offset"]
    assert (tmp_path / "verdict" / "rope.png").is_file()
    played = ["simulate", given[0], "--out", str(tmp_path / "played"), "--verdict", str(tmp_path / "verdict")]
    assert run(played) == 0
    off = (
        read_recording(tmp_path / "played").points.xyz_m - read_recording(tmp_path / "recording").points.xyz_m
    )
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) == pytest.approx(verdict.augmented.rmse_m, rel=0.1)


def test_too_little_is_refused() -> None:
    recording = made({})
    points = recording.points
    few = Points(*(getattr(points, name)[:5] for name in ("frame", "t_s", "s_m", "xyz_m")))
    with pytest.raises(ParameterError, match="a diagnosis needs"):
        diagnose([replace(recording, points=few)], QUICK)


def test_a_motion_that_is_not_the_ropes_is_refused() -> None:
    recording = made({})
    motion = replace(recording.motion, end_m=np.add(recording.motion.end_m, (0.05, 0.0, 0.0)))
    with pytest.raises(ParameterError, match="end was seen 50 mm from where it was held"):
        diagnose([replace(recording, motion=motion)], QUICK)


def test_one_object_may_have_been_measured_twice() -> None:
    """By a length that differs by half a millimetre it is no other one; what that means is each one's own."""
    first = made({})
    longer = replace(first, rope=replace(ROPE, length_m=1.001 * ROPE.length_m), name="other")
    _check([first, longer])
    study = raw_study([first, longer], QUICK)
    rods = [study.rod(k, {"bending_stiffness": 3e-4}) for k in range(2)]
    assert [rod.rope.length_m for rod in rods] == [ROPE.length_m, 1.001 * ROPE.length_m]


def test_without_a_load_nothing_tells_how_stiff_the_rope_is() -> None:
    with pytest.raises(ParameterError, match="no load tells how stiff the rope is: it weighs nothing"):
        diagnose([replace(made({}), gravity_m_s2=np.zeros(3))], QUICK)


def test_what_happens_at_an_end_that_nobody_holds_has_no_size() -> None:
    free = replace(made({}), ends=Ends(end="free"))
    study = SimpleNamespace(seen=[SimpleNamespace(recording=free)], middle=lambda name: 0.1)
    named = {one.name for one in asked(cast(Study, study), ())}
    assert "grasp_slip" not in named and "plastic_bending" in named
    study.seen[0].recording = made({})
    assert "grasp_slip" in {one.name for one in asked(cast(Study, study), ())}


def test_different_objects_are_refused() -> None:
    other = replace(made({}), rope=replace(ROPE, name="cable"), name="other")
    with pytest.raises(ParameterError, match="one object"):
        diagnose([made({}), other], QUICK)


def test_identification_takes_a_verdict(tmp_path: Path) -> None:
    """With the named law EI comes out as the rope's, without it far too soft."""
    write_recording(made(PLANTED["plastic"]), tmp_path / "recording")
    write_diagnosis(found("plastic"), tmp_path)
    for words in ((), ("--verdict", str(tmp_path / "verdict.json"))):
        given = ["identify", str(tmp_path / "recording"), "--out", str(tmp_path / f"fit{len(words)}"), *words]
        assert run(given) == 0
    without, named = (read_fit(tmp_path / f"fit{k}").parameters["bending_stiffness"].value for k in (0, 2))
    assert named == pytest.approx(EI, rel=0.08) and without < 0.8 * EI


def test_the_verdict_does_not_depend_on_the_processes() -> None:
    shared = diagnose([made(PLANTED["spot"])], replace(QUICK, workers=2)).verdict
    assert shared == found("spot").verdict


def test_two_recordings_share_the_material_and_are_mounted_each_in_its_own_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One is held 3 degrees otherwise, of which no effect is made; its declared frames alone are held out."""
    other = made({"end_angle.start_1": np.deg2rad(3.0)}, seed=2)
    one = replace(made({}), name="first")
    both = diagnose([one, replace(other, heldout_frames=(30, 39))], QUICK)
    assert both.verdict.status == "no_mismatch"
    own = both.verdict.nuisances["planted"]["end_angle.start_1"]
    assert own.low is not None and own.high is not None and own.low < np.deg2rad(3.0) < own.high
    assert not both.verdict.nuisances["first"]
    assert both.verdict.baseline.heldout_rmse_m == pytest.approx(np.sqrt(3) * SIGMA, rel=0.15)
    assert [len(np.unique(seen.recording.points.frame)) for seen in both.found.study.seen] == [FRAMES, 30]
    # where no effect is named, how each is mounted goes with the elastic rod that is handed on
    monkeypatch.setattr(verdict, "helps", lambda model, base: False)
    base = both.found.searched.baseline
    poor = replace(base, effects=("plastic_bending",), theta=1.5 * base.theta)
    decision = replace(both.found.decision, status="unexplained", winner=poor)
    assert verdict_of(replace(both.found, decision=decision)).nuisances == both.verdict.nuisances


def test_the_way_back_is_found_of_a_rope_with_a_free_end() -> None:
    whole = made({})
    nowhere = {"start_m": np.full_like(whole.motion.start_m, np.nan)}
    nowhere["start_q"] = np.full_like(whole.motion.start_q, np.nan)
    free = replace(whole, ends=Ends("free", "clamped"), motion=replace(whole.motion, **nowhere))
    assert locate._pairs(free) == locate._pairs(whole) != []


def test_no_frame_is_in_two_pairs_however_often_an_arc_is_gone_through() -> None:
    once = made({})
    again = np.arange(3)[:, None] * (once.motion.t_s[-1] + 1.0) + once.motion.t_s
    parts = ("start_m", "start_q", "end_m", "end_q")
    thrice = Motion(again.ravel(), *(np.tile(getattr(once.motion, part), (3, 1)) for part in parts))
    frames = np.linspace(0.0, thrice.t_s[-1], 3 * FRAMES)
    points = Points(np.arange(3 * FRAMES), frames, np.full(3 * FRAMES, 0.2), np.zeros((3 * FRAMES, 3)))
    pairs = locate._pairs(replace(once, motion=thrice, points=points))
    seen = [frame for pair in pairs for frame in pair]
    assert len(seen) == len(set(seen)) > FRAMES


@pytest.mark.parametrize("end", ["start", "end"])
def test_an_end_that_turns_in_place_turns(end: str) -> None:
    recording = made({})
    count = len(recording.motion.t_s)
    turned = Rotation.from_rotvec(np.outer(np.linspace(0.0, 1.0, count), [1.0, 0.0, 0.0])).as_quat(
        scalar_first=True
    )
    start, at = (np.tile(x[:1], (count, 1)) for x in (recording.motion.start_m, recording.motion.end_m))
    motion = replace(recording.motion, start_m=start, end_m=at, **{f"{end}_q": turned})
    assert locate._phase(replace(recording, motion=motion), 0, FRAMES // 2) == "turn"
