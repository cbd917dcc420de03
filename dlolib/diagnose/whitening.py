"""Residuals rid of the noise's correlation, and of errors that last.

Correlated noise, exp(-lag / value) along the rope and over the frames, is an autoregressive process in both
directions, whose whitening is exact and two-diagonal.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.fft import dct
from scipy.sparse.linalg import SuperLU, splu

from dlolib.identify.problem import seen_axes
from dlolib.types import Floats, Ints, Noise, Recording

# The slow modes, over frames and along the rope.
MODES = 8


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
    """The used points of a recording as a grid: by arc length, or by rank where frames share none or
    hold two points that are hardly apart."""
    points = recording.points
    frame, row = np.unique(points.frame[used], return_inverse=True)
    arc = np.round(points.s_m[used] / recording.rope.length_m, 5)
    places, column = np.unique(arc, return_inverse=True)
    most = int(np.bincount(row).max())
    # two points of one frame that are hardly apart would share a place
    crowded = len(np.unique(row * len(places) + column)) < len(row)
    if crowded or len(places) > 2 * most:
        first = np.searchsorted(row, np.arange(len(frame)))
        column = np.arange(len(row)) - first[row]
        return Grid(frame, row, column, most)
    return Grid(frame, row, column, len(places))


@dataclass(frozen=True)
class ModesOfNoise:
    """How noise lies in a whitened grid in which some places were not seen: more of it in some modes.

    places: how many were seen. covariance: of the slow modes of a cosine transform over frames and places,
    (M, N, M, N), of each axis; the identity where all places were seen.
    """

    places: int
    covariance: Floats


@dataclass(frozen=True)
class Whitener:
    """Makes the residuals of one recording independent, of variance 1 where there is but noise.

    Args:
        grid: of the points.
        noise: deviation and correlation.
        covariance_m2: of each point (P, A, A) where the recording gives it: in the place of the deviation.
        lasting_m: errors (P, A, M) that may be there besides, each with a size of deviation 1.
    """

    grid: Grid
    noise: Noise
    covariance_m2: Floats | None = None
    lasting_m: Floats | None = None

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
        white = self._rid_of_correlation(values_m)
        if self._shrunk is not None:
            ways, by = self._shrunk
            flat = white.reshape(len(ways), -1)
            white = (flat - ways @ (by[:, None] * (ways.T @ flat))).reshape(white.shape)
        return white

    def _rid_of_correlation(self, values_m: Floats) -> Floats:
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
    def _shrunk(self) -> tuple[Floats, Floats] | None:
        """Directions (N, M) among N whitened values, and by which share of themselves lasting errors shrink
        what lies in them: (1 + U U^T)^(-1/2), U the whitened errors."""
        if self.lasting_m is None:
            return None
        errors = self._rid_of_correlation(self.lasting_m)
        ways, sizes, _ = np.linalg.svd(errors.reshape(-1, errors.shape[-1]), full_matrices=False)
        return ways, 1 - 1 / np.sqrt(1 + sizes**2)

    @cached_property
    def noise_modes(self) -> ModesOfNoise:
        """What is to be expected of noise alone: with P, which takes out what was not seen, and the modes S,
        their covariance is S P S^T."""
        over_frames, over_places = (dct(np.eye(n), axis=0, norm="ortho")[:MODES] for n in self.shape)
        modes = np.kron(over_frames, over_places)
        covariance = np.eye(len(modes))
        if self._missing is not None:
            unseen, factor = self._missing
            hidden = unseen.T @ modes.T
            covariance -= hidden.T @ factor.solve(hidden)
        shape = len(over_frames), len(over_places)
        return ModesOfNoise(len(self._place), covariance.reshape(*shape, *shape))

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


def lasting(
    recording: Recording, used: np.ndarray, grid: Grid, covariance_m2: Floats | None
) -> Floats | None:
    """The part of a named camera's error that is the same in every frame, as `Whitener` takes it.

    No number of frames averages it away. It is taken for as large as the noise: each place on the rope is off
    by as much as a point, alike for neighbours as far as noise is; all are shifted by as much; and turned, by
    what moves points a rope's length away by as much.
    """
    noise = recording.noise
    if recording.world_from_camera is None or noise is None:
        return None
    seen = seen_axes(recording)
    points = recording.points.xyz_m[used]
    lags = np.abs(np.subtract.outer(np.arange(grid.columns), np.arange(grid.columns)))
    alike = np.linalg.cholesky(decay(lags, max(noise.correlation_points, 1e-9)))[grid.column]
    if covariance_m2 is None:
        covariance_m2 = np.tile(noise.sigma_m**2 * np.eye(len(seen)), (len(points), 1, 1))
    deviations = np.linalg.cholesky(covariance_m2)
    places = np.einsum("pab,pc->pabc", deviations, alike).reshape(*deviations.shape[:2], -1)
    shifts = np.tile(noise.sigma_m * np.eye(3), (len(points), 1, 1))
    arms = np.cross(points[:, None] - points.mean(axis=0), np.eye(3)).swapaxes(1, 2)
    turns = noise.sigma_m / recording.rope.length_m * arms
    return np.concatenate([places, np.concatenate([shifts, turns], axis=2)[:, seen]], axis=2)


def decay(lag: Floats, length: float) -> Floats:
    return np.asarray(np.exp(-lag / length))


__all__ = ["MODES", "Grid", "ModesOfNoise", "Whitener", "decay", "grid_of", "lasting"]
