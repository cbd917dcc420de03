"""Gradient and Hessian of one step's energy: the constraints, the loads and the inertia of the particles.

Block i of the unknowns is particle i - 1 and frame i, i = 0 ... n. Frames 0 and n are those of the wall
and the grasp (the paper's q_0 and q_n), joined to the rope over half a segment, so that the clamp is at
the wall and not in the middle of the first segment.
"""

from dlolib.sim.band import HALF
from dlolib.sim.contact import push
from dlolib.sim.rotations import identity
from dlolib.sim.runtime import mat3, ti, vec3, vec4
from dlolib.sim.strain import bend_twist, stretch_shear

scalars2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
scalars3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
vectors2 = ti.types.ndarray(dtype=vec3, ndim=2)
vectors3 = ti.types.ndarray(dtype=vec3, ndim=3)
vectors4 = ti.types.ndarray(dtype=vec3, ndim=4)
frames2 = ti.types.ndarray(dtype=vec4, ndim=2)
frames3 = ti.types.ndarray(dtype=vec4, ndim=3)
flags1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
flags2 = ti.types.ndarray(dtype=ti.i32, ndim=2)


@ti.func
def write_block(
    band: ti.template(), b: int, i: int, xx: mat3, xt: mat3, tt: mat3, x_x: mat3, t_x: mat3, t_t: mat3
):
    """Rows of block i: its own xx, x-theta and theta-theta, and those that couple it to block i + 1."""
    for r in ti.static(range(3)):
        for c in ti.static(range(3)):
            if ti.static(c >= r):
                band[b, 6 * i + r, c - r] = xx[r, c]
                band[b, 6 * i + 3 + r, c - r] = tt[r, c]
            band[b, 6 * i + r, 3 + c - r] = xt[r, c]
            band[b, 6 * i + r, 6 + c - r] = x_x[r, c]
            band[b, 6 * i + 3 + r, 3 + c - r] = t_x[r, c]
            band[b, 6 * i + 3 + r, 6 + c - r] = t_t[r, c]
        for k in ti.static(range(9 - r, HALF + 1)):
            band[b, 6 * i + r, k] = 0.0
            band[b, 6 * i + 3 + r, k] = 0.0


@ti.func
def assemble(
    b: int,
    t: int,
    x: ti.template(),
    q: ti.template(),
    free_flight: ti.template(),
    previous: int,
    joint_d: ti.template(),
    joint_l: ti.template(),
    joint_rest: ti.template(),
    segment_l: ti.template(),
    segment_k: ti.template(),
    mass: ti.template(),
    force: ti.template(),
    drag: ti.template(),
    obstacles: ti.template(),
    radius: ti.template(),
    contact: ti.template(),
    rate: float,
    band: ti.template(),
    y: ti.template(),
) -> float:
    """Fill `band` with the Hessian and column 0 of `y` with minus the gradient; return the energy [J].

    The energy's minimum over the state at index t is the implicit Euler step to it: the elastic, contact
    and load energies plus m |x - free_flight|^2 / (2 dt^2) and drag |x - x_previous|^2 / (2 dt), with
    `rate` = 1 / dt, or 0 for a quasi-static step.
    """
    n = mass.shape[1]
    energy = 0.0
    gx_next, gt_next = vec3(0.0), vec3(0.0)
    xx_next, tt_next = 0.0 * identity(), 0.0 * identity()
    for i in range(n + 1):
        gx, gt, xx, tt = gx_next, gt_next, xx_next, tt_next
        xt, x_x, t_x, t_t = 0.0 * identity(), 0.0 * identity(), 0.0 * identity(), 0.0 * identity()
        gx_next, gt_next = vec3(0.0), vec3(0.0)
        xx_next, tt_next = 0.0 * identity(), 0.0 * identity()
        if i < n:
            e, _moment, ga, gb, aa, ab, bb = bend_twist(
                q[b, t, i], q[b, t, i + 1], joint_l[b, i], joint_d[b, i], joint_rest[b, i]
            )
            energy += e
            gt += ga
            tt += aa
            t_t = ab
            gt_next = gb
            tt_next = bb
            if i > 0:
                s = i - 1
                e, gd, gs, dd, dt, st = stretch_shear(
                    x[b, t, s + 1] - x[b, t, s], q[b, t, i], segment_l[b, s], segment_k[b, s]
                )
                energy += e
                gx -= gd
                gt += gs
                xx += dd
                tt += st
                xt = -dt
                x_x = -dd
                t_x = dt.transpose()
                gx_next = gd
                xx_next = dd
        if i > 0:
            p = i - 1
            # the particle itself, and the middle of the segment that follows it
            for middle in range(2):
                if p + middle < n:
                    here = x[b, t, p]
                    share = 1.0
                    if middle == 1:
                        here = 0.5 * (here + x[b, t, p + 1])
                        share = 0.5
                    e, g, h = push(here, radius[b, 0], contact[b, 2 * p + middle], obstacles, b)
                    energy += e
                    gx += share * g
                    xx += share * share * h
                    if middle == 1:
                        gx_next += share * g
                        xx_next += share * share * h
                        x_x += share * share * h
            inertia, friction = mass[b, p] * rate * rate, drag[b, p] * rate
            flown, moved = x[b, t, p] - free_flight[b, p], x[b, t, p] - x[b, previous, p]
            energy -= force[b, p].dot(x[b, t, p])
            energy += 0.5 * inertia * flown.dot(flown) + 0.5 * friction * moved.dot(moved)
            gx += inertia * flown + friction * moved - force[b, p]
            xx += (inertia + friction) * identity()
        write_block(band, b, i, xx, xt, tt, x_x, t_x, t_t)
        for r in ti.static(range(3)):
            y[b, 0, 6 * i + r] = -gx[r]
            y[b, 0, 6 * i + 3 + r] = -gt[r]
    return energy


@ti.func
def hold(band: ti.template(), b: int, row: int):
    """Take three unknowns out of the Hessian: unit diagonal, no coupling."""
    for r in ti.static(range(3)):
        for k in ti.static(range(1, HALF + 1)):
            band[b, row + r, k] = 0.0
            if row + r - k >= 0:
                band[b, row + r - k, k] = 0.0
        band[b, row + r, 0] = 1.0


@ti.func
def hold_ends(band: ti.template(), b: int, n: int, clamped: ti.template()):
    """Take out what is prescribed: both outer frames, the unused first position, the held particles."""
    hold(band, b, 0)
    hold(band, b, 3)
    hold(band, b, 6 * n + 3)
    if clamped[b, 0] == 1:
        hold(band, b, 6)
    if clamped[b, 1] == 1:
        hold(band, b, 6 * n)


@ti.func
def clear_held(y: ti.template(), b: int, c: int, n: int, clamped: ti.template()):
    """Zero the prescribed unknowns of column c."""
    for r in ti.static(range(6)):
        y[b, c, r] = 0.0
    for r in ti.static(range(3)):
        y[b, c, 6 * n + 3 + r] = 0.0
        if clamped[b, 0] == 1:
            y[b, c, 6 + r] = 0.0
        if clamped[b, 1] == 1:
            y[b, c, 6 * n + r] = 0.0
