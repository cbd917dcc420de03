"""Derivatives of a roll-out, by the implicit function theorem: one banded solve a step.

With r the step's forces, u its state and h the histories of laws and contacts, a step is r(u, u', h', p) = 0
and h = G(u, u', h', p); primes mark the step before. Then

    K du = -(dr/du' du' + dr/dh' dh' + dr/dp),   K = dr/du

forwards in time (`sensitivity`, for a handful of parameters p and many residuals), and the transpose of all
this backwards (`adjoint`, for one loss and any number of inputs). What a parameter does, dr/dp and dG/dp
at fixed u, u' and h', comes from the residuals of two scenes (`explicit`), a little to either side: an
explicit function, smooth on the branches that the step took; its differences are right to some eight digits.

Columns, one a parameter, lie in groups of `LANES`, entries of one vector each.
"""

from dlolib.sim.runtime import lanes, mat2, mat3, ti, vec3
from dlolib.sim.scene import SAMPLES

lanes2 = ti.types.ndarray(dtype=lanes, ndim=2)
lanes3 = ti.types.ndarray(dtype=lanes, ndim=3)
lanes4 = ti.types.ndarray(dtype=lanes, ndim=4)


@ti.func
def of_end(k: int, by_held: ti.template(), b: int, t: int, g: int, j: int) -> lanes:
    """How coordinate j of the k-th of what may be prescribed moves with the parameters of group g at index t.

    by_held (B, T, G, 12): of the start its position and its frame's turn, then of the end.
    """
    found = lanes(0.0)
    if k > 0:
        end, first = (k - 1) % 2, 0
        if k < 3:
            first = 3
        found = by_held[b, t - 1, g, 6 * end + first + j]
    return found


@ti.func
def block2(bends: ti.template(), m: int, i: int, k: int, part: ti.template()) -> mat2:
    """One of a law's five matrices: of the moment by curvature before and history, of the history by all."""
    o = 4 * part
    return mat2(
        [
            [bends[m, i, k, o], bends[m, i, k, o + 1]],
            [bends[m, i, k, o + 2], bends[m, i, k, o + 3]],
        ]
    )


@ti.func
def block3(rubs: ti.template(), m: int, k: int, o: ti.template()) -> mat3:
    """One of a contact's two matrices: of the stretch by the point (at 1), by the stretch before (at 10)."""
    found = mat3(0.0)
    for r in ti.static(range(3)):
        for c in ti.static(range(3)):
            found[r, c] = rubs[m, k, o + 3 * r + c]
    return found


@ti.func
def of_two(a: mat2, r: ti.template(), v0: lanes, v1: lanes) -> lanes:
    """Row r of a times (v0, v1), of a group of columns."""
    return a[r, 0] * v0 + a[r, 1] * v1


@ti.func
def of_three(a: mat3, r: ti.template(), v0: lanes, v1: lanes, v2: lanes) -> lanes:
    """Row r of a times (v0, v1, v2), of a group of columns."""
    return a[r, 0] * v0 + a[r, 1] * v1 + a[r, 2] * v2


@ti.func
def spread(y: ti.template(), b: int, c: int, p: int, j: int, force: vec3):
    """Add a force on contact point j after particle p to the unknowns that carry it."""
    there = j / float(SAMPLES)
    for k in ti.static(range(3)):
        y[b, c, 6 * (p + 1) + k] += (1.0 - there) * force[k]
        if j > 0:
            y[b, c, 6 * (p + 2) + k] += there * force[k]


@ti.func
def gathered(y: ti.template(), b: int, c: int, p: int, j: int) -> vec3:
    """How contact point j after particle p moves with the unknowns in y."""
    r = 6 * (p + 1)
    there = j / float(SAMPLES)
    moved = vec3(y[b, c, r], y[b, c, r + 1], y[b, c, r + 2])
    if j > 0:
        moved = (1.0 - there) * moved + there * vec3(y[b, c, r + 6], y[b, c, r + 7], y[b, c, r + 8])
    return moved


@ti.func
def spread_lanes(y: ti.template(), b: int, g: int, p: int, j: int, k: int, force: lanes):
    """Coordinate k of `spread`, of a group of columns."""
    there = j / float(SAMPLES)
    y[b, g, 6 * (p + 1) + k] += (1.0 - there) * force
    if j > 0:
        y[b, g, 6 * (p + 2) + k] += there * force


@ti.func
def point_of(u: ti.template(), b: int, g: int, p: int, j: int):
    """The three coordinates of `gathered`, of a group of columns."""
    r, there = 6 * (p + 1), j / float(SAMPLES)
    m0, m1, m2 = u[b, g, r], u[b, g, r + 1], u[b, g, r + 2]
    if j > 0:
        m0 = (1.0 - there) * m0 + there * u[b, g, r + 6]
        m1 = (1.0 - there) * m1 + there * u[b, g, r + 7]
        m2 = (1.0 - there) * m2 + there * u[b, g, r + 8]
    return m0, m1, m2
