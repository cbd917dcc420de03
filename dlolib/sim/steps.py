"""When to solve for the rope: at every dt, or as often as its ends' way asks for."""

from __future__ import annotations

import numpy as np

from dlolib.errors import SimulationError
from dlolib.formats import interpolate_motion
from dlolib.types import Floats, Motion, Recording

# Between two quasi-static steps an end moves and turns at most this much, so that the rope follows its
# branch where several equilibria exist; a rope that remembers its way takes shorter ones.
LARGEST_MOVE_M, LARGEST_TURN_RAD = 0.01, 0.1
REMEMBERED = 0.4
# Frames so close to each other in way, in units of that step, and in time, as a share of the recording, are
# not each solved for: between them the rope goes in a straight line but for some 0.01 % of its length, 0.2 %
# where it swings far for what its ends do.
CLOSE, BRIEF = 0.25, 0.01
# While its ends stand, a rope that relaxes in a time is solved for so many times that after they stopped, and
# again when so many times as long has passed.
RELAXED, LATER = 0.5, np.sqrt(2.0)
# Dynamic steps between two rows of the motion: what is recorded so often moves that fast.
STEPS_A_ROW = 4
# A step of the dynamic clock follows an end by this share of the rope's length and by this turn.
FOLLOWED, FOLLOWED_RAD = 0.25, 1.0
# A roll-out of so many steps takes all of a machine's memory.
MOST_STEPS = 1_000_000


def dynamic_step(motion: Motion, longest_s: float) -> float:
    """A step [s] that follows what the motion's rows tell: a share of the time between two of them."""
    between_s = float(np.median(np.diff(motion.t_s))) if len(motion.t_s) > 1 else np.inf
    return min(longest_s, between_s / STEPS_A_ROW)


def largest_step(motion: Motion) -> float:
    """The largest way between two rows of the motion, in units of the largest quasi-static step."""
    return float(_ways(motion).max(initial=0.0))


def dynamic_times(recording: Recording, step_s: float, begin_s: float) -> Floats:
    """Every dt up to the last frame [s]; the first dt ends at `begin_s`.

    Raises:
        SimulationError: too many steps.
    """
    last_s = max(recording.points.t_s.max(), begin_s + step_s)
    if last_s - begin_s > MOST_STEPS * step_s:
        problem = f"{last_s - begin_s:g} s in steps of {step_s:g} s are more than {MOST_STEPS:,} steps"
        raise SimulationError(problem, mend="look for a jump of the clock in t_s")
    return np.asarray(begin_s + step_s * np.arange(np.ceil((last_s - begin_s) / step_s - 1e-9) + 1))


def check_speed(recording: Recording, times_s: Floats, step_s: float) -> None:
    """Refuse a motion that steps at these times do not follow.

    Raises:
        SimulationError: an end moves or turns too far in one of them.
    """
    poses = interpolate_motion(recording.motion, times_s)
    ways = [np.linalg.norm(np.diff(m, axis=0), axis=1) for m in (poses.start_m, poses.end_m)]
    cosines = [np.sum(q[1:] * q[:-1], axis=1) for q in (poses.start_q, poses.end_q)]
    way = np.nan_to_num(ways).max(axis=0)
    turn = 2 * np.arccos(np.clip(np.nan_to_num(cosines, nan=1.0), -1, 1)).max(axis=0)
    follows_m = FOLLOWED * recording.rope.length_m
    hard = np.maximum(way / follows_m, turn / FOLLOWED_RAD)
    worst = int(np.argmax(hard))
    if hard[worst] > 1:
        raise SimulationError(
            f"from t_s = {times_s[worst]:g} on an end moves {way[worst]:.3g} m and turns "
            f"{turn[worst]:.2g} rad in a step of {step_s:g} s, which follows {follows_m:.3g} m "
            f"and {FOLLOWED_RAD:g} rad at most",
            mend=f"give rod.time_step_s of {0.9 * step_s / hard[worst]:.2g} or less, or correct motion.csv",
        )


def quasi_static_times(
    recording: Recording, share: float = 1.0, rows_too: bool = False, relaxes_s: float = np.inf
) -> Floats:
    """At the frames and as many times between [s] as the ends' way asks for, in steps no longer than this
    share of the largest; with `rows_too` at the motion's rows, too. Where the ends stop, as often as a rope
    asks for that relaxes in so long."""
    rows, frames = recording.motion.t_s, np.unique(recording.points.t_s)
    frames = np.unique(np.concatenate([rows[:1], frames]))
    fine = np.unique(np.concatenate([frames, rows[rows <= frames[-1]]]))
    gone = np.concatenate([[0.0], np.cumsum(_ways(interpolate_motion(recording.motion, fine)))])
    marks = fine if rows_too else _marks(frames, np.interp(frames, fine, gone))
    times = _evenly(marks, fine, gone, share)
    return _settling(times, np.interp(times, fine, gone), relaxes_s)


def _marks(frames: Floats, gone: Floats) -> Floats:
    """Frames at which to solve for the rope, the last one too; at others, close between two of these, it is
    where it goes past in a straight line.

    gone: the ends' way to each frame, in units of the largest step.
    """
    brief_s = BRIEF * (frames[-1] - frames[0])
    kept = [0]
    for k in range(1, len(frames) - 1):
        if gone[k + 1] - gone[kept[-1]] > CLOSE or frames[k + 1] - frames[kept[-1]] > brief_s:
            kept.append(k)
    return frames[[*kept, len(frames) - 1]] if len(frames) > 1 else frames


def _evenly(marks: Floats, fine: Floats, gone: Floats, share: float) -> Floats:
    """Times from mark to mark, each way in as many equal parts as the largest step asks for; `gone` is the
    ends' way at the times `fine`.

    Equal steps are what the solver foretells best: its first guess goes on as the last steps went.
    """
    at = np.interp(marks, fine, gone)
    times = [marks[:1]]
    for first, last, begin, end in zip(marks, marks[1:], at, at[1:], strict=False):
        parts = max(int(np.ceil((end - begin) / share - 1e-9)), 1)
        inner = np.interp(begin + (end - begin) * np.arange(1, parts) / parts, gone, fine)
        times.append(np.append(np.clip(inner, first, last), last))
    return np.unique(np.concatenate(times))


def _settling(times: Floats, gone: Floats, relaxes_s: float) -> Floats:
    """With further times in long steps while the ends hardly move."""
    brief_s, took_s = RELAXED * relaxes_s, np.diff(times)
    # before the first step nothing stood still, either
    still = np.append(np.diff(gone) < CLOSE, False)
    stopped_s, more = times[0], [times]
    for k in range(len(took_s)):
        if not (still[k] and still[k - 1]):
            stopped_s = times[k]
        if still[k] and took_s[k] > brief_s:
            count = np.ceil(np.log((times[k + 1] - stopped_s) / brief_s) / np.log(LATER))
            after = stopped_s + brief_s * LATER ** np.arange(count)
            more.append(after[(after > times[k]) & (after < times[k + 1])])
    return np.unique(np.concatenate(more))


def _ways(poses: Motion) -> Floats:
    """From each row to the next, in units of the largest step: (T - 1,)."""
    ways = [np.zeros(len(poses.t_s) - 1)]
    for x, q in ((poses.start_m, poses.start_q), (poses.end_m, poses.end_q)):
        along = np.sum(q[1:] * q[:-1], axis=1)
        half = np.arccos(np.clip(np.abs(along), 0, 1))
        turned = 2 * np.where(along < 0, np.pi - half, half)
        ways += [np.linalg.norm(np.diff(x, axis=0), axis=1) / LARGEST_MOVE_M, turned / LARGEST_TURN_RAD]
    return np.asarray(np.nanmax(ways, axis=0))
