"""Whether camera and robot share a clock: the held end as it is seen against where the robot says it was.

What the camera sees at t is the pose that the robot logged at t - offset, as in the effect `clock_offset` of
a diagnosis. Clocks stay as they were recorded: the offset is said, and nothing is shifted by it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import argrelmin
from scipy.spatial.transform import Rotation

from dlolib.formats import interpolate_motion
from dlolib.types import Floats, Motion, Recording

# The seen end: points this near to it, without what may lie in the gripper, continued to it by a parabola.
FROM_M, TO_M, LEAST_POINTS, LEAST_SPAN_M = 0.006, 0.085, 4, 0.03
# A camera stands, and a grasp holds, a little elsewhere than said; a motion that looks alike tells nothing.
CAMERA_M, CAMERA_RAD, GRASP_M = 0.02, np.radians(1.0), 0.01
LEAST_FRAMES, LEAST_WAY_M = 8, 0.005
# Offsets that are tried: a share of the recording, at most so many seconds, in so many steps.
SHARE, LONGEST_S, STEPS = 0.2, 10.0, 240
WORST_M, FLOOR_M = 0.01, 1e-4
# Of chi-square, within which a second minimum explains as well; of a normal distribution, 95 %.
TIE, WIDTH_95 = 9.0, 1.96
TANGENT = np.array([0.0, 0.0, 1.0])
End = Literal["start", "end"]


@dataclass(frozen=True)
class ClockOffset:
    """By how much the camera's clock is ahead of the robot's [s], or why the recording does not tell.

    time_s, with its 95 % interval low_s to high_s; None where `reason` says why. end: which held end was
    followed; frames: in how many; residual_m: RMS distance per axis [m] between the seen and the logged end
    at that offset, small errors of camera and grasp taken out.
    """

    time_s: float | None
    low_s: float | None
    high_s: float | None
    end: End | None
    frames: int
    residual_m: float | None
    reason: str | None = None

    @property
    def says(self) -> str:
        """One line for a person."""
        if self.time_s is None or self.low_s is None or self.high_s is None:
            return f"the points do not tell whether camera and robot share a clock: {self.reason}"
        return (
            f"the camera sees at t what the robot logged at t - ({self.time_s:.3f} s), 95 %: "
            f"{self.low_s:.3f} to {self.high_s:.3f} s, from the {self.end} in {self.frames} frames; "
            "the clocks stay as recorded"
        )


def clock_offset(recording: Recording) -> ClockOffset:
    """Estimate the offset between the clocks of camera and robot from the held end that moves most.

    Least squares over the offset, with small errors of the camera's pose and of the grasp beside it, each
    within what is usual; the best of many offsets begins. The residuals' correlation from frame to frame
    widens the interval.

    Args:
        recording: points along the rope, frame by frame, and the motion of the held ends.

    Returns:
        The offset with its interval, or the reason why the motion does not tell it.
    """
    end = _moving(recording)
    if end is None:
        return _untold("no held end moves by 5 mm")
    t_s, seen_m = _seen(recording, end)
    # from the log's beginning: of clocks that count from 1970 a double keeps too few digits to differentiate
    motion = replace(recording.motion, t_s=recording.motion.t_s - recording.motion.t_s[0])
    t_s = t_s - recording.motion.t_s[0]
    if len(t_s) < LEAST_FRAMES:
        return _untold(f"the {end} is seen in {len(t_s)} frames, {LEAST_FRAMES} are needed", end, len(t_s))
    widest = min(SHARE * float(motion.t_s[-1] - motion.t_s[0]), LONGEST_S)
    inside = _inside(t_s, motion, -widest, widest)
    if inside.sum() < LEAST_FRAMES:
        problem = f"the robot's log is too short beside the frames to try offsets up to {widest:.2g} s"
        return _untold(problem, end, int(inside.sum()))
    tried = np.linspace(-widest, widest, STEPS + 1)
    first = _Fit.at(tried, t_s[inside], seen_m[inside], motion, end)
    best = float(tried[np.argmin(first.chi2)])
    # near the best one more frames have a logged pose
    step = float(np.median(np.diff(t_s)))
    inside = _inside(t_s, motion, best - step, best + step)
    return _judged(best, widest, first, t_s[inside], seen_m[inside], motion, end)


@dataclass(frozen=True)
class _Fit:
    """Chi-square of each offset tried, (O,), residuals weighed by their own deviation at the best."""

    tried: Floats
    chi2: Floats

    @classmethod
    def at(cls, tried: Floats, t_s: Floats, seen_m: Floats, motion: Motion, end: End) -> _Fit:
        sigma = CAMERA_M
        for _ in range(3):
            fits = [_linear(float(offset), t_s, seen_m, motion, end, sigma) for offset in tried]
            off = min(fits, key=lambda fit: fit[0])[1]
            sigma = max(float(np.sqrt(np.mean(off**2))), FLOOR_M) * _widening(off)
        chi2 = [_linear(float(offset), t_s, seen_m, motion, end, sigma)[0] for offset in tried]
        return cls(tried, np.array(chi2))


def _judged(
    best: float, widest: float, first: _Fit, t_s: Floats, seen_m: Floats, motion: Motion, end: End
) -> ClockOffset:
    sigma, count = CAMERA_M, len(t_s)
    fit: Any = None
    for _ in range(3):
        start = np.zeros(8) if fit is None else fit.x
        start[0] = best if fit is None else fit.x[0]
        fit = least_squares(_residual, start, args=(t_s, seen_m, motion, end, sigma), x_scale="jac")
        off = fit.fun[: 3 * count].reshape(-1, 3) * sigma
        rms = float(np.sqrt(np.mean(off**2)))
        sigma = max(rms, FLOOR_M) * _widening(off)
    offset = float(fit.x[0])
    deviation = float(np.sqrt(np.linalg.pinv(fit.jac.T @ fit.jac)[0, 0]))
    step = float(np.median(np.diff(t_s)))
    others = first.tried[argrelmin(first.chi2)]
    alike = [
        t
        for t in others
        if first.chi2[first.tried == t][0] < first.chi2.min() + TIE and abs(t - offset) > 5 * deviation + step
    ]
    if rms > WORST_M:
        return _untold(
            f"the seen {end} stays {1e3 * rms:.0f} mm from the logged one at any offset", end, count
        )
    if alike:
        problem = f"offsets of {offset:.3g} and {alike[0]:.3g} s fit alike: the motion repeats itself"
        return _untold(problem, end, count)
    if WIDTH_95 * deviation > step:
        problem = (
            f"the motion tells it to ± {WIDTH_95 * deviation:.2g} s only, more than a frame; "
            f"move the {end} faster, to and fro, and not evenly"
        )
        return _untold(problem, end, count)
    if abs(offset) > widest - step:
        return _untold(f"it is more than the {widest:.2g} s that are tried", end, count)
    half = WIDTH_95 * deviation
    return ClockOffset(offset, offset - half, offset + half, end, count, rms)


def _untold(reason: str, end: End | None = None, frames: int = 0) -> ClockOffset:
    return ClockOffset(None, None, None, end, frames, None, reason)


def _moving(recording: Recording) -> End | None:
    """The held end that goes furthest."""
    ways: dict[End, float] = {}
    motion, ends = recording.motion, recording.ends
    for end, kind, place in (("start", ends.start, motion.start_m), ("end", ends.end, motion.end_m)):
        if kind == "clamped" and not np.isnan(place).any():
            ways["start" if end == "start" else "end"] = float(np.linalg.norm(np.ptp(place, axis=0)))
    best = max(ways, key=lambda end: ways[end], default=None)
    return best if best is not None and ways[best] >= LEAST_WAY_M else None


def _seen(recording: Recording, end: End) -> tuple[Floats, Floats]:
    """Times (F,) [s] and places (F, 3) [m] of the end in the frames in which the rope near it is seen."""
    points, length = recording.points, recording.rope.length_m
    away = points.s_m if end == "start" else length - points.s_m
    near = (away >= FROM_M) & (away <= TO_M)
    times, places = [], []
    for frame in np.unique(points.frame[near]):
        rows = near & (points.frame == frame)
        if rows.sum() < LEAST_POINTS or np.ptp(away[rows]) < LEAST_SPAN_M:
            continue
        places.append(np.polynomial.polynomial.polyfit(away[rows], points.xyz_m[rows], 2)[0])
        times.append(points.t_s[rows][0])
    return np.array(times), np.array(places).reshape(-1, 3)


def _inside(t_s: Floats, motion: Motion, low: float, high: float) -> Any:
    """Which frames have a logged pose for every offset between low and high."""
    return (t_s - high >= motion.t_s[0]) & (t_s - low <= motion.t_s[-1])


def _columns(offset: float, t_s: Floats, motion: Motion, end: End) -> tuple[Floats, Floats]:
    """The logged place (F, 3), and what small errors of camera and grasp change of it (F, 3, 7)."""
    poses = interpolate_motion(motion, t_s - offset)
    place, turn = (poses.start_m, poses.start_q) if end == "start" else (poses.end_m, poses.end_q)
    arm = place - place.mean(axis=0)
    turned = np.cross(np.eye(3)[None], arm[:, None])
    along = Rotation.from_quat(turn, scalar_first=True).apply(TANGENT)
    columns = np.concatenate(
        [np.tile(np.eye(3), (len(t_s), 1, 1)), np.swapaxes(turned, 1, 2), along[..., None]], 2
    )
    return place, columns


USUAL = np.array([CAMERA_M] * 3 + [CAMERA_RAD] * 3 + [GRASP_M])


def _linear(
    offset: float, t_s: Floats, seen_m: Floats, motion: Motion, end: End, sigma_m: float
) -> tuple[float, Floats]:
    """Chi-square and residuals (F, 3) [m] of an offset, the small errors at their best."""
    place, columns = _columns(offset, t_s, motion, end)
    matrix = np.vstack([columns.reshape(-1, 7) * USUAL / sigma_m, np.eye(7)])
    wanted = np.concatenate([(seen_m - place).ravel() / sigma_m, np.zeros(7)])
    found = np.linalg.lstsq(matrix, wanted)[0]
    off = wanted - matrix @ found
    return float(off @ off), off[:-7].reshape(-1, 3) * sigma_m


def _residual(
    values: Floats, t_s: Floats, seen_m: Floats, motion: Motion, end: End, sigma_m: float
) -> Floats:
    """Of the offset and the small errors, in parts of the usual."""
    place, columns = _columns(float(values[0]), t_s, motion, end)
    off = (seen_m - place - columns @ (USUAL * values[1:])).ravel() / sigma_m
    return np.concatenate([off, values[1:]])


def _widening(off: Floats) -> float:
    """By how much correlated residuals (F, 3) widen an interval, as a first-order process."""
    centred = off - off.mean(axis=0)
    total = float(np.sum(centred**2))
    lag = float(np.sum(centred[1:] * centred[:-1])) / total if total > 0 else 0.0
    lag = float(np.clip(lag, 0.0, 0.9))
    return float(np.sqrt((1 + lag) / (1 - lag)))
