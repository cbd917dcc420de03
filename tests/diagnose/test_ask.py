"""The next motion: one a robot can do from where it stands, and one that tells the two models apart."""

from dataclasses import replace

import numpy as np
import pytest
from diagnose.test_diagnose import found, made
from scipy.spatial.transform import Rotation

from dlolib.diagnose.ask import QUICKER, ROLL_RAD, ROLL_RAD_S, menu, next_motion
from dlolib.sim.upright import as_logged, upright
from dlolib.types import Floats, Motion

MOTION = made({}).motion


def test_every_motion_of_the_menu_goes_on_from_the_last_pose() -> None:
    speed = np.linalg.norm(np.diff(MOTION.end_m, axis=0), axis=1).max() / np.diff(MOTION.t_s).min()
    for says, motion in menu(MOTION):
        assert motion.t_s[0] == 0 and (np.diff(motion.t_s) > 0).all(), says
        for name in ("start_m", "start_q", "end_m", "end_q"):
            assert getattr(motion, name)[0] == pytest.approx(getattr(MOTION, name)[-1], abs=1e-9), says
        ways = np.linalg.norm(np.diff(motion.end_m, axis=0), axis=1)
        assert (ways <= 1.01 * QUICKER * speed * np.diff(motion.t_s)).all(), says
        assert (np.sum(motion.end_q[1:] * motion.end_q[:-1], axis=1) > 0.9).all(), says


def test_of_an_end_that_only_turns_no_arc_is_asked_for() -> None:
    angle = np.deg2rad(60) * np.sin(np.linspace(0, np.pi, len(MOTION.t_s)))
    turns = Rotation.from_quat(MOTION.end_q[0], scalar_first=True) * Rotation.from_rotvec(
        np.outer(angle, [0, 0, 1])
    )
    still = np.tile(MOTION.end_m[0], (len(angle), 1))
    says = menu(replace(MOTION, end_m=still, end_q=turns.as_quat(scalar_first=True)))
    assert len(says) == 2 and all(motion.t_s[-1] > 1 for _, motion in says)


def test_the_roll_is_about_the_rope() -> None:
    (_, roll), *_ = menu(MOTION)
    turns = Rotation.from_quat(roll.end_q[0], scalar_first=True).inv() * Rotation.from_quat(
        roll.end_q, scalar_first=True
    )
    rolled = turns.as_rotvec()
    assert np.abs(rolled[:, :2]).max() < 1e-6
    assert rolled[:, 2].max() == pytest.approx(ROLL_RAD) and rolled[:, 2].min() == pytest.approx(-ROLL_RAD)


def test_two_laws_are_told_apart_and_a_model_is_not_told_from_itself() -> None:
    study = found("plastic").found.study
    models = {one.effects: one for one in found("plastic").found.searched.models}
    plastic, friction = models[("plastic_bending",)], models[("internal_friction",)]
    asked = next_motion(study, plastic, friction)
    assert asked is not None and asked.expected > 10
    assert asked.says in [says for says, _ in menu(study.seen[0].recording.motion)]
    same = next_motion(study, plastic, plastic)
    assert same is not None and same.expected < 1e-6


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
    for says, asked in menu(motion):
        for name in ("start_m", "start_q", "end_m", "end_q"):
            first, last = getattr(asked, name)[0], getattr(motion, name)[-1]
            assert first == pytest.approx(last, abs=1e-9) or first == pytest.approx(-last, abs=1e-9), says
        for some, fastest in zip(moved(asked), most, strict=True):
            assert (some <= QUICKER * 1.01 * fastest * np.diff(asked.t_s) + 1e-9).all(), says


def test_a_clamp_of_unknown_roll_is_asked_to_go_on_as_it_was_logged() -> None:
    ends = replace(made({}).ends, end_roll_known=False)
    turns = Rotation.from_quat(MOTION.end_q, scalar_first=True) * Rotation.from_rotvec([0, 0, 0.7])
    own = replace(made({}), ends=ends, motion=replace(MOTION, end_q=turns.as_quat(scalar_first=True)))
    for says, asked in menu(upright(own).motion):
        there = as_logged(asked, own)
        assert there.end_q[0] == pytest.approx(own.motion.end_q[-1], abs=1e-9), says
        assert there.start_q[0] == pytest.approx(own.motion.start_q[-1], abs=1e-9), says


def moved(motion: Motion) -> tuple[Floats, Floats]:
    """How far the ends go [m] and turn [rad] from row to row, the further of both."""
    ways = [np.linalg.norm(np.diff(x, axis=0), axis=1) for x in (motion.start_m, motion.end_m)]
    turns = [Rotation.from_quat(q, scalar_first=True) for q in (motion.start_q, motion.end_q)]
    turned = [(turn[:-1].inv() * turn[1:]).magnitude() for turn in turns]
    return np.maximum(*ways), np.maximum(*turned)
