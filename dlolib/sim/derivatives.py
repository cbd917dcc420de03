"""Derivatives of a roll-out, by the implicit function theorem: one banded solve a step.

With r the step's forces, u its state and h the histories of laws and contacts, a step is r(u, u', h', p) = 0
and h = G(u, u', h', p); primes mark the step before. Then

    K du = -(dr/du' du' + dr/dh' dh' + dr/dp),   K = dr/du

forwards in time (`sensitivity`, for a handful of parameters p and many residuals), and the transpose of all
this backwards (`adjoint`, for one loss and any number of inputs). What a parameter does, dr/dp and dG/dp
at fixed u, u' and h', comes from the residuals of two scenes (`linearise`), a little to either side: an
explicit function, smooth on the branches that the step took; its differences are right to some eight digits.
"""

from dlolib.sim.runtime import mat2, mat3, ti, vec3
from dlolib.sim.scene import SAMPLES

scalars5 = ti.types.ndarray(dtype=ti.f64, ndim=5)


@ti.func
def of_end(k: int, by_held: ti.template(), b: int, t: int, c: int) -> vec3:
    """How the k-th of what may be prescribed moves with parameter c at index t."""
    found = vec3(0.0)
    if k > 0:
        end, first = (k - 1) % 2, 0
        if k < 3:
            first = 3
        for j in ti.static(range(3)):
            found[j] = by_held[b, t - 1, c, end, first + j]
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
