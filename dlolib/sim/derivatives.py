"""Derivatives of a roll-out, by the implicit function theorem: one banded solve a step.

With r the step's forces, u its state and h the histories of laws and contacts, a step is r(u, u', h', p) = 0
and h = G(u, u', h', p); primes mark the step before. Then

    K du = -(dr/du' du' + dr/dh' dh' + dr/dp),   K = dr/du

forwards in time (`sensitivities`, for a handful of parameters p and many residuals), and the transpose of
all this backwards (`adjoint`, for one loss and any number of inputs). What a parameter does, dr/dp and dG/dp
at fixed u, u' and h', comes from the residuals of two scenes (`linearise`), a little to either side: an
explicit function, smooth on the branches that the step took; its differences are right to some eight digits.
"""

from dlolib.sim.assembly import (
    ENDS,
    bands,
    clear_held,
    flags1,
    flags2,
    frames3,
    is_held,
    joint_lengths,
    row_of,
    sample,
    scalars3,
    scalars4,
    vectors2,
    vectors3,
    vectors4,
)
from dlolib.sim.band import HALF, solve, solve_transposed
from dlolib.sim.joints import HISTORY, law_acts, laws_act
from dlolib.sim.runtime import APART, mat2, mat3, ti, vec2, vec3
from dlolib.sim.scene import DRAG, INERTIA, SAMPLES
from dlolib.sim.strain import bend_twist, darboux, moment_to_rotations, rotations_to_strain

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


@ti.func
def bent_of(bent: ti.template(), b: int, c: int, i: int) -> vec2:
    """What `keep_bent` kept last of joint i: how its two curvatures [1/m] change with parameter c."""
    return vec2(bent[b, c, i, 0], bent[b, c, i, 1])


@ti.func
def keep_bent(
    bent: ti.template(), turn: ti.template(), q: ti.template(), joints: ti.template(), steps: ti.template(),
    b: int, t: int,
):  # fmt: skip
    """Into bent[b, c, i] how the curvatures of joints with laws change at index t, from turns [b, c]."""
    for i in range(joints.shape[1]):
        if laws_act(joints, b, i):
            length, _before = joint_lengths(joints, steps, b, t, i)
            _phi, w, v, c0, c1, _c2 = darboux(q[b, t, i], q[b, t, i + 1])
            for c in range(bent.shape[1]):
                change = rotations_to_strain(w, v, c0, c1, turn[b, c, i], turn[b, c, i + 1]) / length
                bent[b, c, i, 0], bent[b, c, i, 1] = change[0], change[1]


@ti.func
def pull_of_laws(
    y: ti.template(), q: ti.template(), joints: ti.template(), bends: ti.template(), bent: ti.template(),
    d_past: ti.template(), b: int, t: int, m: int, fresh: int,
):  # fmt: skip
    """Into y[b, c] minus what the laws' moments at index t owe to the curvatures and histories before."""
    for i in range(joints.shape[1]):
        if laws_act(joints, b, i):
            _phi, w, v, c0, c1, _c2 = darboux(q[b, t, i], q[b, t, i + 1])
            for c in range(bent.shape[1]):
                before = bent_of(bent, b, c, i) * (1 - fresh)
                moment = vec3(0.0)
                for k in range(bends.shape[2]):
                    if law_acts(joints, b, i, k):
                        h = vec2(d_past[b, c, i, 3 * k], d_past[b, c, i, 3 * k + 1])
                        change = block2(bends, m, i, k, 0) @ before + block2(bends, m, i, k, 1) @ h
                        moment += vec3(change[0], change[1], 0.0)
                ga, gb = moment_to_rotations(w, v, c0, c1, moment)
                for k in ti.static(range(3)):
                    y[b, c, 6 * i + 3 + k] -= ga[k]
                    y[b, c, 6 * i + 9 + k] -= gb[k]


@ti.func
def remember_laws(
    next_turn: ti.template(), q: ti.template(), steps: ti.template(), joints: ti.template(),
    bends: ti.template(), bent: ti.template(), by_past: ti.template(), d_past: ti.template(), b: int, t: int,
    m: int, fresh: int,
):  # fmt: skip
    """The derivatives of the laws' histories and curvatures from those at index t - 1 to those at t."""
    for i in range(joints.shape[1]):
        if laws_act(joints, b, i):
            length, _before = joint_lengths(joints, steps, b, t, i)
            _phi, w, v, c0, c1, _c2 = darboux(q[b, t, i], q[b, t, i + 1])
            for c in range(bent.shape[1]):
                before = bent_of(bent, b, c, i) * (1 - fresh)
                change = (
                    rotations_to_strain(w, v, c0, c1, next_turn[b, c, i], next_turn[b, c, i + 1]) / length
                )
                now = vec2(change[0], change[1])
                for k in range(bends.shape[2]):
                    if law_acts(joints, b, i, k):
                        h = vec2(d_past[b, c, i, 3 * k], d_past[b, c, i, 3 * k + 1])
                        h = block2(bends, m, i, k, 4) @ h
                        h += block2(bends, m, i, k, 2) @ now + block2(bends, m, i, k, 3) @ before
                        for j in ti.static(range(2)):
                            d_past[b, c, i, 3 * k + j] = h[j] + by_past[m, c, i, 3 * k + j]
                bent[b, c, i, 0], bent[b, c, i, 1] = now[0], now[1]


@ti.kernel
def sensitivities(
    x: vectors3,
    q: frames3,
    steps: scalars3,
    joints: scalars3,
    particles: scalars3,
    grips: scalars3,
    clamped: flags2,
    moving: ti.i32,
    momentum: ti.f64,
    fresh: ti.i32,
    symmetric: ti.i32,
    upper: bands,
    lower: bands,
    columns: scalars4,
    y: scalars3,
    bends: scalars4,
    rubs: scalars3,
    slot: flags1,
    by_force: scalars3,
    by_past: scalars4,
    by_slip: vectors3,
    by_held: scalars5,
    last: vectors3,
    last_but_one: vectors3,
    turn: vectors3,
    next_turn: vectors3,
    d_past: scalars4,
    d_slip: vectors3,
    bent: scalars4,
    out: vectors4,
):
    """Forward pass beside `roll_out`: derivatives of the positions by a handful of parameters c.

    by_force (S, C, rows), by_past (S, C, n, HISTORY), by_slip (S, C, K): what the parameters do to each
    step at fixed states; by_held (B, T, C, 2, 6): to the held positions and frames. last, last_but_one, turn,
    d_past, d_slip: derivatives of the initial state, on exit of the last. bent (B, C, n, 2): room for those
    of the curvatures of joints with laws. `slot[t - 1]` says where in `out` (B, slot, C, n) step t goes, -1
    for nowhere.
    """
    for lane in range(x.shape[0] * APART):
        if lane % APART != 0:
            continue
        b = lane // APART
        n = x.shape[2]
        rows = 6 * (n + 1)
        keep_bent(bent, turn, q, joints, steps, b, 0)
        for c in range(last.shape[1]):
            for i in range(n + 1):
                next_turn[b, c, i] = turn[b, c, i]
        for t in range(1, x.shape[1]):
            m = b * (x.shape[1] - 1) + t - 1
            for c in range(last.shape[1]):
                for r in range(rows):
                    y[b, c, r] = by_force[m, c, r]
                if moving == 1:
                    rate = 1.0 / steps[b, t, 0]
                    ratio = steps[b, t, 0] / steps[b, t - 1, 0]
                    for p in range(n):
                        inertia, drag = particles[b, p, INERTIA] * rate * rate, particles[b, p, DRAG] * rate
                        moved = last[b, c, p] - last_but_one[b, c, p]
                        pull = (inertia + drag) * last[b, c, p] + inertia * momentum * ratio * moved
                        for k in ti.static(range(3)):
                            y[b, c, 6 * (p + 1) + k] += pull[k]
            pull_of_laws(y, q, joints, bends, bent, d_past, b, t, m, fresh)
            for c in range(last.shape[1]):
                if d_slip.shape[2] > 1 and fresh == 0:
                    for p in range(n):
                        for j in range(SAMPLES):
                            k = SAMPLES * p + j
                            if (j == 0 or p + 1 < n) and rubs[m, k, 0] > 0.0:
                                moved = sample(last, b, c, p, j) - d_slip[b, c, k]
                                spread(y, b, c, p, j, rubs[m, k, 0] * (block3(rubs, m, k, 10) @ moved))
                for k in range(ENDS):
                    row = row_of(k, n)
                    if is_held(k, b, grips, clamped):
                        moved = of_end(k, by_held, b, t, c)
                        if moved.norm() > 0.0:
                            for r in range(ti.max(row - HALF, 0), ti.min(row + HALF + 3, rows)):
                                for j in ti.static(range(3)):
                                    if ti.abs(row + j - r) <= HALF:
                                        y[b, c, r] -= columns[m, k - 1, j, r - row - j + HALF] * moved[j]
                clear_held(y, b, c, n, b, grips, clamped)
                solve(upper, lower, m, y, b, c, rows, symmetric)
                for k in range(ENDS):
                    row = row_of(k, n)
                    if is_held(k, b, grips, clamped):
                        moved = of_end(k, by_held, b, t, c)
                        for j in ti.static(range(3)):
                            y[b, c, row + j] = moved[j]
                for i in range(n + 1):
                    next_turn[b, c, i] = vec3(y[b, c, 6 * i + 3], y[b, c, 6 * i + 4], y[b, c, 6 * i + 5])
                if d_slip.shape[2] > 1 and fresh == 0:
                    for p in range(n):
                        for j in range(SAMPLES):
                            if j == 0 or p + 1 < n:
                                k = SAMPLES * p + j
                                held = d_slip[b, c, k] - sample(last, b, c, p, j)
                                held = block3(rubs, m, k, 10) @ held
                                held += block3(rubs, m, k, 1) @ gathered(y, b, c, p, j)
                                d_slip[b, c, k] = held + by_slip[m, c, k]
                for p in range(n):
                    r = 6 * (p + 1)
                    last_but_one[b, c, p] = last[b, c, p]
                    last[b, c, p] = vec3(y[b, c, r], y[b, c, r + 1], y[b, c, r + 2])
                    if slot[t - 1] >= 0:
                        out[b, slot[t - 1], c, p] = last[b, c, p]
            remember_laws(next_turn, q, steps, joints, bends, bent, by_past, d_past, b, t, m, fresh)
        for c in range(last.shape[1]):
            for i in range(n + 1):
                turn[b, c, i] = next_turn[b, c, i]


@ti.kernel
def adjoint(
    x: vectors3,
    q: frames3,
    end_q: frames3,
    steps: scalars3,
    joints: scalars3,
    particles: scalars3,
    grips: scalars3,
    clamped: flags2,
    moving: ti.i32,
    momentum: ti.f64,
    fresh: ti.i32,
    symmetric: ti.i32,
    upper: bands,
    lower: bands,
    columns: scalars4,
    y: scalars3,
    bends: scalars4,
    rubs: scalars3,
    by_force: scalars3,
    by_past: scalars4,
    by_slip: vectors3,
    by_held: scalars5,
    d_x: vectors3,
    d_first: vectors2,
    turn: vectors2,
    d_past: scalars3,
    d_slip: vectors2,
    d_end_x: vectors3,
    d_end_q: vectors3,
    d_parameter: scalars3,
):
    """Reverse pass of `roll_out`.

    On entry d_x (B, T + 1, n) holds the loss's derivative by every position, and turn (B, n + 1), d_past,
    d_slip those by the last state's frames and histories; on exit d_x's first index and the others those by
    the initial state (d_first: by the positions before it). d_end_x, d_end_q and d_parameter (B, C, 1) are
    added to.
    """
    for lane in range(x.shape[0] * APART):
        if lane % APART != 0:
            continue
        b = lane // APART
        n = x.shape[2]
        rows = 6 * (n + 1)
        for back in range(x.shape[1] - 1):
            t = x.shape[1] - 1 - back
            m = b * (x.shape[1] - 1) + t - 1
            for p in range(n):
                for k in ti.static(range(3)):
                    y[b, 0, 6 * (p + 1) + k] = d_x[b, t, p][k]
            for k in ti.static(range(3)):
                y[b, 0, k] = 0.0
            for i in range(n + 1):
                for k in ti.static(range(3)):
                    y[b, 0, 6 * i + 3 + k] = turn[b, i][k]
                turn[b, i] = vec3(0.0)
            # what was remembered of this step, later steps have read
            for i in range(n):
                if laws_act(joints, b, i):
                    now_l, _before_l = joint_lengths(joints, steps, b, t, i)
                    pull = vec3(0.0)
                    for k in range(bends.shape[2]):
                        h = vec2(d_past[b, i, 3 * k], d_past[b, i, 3 * k + 1])
                        a = block2(bends, m, i, k, 2).transpose() @ h
                        pull += vec3(a[0], a[1], 0.0) / now_l
                    _phi, w, v, c0, c1, _c2 = darboux(q[b, t, i], q[b, t, i + 1])
                    ga, gb = moment_to_rotations(w, v, c0, c1, pull)
                    for k in ti.static(range(3)):
                        y[b, 0, 6 * i + 3 + k] += ga[k]
                        y[b, 0, 6 * i + 9 + k] += gb[k]
            if d_slip.shape[1] > 1 and fresh == 0:
                for p in range(n):
                    for j in range(SAMPLES):
                        if j == 0 or p + 1 < n:
                            k = SAMPLES * p + j
                            spread(y, b, 0, p, j, block3(rubs, m, k, 1).transpose() @ d_slip[b, k])
            # column 1 keeps what the loss says of the prescribed unknowns
            for k in range(ENDS):
                for r in range(row_of(k, n), row_of(k, n) + 3):
                    y[b, 1, r] = y[b, 0, r]
            clear_held(y, b, 0, n, b, grips, clamped)
            if symmetric == 1:
                solve(upper, lower, m, y, b, 0, rows, 1)
            else:
                solve_transposed(upper, lower, m, y, b, 0, rows)
            # lambda is in y: what the step reads, it feeds back to
            for k in range(1, ENDS):
                row = row_of(k, n)
                if is_held(k, b, grips, clamped):
                    found = vec3(0.0)
                    for j in ti.static(range(3)):
                        found[j] = y[b, 1, row + j]
                        for i in range(2 * HALF + 1):
                            r = row + j - HALF + i
                            if r >= 0 and r < rows:
                                found[j] -= columns[m, k - 1, j, i] * y[b, 0, r]
                    if k < 3:
                        d_end_q[b, t - 1, k - 1] += found
                    else:
                        d_end_x[b, t - 1, k - 3] += found
                    for c in range(d_parameter.shape[1]):
                        d_parameter[b, c, 0] += found.dot(of_end(k, by_held, b, t, c))
            for end in ti.static(range(2)):
                if grips[b, end, 0] > 0.0:
                    i = n * end
                    k = vec3(grips[b, end, 0], grips[b, end, 1], grips[b, end, 2])
                    phi, w, v, c0, c1, c2 = darboux(end_q[b, t - 1, end], q[b, t, i])
                    stiff = ti.Matrix([[k[0], 0.0, 0.0], [0.0, k[1], 0.0], [0.0, 0.0, k[2]]])
                    _ga, _gb, _aa, _ab, ba, _bb = bend_twist(w, v, c0, c1, c2, k * phi, stiff)
                    own = vec3(y[b, 0, 6 * i + 3], y[b, 0, 6 * i + 4], y[b, 0, 6 * i + 5])
                    d_end_q[b, t - 1, end] -= ba.transpose() @ own
            for c in range(d_parameter.shape[1]):
                total = 0.0
                for r in range(rows):
                    total += y[b, 0, r] * by_force[m, c, r]
                for i in range(n):
                    if laws_act(joints, b, i):
                        for k in range(HISTORY):
                            total += d_past[b, i, k] * by_past[m, c, i, k]
                for k in range(d_slip.shape[1]):
                    total += d_slip[b, k].dot(by_slip[m, c, k])
                d_parameter[b, c, 0] += total
            if moving == 1:
                rate = 1.0 / steps[b, t, 0]
                ratio = steps[b, t, 0] / steps[b, t - 1, 0]
                for p in range(n):
                    r = 6 * (p + 1)
                    pull = vec3(y[b, 0, r], y[b, 0, r + 1], y[b, 0, r + 2])
                    inertia, drag = particles[b, p, INERTIA] * rate * rate, particles[b, p, DRAG] * rate
                    d_x[b, t - 1, p] += ((1.0 + momentum * ratio) * inertia + drag) * pull
                    if t > 1:
                        d_x[b, t - 2, p] -= momentum * ratio * inertia * pull
                    else:
                        d_first[b, p] -= momentum * inertia * pull
            for i in range(n):
                if laws_act(joints, b, i):
                    _now_l, before_l = joint_lengths(joints, steps, b, t, i)
                    ra, rb = 6 * i + 3, 6 * i + 9
                    ta = vec3(y[b, 0, ra], y[b, 0, ra + 1], y[b, 0, ra + 2])
                    tb = vec3(y[b, 0, rb], y[b, 0, rb + 1], y[b, 0, rb + 2])
                    _phi, w, v, c0, c1, _c2 = darboux(q[b, t, i], q[b, t, i + 1])
                    work = rotations_to_strain(w, v, c0, c1, ta, tb)
                    own = vec2(work[0], work[1])
                    bent = vec3(0.0)
                    for k in range(bends.shape[2]):
                        h = vec2(d_past[b, i, 3 * k], d_past[b, i, 3 * k + 1])
                        a = block2(bends, m, i, k, 3).transpose() @ h
                        a -= block2(bends, m, i, k, 0).transpose() @ own
                        h = block2(bends, m, i, k, 4).transpose() @ h
                        h -= block2(bends, m, i, k, 1).transpose() @ own
                        bent += vec3(a[0], a[1], 0.0)
                        d_past[b, i, 3 * k], d_past[b, i, 3 * k + 1] = h[0], h[1]
                    if fresh == 0:
                        _phi, w, v, c0, c1, _c2 = darboux(q[b, t - 1, i], q[b, t - 1, i + 1])
                        ga, gb = moment_to_rotations(w, v, c0, c1, bent / before_l)
                        turn[b, i] += ga
                        turn[b, i + 1] += gb
            if d_slip.shape[1] > 1 and fresh == 0:
                for p in range(n):
                    for j in range(SAMPLES):
                        if j == 0 or p + 1 < n:
                            k = SAMPLES * p + j
                            back_to = d_slip[b, k] - rubs[m, k, 0] * gathered(y, b, 0, p, j)
                            back_to = block3(rubs, m, k, 10).transpose() @ back_to
                            d_slip[b, k] = back_to
                            there = j / float(SAMPLES)
                            d_x[b, t - 1, p] -= (1.0 - there) * back_to
                            if j > 0:
                                d_x[b, t - 1, p + 1] -= there * back_to


__all__ = ["adjoint", "sensitivities"]
