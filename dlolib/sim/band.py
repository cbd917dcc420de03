"""Factors of the rod's Hessian, which is banded.

A particle and its segment's frame are six unknowns; each couples only to its neighbours, and a particle
not to the next frame, so the half bandwidth is 8. Row r of `band[b]` holds A[r, r], ..., A[r, r + 8];
eight rows of zeros follow the last, so that no loop asks where the matrix ends.
"""

from dlolib.sim.runtime import ti

HALF = 8


@ti.func
def factor(band: ti.template(), b: int, rows: int, definite: int) -> int:
    """A = L D L^T in place: row r then holds 1 / D[r] and column r of L. Returns 0, or r + 1 where it broke.

    With `definite` = 1 a pivot that is not positive breaks it down (an energy has no minimum there);
    with 0 only one that is zero does.
    """
    failed = 0
    for r in range(rows):
        pivot = band[b, r, 0]
        if failed == 0:
            if pivot > 0.0 or (definite == 0 and pivot < 0.0):
                inverse = 1.0 / pivot
                band[b, r, 0] = inverse
                for i in ti.static(range(1, HALF + 1)):
                    u = band[b, r, i] * inverse
                    for k in ti.static(range(HALF + 1 - i)):
                        band[b, r + i, k] = band[b, r + i, k] - u * band[b, r, i + k]
                for i in ti.static(range(1, HALF + 1)):
                    band[b, r, i] = band[b, r, i] * inverse
            else:
                failed = r + 1
    return failed


@ti.func
def solve(band: ti.template(), m: int, y: ti.template(), b: int, c: int, rows: int):
    """Column c of y[b]: y <- A^-1 y, with the factor that `factor` left in band[m]."""
    for r in range(rows):
        value = y[b, c, r]
        for k in ti.static(range(1, HALF + 1)):
            y[b, c, r + k] = y[b, c, r + k] - band[m, r, k] * value
    for back in range(rows):
        r = rows - 1 - back
        value = y[b, c, r] * band[m, r, 0]
        for k in ti.static(range(1, HALF + 1)):
            value -= band[m, r, k] * y[b, c, r + k]
        y[b, c, r] = value


@ti.func
def row_times(band: ti.template(), m: int, y: ti.template(), b: int, c: int, r: int) -> float:
    """(A y)[r] of column c of y[b], for an A in band[m] that is not factored."""
    value = band[m, r, 0] * y[b, c, r]
    for k in ti.static(range(1, HALF + 1)):
        value += band[m, r, k] * y[b, c, r + k]
        if r - k >= 0:
            value += band[m, r - k, k] * y[b, c, r - k]
    return value
