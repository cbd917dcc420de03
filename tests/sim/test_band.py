"""The banded solve against NumPy's."""

import numpy as np
import pytest

from dlolib.sim.assembly import bands, scalars3
from dlolib.sim.band import HALF, entry, factor, solve, solve_lanes, solve_transposed
from dlolib.sim.derivatives import lanes3
from dlolib.sim.runtime import LANES, ti

ROWS = 60


@ti.kernel
def solved(
    upper: bands, lower: bands, factors: bands, under: bands, y: scalars3, symmetric: ti.i32,
    definite: ti.i32, transposed: ti.i32,
) -> ti.i32:  # fmt: skip
    rows = y.shape[2] - HALF
    failed = factor(upper, lower, 0, factors, under, rows, symmetric, definite)
    if failed == 0:
        if transposed == 1 and symmetric == 0:
            solve_transposed(factors, under, 0, y, 0, 0, rows)
        else:
            solve(factors, under, 0, y, 0, 0, rows, symmetric)
    return failed


@ti.kernel
def solve_together(upper: bands, lower: bands, y: lanes3, symmetric: ti.i32):
    rows = y.shape[2] - HALF
    factor(upper, lower, 0, upper, lower, rows, symmetric, 1)
    for g in range(y.shape[1]):
        solve_lanes(upper, lower, 0, y, 0, g, rows, symmetric)


@ti.kernel
def entries(upper: bands, lower: bands, out: scalars3, symmetric: ti.i32):
    for r in range(out.shape[2]):
        before = ti.max(r - 2, 0)
        out[0, 0, r] = entry(upper, lower, 0, r, before, symmetric)
        out[0, 1, r] = entry(upper, lower, 0, before, r, symmetric)


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
@pytest.mark.parametrize("apart", [True, False])
def test_solves_as_numpy_does(symmetric: bool, transposed: bool, apart: bool) -> None:
    """Apart from the matrix, which then stays as it is, or in its place."""
    a, upper, lower = banded(1, 20.0, symmetric)
    if symmetric:
        lower[:] = np.nan  # not read
    y = np.zeros((1, 1, ROWS + HALF))
    y[0, 0, :ROWS] = right = np.random.default_rng(2).normal(size=ROWS)
    before = upper.copy()
    into = (np.full_like(upper, np.nan), np.full_like(lower, np.nan)) if apart else (upper, lower)
    assert solved(upper, lower, *into, y, int(symmetric), 1, int(transposed)) == 0
    assert np.array_equal(upper, before) is apart
    assert y[0, 0, :ROWS] == pytest.approx(np.linalg.solve(a.T if transposed else a, right), rel=1e-12)


def test_an_indefinite_matrix_breaks_down_only_where_an_energy_is_asked_for() -> None:
    _, upper, lower = banded(1, 0.5, True)
    y = np.zeros((1, 1, ROWS + HALF))
    apart = np.zeros_like(upper), np.zeros_like(lower)
    assert solved(upper, lower, *apart, y, 1, 1, 0) > 0
    assert solved(upper, lower, *apart, y, 1, 0, 0) == 0


@pytest.mark.parametrize("symmetric", [True, False])
def test_columns_are_solved_together_as_numpy_does(symmetric: bool) -> None:
    a, upper, lower = banded(1, 20.0, symmetric)
    y = np.zeros((1, 2, ROWS + HALF, LANES))
    y[0, :, :ROWS] = right = np.random.default_rng(2).normal(size=(2, ROWS, LANES))
    solve_together(upper, lower, y, int(symmetric))
    for mine, own in zip(y[0, :, :ROWS], right, strict=True):
        np.testing.assert_allclose(mine, np.linalg.solve(a, own), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("symmetric", [True, False])
def test_entries(symmetric: bool) -> None:
    a, upper, lower = banded(3, 1.0, symmetric)
    if symmetric:
        lower[:] = np.nan  # not read
    out = np.zeros((1, 2, ROWS))
    entries(upper, lower, out, int(symmetric))
    before = np.maximum(np.arange(ROWS) - 2, 0)
    assert (out[0, 0] == a[np.arange(ROWS), before]).all()
    assert (out[0, 1] == a[before, np.arange(ROWS)]).all()
