"""Factors of the rod's Hessian, which is banded.

A particle and its segment's frame are six unknowns; each couples only to its neighbours, and a particle
not to the next frame, so the half bandwidth is 8. Row r of `upper[m]` holds A[r, r], ..., A[r, r + 8], row
r of `lower[m]` the column A[r, r], ..., A[r + 8, r] (its first entry is not used); eight rows of zeros follow
the last, so that no loop asks where the matrix ends. Three rows, those of a position or a turn, couple to no
more than the nine columns from the first of them on.
"""

from dlolib.sim.runtime import LANES, lanes, ti

HALF = 8
vec8 = ti.types.vector(HALF, ti.f64)
row_type = ti.types.vector(HALF + 1, ti.f64)
# Rows 0 ... 8 of a triangle, each shorter by one, in one vector: where each begins.
PLACE = tuple(i * (HALF + 1) - i * (i - 1) // 2 for i in range(HALF + 1))
triangle = ti.types.vector(PLACE[-1] + 1, ti.f64)
# Eight unknowns of `LANES` columns.
window_type = ti.types.matrix(HALF, LANES, ti.f64)


@ti.func
def factor(
    upper: ti.template(), lower: ti.template(), m: int, factors: ti.template(), under: ti.template(),
    rows: int, symmetric: int, definite: int,
) -> int:  # fmt: skip
    """A = L U: row r of `factors` then holds 1 / U[r, r] and row r of U, `under` column r of L; they may be
    A's own arrays.

    Of a `symmetric` A only the upper part is read and written: there L[k, r] is U[r, k] / U[r, r]. With
    `definite` = 1 a pivot that is not positive breaks it down (an energy has no minimum there); with 0 only
    one that is zero does. Returns 0, or r + 1 where it broke.
    """
    failed = 0
    if symmetric == 1:
        failed = factor_symmetric(upper, m, factors, rows, definite)
    else:
        failed = factor_general(upper, lower, m, factors, under, rows, definite)
    return failed


@ti.func
def factor_symmetric(upper: ti.template(), m: int, factors: ti.template(), rows: int, definite: int) -> int:
    """See `factor`. Three rows at once; what they change, a triangle of nine, stays in registers."""
    failed = 0
    window = triangle(0.0)
    for i in ti.static(range(HALF + 1)):
        for k in ti.static(range(HALF + 1 - i)):
            window[PLACE[i] + k] = upper[m, i][k]
    for block in range(rows // 3):
        r = 3 * block
        for s in ti.static(range(3)):
            pivot = window[PLACE[s]]
            if failed == 0 and not (pivot > 0.0 or (definite == 0 and pivot < 0.0)):
                failed = r + s + 1
            inverse = 1.0 / pivot
            row = row_type(0.0)
            row[0] = inverse
            for i in ti.static(range(s + 1, HALF + 1)):
                row[i - s] = window[PLACE[s] + i - s]
                share = row[i - s] * inverse
                for k in ti.static(range(HALF + 1 - i)):
                    window[PLACE[i] + k] -= share * window[PLACE[s] + i - s + k]
            factors[m, r + s] = row
        for i in ti.static(range(HALF + 1)):
            # a row past the end is read once, and not used
            following = upper[m, ti.min(r + 3 + i, rows + HALF - 1)]
            for k in ti.static(range(HALF + 1 - i)):
                if ti.static(i + k < 6):
                    window[PLACE[i] + k] = window[PLACE[i + 3] + k]
                else:
                    window[PLACE[i] + k] = following[k]
        if failed > 0:
            break
    return failed


@ti.func
def factor_general(
    upper: ti.template(), lower: ti.template(), m: int, factors: ti.template(), under: ti.template(),
    rows: int, definite: int,
) -> int:  # fmt: skip
    """See `factor`. As `factor_symmetric`, with a second triangle for what lies below the diagonal."""
    failed = 0
    above, below = triangle(0.0), triangle(0.0)
    for i in ti.static(range(HALF + 1)):
        for k in ti.static(range(HALF + 1 - i)):
            above[PLACE[i] + k], below[PLACE[i] + k] = upper[m, i][k], lower[m, i][k]
    for block in range(rows // 3):
        r = 3 * block
        for s in ti.static(range(3)):
            pivot = above[PLACE[s]]
            if failed == 0 and not (pivot > 0.0 or (definite == 0 and pivot < 0.0)):
                failed = r + s + 1
            inverse = 1.0 / pivot
            row, column = row_type(0.0), row_type(0.0)
            row[0] = inverse
            for i in ti.static(range(s + 1, HALF + 1)):
                row[i - s] = above[PLACE[s] + i - s]
                column[i - s] = below[PLACE[s] + i - s] * inverse
            for i in ti.static(range(s + 1, HALF + 1)):
                for k in ti.static(range(s + 1, HALF + 1)):
                    if ti.static(k >= i):
                        above[PLACE[i] + k - i] -= column[i - s] * row[k - s]
                    else:
                        below[PLACE[k] + i - k] -= column[i - s] * row[k - s]
            factors[m, r + s], under[m, r + s] = row, column
        for i in ti.static(range(HALF + 1)):
            # a row past the end is read once, and not used
            following = ti.min(r + 3 + i, rows + HALF - 1)
            right, down = upper[m, following], lower[m, following]
            for k in ti.static(range(HALF + 1 - i)):
                if ti.static(i + k < 6):
                    above[PLACE[i] + k] = above[PLACE[i + 3] + k]
                    below[PLACE[i] + k] = below[PLACE[i + 3] + k]
                else:
                    above[PLACE[i] + k], below[PLACE[i] + k] = right[k], down[k]
        if failed > 0:
            break
    return failed


@ti.func
def solve(
    upper: ti.template(), lower: ti.template(), m: int, y: ti.template(), b: int, c: int, rows: int,
    symmetric: int,
):  # fmt: skip
    """Column c of y[b]: y <- A^-1 y, with the factors that `factor` left in upper[m] and lower[m]."""
    # a window of the eight unknowns ahead, or behind on the way back, stays in registers
    ahead = vec8(0.0)
    for k in ti.static(range(HALF)):
        ahead[k] = y[b, c, k]
    for r in range(rows):
        value = ahead[0]
        y[b, c, r] = value
        column, share = upper[m, r], value
        if symmetric == 1:
            share = value * column[0]
        else:
            column = lower[m, r]
        for k in ti.static(range(HALF - 1)):
            ahead[k] = ahead[k + 1] - column[k + 1] * share
        ahead[HALF - 1] = y[b, c, r + HALF] - column[HALF] * share
    behind = vec8(0.0)
    for back in range(rows):
        r = rows - 1 - back
        value = y[b, c, r]
        row = upper[m, r]
        for k in ti.static(range(HALF, 0, -1)):
            value -= row[k] * behind[k - 1]
        for k in ti.static(range(HALF - 1, 0, -1)):
            behind[k] = behind[k - 1]
        behind[0] = value * row[0]
        y[b, c, r] = behind[0]


@ti.func
def solve_lanes(
    upper: ti.template(), lower: ti.template(), m: int, y: ti.template(), b: int, g: int, rows: int,
    symmetric: int,
):  # fmt: skip
    """The same of a group of columns, y[b, g], each entry of which is `lanes`."""
    ahead = window_type(0.0)
    for k in ti.static(range(HALF)):
        for j in ti.static(range(LANES)):
            ahead[k, j] = y[b, g, k][j]
    for r in range(rows):
        value = lanes(0.0)
        for j in ti.static(range(LANES)):
            value[j] = ahead[0, j]
        y[b, g, r] = value
        column, share, following = upper[m, r], value, y[b, g, r + HALF]
        if symmetric == 1:
            share = value * column[0]
        else:
            column = lower[m, r]
        for k in ti.static(range(HALF - 1)):
            for j in ti.static(range(LANES)):
                ahead[k, j] = ahead[k + 1, j] - column[k + 1] * share[j]
        for j in ti.static(range(LANES)):
            ahead[HALF - 1, j] = following[j] - column[HALF] * share[j]
    behind = window_type(0.0)
    for back in range(rows):
        r = rows - 1 - back
        value, row = y[b, g, r], upper[m, r]
        for k in ti.static(range(HALF, 0, -1)):
            for j in ti.static(range(LANES)):
                value[j] -= row[k] * behind[k - 1, j]
        for k in ti.static(range(HALF - 1, 0, -1)):
            for j in ti.static(range(LANES)):
                behind[k, j] = behind[k - 1, j]
        value *= row[0]
        for j in ti.static(range(LANES)):
            behind[0, j] = value[j]
        y[b, g, r] = value


@ti.func
def solve_transposed(
    upper: ti.template(), lower: ti.template(), m: int, y: ti.template(), b: int, c: int, rows: int
):
    """Column c of y[b]: y <- A^-T y."""
    for r in range(rows):
        value = y[b, c, r] * upper[m, r][0]
        y[b, c, r] = value
        for k in ti.static(range(1, HALF + 1)):
            y[b, c, r + k] = y[b, c, r + k] - upper[m, r][k] * value
    for back in range(rows):
        r = rows - 1 - back
        value = y[b, c, r]
        for k in ti.static(range(1, HALF + 1)):
            value -= lower[m, r][k] * y[b, c, r + k]
        y[b, c, r] = value


@ti.func
def entry(upper: ti.template(), lower: ti.template(), m: int, r: int, c: int, symmetric: int) -> float:
    """A[r, c] within the band, not factored; of a `symmetric` A from its upper part."""
    value = upper[m, ti.min(r, c)][ti.abs(r - c)]
    if symmetric == 0 and c < r:
        value = lower[m, c][r - c]
    return value
