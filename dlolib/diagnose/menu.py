"""What a robot can do next: motions from where a recording ended on, of its own speed unless they say so."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.identify.intervals import JITTER_M, JITTER_RAD
from dlolib.types import Floats, Motion

# Rows a second; how far and how fast the wrist rolls; how long it holds a pose, and how long each of two.
RATE_HZ = 20.0
ROLL_RAD, ROLL_RAD_S = np.deg2rad(120.0), 0.5
HOLD_S, HOLD_EACH_S = 20.0, 10.0
# How much faster, or slower, the arc is gone through again; by which share of their distance ends near.
QUICKER, NEARER = 3.0, 0.5
# Ends as near as this touch. A speed where an end only turned, and the slowest worth waiting for [m/s].
TOUCHING_M, USUAL_M_S, SLOWEST_M_S = 0.02, 0.05, 0.01
FEWEST_ROWS = 3
# A row that is reached from the one before in less is the same pose.
STILL_S = 1e-7

Pose = tuple[Floats, Floats, Floats, Floats]


def menu(motion: Motion) -> list[tuple[str, Motion]]:
    """What a robot can do from the motion's last pose, each with what it is.

    It moves the rope's end; where that hangs free, its start.
    """
    if np.isnan(motion.end_m).all():
        return [(says, _other_way_round(one)) for says, one in menu(_other_way_round(motion))]
    speed, turning_speed = _speed(motion), max(ROLL_RAD_S, _turning_speed(motion))
    last, bent, arcs = _pose(motion, -1), _pose(motion, _most_bent(motion)), _arc(motion)

    def timed(way: Motion, share: float) -> Motion:
        return _timed(way, share * speed, share * turning_speed)

    def through(*poses: tuple[Pose, float]) -> Motion:
        return _through([(last, 0.0), *poses, (last, 0.0)], speed)

    one_way, other_way = _rolled(bent, ROLL_RAD), _rolled(bent, -ROLL_RAD)
    # back through where it began: from one side straight to the other would be the short way round
    rolled = through((bent, 0.0), (one_way, HOLD_EACH_S), (bent, 0.0), (other_way, HOLD_EACH_S), (bent, 0.0))
    whole = [
        ("roll the wrist by 120 degrees both ways at the most bent pose, held for 10 s each", rolled),
        ("hold the most bent pose for 20 s", through((bent, HOLD_S))),
    ]
    if np.linalg.norm(bent[2] - bent[0]) > TOUCHING_M:  # and not of a free start, which is nowhere
        held = through((bent, 0.0), (_nearer(bent), HOLD_S), (bent, 0.0))
        whole.append(("bring the ends nearer by half of their least distance and hold that for 20 s", held))
    if _moves(arcs):
        whole += [
            ("move along the same arc on the opposite side, out and back", timed(_mirrored(arcs), 1.0)),
            ("move along the same arc three times as fast", timed(arcs, QUICKER)),
            ("move along the same arc a third as fast", timed(arcs, 1 / QUICKER)),
        ]
    elif _turns(arcs).max(initial=0.0) > JITTER_RAD:
        own = _turning_speed(motion)
        whole += [
            ("turn as before three times as fast", _timed(arcs, speed, QUICKER * own)),
            ("turn as before a third as fast", _timed(arcs, speed, own / QUICKER)),
        ]
    return [(says, one) for says, one in whole if len(one.t_s) >= FEWEST_ROWS]


def then(one: Motion, other: Motion) -> Motion:
    """Two motions of the menu one after the other: each ends where both begin."""
    return _joined([one, other])


def _other_way_round(motion: Motion) -> Motion:
    """The rope's start for its end: what moves the one moves the other."""
    return Motion(motion.t_s, motion.end_m, motion.end_q, motion.start_m, motion.start_q)


def _pose(motion: Motion, k: int) -> Pose:
    return motion.start_m[k], motion.start_q[k], motion.end_m[k], motion.end_q[k]


def _speed(motion: Motion) -> float:
    """Of the moved end while it moves [m/s]."""
    way = np.linalg.norm(np.diff(motion.end_m, axis=0), axis=1)
    moving = way > 1e-6
    if not moving.any():
        return USUAL_M_S
    return max(float(way[moving].sum() / np.diff(motion.t_s)[moving].sum()), SLOWEST_M_S)


def _turning_speed(motion: Motion) -> float:
    """Of the ends while they turn [rad/s]."""
    turn = _turns(motion)
    turning = turn > 1e-6
    return float(turn[turning].sum() / np.diff(motion.t_s)[turning].sum()) if turning.any() else 0.0


def _ways(motion: Motion) -> Floats:
    """How far the further moved end goes from row to row (T - 1,) [m]."""
    ways = [np.linalg.norm(np.diff(x, axis=0), axis=1) for x in (motion.start_m, motion.end_m)]
    return np.asarray(np.nanmax([np.nan_to_num(way) for way in ways], axis=0))


def _turns(motion: Motion) -> Floats:
    """How far the further turned end turns from row to row (T - 1,) [rad]."""
    found = np.zeros(len(motion.t_s) - 1)
    for q in (motion.start_q, motion.end_q):
        if not np.isnan(q).any():
            turns = Rotation.from_quat(q, scalar_first=True)
            found = np.maximum(found, (turns[:-1].inv() * turns[1:]).magnitude())
    return found


def _most_bent(motion: Motion) -> int:
    """The row at which the two ends are nearest, or the end is furthest from how it began."""
    if np.isnan(motion.start_m).all():
        return int(np.argmax(_away(motion, 0)))
    return int(np.argmin(np.linalg.norm(motion.end_m - motion.start_m, axis=1)))


def _away(motion: Motion, row: int) -> Floats:
    """How far the end is from where it is at one row (T,) [m]; turned, if it only turns [rad]."""
    if _moves(motion):
        return np.asarray(np.linalg.norm(motion.end_m - motion.end_m[row], axis=1))
    turns = Rotation.from_quat(motion.end_q, scalar_first=True)
    return np.asarray((turns[row].inv() * turns).magnitude())


def _moves(motion: Motion) -> bool:
    """Whether the end goes anywhere: the arc of one that only turns is a point."""
    return bool(np.ptp(motion.end_m, axis=0).max() > JITTER_M)


def _rolled(pose: Pose, angle: float) -> Pose:
    turn = Rotation.from_quat(pose[3], scalar_first=True) * Rotation.from_rotvec([0, 0, angle])
    return pose[0], pose[1], pose[2], _alike(turn.as_quat(scalar_first=True), pose[3])


def _nearer(pose: Pose) -> Pose:
    """The end brought nearer to the start."""
    return pose[0], pose[1], pose[2] + NEARER * (pose[0] - pose[2]), pose[3]


def _alike(q: Floats, other: Floats) -> Floats:
    """Of the two signs of a quaternion the one nearer to another."""
    return np.asarray(q if q @ other >= 0 else -q)


def _go(one: Pose, other: Pose, speed: float, least_s: float = 0.0) -> Motion:
    """From pose to pose in a straight line, turning evenly; both ends."""
    both = Motion(np.arange(2.0), *(np.stack(pair) for pair in zip(one, other, strict=True)))
    way, turn = float(_ways(both)[0]), float(_turns(both)[0])
    duration = max(way / speed, turn / ROLL_RAD_S, least_s, 2 / RATE_HZ)
    t = np.linspace(0, duration, int(np.ceil(duration * RATE_HZ)) + 1)
    share = (t / duration)[:, None]
    start_m, end_m = (one[k] + share * (other[k] - one[k]) for k in (0, 2))
    return Motion(t, start_m, _turning(one[1], other[1], share), end_m, _turning(one[3], other[3], share))


def _turning(one: Floats, other: Floats, share: Floats) -> Floats:
    """Frames (T, 4) from one to another; a free end has none."""
    if np.isnan(one).any() or np.isnan(other).any():
        return np.full((len(share), 4), np.nan)
    first, second = (Rotation.from_quat(q, scalar_first=True) for q in (one, other))
    turn = (first.inv() * second).as_rotvec()
    q = (first * Rotation.from_rotvec(share * turn)).as_quat(scalar_first=True)
    q[0] = _alike(q[0], one)
    for k in range(1, len(q)):
        q[k] = _alike(q[k], q[k - 1])
    return np.asarray(q)


def _through(poses: list[tuple[Pose, float]], speed: float) -> Motion:
    """From each pose straight to the next, each held for so long [s]."""
    legs = []
    for (one, _), (other, held_s) in itertools.pairwise(poses):
        legs += [_go(one, other, speed)] + ([_go(other, other, speed, held_s)] if held_s else [])
    return _joined(legs)


def _joined(legs: list[Motion]) -> Motion:
    """One after the other."""
    whole = legs[0]
    for leg in legs[1:]:
        rest = [getattr(leg, name)[1:] for name in ("start_m", "start_q", "end_m", "end_q")]
        for k, before, after in ((1, whole.start_q, leg.start_q), (3, whole.end_q, leg.end_q)):
            if before[-1] @ after[0] < 0:
                rest[k] = -rest[k]
        parts = [
            np.concatenate([getattr(whole, name), more])
            for name, more in zip(("start_m", "start_q", "end_m", "end_q"), rest, strict=True)
        ]
        whole = Motion(np.concatenate([whole.t_s, whole.t_s[-1] + leg.t_s[1:]]), *parts)
    return whole


def _arc(motion: Motion) -> Motion:
    """The recorded way of the end out to where it is furthest from its last pose, and back."""
    first = int(np.argmax(_away(motion, -1)))
    back = [np.asarray(getattr(motion, name)[first:]) for name in ("start_m", "start_q", "end_m", "end_q")]
    both = [np.concatenate([part[::-1], part[1:]]) for part in back]
    return Motion(np.arange(len(both[0]), dtype=float), *both)


def _mirrored(motion: Motion) -> Motion:
    """The end's way turned by half a revolution about the line from the start to where it begins."""
    origin = motion.end_m[0]
    along = origin - motion.start_m[0] if not np.isnan(motion.start_m).any() else np.array([0.0, 0.0, 1.0])
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    away = motion.end_m - origin
    return replace(motion, end_m=origin + 2 * np.outer(away @ along, along) - away)


def _timed(motion: Motion, speed: float, turning_speed: float) -> Motion:
    """At an even speed [m/s], slower where it turns faster than that [rad/s]; rows that stand still left
    out."""
    takes_s = np.maximum(_ways(motion) / speed, _turns(motion) / turning_speed)
    moves = takes_s > STILL_S
    keep = np.concatenate([[True], moves])
    parts = [getattr(motion, name)[keep] for name in ("start_m", "start_q", "end_m", "end_q")]
    return Motion(np.concatenate([[0.0], np.cumsum(takes_s[moves])]), *parts)


__all__ = ["FEWEST_ROWS", "menu", "then"]
