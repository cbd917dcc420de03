"""The tracker's noise: normal, correlated by exp(-lag / length) over points and frames, and lost points."""

from __future__ import annotations

import numpy as np

from dlolib.types import Floats, Noise


def decay(correlation: float) -> float:
    """Correlation of neighbours for a correlation length in points or frames."""
    return float(np.exp(-1 / correlation)) if correlation > 0 else 0.0


def draw_noise(rng: np.random.Generator, noise: Noise, shape: tuple[int, int, int]) -> Floats:
    """Noise [m] of shape (F, P, 3): an autoregression of first order along frames and along points."""
    white = rng.normal(size=shape) * noise.sigma_m
    along = _regress(white, decay(noise.correlation_frames))
    return _regress(along.swapaxes(0, 1), decay(noise.correlation_points)).swapaxes(0, 1)


def whiten(error: Floats, noise: Noise) -> Floats:
    """What the noise's inverse covariance makes of errors (F, P, 3): a sum of squares is a chi-squared."""
    flat = _deregress(error / noise.sigma_m, decay(noise.correlation_frames))
    return _deregress(flat.swapaxes(0, 1), decay(noise.correlation_points)).swapaxes(0, 1)


def _regress(white: Floats, rho: float) -> Floats:
    found = white.copy()
    for index in range(1, len(found)):
        found[index] = rho * found[index - 1] + np.sqrt(1 - rho**2) * white[index]
    return found


def _deregress(values: Floats, rho: float) -> Floats:
    found = values.copy()
    found[1:] = (values[1:] - rho * values[:-1]) / np.sqrt(1 - rho**2)
    return found
