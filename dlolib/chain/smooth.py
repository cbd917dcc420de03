"""Smoothing of evenly spaced readings along the rope."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg.lapack import dpbsv
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
    splines, banded = _system(weights, half_wave)
    right = splines.turned @ (share * columns + TRACE * between)
    curve = splines.basis @ _solved(banded, right)
    if not onward:
        first, last = read[0], read[-1]
        most = min(STRAIGHT_ON * half_wave, 0.5 * (last - first))
        before, after = np.clip(at - first, -most, 0), np.clip(at - last, 0, most)
        ends = np.diff(curve[[first, first + (last > first), last - (last > first), last]], axis=0)
        curve = curve[np.clip(at, first, last)] + before[:, None] * ends[0] + after[:, None] * ends[2]
    return np.asarray(curve.reshape(np.shape(readings)), dtype=np.float64)


def noise_gain(weights: Floats, half_wave: float) -> Floats:
    """Deviation (N,) of what `smoothed` gives where single readings of deviation 1 came `weights` a sample.

    A sample's reading then is the mean of so many; the smoother is linear, so this is exact.
    """
    mean = max(float(weights.mean()), 1e-12)
    if len(weights) <= ORDER or not weights.any():
        return np.full(len(weights), 1 / np.sqrt(mean))
    splines, banded = _system(weights, half_wave)
    response = splines.basis @ _solved(banded, splines.turned.toarray())
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


@dataclass(frozen=True)
class _Splines:
    """K splines over N samples: their values (N, K), the same turned (K, N), their products as what weights
    (N,) make of normal equations, and the penalty of their differences; both in the upper banded form of
    LAPACK, (ORDER + 1, K), which the products (.., N) have unrolled."""

    basis: csr_array
    turned: csc_array
    products: csr_array
    penalty: Floats


def _system(weights: Floats, half_wave: float) -> tuple[_Splines, Floats]:
    """The splines, and their normal equations with these weights, banded.

    No wave is shorter than two samples: else nothing would carry the curve across what was not read.
    """
    half_wave = max(half_wave, 1.0)
    steps = max(int(np.ceil((len(weights) - 1) / max(half_wave / SPLINES, 1.0))), 1)
    step = (len(weights) - 1) / steps
    splines = _splines(len(weights), steps)
    held = step * (half_wave / (np.pi * step)) ** (2 * ORDER) * splines.penalty
    told = splines.products @ (weights / weights.mean() + TRACE)
    return splines, held + told.reshape(held.shape)


def _solved(banded: Floats, right: Floats) -> Floats:
    """Of positive definite equations; `scipy.linalg.solveh_banded` without its checks, which take longer."""
    _, answer, failed = dpbsv(banded, right)
    if failed:
        raise np.linalg.LinAlgError("the splines' normal equations are not positive definite")
    return np.asarray(answer)


@lru_cache(maxsize=512)
def _splines(count: int, steps: int) -> _Splines:
    """Splines over so many samples in so many even steps. Lines of one rope have much the same counts in all
    frames."""
    step = (count - 1) / steps
    knots = step * np.arange(-DEGREE, steps + DEGREE + 1)
    at = np.clip(np.arange(count, dtype=np.float64), 0, steps * step)
    basis = BSpline.design_matrix(at, knots, DEGREE)
    splines = steps + DEGREE
    # at each sample so many splines are not zero, one beside the other
    first, values = basis.indices[::ORDER], basis.data.reshape(-1, ORDER).T
    one, other = np.triu_indices(ORDER)
    place = (ORDER + one - other)[:, None] * splines + first + other[:, None]
    sample = np.broadcast_to(np.arange(count), place.shape)
    shape = ((ORDER + 1) * splines, count)
    products = csr_array(((values[one] * values[other]).ravel(), (place.ravel(), sample.ravel())), shape)
    differences = [(-1) ** (ORDER - k) * binom(ORDER, k) for k in range(ORDER + 1)]
    penalty = np.zeros((ORDER + 1, splines))
    for k in range(ORDER + 1):
        for j in range(k, ORDER + 1):
            lag = j - k
            penalty[ORDER - lag, j : splines - ORDER + j] += differences[k] * differences[j]
    return _Splines(basis, basis.T, products, penalty)
