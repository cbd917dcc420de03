"""The banded solve against NumPy's."""

import numpy as np
import pytest

from dlolib.sim.assembly import bands, scalars3
from dlolib.sim.band import HALF, entry, factor, solve, solve_transposed, times_column
from dlolib.sim.runtime import ti

ROWS = 60


@ti.kernel
def solve_in_place(
    upper: bands, lower: bands, y: scalars3, symmetric: ti.i32, definite: ti.i32, transposed: ti.i32
) -> ti.i32:
    rows = y.shape[2] - HALF
    failed = factor(upper, lower, 0, rows, symmetric, definite)
    if failed == 0:
        if transposed == 1:
            solve_transposed(upper, lower, 0, y, 0, 0, rows)
        else:
            solve(upper, lower, 0, y, 0, 0, rows)
    return failed


@ti.kernel
def multiply(upper: bands, lower: bands, y: scalars3, out: scalars3):
    for r in range(out.shape[2]):
        out[0, 0, r] = times_column(upper, lower, 0, y, 0, 0, r)
        out[0, 1, r] = entry(upper, lower, 0, r, ti.max(r - 2, 0)) + entry(
            upper, lower, 0, ti.max(r - 2, 0), r
        )


def banded(seed: int, diagonal: float, symmetric: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A random matrix, dense and as the two parts that the kernels want."""
    rng = np.random.default_rng(seed)
    a = np.triu(np.tril(rng.normal(size=(ROWS, ROWS)), HALF), -HALF)
    row, column = np.indices(a.shape)
    a[np.maximum(row, column) > 3 * (np.minimum(row, column) // 3) + HALF] = 0.0
    if symmetric:
        a = np.triu(a) + np.triu(a, 1).T
    a += diagonal * np.eye(ROWS)
    upper, lower = np.zeros((1, ROWS + HALF, HALF + 1)), np.zeros((1, ROWS + HALF, HALF + 1))
    for r in range(ROWS):
        for k in range(min(HALF + 1, ROWS - r)):
            upper[0, r, k], lower[0, r, k] = a[r, r + k], a[r + k, r]
    return a, upper, lower


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("transposed", [True, False])
def test_solves_as_numpy_does(symmetric: bool, transposed: bool) -> None:
    a, upper, lower = banded(1, 20.0, symmetric)
    if symmetric:
        lower[:] = np.nan  # not read
        lower[0, ROWS:] = 0.0
    y = np.zeros((1, 1, ROWS + HALF))
    y[0, 0, :ROWS] = right = np.random.default_rng(2).normal(size=ROWS)
    assert solve_in_place(upper, lower, y, int(symmetric), 1, int(transposed)) == 0
    assert y[0, 0, :ROWS] == pytest.approx(np.linalg.solve(a.T if transposed else a, right), rel=1e-12)


def test_an_indefinite_matrix_breaks_down_only_where_an_energy_is_asked_for() -> None:
    _, upper, lower = banded(1, 0.5, True)
    y = np.zeros((1, 1, ROWS + HALF))
    assert solve_in_place(upper.copy(), lower.copy(), y, 1, 1, 0) > 0
    assert solve_in_place(upper, lower, y, 1, 0, 0) == 0


def test_products_and_entries() -> None:
    a, upper, lower = banded(3, 1.0, False)
    y, out = np.zeros((1, 1, ROWS + HALF)), np.zeros((1, 2, ROWS))
    y[0, 0, :ROWS] = right = np.random.default_rng(4).normal(size=ROWS)
    multiply(upper, lower, y, out)
    assert out[0, 0] == pytest.approx(a.T @ right, rel=1e-12)
    both = [a[r, max(r - 2, 0)] + a[max(r - 2, 0), r] for r in range(ROWS)]
    assert out[0, 1] == pytest.approx(np.array(both), rel=1e-14)
