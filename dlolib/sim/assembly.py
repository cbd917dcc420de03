"""Forces and Hessian of one step: the constraints, the laws, the loads, and the inertia of the particles.

Block i of the unknowns is particle i - 1 and frame i, i = 0 ... n. Frames 0 and n are those of the wall
and the grasp (the paper's q_0 and q_n), joined to the rope over half a segment, so that the clamp is at
the wall and not in the middle of the first segment.
"""

from dlolib.sim.band import HALF, row_type
from dlolib.sim.contact import friction, push, within
from dlolib.sim.inertia import paces, slowed
from dlolib.sim.joints import curvature, elastic, laws_act, remember, respond
from dlolib.sim.rotations import identity
from dlolib.sim.runtime import mat3, ti, vec3, vec4
from dlolib.sim.scene import LENGTH, LOAD, PRIOR, SAMPLES, STIFFNESS
from dlolib.sim.strain import bend_twist, darboux, stretch_shear

scalars1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
scalars2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
scalars3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
scalars4 = ti.types.ndarray(dtype=ti.f64, ndim=4)
bands = ti.types.ndarray(dtype=row_type, ndim=2)
vectors2 = ti.types.ndarray(dtype=vec3, ndim=2)
vectors3 = ti.types.ndarray(dtype=vec3, ndim=3)
vectors4 = ti.types.ndarray(dtype=vec3, ndim=4)
frames2 = ti.types.ndarray(dtype=vec4, ndim=2)
frames3 = ti.types.ndarray(dtype=vec4, ndim=3)
flags1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
flags2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
flags3 = ti.types.ndarray(dtype=ti.i32, ndim=3)

# What may be prescribed, three unknowns each: the unused position, both outer frames, both end particles.
ENDS = 5
# What the roll of a rope that nobody holds meets, over the torsional stiffness: a step that goes on until no
# force is left may take more than a derivative, which has one try.
ROLL, ROLL_OF_DERIVATIVES = 1e-6, 1e-8


@ti.func
def write_upper(
    upper: ti.template(), m: int, i: int, xx: mat3, xt: mat3, tt: mat3, x_x: mat3, t_x: mat3, t_t: mat3
):
    """Rows of block i: its own xx, x-theta and theta-theta, and those that couple it to block i + 1."""
    for r in ti.static(range(3)):
        position, turn = row_type(0.0), row_type(0.0)
        for c in ti.static(range(3)):
            if ti.static(c >= r):
                position[c - r] = xx[r, c]
                turn[c - r] = tt[r, c]
            position[3 + c - r] = xt[r, c]
            position[6 + c - r] = x_x[r, c]
            turn[3 + c - r] = t_x[r, c]
            turn[6 + c - r] = t_t[r, c]
        upper[m, 6 * i + r] = position
        upper[m, 6 * i + 3 + r] = turn


@ti.func
def write_lower(
    lower: ti.template(), m: int, i: int, xx: mat3, tx: mat3, tt: mat3, x_x: mat3, x_t: mat3, t_t: mat3
):
    """Columns of block i: the same below the diagonal; x_t is by theta of block i, of the next particle."""
    for r in ti.static(range(3)):
        position, turn = row_type(0.0), row_type(0.0)
        for c in ti.static(range(3)):
            if ti.static(c > r):
                position[c - r] = xx[c, r]
                turn[c - r] = tt[c, r]
            position[3 + c - r] = tx[c, r]
            position[6 + c - r] = x_x[c, r]
            turn[3 + c - r] = x_t[c, r]
            turn[6 + c - r] = t_t[c, r]
        lower[m, 6 * i + r] = position
        lower[m, 6 * i + 3 + r] = turn


@ti.func
def joint_lengths(joints: ti.template(), steps: ti.template(), b: int, t: int, i: int):
    """Rest length of joint i [m] at index t and at the one before."""
    return joints[b, i, LENGTH] * steps[b, t, 1], joints[b, i, LENGTH] * steps[b, ti.max(t - 1, 0), 1]


@ti.func
def bent_from(joints: ti.template(), b: int, i: int, before: vec3, fresh: int) -> vec3:
    """From which curvature joint i comes [1/m]: that before, or of a `fresh` rope what it once was."""
    came = before
    if fresh == 1:
        came = vec3(joints[b, i, PRIOR], joints[b, i, PRIOR + 1], 0.0)
    return came


@ti.func
def bent_before(
    joints: ti.template(), q: ti.template(), b: int, t: int, i: int, length: float, fresh: int
) -> vec3:
    """The same of joint i in the step to index t; length: that of the joint at the step before [m]."""
    return bent_from(joints, b, i, curvature(q, b, t - 1, i, length), fresh)


@ti.func
def sample(x: ti.template(), b: int, t: int, p: int, j: int) -> vec3:
    """Contact point j of the segment that follows particle p; j = 0 is the particle itself."""
    here = x[b, t, p]
    if j > 0:
        share = j / float(SAMPLES)
        here = (1.0 - share) * here + share * x[b, t, p + 1]
    return here


@ti.func
def out_of_reach(
    case: int, b: int, t: int, p: int, x: ti.template(), steps: ti.template(), segments: ti.template(),
    contacts: ti.template(), obstacles: ti.template(),
) -> bool:  # fmt: skip
    """Whether no obstacle is near the segment that follows particle p."""
    far = False
    if p + 1 < x.shape[2]:
        span = contacts[case, SAMPLES * p + SAMPLES // 2, 1]
        span += 0.6 * segments[case, p, 0] * steps[case, t, 1]
        far = not within(sample(x, b, t, p, SAMPLES // 2), span, obstacles, case)
    return far


@ti.func
def kept(sliding: ti.template(), b: int, t: int, k: int, forced: int) -> int:
    """Whether contact k slid in the step to index t, or -1 where it is free to choose."""
    branch = -1
    if forced == 1:
        branch = sliding[b, t, k]
    return branch


@ti.func
def frozen(limits: ti.template(), b: int, k: int, lagged: int) -> vec4:
    """The limit at which contact k slides and its normal, if they are to be those noted, or -1 first."""
    found = vec4(-1.0)
    if lagged == 1:
        for j in ti.static(range(4)):
            found[j] = limits[b, j, k]
    return found


@ti.func
def held(limits: ti.template(), b: int, p: int, points: int, lagged: int) -> bool:
    """Whether a limit is noted of any of so many contact points that begin with particle p."""
    found = False
    if lagged == 1:
        for j in range(points):
            found = found or limits[b, 0, SAMPLES * p + j] > 0.0
    return found


@ti.func
def pulled(limits: ti.template(), b: int, k: int, lagged: int) -> vec3:
    """The stretch that contact k is expected to have, where its limit is noted."""
    found = vec3(0.0)
    if lagged == 1:
        for j in ti.static(range(3)):
            found[j] = limits[b, 4 + j, k]
    return found


@ti.func
def assemble(
    b: int, t: int, m: int, x: ti.template(), q: ti.template(), first: ti.template(),
    past: ti.template(), slip: ti.template(), sliding: ti.template(), end_q: ti.template(),
    steps: ti.template(), joints: ti.template(), segments: ti.template(), particles: ti.template(),
    contacts: ti.template(), obstacles: ti.template(), grips: ti.template(), clamped: ti.template(),
    moving: int, euler: int, fresh: int, symmetric: int, forced: int, lagged: int,
    limits: ti.template(), mixed: int, expected: ti.template(), upper: ti.template(),
    lower: ti.template(), y: ti.template(), plain: ti.template(),
) -> float:  # fmt: skip
    """Write the Hessian of the step to index t of rope b into slot m, minus its gradient into y[m, 0].

    The step solves gradient = 0 for the state at index t. Where all forces have potentials the gradient is
    that of the energy returned: elastic, contact and load energies, the work of the laws, and with `moving` s
    |x - x_free|^2 / 2 of each particle, with s the stiffness of inertia and drag and x_free where these
    vanish (`slowed`). `first` are the positions one step before index 0. With `forced` laws and contacts take
    the branches noted at index t. With `lagged` contacts slide at the `limits` and along the surfaces noted,
    wherever they are. With `mixed` the Hessian is that under the segments' `expected` forces. With `fresh`
    the laws see the rope come from being straight or as it once was, at once. A `plain` rope, a choice of
    compile time, has neither laws nor obstacles, and is symmetric.
    """
    n = particles.shape[1]
    dt = steps[b, t, 0] * (1 - fresh)
    inertia, drag = paces(steps, b, t, euler)
    energy = 0.0
    none = 0.0 * identity()
    gx_next, gt_next = vec3(0.0), vec3(0.0)
    xx_next, tt_next = none, none
    for i in range(n + 1):
        gx, gt, xx, tt = gx_next, gt_next, xx_next, tt_next
        xt, x_x, t_x, t_t, t_t_low, rub = none, none, none, none, none, none
        gx_next, gt_next = vec3(0.0), vec3(0.0)
        xx_next, tt_next = none, none
        if i < n:
            now_l, before_l = joint_lengths(joints, steps, b, t, i)
            phi, w, v, c, c1, c2 = darboux(q[b, t, i], q[b, t, i + 1])
            kappa = phi / now_l
            e, moment, tangent = elastic(joints, b, i, kappa)
            if ti.static(not plain):
                before = kappa
                if laws_act(joints, b, i):
                    before = bent_before(joints, q, b, t, i, before_l, fresh)
                e, moment, tangent = respond(
                    joints, past, b, b, t - 1, i, kappa, before, dt, forced, False, past, 0
                )
            energy += now_l * e
            ga, gb, aa, ab, ba, bb = bend_twist(w, v, c, c1, c2, moment, tangent * (1.0 / now_l))
            gt += ga
            tt += aa
            t_t, t_t_low = ab, ba
            gt_next, tt_next = gb, bb
            if i > 0:
                s = i - 1
                e, gd, gs, dd, dtheta, st = stretch_shear(
                    x[b, t, s + 1] - x[b, t, s], q[b, t, i], segments[b, s, 0] * steps[b, t, 1],
                    vec3(segments[b, s, 1], segments[b, s, 2], segments[b, s, 3]), mixed,
                    expected[b, s],
                )  # fmt: skip
                energy += e
                gx -= gd
                gt += gs
                xx += dd
                tt += st
                xt = -dtheta
                x_x = -dd
                t_x = dtheta.transpose()
                gx_next = gd
                xx_next = dd
        if i == 1 and clamped[b, 0] + clamped[b, 1] == 0:
            # no force, but a Hessian for the roll: alone it moves nothing, and rounding would decide
            share = ROLL if forced == 0 else ROLL_OF_DERIVATIVES
            tt[2, 2] += share * joints[b, 1, STIFFNESS + 2] / joints[b, 1, LENGTH]
        for end in ti.static(range(2)):
            if i == end * n and grips[b, end, 0] > 0.0:
                e, g, h = grip(
                    end_q[b, t - 1, end],
                    q[b, t, i],
                    vec3(grips[b, end, 0], grips[b, end, 1], grips[b, end, 2]),
                )
                energy += e
                gt += g
                tt += h
        if i > 0:
            p = i - 1
            if ti.static(not plain):
                # a segment out of reach has nothing to look for, but where limits are noted
                reach = SAMPLES if p + 1 < n else 1
                if obstacles.shape[1] == 0 or (
                    out_of_reach(b, b, t, p, x, steps, segments, contacts, obstacles)
                    and not held(limits, b, p, reach, lagged)
                ):
                    reach = 0
                for j in range(reach):
                    k = SAMPLES * p + j
                    there = j / float(SAMPLES)
                    here = 1.0 - there
                    point = sample(x, b, t, p, j)
                    e, g, h = push(point, contacts[b, k, 1], contacts[b, k, 0], obstacles, b)
                    if slip.shape[2] > 1 and fresh == 0:
                        ef, hold, stretch, by_p, _by_past, _k = friction(
                            point, sample(x, b, t - 1, p, j), slip[b, t - 1, k], contacts[b, k, 1],
                            contacts[b, k, 0], obstacles, b, kept(sliding, b, t, k, forced),
                            frozen(limits, b, k, lagged), pulled(limits, b, k, lagged),
                        )  # fmt: skip
                        e += ef
                        g += hold * stretch
                        h += hold * by_p
                    energy += e
                    gx += here * g
                    xx += here * here * h
                    gx_next += there * g
                    xx_next += there * there * h
                    rub += here * there * h
            load = vec3(particles[b, p, LOAD], particles[b, p, LOAD + 1], particles[b, p, LOAD + 2])
            energy -= load.dot(x[b, t, p])
            gx -= load
            if moving == 1:
                force, stiffness = slowed(x, first, particles, inertia, drag, b, b, t, p)
                if stiffness > 0.0:
                    energy += 0.5 / stiffness * force.dot(force)
                gx += force
                xx += stiffness * identity()
        write_upper(upper, m, i, xx, xt, tt, x_x + rub, t_x, t_t)
        if ti.static(not plain) and symmetric == 0:
            write_lower(lower, m, i, xx, xt.transpose(), tt, x_x + rub, t_x.transpose(), t_t_low)
        for r in ti.static(range(3)):
            y[m, 0, 6 * i + r] = -gx[r]
            y[m, 0, 6 * i + 3 + r] = -gt[r]
    return energy


@ti.func
def grip(held: vec4, frame: vec4, stiffness: vec3):
    """Energy [J] of a clamp that gives way, its gradient by a turn of the rope's frame, and its Hessian."""
    phi, w, v, c, c1, c2 = darboux(held, frame)
    diagonal = mat3([[stiffness[0], 0.0, 0.0], [0.0, stiffness[1], 0.0], [0.0, 0.0, stiffness[2]]])
    _ga, g, _aa, _ab, _ba, h = bend_twist(w, v, c, c1, c2, stiffness * phi, diagonal)
    return 0.5 * (stiffness * phi).dot(phi), g, h


@ti.func
def advance(
    b: int, t: int, x: ti.template(), q: ti.template(), past: ti.template(), slip: ti.template(),
    sliding: ti.template(), steps: ti.template(), joints: ti.template(), contacts: ti.template(),
    obstacles: ti.template(), fresh: int,
):  # fmt: skip
    """The histories of laws and contacts after the step to index t, into past[b, t] and slip[b, t], with the
    branches that they took in past and `sliding`."""
    n = joints.shape[1]
    dt = steps[b, t, 0] * (1 - fresh)
    for i in range(n):
        now_l, before_l = joint_lengths(joints, steps, b, t, i)
        if laws_act(joints, b, i):
            kappa = curvature(q, b, t, i, now_l)
            before = bent_before(joints, q, b, t, i, before_l, fresh)
            remember(joints, past, b, t, i, kappa, before, dt)
        for j in range(SAMPLES):
            if slip.shape[2] > 1 and (j == 0 or i + 1 < n):
                k = SAMPLES * i + j
                stretch = vec3(0.0)
                if fresh == 0:
                    _e, _hold, stretch, _by_p, _by_past, slides = friction(
                        sample(x, b, t, i, j), sample(x, b, t - 1, i, j), slip[b, t - 1, k],
                        contacts[b, k, 1], contacts[b, k, 0], obstacles, b, -1, vec4(-1.0), vec3(0.0),
                    )  # fmt: skip
                    sliding[b, t, k] = slides
                slip[b, t, k] = stretch


@ti.func
def row_of(k: int, n: int) -> int:
    """The first unknown of the k-th of what may be prescribed."""
    row = 0
    if k == 1:
        row = 3
    elif k == 2:
        row = 6 * n + 3
    elif k == 3:
        row = 6
    elif k == 4:
        row = 6 * n
    return row


@ti.func
def is_held(k: int, b: int, grips: ti.template(), clamped: ti.template()) -> bool:
    """Whether the k-th of what may be prescribed is: held ends, and what is not used."""
    held = k == 0
    if k == 1 or k == 2:
        held = grips[b, k - 1, 0] == 0.0
    elif k > 2:
        held = clamped[b, k - 3] == 1
    return held


@ti.func
def hold_ends(
    upper: ti.template(),
    lower: ti.template(),
    m: int,
    n: int,
    b: int,
    grips: ti.template(),
    clamped: ti.template(),
    symmetric: int,
):
    """Take out of the Hessian what is prescribed: unit diagonal, no coupling."""
    for end in range(ENDS):
        if is_held(end, b, grips, clamped):
            for r in range(row_of(end, n), row_of(end, n) + 3):
                for k in range(1, HALF + 1):
                    upper[m, r][k] = 0.0
                    if r - k >= 0:
                        upper[m, r - k][k] = 0.0
                    if symmetric == 0:
                        lower[m, r][k] = 0.0
                        if r - k >= 0:
                            lower[m, r - k][k] = 0.0
                upper[m, r][0] = 1.0


@ti.func
def clear_held(
    y: ti.template(), m: int, c: int, n: int, b: int, grips: ti.template(), clamped: ti.template()
):
    """Zero the prescribed unknowns of column c."""
    for end in range(ENDS):
        if is_held(end, b, grips, clamped):
            for r in range(row_of(end, n), row_of(end, n) + 3):
                y[m, c, r] = 0.0
