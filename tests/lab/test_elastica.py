"""The exact elastica meets its ends, its limits and its equation."""

import numpy as np
import pytest
from scipy.optimize import brentq

from dlolib.errors import SimulationError
from dlolib.lab.elastica import planar_elastica

LENGTH, STIFFNESS, WEIGHT = 0.445, 3e-4, 0.04 * 9.81


@pytest.mark.parametrize("end", [(0.36, 0.0), (0.2, 0.196), (0.067, 0.177), (0.3, -0.1), (0.25, -0.3)])
def test_ends_length_and_moment_balance(end: tuple[float, float]) -> None:
    s, x, z, theta = planar_elastica(LENGTH, STIFFNESS, WEIGHT, (0.0, 0.0), 0.0, end, 0.0, points=801)
    assert np.allclose([x[0], z[0], x[-1], z[-1]], [0, 0, *end], atol=1e-9)
    assert np.allclose(theta[[0, -1]], 0, atol=1e-9)
    assert np.hypot(np.diff(x), np.diff(z)).sum() == pytest.approx(LENGTH, rel=1e-5)
    # Moment balance about the middle: what two unknown force components cannot explain must vanish.
    bend = STIFFNESS * np.gradient(np.gradient(theta, s), s)[10:-10] + WEIGHT * (s * np.cos(theta))[10:-10]
    matrix = np.column_stack([np.sin(theta), -np.cos(theta)])[10:-10]
    left = bend - matrix @ np.linalg.lstsq(matrix, bend, rcond=None)[0]
    assert np.abs(left).max() < 2e-3 * np.abs(bend).max()


def test_a_limp_rope_hangs_as_a_catenary() -> None:
    span = 0.3
    a = brentq(lambda a: 2 * a * np.sinh(span / 2 / a) - LENGTH, 0.02, 1.0)
    slope = np.arctan(np.sinh(span / 2 / a))
    _, x, z, _ = planar_elastica(LENGTH, 1e-7, WEIGHT, (0.0, 0.0), -slope, (span, 0.0), slope)
    exact = a * (np.cosh((x - span / 2) / a) - np.cosh(span / 2 / a))
    assert np.abs(z - exact).max() < 1e-4


def test_a_guess_is_followed_and_a_stiffer_rope_bends_less_sharply() -> None:
    soft = planar_elastica(LENGTH, 1e-4, WEIGHT, (0.0, 0.0), 0.0, (0.36, 0.0), 0.0)
    stiff = planar_elastica(LENGTH, 3e-4, WEIGHT, (0.0, 0.0), 0.0, (0.36, 0.0), 0.0, guess=soft)
    fresh = planar_elastica(LENGTH, 3e-4, WEIGHT, (0.0, 0.0), 0.0, (0.36, 0.0), 0.0)
    assert np.allclose(stiff[2], fresh[2], atol=1e-7)
    assert np.ptp(np.diff(stiff[3])) < 0.9 * np.ptp(np.diff(soft[3]))


def test_ends_too_far_apart() -> None:
    with pytest.raises(SimulationError, match="apart"):
        planar_elastica(LENGTH, STIFFNESS, WEIGHT, (0.0, 0.0), 0.0, (0.5, 0.0), 0.0)
