"""One XPBD projection (2)-(3) for each constraint of Section IV, and how each carries derivatives back.

Each `project_...` changes the state in place, as Gauss-Seidel does, and writes into the tape what its
`pull_back_...` needs; that turns derivatives of a loss by the state after the projection (the bar_
arrays) into those by the state before it, in place. Written by hand: Taichi's reverse mode keeps no
values that are overwritten, and Gauss-Seidel overwrites them all.

Stretch-shear and bend-twist have Jacobians of orthogonal rows, so that the 3 x 3 matrix of (3) is a
multiple of the identity, plus the compliance (Kugelstadt and Schoemer 2016, the paper's [22]).
"""

from dlolib.sim.rotations import conjugate, product
from dlolib.sim.runtime import ti, vec3, vec4
from dlolib.sim.shapes import signed_distance

# Keeps the tridiagonal matrix of constraint 3 regular in a rope held straight at both ends, where it has
# one constraint more than particles can move; relative to its diagonal.
REGULAR = 1e-6


@ti.func
def pure(v: vec3) -> vec4:
    """The quaternion without real part."""
    return vec4(0.0, v[0], v[1], v[2])


@ti.func
def imaginary(q: vec4) -> vec3:
    """The imaginary part."""
    return vec3(q[1], q[2], q[3])


@ti.func
def times_e3(q: vec4) -> vec4:
    """q e3."""
    return vec4(-q[3], q[2], -q[1], q[0])


@ti.func
def before_normalising(u: vec4, bar: vec4) -> vec4:
    """Derivative by u from that by u / |u|."""
    size = u.norm()
    unit = u / size
    return (bar - unit.dot(bar) * unit) / size


@ti.func
def project_stretch(
    b: int, t: int, slot: int, i: int, x: ti.template(), q: ti.template(), segment_l: ti.template(),
    weight_x: ti.template(), weight_q: ti.template(), tape_q: ti.template(), tape_step: ti.template(),
):  # fmt: skip
    """Constraint 1 of segment i with alpha = 0: C = (x_i+1 - x_i) / l - R(q) e3, equations (4) to (6).

    The sign is that of (5) and of the paper's figure 4, not of (4) as printed.
    """
    length, frame = segment_l[b, i], q[b, t, i + 1]
    first, second, turn = weight_x[b, i], weight_x[b, i + 1], weight_q[b, i + 1]
    tangent = imaginary(product(times_e3(frame), conjugate(frame)))
    value = (x[b, t, i + 1] - x[b, t, i]) / length - tangent
    step = -value / ((first + second) / length**2 + 4.0 * turn)
    tape_q[b, slot, i] = frame
    tape_step[b, slot, i] = step
    x[b, t, i] = x[b, t, i] - first / length * step
    x[b, t, i + 1] = x[b, t, i + 1] + second / length * step
    q[b, t, i + 1] = (frame + 2.0 * turn * product(pure(step), times_e3(frame))).normalized()


@ti.func
def pull_back_stretch(
    b: int, slot: int, i: int, bar_x: ti.template(), bar_q: ti.template(), segment_l: ti.template(),
    weight_x: ti.template(), weight_q: ti.template(), tape_q: ti.template(), tape_step: ti.template(),
):  # fmt: skip
    """Derivatives back through `project_stretch`."""
    length, frame, step = segment_l[b, i], tape_q[b, slot, i], tape_step[b, slot, i]
    first, second, turn = weight_x[b, i], weight_x[b, i + 1], weight_q[b, i + 1]
    turned = times_e3(frame)
    u = before_normalising(frame + 2.0 * turn * product(pure(step), turned), bar_q[b, i + 1])
    bar_step = (second * bar_x[b, i + 1] - first * bar_x[b, i]) / length
    bar_step += 2.0 * turn * imaginary(product(u, conjugate(turned)))
    bar_value = -bar_step / ((first + second) / length**2 + 4.0 * turn)
    bar_x[b, i] = bar_x[b, i] - bar_value / length
    bar_x[b, i + 1] = bar_x[b, i + 1] + bar_value / length
    bar_q[b, i + 1] = u + 2.0 * (turn * product(pure(step), times_e3(u)) + product(pure(bar_value), turned))


@ti.func
def darboux_difference(qa: vec4, qb: vec4, rest: vec4):
    """C_b = Im(Omega - xi Omega0) and xi, equations (7) and (8).

    xi compares the whole quaternions, as the code of [22] does; with the imaginary parts alone, as
    printed, it would flip for a rope bent gently against its rest curvature.
    """
    omega = product(conjugate(qa), qb)
    xi = 1.0
    if omega.dot(rest) < 0.0:
        xi = -1.0
    return imaginary(omega - xi * rest), xi


@ti.func
def project_bend(
    b: int, t: int, slot: int, i: int, q: ti.template(), multiplier: ti.template(), stiffness: ti.template(),
    rest: ti.template(), weight_q: ti.template(), tape_a: ti.template(), tape_b: ti.template(),
    tape_multiplier: ti.template(),
):  # fmt: skip
    """Constraints 2 and 4 between frames i and i + 1, equations (7) to (9); `stiffness` is 1 / alpha~."""
    qa, qb, total = q[b, t, i], q[b, t, i + 1], multiplier[b, i]
    wa, wb, k = weight_q[b, i], weight_q[b, i + 1], stiffness[b, i]
    value, _xi = darboux_difference(qa, qb, rest[b, i])
    step = -(k * value + total) / (k * (wa + wb) + 1.0)
    tape_a[b, slot, i] = qa
    tape_b[b, slot, i] = qb
    tape_multiplier[b, slot, i] = total
    multiplier[b, i] = total + step
    if wa > 0.0:
        q[b, t, i] = (qa - wa * product(qb, pure(step))).normalized()
    if wb > 0.0:
        q[b, t, i + 1] = (qb + wb * product(qa, pure(step))).normalized()


@ti.func
def pull_back_bend(
    b: int, slot: int, i: int, bar_q: ti.template(), bar_multiplier: ti.template(), stiffness: ti.template(),
    rest: ti.template(), weight_q: ti.template(), tape_a: ti.template(), tape_b: ti.template(),
    tape_multiplier: ti.template(), bar_stiffness: ti.template(), bar_rest: ti.template(),
):  # fmt: skip
    """Derivatives back through `project_bend`; adds those by 1 / alpha~ and by Im(Omega0)."""
    qa, qb, total = tape_a[b, slot, i], tape_b[b, slot, i], tape_multiplier[b, slot, i]
    wa, wb, k = weight_q[b, i], weight_q[b, i + 1], stiffness[b, i]
    value, xi = darboux_difference(qa, qb, rest[b, i])
    divisor = k * (wa + wb) + 1.0
    step = -(k * value + total) / divisor
    ua, ub = bar_q[b, i], bar_q[b, i + 1]
    if wa > 0.0:
        ua = before_normalising(qa - wa * product(qb, pure(step)), ua)
    if wb > 0.0:
        ub = before_normalising(qb + wb * product(qa, pure(step)), ub)
    turned = wb * product(conjugate(qa), ub) - wa * product(conjugate(qb), ua)
    bar_step = (bar_multiplier[b, i] + imaginary(turned)) / divisor
    bar_value = -k * bar_step
    bar_multiplier[b, i] = bar_multiplier[b, i] - bar_step
    bar_stiffness[b, i] = bar_stiffness[b, i] - bar_step * (value + (wa + wb) * step)
    bar_rest[b, i] = bar_rest[b, i] - xi * bar_value
    bar_q[b, i] = ua - wb * product(ub, pure(step)) - product(qb, pure(bar_value))
    bar_q[b, i + 1] = ub + wa * product(ua, pure(step)) + product(qa, pure(bar_value))


@ti.func
def direction(b: int, slot: int, i: int, tape_x: ti.template()):
    """Unit vector along segment i and the segment's present length [m]."""
    d = tape_x[b, slot, i + 1] - tape_x[b, slot, i]
    length = d.norm()
    return d / length, length


@ti.func
def solve_tridiagonal(
    b: int, slot: int, n: int, tape_x: ti.template(), weight_x: ti.template(), y: ti.template()
):
    """y[b, 0] <- A^-1 y[b, 0] by Thomas's algorithm, A the matrix of constraint 3 ([25]); y[b, 1] is work."""
    along, _length = direction(b, slot, 0, tape_x)
    pivot = (weight_x[b, 0] + weight_x[b, 1]) * (1.0 + REGULAR)
    y[b, 0, 0] = y[b, 0, 0] / pivot
    for i in range(1, n - 1):
        ahead, _length = direction(b, slot, i, tape_x)
        beside = -weight_x[b, i] * along.dot(ahead)
        y[b, 1, i - 1] = beside / pivot
        pivot = (weight_x[b, i] + weight_x[b, i + 1]) * (1.0 + REGULAR) - beside * y[b, 1, i - 1]
        y[b, 0, i] = (y[b, 0, i] - beside * y[b, 0, i - 1]) / pivot
        along = ahead
    for back in range(n - 2):
        i = n - 3 - back
        y[b, 0, i] = y[b, 0, i] - y[b, 1, i] * y[b, 0, i + 1]


@ti.func
def project_distance(
    b: int, t: int, slot: int, x: ti.template(), segment_l: ti.template(), weight_x: ti.template(),
    tape_x: ti.template(), tape_step: ti.template(), y: ti.template(),
):  # fmt: skip
    """Constraint 3, equations (10) and (11): all segments' lengths at once."""
    n = x.shape[2]
    for p in range(n):
        tape_x[b, slot, p] = x[b, t, p]
    for i in range(n - 1):
        along, length = direction(b, slot, i, tape_x)
        y[b, 0, i] = segment_l[b, i] - length
    solve_tridiagonal(b, slot, n, tape_x, weight_x, y)
    for i in range(n - 1):
        along, length = direction(b, slot, i, tape_x)
        step = y[b, 0, i]
        tape_step[b, slot, i] = step
        x[b, t, i] = x[b, t, i] - weight_x[b, i] * step * along
        x[b, t, i + 1] = x[b, t, i + 1] + weight_x[b, i + 1] * step * along


@ti.func
def pull_back_distance(
    b: int, slot: int, bar_x: ti.template(), weight_x: ti.template(), tape_x: ti.template(),
    tape_step: ti.template(), y: ti.template(), bar_along: ti.template(),
):  # fmt: skip
    """Derivatives back through `project_distance`: one more solve with the same matrix."""
    n = bar_x.shape[1]
    for i in range(n - 1):
        along, length = direction(b, slot, i, tape_x)
        pulled = weight_x[b, i + 1] * bar_x[b, i + 1] - weight_x[b, i] * bar_x[b, i]
        y[b, 0, i] = along.dot(pulled)
        bar_along[b, i] = tape_step[b, slot, i] * pulled
    solve_tridiagonal(b, slot, n, tape_x, weight_x, y)
    for i in range(n - 2):
        along, length = direction(b, slot, i, tape_x)
        ahead, _length = direction(b, slot, i + 1, tape_x)
        product_bar = y[b, 0, i] * tape_step[b, slot, i + 1] + y[b, 0, i + 1] * tape_step[b, slot, i]
        bar_along[b, i] = bar_along[b, i] + weight_x[b, i + 1] * product_bar * ahead
        bar_along[b, i + 1] = bar_along[b, i + 1] + weight_x[b, i + 1] * product_bar * along
    for i in range(n - 1):
        along, length = direction(b, slot, i, tape_x)
        bar = (bar_along[b, i] - along.dot(bar_along[b, i]) * along) / length - y[b, 0, i] * along
        bar_x[b, i] = bar_x[b, i] - bar
        bar_x[b, i + 1] = bar_x[b, i + 1] + bar


@ti.func
def project_contact(
    b: int, t: int, slot: int, p: int, k: int, x: ti.template(), multiplier: ti.template(),
    obstacles: ti.template(), radius: ti.template(), alpha: float, weight_x: ti.template(),
    tape_x: ti.template(), tape_multiplier: ti.template(),
):  # fmt: skip
    """Constraint 5 of particle p and obstacle k: C = distance to surface - radius >= 0; `alpha` is alpha~.

    x_ic is the surface point nearest to the particle, so that (x - x_ic) . n_ic is the signed distance.
    """
    total, w = multiplier[b, p, k], weight_x[b, p]
    tape_x[b, slot, p, k] = x[b, t, p]
    tape_multiplier[b, slot, p, k] = total
    d, n, _h, _section = signed_distance(x[b, t, p], obstacles, b, k)
    step = ti.max(-(d - radius[b, 0] + alpha * total) / (w + alpha), -total)
    multiplier[b, p, k] = total + step
    x[b, t, p] = x[b, t, p] + w * step * n


@ti.func
def pull_back_contact(
    b: int, slot: int, p: int, k: int, bar_x: ti.template(), bar_multiplier: ti.template(),
    obstacles: ti.template(), radius: ti.template(), alpha: float, weight_x: ti.template(),
    tape_x: ti.template(), tape_multiplier: ti.template(),
):  # fmt: skip
    """Derivatives back through `project_contact`, with the obstacle's curvature."""
    total, w = tape_multiplier[b, slot, p, k], weight_x[b, p]
    d, n, h, _section = signed_distance(tape_x[b, slot, p, k], obstacles, b, k)
    step = -(d - radius[b, 0] + alpha * total) / (w + alpha)
    bar_step = bar_multiplier[b, p, k] + w * n.dot(bar_x[b, p])
    by_total, by_value = alpha / (w + alpha), 1.0 / (w + alpha)
    if step <= -total:
        step, by_total, by_value = -total, 1.0, 0.0
    bar_multiplier[b, p, k] = bar_multiplier[b, p, k] - by_total * bar_step
    bar_x[b, p] = bar_x[b, p] + w * step * (h @ bar_x[b, p]) - by_value * bar_step * n
