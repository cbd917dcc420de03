"""The banded solve against SciPy's."""

import numpy as np
import pytest
from scipy.linalg import solveh_banded

from dlolib.sim.band import HALF, factor, row_times, solve
from dlolib.sim.runtime import ti

ROWS = 60


@ti.kernel
def solve_in_place(
    band: ti.types.ndarray(dtype=ti.f64, ndim=3),
    y: ti.types.ndarray(dtype=ti.f64, ndim=3),
    rows: ti.i32,
    definite: ti.i32,
) -> ti.i32:
    failed = factor(band, 0, rows, definite)
    if failed == 0:
        solve(band, 0, y, 0, 0, rows)
    return failed


@ti.kernel
def multiply(
    band: ti.types.ndarray(dtype=ti.f64, ndim=3),
    y: ti.types.ndarray(dtype=ti.f64, ndim=3),
    out: ti.types.ndarray(dtype=ti.f64, ndim=1),
):
    for r in range(out.shape[0]):
        out[r] = row_times(band, 0, y, 0, 0, r)


def random_band(seed: int, diagonal: float) -> np.ndarray:
    """Rows A[r, r] ... A[r, r + HALF], padded as the kernels want them."""
    rng = np.random.default_rng(seed)
    band = np.zeros((1, ROWS + HALF, HALF + 1))
    band[0, :ROWS] = rng.normal(size=(ROWS, HALF + 1))
    band[0, :ROWS, 0] += diagonal
    for k in range(1, HALF + 1):
        band[0, ROWS - k : ROWS, k] = 0
    return band


def dense(band: np.ndarray) -> np.ndarray:
    full = np.zeros((ROWS, ROWS))
    for r in range(ROWS):
        for k in range(min(HALF + 1, ROWS - r)):
            full[r, r + k] = full[r + k, r] = band[0, r, k]
    return full


def test_solves_as_scipy_does() -> None:
    band = random_band(1, 20.0)
    upper = np.zeros((HALF + 1, ROWS))
    for k in range(HALF + 1):
        upper[HALF - k, k:] = band[0, : ROWS - k, k]
    right = np.random.default_rng(2).normal(size=ROWS)
    y = np.zeros((1, 1, ROWS + HALF))
    y[0, 0, :ROWS] = right
    assert solve_in_place(band, y, ROWS, 1) == 0
    assert y[0, 0, :ROWS] == pytest.approx(solveh_banded(upper, right), rel=1e-12, abs=1e-14)


def test_an_indefinite_matrix_is_refused_or_solved_as_asked() -> None:
    band = random_band(3, 0.0)
    assert np.linalg.eigvalsh(dense(band))[0] < 0
    y = np.ones((1, 1, ROWS + HALF))
    y[0, 0, ROWS:] = 0
    assert solve_in_place(band.copy(), y.copy(), ROWS, 1) > 0
    assert solve_in_place(band.copy(), y, ROWS, 0) == 0
    assert dense(band) @ y[0, 0, :ROWS] == pytest.approx(np.ones(ROWS), rel=1e-6)


def test_row_times_is_the_product() -> None:
    band = random_band(4, 5.0)
    y = np.zeros((1, 1, ROWS + HALF))
    y[0, 0, :ROWS] = np.random.default_rng(5).normal(size=ROWS)
    out = np.zeros(ROWS)
    multiply(band, y, out)
    assert out == pytest.approx(dense(band) @ y[0, 0, :ROWS], rel=1e-12)
