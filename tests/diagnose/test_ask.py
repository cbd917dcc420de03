"""The next motion: one a robot can do from where it stands, and one that tells the two models apart."""

from dataclasses import replace

import numpy as np
import pytest
from diagnose.test_diagnose import QUICK, SIGMA, found, made
from scipy.spatial.transform import Rotation
from sim import test_begun
from sim.ropes import EI, GJ, GRAVITY, ROPE

from dlolib.diagnose import DiagnoseSettings, diagnose
from dlolib.diagnose.ask import (
    ENOUGH,
    POINTS,
    Asked,
    Pair,
    _chosen,
    _longer,
    frames_of,
    left,
    next_motion,
    paired,
    rivals,
)
from dlolib.diagnose.decide import IMITATED, Decision
from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.menu import QUICKER, ROLL_RAD, ROLL_RAD_S, menu, then
from dlolib.diagnose.workers import Workers
from dlolib.sim.begun import BegunModel, motion_model
from dlolib.sim.continuum import simulated
from dlolib.sim.poses import PosesModel, model_of
from dlolib.sim.recording import first_points
from dlolib.sim.rod import Rod
from dlolib.sim.upright import as_logged, upright
from dlolib.types import Ends, Floats, Motion, Noise, Points, Recording

MOTION = made({}).motion


def test_every_motion_of_the_menu_goes_on_from_the_last_pose() -> None:
    speed = np.linalg.norm(np.diff(MOTION.end_m, axis=0), axis=1).max() / np.diff(MOTION.t_s).min()
    some = menu(MOTION)
    assert len(some) == len({says for says, _ in some}) == 6
    for says, motion in some:
        assert motion.t_s[0] == 0 and (np.diff(motion.t_s) > 0).all(), says
        for name in ("start_m", "start_q", "end_m", "end_q"):
            assert getattr(motion, name)[0] == pytest.approx(getattr(MOTION, name)[-1], abs=1e-9), says
        ways = np.linalg.norm(np.diff(motion.end_m, axis=0), axis=1)
        assert (ways <= 1.01 * QUICKER * speed * np.diff(motion.t_s)).all(), says
        assert (np.sum(motion.end_q[1:] * motion.end_q[:-1], axis=1) > 0.9).all(), says


def turning() -> Motion:
    """An end that stays where it is and turns by 60 degrees about the rope and 40 of them back."""
    share = np.interp(np.linspace(0.0, 3.0, len(MOTION.t_s)), [0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 1 / 3, 1 / 3])
    turns = Rotation.from_quat(MOTION.end_q[0], scalar_first=True) * Rotation.from_rotvec(
        np.outer(np.deg2rad(60) * share, [0, 0, 1])
    )
    still = np.tile(MOTION.end_m[0], (len(share), 1))
    return replace(MOTION, end_m=still, end_q=turns.as_quat(scalar_first=True))


def test_an_end_that_only_turned_turns_again() -> None:
    """It has no arc. Out to where it was turned furthest from its last pose and back, at its own pace."""
    motion = turning()
    some = dict(menu(motion))
    assert len(some) == 5 and not any("arc" in says for says in some)
    takes_s = 80 / 100 * np.ptp(motion.t_s) * 2 / 3
    (quick,) = (one for says, one in some.items() if "three times" in says)
    (slow,) = (one for says, one in some.items() if "a third" in says)
    back = Rotation.from_quat(motion.end_q[-1], scalar_first=True).inv()
    for asked, factor in ((quick, QUICKER), (slow, 1 / QUICKER)):
        away = (back * Rotation.from_quat(asked.end_q, scalar_first=True)).magnitude()
        assert away[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-6)
        assert away.max() == pytest.approx(np.deg2rad(40), abs=0.01)
        assert asked.t_s[-1] == pytest.approx(takes_s / factor, rel=0.02)


def hanging(motion: Motion) -> Motion:
    """The same of a rope whose other end hangs free."""
    free = np.full_like(motion.end_m, np.nan), np.full_like(motion.end_q, np.nan)
    return Motion(motion.t_s, motion.end_m, motion.end_q, *free)


@pytest.mark.parametrize("motion", [MOTION, turning()])
def test_where_the_end_hangs_free_the_start_does_what_the_end_would(motion: Motion) -> None:
    started = menu(hanging(motion))
    free = hanging(motion)
    ended = menu(Motion(motion.t_s, free.end_m, free.end_q, motion.end_m, motion.end_q))
    assert len(started) >= 4 and [says for says, _ in started] == [says for says, _ in ended]
    for (says, one), (_, other) in zip(started, ended, strict=True):
        assert np.isnan(one.end_m).all() and np.isnan(one.end_q).all(), says
        assert np.array_equal(one.start_m, other.end_m) and np.array_equal(one.start_q, other.end_q), says
        assert one.start_m[0] == pytest.approx(motion.end_m[-1], abs=1e-9), says


def test_the_ends_come_no_nearer_than_half() -> None:
    least = np.linalg.norm(MOTION.end_m - MOTION.start_m, axis=1).min()
    nearest = {says: np.linalg.norm(m.end_m - m.start_m, axis=1).min() for says, m in menu(MOTION)}
    (half,) = (near for says, near in nearest.items() if "nearer" in says)
    assert half == pytest.approx(0.5 * least)


def test_ends_that_touch_are_brought_no_nearer() -> None:
    bent = int(np.argmin(np.linalg.norm(MOTION.end_m - MOTION.start_m, axis=1)))
    touching = replace(MOTION, start_m=np.tile(MOTION.end_m[bent] + [0.01, 0, 0], (len(MOTION.t_s), 1)))
    assert not any("nearer" in says for says, _ in menu(touching))


@pytest.mark.parametrize("rate_rad_s", [0.0, 0.5 * ROLL_RAD_S, 3.0 * ROLL_RAD_S])
def test_an_arc_lasts_as_long_as_it_did_however_fast_the_end_turned_on_it(rate_rad_s: float) -> None:
    """Evenly out in 4 s and turning all the while: back and out again on the opposite side takes 8 s."""
    t_s = np.linspace(0.0, 4.0, 41)
    end_m = np.array([0.4, 0.0, 0.0]) + np.outer(t_s, [0.0, 0.02, 0.01])
    turns = Rotation.from_quat(MOTION.end_q[0], scalar_first=True) * Rotation.from_rotvec(
        np.outer(rate_rad_s * t_s, [0.0, 0.0, 1.0])
    )
    held = np.tile(MOTION.start_q[0], (41, 1))
    lasts = {
        says: asked.t_s[-1]
        for says, asked in menu(Motion(t_s, np.zeros((41, 3)), held, end_m, turns.as_quat(scalar_first=True)))
    }
    (opposite,) = (seconds for says, seconds in lasts.items() if "opposite" in says)
    (quick,) = (seconds for says, seconds in lasts.items() if "three times as fast" in says)
    (slow,) = (seconds for says, seconds in lasts.items() if "a third as fast" in says)
    assert (opposite, quick, slow) == pytest.approx((8.0, 8.0 / QUICKER, 8.0 * QUICKER), rel=1e-6)


def test_an_end_that_only_shakes_goes_no_slower_for_that() -> None:
    shaken = 1e-5 * np.random.default_rng(0).normal(size=MOTION.end_m.shape)
    some = menu(replace(MOTION, end_m=MOTION.end_m[0] + shaken))
    assert not any("arc" in says for says, _ in some) and all(motion.t_s[-1] < 120 for _, motion in some)


def test_of_an_end_that_hangs_free_none_is_brought_nearer() -> None:
    hangs = replace(
        MOTION, start_m=np.full_like(MOTION.start_m, np.nan), start_q=np.full_like(MOTION.start_q, np.nan)
    )
    assert not any("nearer" in says for says, _ in menu(hangs))


def test_the_roll_is_about_the_rope() -> None:
    (_, roll), *_ = menu(MOTION)
    turns = Rotation.from_quat(roll.end_q[0], scalar_first=True).inv() * Rotation.from_quat(
        roll.end_q, scalar_first=True
    )
    rolled = turns.as_rotvec()
    assert np.abs(rolled[:, :2]).max() < 1e-6
    assert rolled[:, 2].max() == pytest.approx(ROLL_RAD) and rolled[:, 2].min() == pytest.approx(-ROLL_RAD)


def models_of(name: str) -> dict[tuple[str, ...], Fitted]:
    return {one.effects: one for one in found(name).found.searched.models}


def asked_for(*tie: Fitted) -> object:
    """The next motion were these a tie."""
    of = found("plastic").found
    with Workers(1) as run:
        run.begin(of.study)
        return next_motion(of.study, of.searched, Decision("ambiguous", tie[0], tie), DiagnoseSettings(), run)


def test_two_laws_are_told_apart_and_a_model_is_not_told_from_itself() -> None:
    models = models_of("plastic")
    plastic, friction = models[("plastic_bending",)], models[("internal_friction",)]
    asked = asked_for(plastic, friction)
    assert isinstance(asked, Asked) and asked.expected > 10 and asked.surely >= ENOUGH
    assert asked.says in [says for says, _ in menu(found("plastic").found.study.seen[0].recording.motion)]
    assert asked_for(plastic, plastic) is None
    assert asked_for(plastic) is None


def test_of_a_rope_that_hangs_a_motion_of_its_start_tells_two_models_apart() -> None:
    """Its clamp lifts it up and lays it over: is it softer somewhere, or does the clamp point elsewhere?"""
    t = np.linspace(0.0, 12.0, 121)
    up = np.sin(np.pi * t / 12.0) ** 2
    start_m = np.stack([0.1 * up, 0.0 * t, 0.1 * up], axis=1)
    turn = Rotation.from_quat(MOTION.start_q[0], scalar_first=True) * Rotation.from_rotvec(
        np.outer(np.deg2rad(70) * up, [1.0, 0.0, 0.0])
    )
    free = np.full((len(t), 3), np.nan), np.full((len(t), 4), np.nan)
    motion = Motion(t, start_m, turn.as_quat(scalar_first=True), *free)
    frame, at = np.repeat(np.arange(40), 12), np.linspace(0.1, 11.9, 40)
    points = Points(frame, at[frame], np.tile(np.linspace(0.0, ROPE.length_m, 12), 40), np.zeros((480, 3)))
    noise = Noise(SIGMA, 0.0, 0.0)
    blank = Recording("hangs", ROPE, GRAVITY, Ends("clamped", "free"), motion, points, noise=noise)
    soft = {"stiffness_profile.s": 0.1, "stiffness_profile.factor": 0.6, "stiffness_profile.width": 0.05}
    shown = simulated(blank, Rod(ROPE, EI, GJ, soft, particles=81))
    off = np.random.default_rng(5).normal(0.0, SIGMA, shown.points.xyz_m.shape)
    seen = replace(shown.points, xyz_m=shown.points.xyz_m + off)
    of = diagnose([replace(shown, points=seen, noise=noise)], QUICK).found
    models = {one.effects: one for one in of.searched.models}
    tie = models[("stiffness_profile",)], models[("end_angle",)]
    with Workers(1) as run:
        run.begin(of.study)
        decision = Decision("ambiguous", tie[0], tie)
        asked = next_motion(of.study, of.searched, decision, DiagnoseSettings(), run)
    assert isinstance(asked, Asked) and asked.expected > 10
    assert np.isnan(asked.motion.end_m).all() and asked.motion.start_m[0] == pytest.approx(start_m[-1])


def test_where_one_motion_does_not_promise_enough_another_follows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    models = models_of("plastic")
    tie = models[("plastic_bending",)], models[("internal_friction",)]
    one = asked_for(*tie)
    monkeypatch.setattr("dlolib.diagnose.ask.ENOUGH", 1e9)
    both = asked_for(*tie)
    assert isinstance(one, Asked) and isinstance(both, Asked) and both.clear > one.clear
    names = [says for says, _ in menu(found("plastic").found.study.seen[0].recording.motion)]
    assert both.says in [f"{first}, then {second}" for first in names for second in names if first != second]


def test_of_what_promises_enough_the_shortest_is_asked_for() -> None:
    short, long = (replace(MOTION, t_s=factor * MOTION.t_s) for factor in (1.0, 2.0))
    sure, surer = Asked(short, "short", 40.0, 6.0, ENOUGH), Asked(long, "long", 90.0, 12.0, 2 * ENOUGH)
    assert _chosen([surer, sure]) is sure
    assert _chosen([replace(sure, surely=0.9 * ENOUGH), surer]) is surer
    assert _chosen([replace(sure, surely=0.0), replace(surer, surely=0.0)]).says == "long"


def test_of_two_motions_the_second_goes_on_from_where_the_first_ended() -> None:
    (_, roll), *_, (_, slow) = menu(MOTION)
    both = then(roll, slow)
    assert both.t_s[-1] == pytest.approx(roll.t_s[-1] + slow.t_s[-1]) and (np.diff(both.t_s) > 0).all()
    rows = len(roll.t_s)
    assert both.end_m[:rows] == pytest.approx(roll.end_m)
    assert both.end_m[rows - 1 :] == pytest.approx(slow.end_m)


def test_the_camera_looks_as_often_as_it_did() -> None:
    recording = made({})
    every_s = np.median(np.diff(np.unique(recording.points.t_s)))
    assert (
        frames_of(replace(MOTION, t_s=MOTION.t_s * (40.5 * every_s / MOTION.t_s[-1])), recording, 200) == 40
    )
    assert frames_of(replace(MOTION, t_s=1e3 * MOTION.t_s), recording, 200) == 200


def test_what_forms_may_leave_of_what_is_explained_is_no_difference() -> None:
    """A large difference of much that is explained tells less than a small one of little."""
    model = models_of("plastic")[("plastic_bending",)]
    law = Pair(model, model, share=IMITATED, least=0.0, further=0)
    assert law.over(500.0, 7000.0, 100, tie=6.0) < 1.0 < law.over(100.0, 250.0, 100, tie=6.0)
    assert replace(law, share=0.0).over(500.0, 7000.0, 100, tie=6.0) == 500.0 / 6.0
    assert law.over(100.0, 100.0, 100, tie=0.0) > 1.0


def test_what_is_further_must_earn_its_place() -> None:
    """Of a model and a part of it the whole is shown; it pays for its parameters, and chance is no gain."""
    model = models_of("plastic")[("plastic_bending",)]
    more = replace(
        model, effects=("end_angle", "plastic_bending"), unknowns=(*model.unknowns, model.unknowns[0])
    )
    pair = paired(model, more, 5e-5)
    assert (
        pair.shown is more and pair.model is model and pair.gain(9.0, 100) == pytest.approx(9.0 - np.log(100))
    )
    assert pair.least == pytest.approx(16.4, abs=0.1)
    assert pair.over(15.0, 0.0, 100, tie=6.0) < 1.0
    other = models_of("plastic")[("internal_friction",)]
    assert paired(model, other, 5e-5).least == 0.0


def test_a_model_is_not_told_from_itself_by_what_a_recording_has_for_itself() -> None:
    """A camera that stands otherwise is no difference between two models that both know it."""
    study, model = found("plastic").found.study, models_of("plastic")[("plastic_bending",)]
    _, motion = menu(study.seen[0].recording.motion)[0]
    longer = _longer(study, motion, 60)
    own = tuple(longer.nuisances)
    off = [2 * longer.nuisances[one] for one in own]
    shown = replace(model, unknowns=(*model.unknowns, *own), theta=np.append(model.theta, off))
    assert left(longer, shown, shown) < 1e-6
    assert left(longer, shown, model) < 1e-6


def test_settled_poses_go_on_from_the_last_one() -> None:
    """The way between poses is not known, but that of what a robot does next is."""
    recording = made({})
    rows = slice(0, None, 20)
    motion = Motion(
        3.0 * np.arange(len(MOTION.t_s[rows])),
        *(getattr(MOTION, name)[rows] for name in ("start_m", "start_q", "end_m", "end_q")),
    )
    count = int((recording.points.frame == 0).sum())
    points = replace(
        recording.points, t_s=motion.t_s.repeat(count), frame=np.arange(len(motion.t_s)).repeat(count),
        s_m=recording.points.s_m[: count * len(motion.t_s)],
        xyz_m=recording.points.xyz_m[: count * len(motion.t_s)],
    )  # fmt: skip
    poses = replace(recording, motion=motion, points=points, static_frames=None, heldout_frames=None)
    study = found("plastic").found.study
    model = model_of(poses, study.seen[0].model.particles, None)
    assert isinstance(model, PosesModel)
    settled = replace(study, seen=(replace(study.seen[0], model=model),))
    rod = study.rod(0, models_of("plastic")[("plastic_bending",)].values(0))
    for says, further in menu(motion):
        there = _longer(settled, further, 60).seen[1].model.predict(rod).xyz_m.reshape(-1, POINTS, 3)
        assert np.linalg.norm(there[-1, -1] - further.end_m[-1]) < 1e-3, says


def test_what_began_in_motion_begins_so_when_it_is_moved_on() -> None:
    """Its first frames tell where it was and how fast; those of the further motion are still to come."""
    recording, study = test_begun.seen(test_begun.SWINGING), found("plastic").found.study
    model = replace(motion_model(recording, 20, test_begun.STEP_S), first=first_points(recording))
    assert isinstance(model, BegunModel)
    begun = replace(study, seen=(replace(study.seen[0], model=model),))
    _, further = menu(recording.motion)[0]
    moved_on = _longer(begun, further, 60).seen[1].model
    first, again = (one.roll_out(test_begun.rod(20)) for one in (model, moved_on))
    assert np.array_equal(again.x[0, : first.x.shape[1]], first.x[0])
    assert again.x.shape[1] > first.x.shape[1]


def test_other_laws_in_the_place_of_the_best_are_looked_at_too() -> None:
    searched, models = found("plastic").found.searched, models_of("plastic")
    plastic, friction = models[("plastic_bending",)], models[("internal_friction",)]
    other = next(
        one for one in searched.models if "plastic_bending" not in one.effects and one is not friction
    )
    assert rivals(searched, Decision("ambiguous", plastic, (plastic, other))) == [other, friction]


def test_both_ends_go_on_from_where_they_are_and_no_faster_than_they_were() -> None:
    """A start that was moved, too, and a wrist that rolled in place on the way: nothing jumps."""
    rows = len(MOTION.t_s)
    aside = np.linspace(0, 0.1, rows)[:, None] * np.array([0.0, 1.0, 0.0])
    place = np.minimum(np.arange(rows), rows // 2)
    angle = np.clip((np.arange(rows) - rows // 2) / (rows // 4), 0, 1) * ROLL_RAD
    start, end = (Rotation.from_quat(q, scalar_first=True) for q in (MOTION.start_q, MOTION.end_q[place]))
    rolled = (end * Rotation.from_rotvec(np.outer(angle, [0, 0, 1]))).as_quat(scalar_first=True)
    motion = replace(
        MOTION, start_m=MOTION.start_m + aside, start_q=start.as_quat(scalar_first=True),
        end_m=MOTION.end_m[place] + aside, end_q=rolled,
    )  # fmt: skip
    most = [(some / np.diff(motion.t_s)).max() for some in moved(motion)]
    most[1] = max(most[1], ROLL_RAD_S)
    some = menu(motion)
    assert len(some) == 6
    for says, asked in some:
        for name in ("start_m", "start_q", "end_m", "end_q"):
            first, last = getattr(asked, name)[0], getattr(motion, name)[-1]
            assert first == pytest.approx(last, abs=1e-9) or first == pytest.approx(-last, abs=1e-9), says
        for ways, fastest in zip(moved(asked), most, strict=True):
            assert (ways <= QUICKER * 1.01 * fastest * np.diff(asked.t_s) + 1e-9).all(), says


def test_a_clamp_of_unknown_roll_is_asked_to_go_on_as_it_was_logged() -> None:
    ends = replace(made({}).ends, end_roll_known=False)
    turns = Rotation.from_quat(MOTION.end_q, scalar_first=True) * Rotation.from_rotvec([0, 0, 0.7])
    own = replace(made({}), ends=ends, motion=replace(MOTION, end_q=turns.as_quat(scalar_first=True)))
    some = menu(upright(own).motion)
    assert len(some) == 6
    for says, asked in some:
        there = as_logged(asked, own)
        assert there.end_q[0] == pytest.approx(own.motion.end_q[-1], abs=1e-9), says
        assert there.start_q[0] == pytest.approx(own.motion.start_q[-1], abs=1e-9), says


def moved(motion: Motion) -> tuple[Floats, Floats]:
    """How far the ends go [m] and turn [rad] from row to row, the further of both."""
    ways = [np.linalg.norm(np.diff(x, axis=0), axis=1) for x in (motion.start_m, motion.end_m)]
    turns = [Rotation.from_quat(q, scalar_first=True) for q in (motion.start_q, motion.end_q)]
    turned = [(turn[:-1].inv() * turn[1:]).magnitude() for turn in turns]
    return np.maximum(*ways), np.maximum(*turned)
