"""What the camera's noise is: its deviation, and how far it goes together.

Noise correlated over 1.5 points and frames makes every recording look like missing physics. It is modelled as
formats.md says, exp(-lag / value) along the rope and over the frames. Its three numbers come by restricted
maximum likelihood (Patterson and Thompson, Biometrika 58, 1971), which forgives the mean shape that is
estimated with them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize
from scipy.fft import dct
from scipy.interpolate import BSpline

from dlolib.diagnose.whitening import Grid, decay, grid_of
from dlolib.errors import ParameterError
from dlolib.formats import interpolate_motion
from dlolib.identify.problem import seen_axes
from dlolib.types import Floats, Noise, Recording

# A likelihood over more points than this takes seconds.
MOST_POINTS = 900
# Where the rope never rests, what moves slower than this along rope and time is not counted as noise.
SMOOTH_S, SMOOTH_T = 10, 5
# Correlation lengths beyond these are a systematic error and no noise.
LONGEST = 10.0
# Frames that show one pose tell the noise if they are so many; a pose is the same within this [m, or of 1].
FEWEST_STILL, SAME = 3, 1e-6
# Points are of one place along the rope within this share of its length; so many more than the shape takes
# tell of noise.
SAME_PLACE, FEWEST_LEFT = 2e-5, 3
# No camera's noise is less than this [m].
LEAST_M = 1e-6
# An end that moves or turns further than this while it is to stand still does not [m, rad].
STANDS_M, STANDS_RAD = 2e-3, 0.02
# What is given is refuted by points of one pose that scatter so many times as much, and by more than so many
# deviations of that, where so many readings go together.
REFUTED, SURE, TOGETHER = 1.2, 4.0, 5.0


class NoiseTold(NamedTuple):
    """The noise of a recording, whence it is known, and by how much more its points scatter than their own
    covariances say."""

    noise: Noise
    whence: str
    wider: float = 1.0


def known_noise(recording: Recording) -> NoiseTold | None:
    """The noise that a recording tells without any rod: it is given, or some frames show one pose. These
    refute what is given where they scatter more.

    Raises:
        ParameterError: an end moves in frames that are to stand still.
    """
    told = _standing(recording)
    given, by = _given(recording)
    if told is None:
        return None if recording.noise is None else NoiseTold(recording.noise, "recording.json: noise")
    noise, here, readings = told
    many = noise.sigma_m / given if given else 1.0
    if given and many > REFUTED + SURE / np.sqrt(readings / TOGETHER):
        wider = many if recording.points.covariance_m2 is not None else 1.0
        return NoiseTold(noise, f"{here} and scatter {many:.1f} times as much as {by}", wider)
    if recording.noise is not None:
        return NoiseTold(recording.noise, "recording.json: noise")
    if recording.position_noise_m:
        its = f"recording.json: position_noise_m; its correlation: {here}"
        return NoiseTold(replace(noise, sigma_m=recording.position_noise_m), its)
    return NoiseTold(noise, here)


def _given(recording: Recording) -> tuple[float, str]:
    """The deviation [m] that counts as a recording gives it, 0 where it does not, and where."""
    covariance = recording.points.covariance_m2
    if covariance is not None:
        seen = seen_axes(recording)
        return float(np.sqrt(np.mean(covariance[:, seen, seen]))), "points.csv: the covariances"
    if recording.noise is not None:
        return recording.noise.sigma_m, "recording.json: noise"
    return recording.position_noise_m or 0.0, "recording.json: position_noise_m"


def _standing(recording: Recording) -> tuple[Noise, str, int] | None:
    """The noise of frames that show one pose, which they are, and of how many readings."""
    still = _still(recording)
    if still is None:
        return None
    values = recording.points.xyz_m[:, seen_axes(recording)]
    first, last = recording.points.frame[still][[0, -1]]
    _check_standing(recording, int(first), int(last))
    noise = _likeliest(recording, values, still, still_shape=True)
    if noise.sigma_m < LEAST_M:
        # simulated, or a tracker that says the same again while nothing moves
        return None
    return noise, f"frames {first} to {last}, which stand still", values[still].size


def _check_standing(recording: Recording, first: int, last: int) -> None:
    """What moves there would be taken for noise, and hide what is missing."""
    points = recording.points
    still = (points.frame >= first) & (points.frame <= last)
    poses = interpolate_motion(recording.motion, np.unique(points.t_s[still]))
    for end, place_m, turn in (("start", poses.start_m, poses.start_q), ("end", poses.end_m, poses.end_q)):
        if getattr(recording.ends, end) != "clamped":
            continue
        way_m = float(np.linalg.norm(place_m - place_m[0], axis=1).max())
        turned_rad = float(2 * np.arccos(np.clip(np.abs(turn @ turn[0]), 0, 1)).max())
        if way_m > STANDS_M or turned_rad > STANDS_RAD:
            moves = f"moves by {1e3 * way_m:.0f} mm and turns by {np.rad2deg(turned_rad):.0f} degrees"
            raise ParameterError(
                f"{recording.name}: the {end} {moves} in frames {first} to {last}, which are to stand still",
                place="static_frames",
                mend="name frames in which it stands, or leave static_frames out",
            )


def noise_left(recording: Recording, residual_m: Floats) -> NoiseTold:
    """The noise of a recording by what a rod leaves of its points (P, A) [m]: what is quick in that."""
    noise = _likeliest(recording, residual_m, np.ones(len(residual_m), dtype=bool), still_shape=False)
    here, given = "quick part of the residuals", recording.position_noise_m or 0.0
    if given > 0:
        its = f"recording.json: position_noise_m; its correlation: {here}"
        return NoiseTold(replace(noise, sigma_m=given), its)
    return NoiseTold(replace(noise, sigma_m=max(noise.sigma_m, LEAST_M)), here)


def _still(recording: Recording) -> np.ndarray | None:
    """The points of the static frames (P,), or of all frames where all show one pose; None: too few."""
    points, motion = recording.points, recording.motion
    still = None
    if recording.static_frames is not None:
        first, last = recording.static_frames
        still = (points.frame >= first) & (points.frame <= last)
    elif recording.quasi_static and len(motion.t_s) <= len(np.unique(points.frame)):
        rows = np.hstack([motion.start_m, motion.start_q, motion.end_m, motion.end_q])
        if np.nanmax(np.ptp(rows, axis=0), initial=0.0) < SAME:
            still = np.ones(len(points.frame), dtype=bool)
    if still is None or len(np.unique(points.frame[still])) < FEWEST_STILL:
        return None
    shape = _shape(recording, still, grid_of(recording, still))
    return still if len(shape) - np.linalg.matrix_rank(shape) >= FEWEST_LEFT else None


def _likeliest(recording: Recording, values_m: Floats, used: np.ndarray, still_shape: bool) -> Noise:
    """The noise of greatest restricted likelihood, over the first frames of those used."""
    grid = grid_of(recording, used)
    rows = max(3, MOST_POINTS // grid.columns)
    some = np.flatnonzero(grid.row < rows)
    row, column = grid.row[some], grid.column[some]
    y = values_m[used][some]
    frames = grid.frame[: int(row.max()) + 1]
    if still_shape:
        basis = _shape(recording, used, grid)[some]
    else:
        along = _smooth(grid.columns, SMOOTH_S)[column]
        over = _smooth(len(frames), SMOOTH_T)[row]
        basis = (along[:, :, None] * over[:, None, :]).reshape(len(row), -1)
    lag_t = np.abs(frames[row][:, None] - frames[row][None])
    lag_s = np.abs(column[:, None] - column[None])
    axes, dof = y.shape[1], len(y) - np.linalg.matrix_rank(basis)
    # of points that say the same again nothing is left at all
    least = float(1e-6 * LEAST_M**2 * dof * axes)

    def terms(lengths: Floats) -> tuple[float, float]:
        covariance = decay(lag_s, lengths[0]) * decay(lag_t, lengths[1])
        root = linalg.cholesky(covariance, lower=True)
        white, seen = (linalg.solve_triangular(root, a, lower=True) for a in (y, basis))
        q, r = linalg.qr(seen, mode="economic")
        left = white - q @ (q.T @ white)
        diagonal = np.abs(np.diag(r))
        log_det = 2 * np.log(np.diag(root)).sum() + 2 * np.log(diagonal[diagonal > 1e-9]).sum()
        return float(np.sum(left**2)), float(log_det)

    def deviance(lengths: Floats) -> float:
        squares, log_det = terms(lengths)
        squares = max(squares, least)
        return float(axes * (dof * np.log(squares / (dof * axes)) + log_det))

    best = optimize.minimize(
        deviance, np.array([0.5, 0.5]), method="L-BFGS-B", bounds=[(1e-3, LONGEST)] * 2
    ).x
    squares, _ = terms(best)
    return Noise(float(np.sqrt(squares / (dof * axes))), float(best[0]), float(best[1]))


def _shape(recording: Recording, used: np.ndarray, grid: Grid) -> Floats:
    """What one shape can be at the used points, (P, K): anything at places that frames share; a spline along
    the rope, of half as many pieces as a frame has points, where each frame has places of its own."""
    arc_m, length_m = recording.points.s_m[used], recording.rope.length_m
    if all(np.ptp(arc_m[grid.column == one]) < SAME_PLACE * length_m for one in np.unique(grid.column)):
        return np.asarray(np.eye(grid.columns)[grid.column])
    inner = np.linspace(0.0, length_m, max(grid.columns // 2, 1) + 1)
    knots = np.concatenate([[inner[0]] * 3, inner, [inner[-1]] * 3])
    basis = BSpline.design_matrix(np.clip(arc_m, 0.0, length_m), knots, 3).toarray()
    return np.asarray(basis[:, basis.any(axis=0)])


def _smooth(count: int, modes: int) -> Floats:
    """The slowest modes of a discrete cosine transform, (count, modes)."""
    return np.asarray(dct(np.eye(count), axis=1, norm="ortho")[:, : min(modes, max(count // 3, 1))])


__all__ = ["known_noise", "noise_left"]
