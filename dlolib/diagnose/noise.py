"""What the camera's noise is, and the residuals rid of its correlation.

Noise correlated over 1.5 points and frames makes every recording look like missing physics. It is modelled as
formats.md says, exp(-lag / value) along the rope and over the frames: an autoregressive process in both
directions, whose whitening is exact and two-diagonal. Its three numbers come by restricted maximum
likelihood (Patterson and Thompson, Biometrika 58, 1971), which forgives the mean shape that is estimated with
them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from scipy import linalg, optimize, sparse
from scipy.fft import dct
from scipy.sparse.linalg import SuperLU, splu

from dlolib.identify.problem import seen_axes
from dlolib.types import Floats, Ints, Noise, Recording

# A likelihood over more points than this takes seconds.
MOST_POINTS = 900
# Where the rope never rests, what moves slower than this along rope and time is not counted as noise.
SMOOTH_S, SMOOTH_T = 10, 5
# Correlation lengths beyond these are a systematic error and no noise.
LONGEST = 10.0
# Frames that show one pose tell the noise if they are so many; a pose is the same within this [m, or of 1].
FEWEST_STILL, SAME = 3, 1e-6


@dataclass(frozen=True)
class Grid:
    """Where each point stands in its recording: row (frame) and column (place along the rope).

    frame: numbers of the rows (F,), whose gaps count as lags. row, column (P,). columns: how many.
    """

    frame: Ints
    row: Ints
    column: Ints
    columns: int


def grid_of(recording: Recording, used: np.ndarray) -> Grid:
    """The used points of a recording as a grid: by arc length, or by rank where frames share none."""
    points = recording.points
    frame, row = np.unique(points.frame[used], return_inverse=True)
    arc = np.round(points.s_m[used] / recording.rope.length_m, 5)
    places, column = np.unique(arc, return_inverse=True)
    most = int(np.bincount(row).max())
    if len(places) > 2 * most:
        first = np.searchsorted(row, np.arange(len(frame)))
        column = np.arange(len(row)) - first[row]
        return Grid(frame, row, column, most)
    return Grid(frame, row, column, len(places))


@dataclass(frozen=True)
class Whitener:
    """Makes the residuals of one recording independent, of variance 1 where there is but noise.

    Args:
        grid: of the points.
        noise: deviation and correlation.
        covariance_m2: of each point (P, A, A) where the recording gives it: in the place of the deviation.
    """

    grid: Grid
    noise: Noise
    covariance_m2: Floats | None = None

    @cached_property
    def _along(self) -> sparse.csc_array:
        """Whitening of the whole grid, rows F x columns."""
        over_frames = _bidiagonal(np.diff(self.grid.frame), self.noise.correlation_frames)
        over_points = _bidiagonal(np.ones(self.grid.columns - 1), self.noise.correlation_points)
        return sparse.csc_array(sparse.kron(over_frames, over_points))

    @cached_property
    def _place(self) -> Ints:
        return np.asarray(self.grid.row * self.grid.columns + self.grid.column)

    @cached_property
    def _roots(self) -> Floats | None:
        if self.covariance_m2 is None:
            return None
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance_m2)))

    def __getstate__(self) -> dict[str, object]:
        """What another process needs to make its own factors."""
        return {part.name: getattr(self, part.name) for part in fields(self)}

    @property
    def shape(self) -> tuple[int, int]:
        """Frames and places of the whitened grid."""
        return len(self.grid.frame), self.grid.columns

    def __call__(self, values_m: Floats) -> Floats:
        """Whiten (P, A, ...) [m] to the grid (F, columns, A, ...).

        A point that was not seen is where it fits the others best, which leaves the sum of squares that of
        the seen points alone.
        """
        if self._roots is not None:
            scaled = np.einsum("pab,pb...->pa...", self._roots, values_m)
        else:
            scaled = values_m / self.noise.sigma_m
        frames, columns = self.shape
        flat = np.zeros((frames * columns, int(np.prod(values_m.shape[1:]))))
        flat[self._place] = scaled.reshape(len(values_m), -1)
        white = self._along @ flat
        if self._missing is not None:
            unseen, factor = self._missing
            white -= unseen @ factor.solve(unseen.T @ white)
        return np.asarray(white.reshape(frames, columns, *values_m.shape[1:]))

    @cached_property
    def _missing(self) -> tuple[sparse.csc_array, SuperLU] | None:
        absent = np.ones(self.shape[0] * self.shape[1], dtype=bool)
        absent[self._place] = False
        if not absent.any():
            return None
        unseen = self._along[:, np.flatnonzero(absent)]
        return unseen, splu(sparse.csc_matrix(unseen.T @ unseen))


def _bidiagonal(gaps: Floats, length: float) -> sparse.csc_array:
    """Whitening of exp(-lag / length) over steps of these gaps: exact for any gaps."""
    rho = np.exp(-gaps / length) if length > 0 else np.zeros(len(gaps))
    spread = 1 / np.sqrt(1 - rho**2)
    diagonal = np.concatenate([[1.0], spread])
    return sparse.csc_array(sparse.diags_array([diagonal, -rho * spread], offsets=[0, -1]))


def known_noise(recording: Recording) -> tuple[Noise, str] | None:
    """The noise that a recording tells without any rod, and whence: it is given, or some frames show one
    pose."""
    if recording.noise is not None:
        return recording.noise, "recording.json: noise"
    still = _still(recording)
    if still is None:
        return None
    values = recording.points.xyz_m[:, seen_axes(recording)]
    first, last = recording.points.frame[still][[0, -1]]
    noise = _likeliest(recording, values, still, still_shape=True)
    return _known_deviation(recording, noise), f"frames {first} to {last}, which stand still"


def noise_left(recording: Recording, residual_m: Floats) -> tuple[Noise, str]:
    """The noise of a recording by what a rod leaves of its points (P, A) [m]: what is quick in that."""
    noise = _likeliest(recording, residual_m, np.ones(len(residual_m), dtype=bool), still_shape=False)
    return _known_deviation(recording, noise), "quick part of the residuals"


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
    return still


def _known_deviation(recording: Recording, noise: Noise) -> Noise:
    if recording.position_noise_m is None or recording.position_noise_m <= 0:
        return noise
    return Noise(recording.position_noise_m, noise.correlation_points, noise.correlation_frames)


def _likeliest(recording: Recording, values_m: Floats, used: np.ndarray, still_shape: bool) -> Noise:
    """The noise of greatest restricted likelihood, over the first frames of those used."""
    grid = grid_of(recording, used)
    rows = max(3, MOST_POINTS // grid.columns)
    some = np.flatnonzero(grid.row < rows)
    row, column = grid.row[some], grid.column[some]
    y = values_m[used][some]
    frames = grid.frame[: int(row.max()) + 1]
    if still_shape:
        basis = np.eye(grid.columns)[column]
    else:
        along = _smooth(grid.columns, SMOOTH_S)[column]
        over = _smooth(len(frames), SMOOTH_T)[row]
        basis = (along[:, :, None] * over[:, None, :]).reshape(len(row), -1)
    lag_t = np.abs(frames[row][:, None] - frames[row][None])
    lag_s = np.abs(column[:, None] - column[None])
    axes, dof = y.shape[1], len(y) - np.linalg.matrix_rank(basis)

    def terms(lengths: Floats) -> tuple[float, float]:
        covariance = _decay(lag_s, lengths[0]) * _decay(lag_t, lengths[1])
        root = linalg.cholesky(covariance, lower=True)
        white, seen = (linalg.solve_triangular(root, a, lower=True) for a in (y, basis))
        q, r = linalg.qr(seen, mode="economic")
        left = white - q @ (q.T @ white)
        diagonal = np.abs(np.diag(r))
        log_det = 2 * np.log(np.diag(root)).sum() + 2 * np.log(diagonal[diagonal > 1e-9]).sum()
        return float(np.sum(left**2)), float(log_det)

    def deviance(lengths: Floats) -> float:
        squares, log_det = terms(lengths)
        return float(axes * (dof * np.log(squares / (dof * axes)) + log_det))

    best = optimize.minimize(
        deviance, np.array([0.5, 0.5]), method="L-BFGS-B", bounds=[(1e-3, LONGEST)] * 2
    ).x
    squares, _ = terms(best)
    return Noise(float(np.sqrt(squares / (dof * axes))), float(best[0]), float(best[1]))


def _decay(lag: Floats, length: float) -> Floats:
    return np.asarray(np.exp(-lag / length))


def _smooth(count: int, modes: int) -> Floats:
    """The slowest modes of a discrete cosine transform, (count, modes)."""
    return np.asarray(dct(np.eye(count), axis=1, norm="ortho")[:, : min(modes, max(count // 3, 1))])


__all__ = ["Grid", "Whitener", "grid_of", "known_noise", "noise_left"]
