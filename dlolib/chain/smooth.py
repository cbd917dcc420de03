"""Smoothing of evenly spaced readings along the rope."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded
from scipy.special import binom

from dlolib.types import Floats

ORDER = 3
# Beyond its outermost readings a curve goes straight on for this share of half a wave, then stays.
STRAIGHT_ON = 0.15


def whittaker(readings: Floats, weights: Floats, half_wave: float) -> Floats:
    """Smooth readings (N,) or (N, K) with weights (N,) ≥ 0, halving waves of length 2 `half_wave`.

    Whittaker's smoother (Eilers, Anal. Chem. 75, 2003) with third differences: it leaves a constant
    curvature as it is, up to the very ends, which a smoothing spline with natural ends does not; and it
    carries the curve across inner readings of weight 0. `half_wave` is counted in samples.
    """
    count = len(readings)
    if count <= ORDER:
        return np.array(readings, dtype=np.float64)
    stiffness = (half_wave / np.pi) ** (2 * ORDER)
    mean = max(float(weights.mean()), 1e-12)
    banded = stiffness * _penalty(count)
    # A trace of weight everywhere keeps the system regular where nothing was read.
    banded[-1] += weights / mean + 1e-9
    trend = (weights / mean)[:, None] * np.reshape(readings, (count, -1))
    smooth = solveh_banded(banded, trend, check_finite=False)
    read = np.flatnonzero(weights > 0)
    if len(read):
        # Beyond the outermost readings it would go on in a parabola.
        first, last = read[0], read[-1]
        most = min(STRAIGHT_ON * half_wave, 0.5 * (last - first))
        slope = np.gradient(smooth[first : last + 1], axis=0) if last > first else np.zeros_like(smooth[:1])
        inner = np.clip(np.arange(count), first, last)
        beyond = np.clip(np.arange(count) - inner, -most, most)
        smooth = smooth[inner] + beyond[:, None] * slope[inner - first]
    return np.asarray(smooth.reshape(readings.shape), dtype=np.float64)


def noise_gain(weights: Floats, half_wave: float) -> Floats:
    """Deviation (N,) of what `whittaker` gives where single readings of deviation 1 came `weights` a sample.

    A sample's reading then is the mean of so many; the smoother is linear, so this is exact.
    """
    count = len(weights)
    mean = max(float(weights.mean()), 1e-12)
    if count <= ORDER:
        return np.full(count, 1 / np.sqrt(max(mean, 1e-12)))
    banded = (half_wave / np.pi) ** (2 * ORDER) * _penalty(count)
    banded[-1] += weights / mean + 1e-9
    response = solveh_banded(banded, np.eye(count), check_finite=False)
    gain: Floats = np.sqrt((response**2) @ (weights / mean) / mean)
    return gain


def _penalty(count: int) -> Floats:
    """DᵀD of the third difference D, (4, count) in the upper banded form of scipy.linalg."""
    steps = np.array([(-1) ** (ORDER - k) * binom(ORDER, k) for k in range(ORDER + 1)])
    banded = np.zeros((ORDER + 1, count))
    for k in range(ORDER + 1):
        for j in range(k, ORDER + 1):
            lag = j - k
            banded[ORDER - lag, j : count - ORDER + j] += steps[k] * steps[j]
    return banded
