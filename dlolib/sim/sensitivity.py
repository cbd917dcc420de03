"""Derivatives of a roll-out forwards in time, beside `direct.roll_out`: `derivatives` says of what."""

from dlolib.sim.assembly import (
    ENDS,
    bands,
    flags1,
    flags2,
    flags3,
    frames3,
    is_held,
    joint_lengths,
    row_of,
    scalars1,
    scalars3,
    scalars4,
    vectors2,
    vectors3,
)
from dlolib.sim.band import HALF, solve_lanes
from dlolib.sim.derivatives import (
    block2,
    block3,
    lanes3,
    lanes4,
    of_end,
    of_three,
    of_two,
    point_of,
    spread_lanes,
)
from dlolib.sim.explicit import explicit
from dlolib.sim.inertia import BACK, paces
from dlolib.sim.joints import law_acts, laws_act
from dlolib.sim.launch import kernel
from dlolib.sim.runtime import APART, lanes, ti, vec3
from dlolib.sim.scene import DRAG, INERTIA, SAMPLES
from dlolib.sim.strain import darboux, moment_to_rotations

# States whose derivatives inertia looks back to, and that at which they are wanted.
KEPT = BACK + 1


@ti.func
def bends_frames(q: ti.template(), b: int, t: int, i: int):
    """What moments about the two first axes of joint i do to its two frames; transposed, what turns of these
    do to its two bends."""
    _phi, w, v, c0, c1, _c2 = darboux(q[b, t, i], q[b, t, i + 1])
    a0, b0 = moment_to_rotations(w, v, c0, c1, vec3(1.0, 0.0, 0.0))
    a1, b1 = moment_to_rotations(w, v, c0, c1, vec3(0.0, 1.0, 0.0))
    return a0, b0, a1, b1


@ti.func
def bent_by(u: ti.template(), b: int, g: int, i: int, a: vec3, c: vec3, length: float) -> lanes:
    """How a curvature [1/m] of joint i changes with the frames' turns in u[b, g]; a, c as `bends_frames`
    returns them for its axis."""
    found = lanes(0.0)
    for k in ti.static(range(3)):
        found += a[k] * u[b, g, 6 * i + 3 + k] + c[k] * u[b, g, 6 * i + 9 + k]
    return found / length


@ti.func
def keep_bent(
    bent: ti.template(), u: ti.template(), q: ti.template(), joints: ti.template(), steps: ti.template(),
    b: int, t: int,
):  # fmt: skip
    """Into bent[b, g, i] how the curvatures of joints with laws change at index t, where u[b, g] does."""
    for i in range(joints.shape[1]):
        if laws_act(joints, b, i):
            length, _before = joint_lengths(joints, steps, b, t, i)
            a0, b0, a1, b1 = bends_frames(q, b, t, i)
            for g in range(u.shape[1]):
                bent[b, g, i, 0] = bent_by(u, b, g, i, a0, b0, length)
                bent[b, g, i, 1] = bent_by(u, b, g, i, a1, b1, length)


@ti.func
def pull_of_laws(
    y: ti.template(), q: ti.template(), joints: ti.template(), bends: ti.template(), bent: ti.template(),
    d_past: ti.template(), b: int, t: int, m: int, fresh: int,
):  # fmt: skip
    """Into y[b, g] minus what the laws' moments at index t owe to the curvatures and histories before."""
    for i in range(joints.shape[1]):
        if laws_act(joints, b, i):
            a0, b0, a1, b1 = bends_frames(q, b, t, i)
            for g in range(y.shape[1]):
                m0, m1 = lanes(0.0), lanes(0.0)
                k0, k1 = bent[b, g, i, 0] * (1.0 - fresh), bent[b, g, i, 1] * (1.0 - fresh)
                for k in range(bends.shape[2]):
                    if law_acts(joints, b, i, k):
                        by_bent, by_past = block2(bends, m, i, k, 0), block2(bends, m, i, k, 1)
                        h0, h1 = d_past[b, g, i, 3 * k], d_past[b, g, i, 3 * k + 1]
                        m0 += of_two(by_bent, 0, k0, k1) + of_two(by_past, 0, h0, h1)
                        m1 += of_two(by_bent, 1, k0, k1) + of_two(by_past, 1, h0, h1)
                for k in ti.static(range(3)):
                    y[b, g, 6 * i + 3 + k] -= a0[k] * m0 + a1[k] * m1
                    y[b, g, 6 * i + 9 + k] -= b0[k] * m0 + b1[k] * m1


@ti.func
def remember_laws(
    u: ti.template(), q: ti.template(), steps: ti.template(), joints: ti.template(), bends: ti.template(),
    bent: ti.template(), by_past: ti.template(), d_past: ti.template(), b: int, t: int, m: int, fresh: int,
):  # fmt: skip
    """The derivatives of the laws' histories and curvatures from those at index t - 1 to those at t."""
    for i in range(joints.shape[1]):
        if laws_act(joints, b, i):
            length, _before = joint_lengths(joints, steps, b, t, i)
            a0, b0, a1, b1 = bends_frames(q, b, t, i)
            for g in range(u.shape[1]):
                k0, k1 = bent[b, g, i, 0] * (1.0 - fresh), bent[b, g, i, 1] * (1.0 - fresh)
                n0, n1 = bent_by(u, b, g, i, a0, b0, length), bent_by(u, b, g, i, a1, b1, length)
                for k in range(bends.shape[2]):
                    if law_acts(joints, b, i, k):
                        by_now, by_bent = block2(bends, m, i, k, 2), block2(bends, m, i, k, 3)
                        own = block2(bends, m, i, k, 4)
                        h0, h1 = d_past[b, g, i, 3 * k], d_past[b, g, i, 3 * k + 1]
                        for j in ti.static(range(2)):
                            new = (
                                of_two(by_now, j, n0, n1)
                                + of_two(by_bent, j, k0, k1)
                                + of_two(own, j, h0, h1)
                            )
                            d_past[b, g, i, 3 * k + j] = new + by_past[b, g, i, 3 * k + j]
                bent[b, g, i, 0], bent[b, g, i, 1] = n0, n1


@ti.func
def pull_of_motion(
    y: ti.template(), trail: ti.template(), steps: ti.template(), particles: ti.template(), b: int, t: int,
    euler: int,
):  # fmt: skip
    """Into y[b, g] what inertia and drag at index t owe to the states before."""
    inertia, drag = paces(steps, b, t, euler)
    for p in range(particles.shape[1]):
        stiffness = particles[b, p, INERTIA] * inertia + particles[b, p, DRAG] * drag
        for back in ti.static(range(1, BACK + 1)):
            # the way that leads there, and the one that leads on from there
            share = stiffness[back - 1]
            if ti.static(back < BACK):
                share -= stiffness[back]
            if t >= back - 1:
                for g in range(y.shape[1]):
                    for r in range(6 * (p + 1), 6 * (p + 1) + 3):
                        y[b, g, r] += share * trail[b, (t - back + 1) % KEPT, g, r]


@ti.func
def pull_of_friction(
    y: ti.template(), u: ti.template(), rubs: ti.template(), d_slip: ti.template(), b: int, m: int, n: int
):
    """Into y[b, g] what friction owes to the state before."""
    for p in range(n):
        for j in range(SAMPLES if p + 1 < n else 1):
            k = SAMPLES * p + j
            if rubs[m, k, 0] > 0.0:
                by_past = rubs[m, k, 0] * block3(rubs, m, k, 10)
                for g in range(y.shape[1]):
                    m0, m1, m2 = point_of(u, b, g, p, j)
                    m0, m1, m2 = m0 - d_slip[b, g, k, 0], m1 - d_slip[b, g, k, 1], m2 - d_slip[b, g, k, 2]
                    for r in ti.static(range(3)):
                        spread_lanes(y, b, g, p, j, r, of_three(by_past, r, m0, m1, m2))


@ti.func
def remember_friction(
    y: ti.template(), u: ti.template(), rubs: ti.template(), by_slip: ti.template(), d_slip: ti.template(),
    b: int, m: int, n: int,
):  # fmt: skip
    """The derivatives of the contacts' stretch from that before y[b, g], where u[b, g] was, to that after."""
    for p in range(n):
        for j in range(SAMPLES if p + 1 < n else 1):
            k = SAMPLES * p + j
            by_point, by_past = block3(rubs, m, k, 1), block3(rubs, m, k, 10)
            for g in range(y.shape[1]):
                h0, h1, h2 = point_of(u, b, g, p, j)
                h0, h1, h2 = d_slip[b, g, k, 0] - h0, d_slip[b, g, k, 1] - h1, d_slip[b, g, k, 2] - h2
                m0, m1, m2 = point_of(y, b, g, p, j)
                for r in ti.static(range(3)):
                    new = of_three(by_past, r, h0, h1, h2) + of_three(by_point, r, m0, m1, m2)
                    d_slip[b, g, k, r] = new + by_slip[b, g, k, r]


@ti.func
def move_ends(
    y: ti.template(), by_held: ti.template(), columns: ti.template(), grips: ti.template(),
    clamped: ti.template(), b: int, t: int, m: int, n: int,
):  # fmt: skip
    """Bring what is prescribed to the right-hand side y[b, g], and its own rows to zero."""
    rows = 6 * (n + 1)
    for k in range(1, ENDS):
        row = row_of(k, n)
        if is_held(k, b, grips, clamped):
            for g in range(y.shape[1]):
                for j in range(3):
                    moved = of_end(k, by_held, b, t, g, j)
                    if moved.norm_sqr() > 0.0:
                        for i in range(2 * HALF + 1):
                            r = row + j - HALF + i
                            if r >= 0 and r < rows:
                                y[b, g, r] -= columns[m, k - 1, j, i] * moved
    for k in range(ENDS):
        if is_held(k, b, grips, clamped):
            for g in range(y.shape[1]):
                for r in range(row_of(k, n), row_of(k, n) + 3):
                    y[b, g, r] = lanes(0.0)


@ti.func
def place_ends(
    y: ti.template(), by_held: ti.template(), grips: ti.template(), clamped: ti.template(), b: int, t: int,
    n: int,
):  # fmt: skip
    """Into y[b, g] how what is prescribed moves."""
    for k in range(ENDS):
        if is_held(k, b, grips, clamped):
            for g in range(y.shape[1]):
                for j in range(3):
                    y[b, g, row_of(k, n) + j] = of_end(k, by_held, b, t, g, j)


@kernel
def sensitivities(
    x: vectors3,
    q: frames3,
    first: vectors2,
    past: scalars4,
    slip: vectors3,
    sliding: flags3,
    steps: scalars3,
    joints: scalars3,
    particles: scalars3,
    grips: scalars3,
    clamped: flags2,
    moving: ti.i32,
    euler: ti.i32,
    fresh: ti.i32,
    symmetric: ti.i32,
    upper: bands,
    lower: bands,
    columns: scalars4,
    bends: scalars4,
    rubs: scalars3,
    slot: flags1,
    case_end_q: frames3,
    case_steps: scalars3,
    case_joints: scalars3,
    case_segments: scalars3,
    case_particles: scalars3,
    case_contacts: scalars3,
    case_obstacles: scalars3,
    case_grips: scalars3,
    differs: flags3,
    slots: flags1,
    widths: scalars1,
    by_held: lanes4,
    by_past: lanes4,
    by_slip: lanes4,
    after: scalars4,
    u: lanes3,
    trail: lanes4,
    y: lanes3,
    d_past: lanes4,
    d_slip: lanes4,
    bent: lanes4,
    out: lanes4,
):
    """Forward pass beside `roll_out`: derivatives of the states by a handful of parameters.

    The cases are those of `explicit`; by_held: see `of_end`. u (B, G, rows), d_past and d_slip are
    derivatives of the initial state and of what it remembers, on exit of the last. trail (B, KEPT, G, rows)
    has those of the state at index t at (t + 1) % KEPT: on entry of that before the initial one and of this.
    y, by_past, by_slip, after and bent are room. `slot[t - 1]` says where in `out` (B, slot, G, 3 n) the
    positions of step t go, -1 for nowhere.
    """
    for lane in range(x.shape[0] * APART):
        if lane % APART != 0:
            continue
        b = lane // APART
        n = x.shape[2]
        rows = 6 * (n + 1)
        rubbing = d_slip.shape[2] > 1 and fresh == 0
        keep_bent(bent, u, q, joints, steps, b, 0)
        for t in range(1, x.shape[1]):
            m = b * (x.shape[1] - 1) + t - 1
            for g in range(y.shape[1]):
                for r in range(rows):
                    y[b, g, r] = lanes(0.0)
            explicit(
                b, t, x, q, first, past, slip, sliding, case_end_q, case_steps, case_joints, case_segments,
                case_particles, case_contacts, case_obstacles, case_grips, moving, euler, fresh, differs,
                slots, widths, y, by_past, by_slip, after,
            )  # fmt: skip
            if moving == 1:
                pull_of_motion(y, trail, steps, particles, b, t, euler)
            pull_of_laws(y, q, joints, bends, bent, d_past, b, t, m, fresh)
            if rubbing:
                pull_of_friction(y, u, rubs, d_slip, b, m, n)
            move_ends(y, by_held, columns, grips, clamped, b, t, m, n)
            for g in range(y.shape[1]):
                solve_lanes(upper, lower, m, y, b, g, rows, symmetric)
            place_ends(y, by_held, grips, clamped, b, t, n)
            if rubbing:
                remember_friction(y, u, rubs, by_slip, d_slip, b, m, n)
            remember_laws(y, q, steps, joints, bends, bent, by_past, d_past, b, t, m, fresh)
            for g in range(y.shape[1]):
                for r in range(rows):
                    u[b, g, r] = y[b, g, r]
                    trail[b, (t + 1) % KEPT, g, r] = y[b, g, r]
                if slot[t - 1] >= 0:
                    for p in range(n):
                        for k in ti.static(range(3)):
                            out[b, slot[t - 1], g, 3 * p + k] = y[b, g, 6 * (p + 1) + k]


__all__ = ["sensitivities"]
