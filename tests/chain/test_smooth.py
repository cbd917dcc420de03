"""The smoother, and what it leaves of noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from dlolib.chain.smooth import noise_gain, noise_together, smoothed


def test_the_smoother_keeps_curvature_to_its_ends_and_takes_noise_away() -> None:
    at = np.linspace(-1, 1, 301)
    parabola = 30 * at**2
    np.testing.assert_allclose(smoothed(parabola, np.ones(301), 20), parabola, atol=1e-5)
    noisy = parabola + np.random.default_rng(1).normal(size=301)
    assert np.std(smoothed(noisy, np.ones(301), 20) - parabola) < 0.35


@pytest.mark.parametrize("half_wave", [20, 200])
def test_the_smoother_keeps_a_curvature_that_changes_evenly(half_wave: float) -> None:
    """As beside a clamp; and no rounding is taken for a bend where waves are long (a near camera)."""
    at = np.linspace(-1, 1, 901)
    clamped = 300 + 200 * at + 150 * at**2 - 80 * at**3
    np.testing.assert_allclose(smoothed(clamped, np.ones(901), half_wave), clamped, atol=1e-4)


def test_the_smoother_halves_waves_of_twice_the_half_wave() -> None:
    at = np.arange(901.0)
    for half_wave in (7.0, 20.0, 60.0):
        wave = np.sin(np.pi * at / half_wave)
        inner = smoothed(wave, np.ones(901), half_wave)[300:600]
        assert np.abs(inner).max() == pytest.approx(0.5, abs=0.02)


def test_the_smoother_goes_straight_on_past_its_outermost_readings_and_then_stays() -> None:
    at = np.arange(101.0)
    weights = np.zeros(101)
    weights[10:91] = 1
    smooth = smoothed(np.where(weights > 0, 0.5 * at, 99.0), weights, 20)
    np.testing.assert_allclose(smooth[7:94], 0.5 * at[7:94], atol=1e-6)
    np.testing.assert_allclose(smooth[:7], 3.5, atol=1e-6)
    np.testing.assert_allclose(smooth[94:], 46.5, atol=1e-6)


def test_the_smoother_bridges_readings_without_weight() -> None:
    at = np.linspace(-1, 1, 301)
    weights = np.ones(301)
    weights[100:140] = 0
    wild = np.where(weights > 0, at**2, 99.0)
    np.testing.assert_allclose(smoothed(wild, weights, 10), at**2, atol=1e-4)


@pytest.mark.parametrize("half_wave", [0.02, 1.0, 10.0])
def test_no_wave_is_too_short_to_carry_the_curve_across_a_gap(half_wave: float) -> None:
    readings, weights = np.arange(300) / 20.0, np.ones(300)
    weights[40:260] = 0
    assert smoothed(np.where(weights, readings, 7.0), weights, half_wave) == pytest.approx(readings, abs=0.01)


def test_samples_too_few_to_smooth_take_no_reading_of_weight_0() -> None:
    """As where depth was read nowhere near: what stands there is a 0, a point at the camera."""
    weights = np.array([0.0, 3.0, 0.0, 1.0])
    np.testing.assert_allclose(smoothed(np.array([0.0, 0.7, 0.0, 0.9]), weights, 20), [0.7, 0.7, 0.8, 0.9])
    places = np.array([[0.0, 0.0], [1.0, 2.0], [0.0, 0.0], [3.0, 4.0]])
    np.testing.assert_allclose(smoothed(places, weights, 20), [[1, 2], [1, 2], [2, 3], [3, 4]])


@pytest.mark.parametrize(("grain_px", "least", "most"), [(0.0, 1.0, 1.0), (1.0, 2.0, 5.0), (2.0, 3.0, 9.0)])
def test_noise_that_goes_together_is_told_and_what_is_left_of_it(
    grain_px: float, least: float, most: float
) -> None:
    """Readings over a rope five pixels wide; the curve is not much further off than foretold."""
    rng, count, half_wave = np.random.default_rng(3), 400, 20.0
    sample = np.repeat(np.arange(count), 5)
    weights, off, foretold = np.full(count, 5.0), [], []
    for _ in range(20):
        noise = rng.normal(size=(count, 5))
        noise = gaussian_filter(noise, grain_px, mode="wrap") if grain_px else noise
        noise /= noise.std()
        curve = smoothed(noise.mean(axis=1), weights, half_wave)
        rest = noise.ravel() - curve[sample]
        together = noise_together(sample, rest, half_wave)
        assert least <= together <= most
        off.append(curve)
        foretold.append(together * rest.std() * noise_gain(weights, half_wave).mean())
    assert 0.7 < np.mean(foretold) / np.std(off) < 1.1


def test_of_few_readings_nothing_is_told() -> None:
    rest = np.ones(40)
    rest[::2] = -1.0
    assert noise_together(np.arange(40), rest, 20.0) == 1.0
    assert noise_together(np.arange(400), np.zeros(400), 20.0) == 1.0
    assert noise_together(np.zeros(0, int), np.zeros(0), 20.0) == 1.0
