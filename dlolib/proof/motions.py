"""Motions of the gripper in the manner of data/practice: an arc out and back, and what comes between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.proof.chain import Sizes
from dlolib.types import Floats, Motion

# Turns the third axis (the rope's tangent) onto +x and the first onto +y.
ALONG_X = np.array([0.5, 0.5, 0.5, 0.5])
# From nearly straight to the standing pose, a row every 0.2 s.
FIRST_REACH, APPROACH_ROWS, APPROACH_STEP_S = 0.98, 30, 0.2
STATIC_FRAMES, MAIN_FRAMES, HELDOUT_FRAMES = 30, 60, 24
STATIC_STEP_S, HOLD_STEP_S, HOLD_ROWS = 0.05, 1 / 3, 60
ARC_ROWS, ROLL_ROWS = 400, 240
# How long the gripper takes to its full speed, and from it to rest [s].
RAMP_S = 0.2
KINDS = ("plain", "roll", "hold", "opposite")
# Places (R, 3) [m], rolls (R,) [rad] and steps (R,) [s].
Part = tuple[Floats, Floats, Floats]


@dataclass(frozen=True)
class Arc:
    """A way out and back on an arc: its plane's tilt from the vertical [rad] and its sweep [rad]."""

    tilt_rad: float
    sweep_rad: float


@dataclass(frozen=True)
class Plan:
    """What a motion is made of: kind, where it stands at first [m], the arcs' radius [m], time a row [s]."""

    kind: str
    standing_m: float
    radius_m: float
    main: Arc
    heldout: Arc
    roll_rad: float
    row_s: float


def draw_plan(rng: np.random.Generator, sizes: Sizes) -> Plan:
    """A plan drawn at random; every reach stays within 0.98 of the rope's length."""
    return Plan(
        kind=str(rng.choice(KINDS)),
        standing_m=float(rng.uniform(0.92, 0.95) * sizes.length_m),
        radius_m=float(rng.uniform(0.24, 0.29) * sizes.length_m),
        main=Arc(float(rng.uniform(-1.2, 1.2)), float(rng.uniform(1.6, 2.15))),
        heldout=Arc(float(rng.uniform(-1.5, 1.5)), float(rng.uniform(1.5, 2.0))),
        roll_rad=float(rng.choice([-1.0, 1.0]) * rng.uniform(1.7, 2.3)),
        row_s=float(rng.choice([0.05, 0.05, 0.025, 0.0125])),
    )


def make_motion(plan: Plan, sizes: Sizes) -> tuple[Motion, Floats]:
    """The motion and when its frames are taken [s], (114,): 30 still, 60 on the main way, 24 held out."""
    parts = [_main(plan), _arc(plan, plan.heldout)]
    if plan.kind == "opposite":
        other = Arc(plan.main.tilt_rad + np.pi, plan.main.sweep_rad)
        parts[0] = _joined(parts[0], _arc(plan, other))
    reach = np.linspace(FIRST_REACH * sizes.length_m, plan.standing_m, APPROACH_ROWS)
    still = APPROACH_ROWS + STATIC_FRAMES
    place = np.concatenate([np.outer(reach, [1, 0, 0]), np.tile([plan.standing_m, 0, 0], (STATIC_FRAMES, 1))])
    steps = np.concatenate(
        [np.full(APPROACH_ROWS, APPROACH_STEP_S), [0.25], np.full(STATIC_FRAMES - 1, STATIC_STEP_S)]
    )
    place = np.concatenate([place, *(part[0] for part in parts)])
    steps = np.concatenate([steps, *(part[2] for part in parts)])
    roll = np.concatenate([np.zeros(still), *(part[1] for part in parts)])
    t_s = np.round(np.cumsum(steps), 6)
    turn = Rotation.from_rotvec(np.outer(roll, [1, 0, 0])) * Rotation.from_quat(ALONG_X, scalar_first=True)
    rest = np.tile(ALONG_X, (len(t_s), 1))
    motion = Motion(t_s, np.zeros_like(place), rest, place, _continuous(turn.as_quat(scalar_first=True)))
    last = still + len(parts[0][0])
    rows = np.concatenate(
        [
            np.arange(APPROACH_ROWS, still),
            _spread(still, last, MAIN_FRAMES),
            _spread(last, len(t_s), HELDOUT_FRAMES),
        ]
    )
    return motion, t_s[rows]


def _main(plan: Plan) -> Part:
    """The first arc with what it is broken by."""
    out, back = _leg(plan, plan.main, 0.0, 1.0), _leg(plan, plan.main, 1.0, 0.0)
    if plan.kind == "hold":
        pause = _stay(out, np.zeros(HOLD_ROWS), HOLD_STEP_S)
        return _joined(out, pause, back)
    if plan.kind == "roll":
        halfway, home = _leg(plan, plan.main, 1.0, 0.5), _leg(plan, plan.main, 0.5, 0.0)
        swing = plan.roll_rad * np.sin(2 * np.pi * _ramped(ROLL_ROWS, plan.row_s))
        return _joined(out, halfway, _stay(halfway, swing, plan.row_s), home)
    return _joined(out, back)


def _arc(plan: Plan, arc: Arc) -> Part:
    """One arc out and back, without its first pose."""
    return _joined(_leg(plan, arc, 0.0, 1.0), _leg(plan, arc, 1.0, 0.0))


def _leg(plan: Plan, arc: Arc, first: float, last: float) -> Part:
    """From one share of the arc's sweep to another, from rest to rest, without its first pose."""
    rows = round(abs(last - first) * ARC_ROWS / 2)
    angle = arc.sweep_rad * (first + (last - first) * _ramped(rows, plan.row_s))
    up = np.array([0.0, np.sin(arc.tilt_rad), np.cos(arc.tilt_rad)])
    place = plan.radius_m * np.outer(np.sin(angle), up)
    place[:, 0] += plan.standing_m - plan.radius_m * (1 - np.cos(angle))
    return place, np.zeros(len(angle)), np.full(len(angle), plan.row_s)


def _stay(before: Part, roll: Floats, step_s: float) -> Part:
    """Roll by these angles (R,) [rad] where a part before ends."""
    return np.tile(before[0][-1], (len(roll), 1)), roll, np.full(len(roll), step_s)


def _joined(*parts: Part) -> Part:
    place, roll, steps = (np.concatenate(one) for one in zip(*parts, strict=True))
    return place, roll, steps


def _ramped(rows: int, row_s: float) -> Floats:
    """Shares (R,) of a way that takes so many rows at full speed: as every arm, it gathers and loses that.

    A rope whose end leaps in speed rings in all of its modes at once, which no steps in time resolve.
    """
    ramp = round(RAMP_S / row_s)
    middle = np.arange(rows + ramp) + 0.5
    return np.cumsum(np.minimum(1.0, np.minimum(middle, middle[::-1]) / ramp)) / rows


def _spread(first: int, last: int, count: int) -> Floats:
    """Row numbers of this many frames, evenly from after `first` to the last row."""
    return np.asarray(np.rint(first - 1 + (last - first) * np.arange(1, count + 1) / count).astype(int))


def _continuous(quaternions: Floats) -> Floats:
    """The same turns, each with the sign that is near the one before."""
    signs = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0, -1.0, 1.0)
    first = np.sign(quaternions[0, 0])
    return np.asarray(quaternions * np.cumprod(np.concatenate([[first], signs]))[:, None])
