"""Smoothing of evenly spaced readings along the rope."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded
from scipy.sparse import csc_array, csr_array
from scipy.special import binom

from dlolib.types import Floats

DEGREE, ORDER = 3, 4
# So many splines to half a wave: more change nothing, and where a wave is long they are few.
SPLINES = 5
# A trace of weight everywhere keeps the system regular; it draws towards the readings to both sides.
TRACE = 1e-9
# Beyond its outermost readings a curve goes straight on for this share of half a wave, then stays.
STRAIGHT_ON = 0.15
# What a curve smoothed through white noise leaves of it in the means of such blocks. So many times that is no
# chance, where there are so many blocks.
WHITE_BLOCKS, SURELY, FEWEST_BLOCKS = 0.5, 2.0, 6


def smoothed(readings: Floats, weights: Floats, half_wave: float, onward: bool = False) -> Floats:
    """Smooth readings (N,) or (N, K) with weights (N,) ≥ 0, halving waves of length 2 `half_wave`.

    P-splines (Eilers and Marx, Statistical Science 11, 1996) with fourth differences: they leave a curvature
    that changes evenly as it is, up to the very ends, where that of a clamped rope changes most, and carry
    the curve across inner readings of weight 0. `half_wave` is counted in samples. Beyond the outermost
    readings it soon stays as it is; a line that goes `onward` bends on there as it did. Too few samples for a
    spline come back as read, those of weight 0 between or beside the others.
    """
    read = np.flatnonzero(weights > 0)
    if not len(read):
        return np.array(readings, dtype=np.float64)
    columns = np.reshape(readings, (len(readings), -1)).astype(np.float64)
    at = np.arange(len(readings))
    between = np.stack([np.interp(at, read, column[read]) for column in columns.T], axis=-1)
    if len(readings) <= ORDER:
        return between.reshape(np.shape(readings))
    share = weights[:, None] / weights.mean()
    basis, turned, banded = _system(weights, half_wave)
    right = turned @ (share * columns + TRACE * between)
    curve = basis @ solveh_banded(banded, right, check_finite=False)
    if not onward:
        first, last = read[0], read[-1]
        most = min(STRAIGHT_ON * half_wave, 0.5 * (last - first))
        slope = np.gradient(curve[first : last + 1], axis=0) if last > first else np.zeros_like(curve[:1])
        inner = np.clip(at, first, last)
        beyond = np.clip(at - inner, -most, most)
        curve = curve[inner] + beyond[:, None] * slope[inner - first]
    return np.asarray(curve.reshape(np.shape(readings)), dtype=np.float64)


def noise_gain(weights: Floats, half_wave: float) -> Floats:
    """Deviation (N,) of what `smoothed` gives where single readings of deviation 1 came `weights` a sample.

    A sample's reading then is the mean of so many; the smoother is linear, so this is exact.
    """
    mean = max(float(weights.mean()), 1e-12)
    if len(weights) <= ORDER or not weights.any():
        return np.full(len(weights), 1 / np.sqrt(mean))
    basis, turned, banded = _system(weights, half_wave)
    response = basis @ solveh_banded(banded, turned.toarray(), check_finite=False)
    gain: Floats = np.sqrt((response**2) @ (weights / mean) / mean)
    return gain


def noise_together(sample: NDArray[np.intp], rest: Floats, half_wave: float) -> float:
    """How much more of the readings' scatter smoothing leaves than if each were off by itself.

    A stereo camera matches patches: readings beside each other are off together, and so is their mean. Blocks
    of half a half wave tell: how far off their means are, over what single readings would make of it. 1 where
    white noise may leave as much.

    Args:
        sample: of each reading, (M,).
        rest: how far it is off a curve smoothed through all, (M,) [m].
        half_wave: as for `smoothed`, in samples.
    """
    block = sample // max(round(0.5 * half_wave), 1)
    count = np.bincount(block)
    filled = count > 0
    if filled.sum() < FEWEST_BLOCKS or np.ptp(rest) == 0.0:
        return 1.0
    sums = np.bincount(block, rest - rest.mean())
    found = float(np.mean(sums[filled] ** 2 / count[filled]) / rest.var()) / WHITE_BLOCKS
    return float(np.sqrt(found)) if found > SURELY else 1.0


def _system(weights: Floats, half_wave: float) -> tuple[csr_array, csc_array, Floats]:
    """The splines (N, K), the same turned (K, N), and their normal equations, in the upper banded form of
    scipy.linalg.

    No wave is shorter than two samples: else nothing would carry the curve across what was not read.
    """
    half_wave = max(half_wave, 1.0)
    steps = max(int(np.ceil((len(weights) - 1) / max(half_wave / SPLINES, 1.0))), 1)
    step = (len(weights) - 1) / steps
    basis, turned, penalty = _splines(len(weights), steps)
    weights = weights / weights.mean() + TRACE
    # at each sample so many splines are not zero, one beside the other
    first = basis.indices[::ORDER]
    values = basis.data.reshape(-1, ORDER).T
    banded = step * (half_wave / (np.pi * step)) ** (2 * ORDER) * penalty
    for i in range(ORDER):
        for j in range(i, ORDER):
            products = weights * values[i] * values[j]
            banded[ORDER + i - j] += np.bincount(first + j, products, minlength=basis.shape[1])
    return basis, turned, banded


@lru_cache(maxsize=512)
def _splines(count: int, steps: int) -> tuple[csr_array, csc_array, Floats]:
    """Splines over so many samples in so many even steps, (count, K), the same turned, and the penalty of
    their differences, (ORDER + 1, K), banded. Lines of one rope have much the same counts in all frames."""
    step = (count - 1) / steps
    knots = step * np.arange(-DEGREE, steps + DEGREE + 1)
    at = np.clip(np.arange(count, dtype=np.float64), 0, steps * step)
    basis = BSpline.design_matrix(at, knots, DEGREE)
    splines = steps + DEGREE
    differences = [(-1) ** (ORDER - k) * binom(ORDER, k) for k in range(ORDER + 1)]
    banded = np.zeros((ORDER + 1, splines))
    for k in range(ORDER + 1):
        for j in range(k, ORDER + 1):
            lag = j - k
            banded[ORDER - lag, j : splines - ORDER + j] += differences[k] * differences[j]
    return basis, basis.T, banded
