"""Derivatives of a roll-out backwards in time, beside `direct.roll_out`: `derivatives` says of what."""

from dlolib.sim.assembly import (
    ENDS,
    bands,
    clear_held,
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
from dlolib.sim.band import HALF, solve, solve_transposed
from dlolib.sim.derivatives import block2, block3, gathered, lanes2, lanes3, lanes4, of_end, spread
from dlolib.sim.explicit import explicit
from dlolib.sim.inertia import BACK, paces
from dlolib.sim.joints import HISTORY, laws_act
from dlolib.sim.launch import kernel
from dlolib.sim.runtime import APART, lanes, ti, vec2, vec3
from dlolib.sim.scene import DRAG, INERTIA, SAMPLES
from dlolib.sim.strain import bend_twist, darboux, moment_to_rotations, rotations_to_strain


@kernel
def adjoint(
    x: vectors3,
    q: frames3,
    first: vectors2,
    past: scalars4,
    slip: vectors3,
    sliding: flags3,
    end_q: frames3,
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
    y: scalars3,
    bends: scalars4,
    rubs: scalars3,
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
    by_force: lanes3,
    by_past: lanes4,
    by_slip: lanes4,
    after: scalars4,
    d_x: vectors3,
    d_first: vectors2,
    turn: vectors2,
    d_past: scalars3,
    d_slip: vectors2,
    d_end_x: vectors3,
    d_end_q: vectors3,
    d_parameter: lanes2,
):
    """Reverse pass of `roll_out`.

    On entry d_x (B, T + 1, n) holds the loss's derivative by every position, and turn (B, n + 1), d_past,
    d_slip those by the last state's frames and histories; on exit d_x's first index and the others those by
    the initial state (d_first: by the positions before it). d_end_x, d_end_q and d_parameter (B, G) are
    added to. The cases are those of `explicit`; by_force, by_past, by_slip and after are room.
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
                    for g in range(d_parameter.shape[1]):
                        for j in ti.static(range(3)):
                            d_parameter[b, g] += found[j] * of_end(k, by_held, b, t, g, j)
            for end in ti.static(range(2)):
                if grips[b, end, 0] > 0.0:
                    i = n * end
                    k = vec3(grips[b, end, 0], grips[b, end, 1], grips[b, end, 2])
                    phi, w, v, c0, c1, c2 = darboux(end_q[b, t - 1, end], q[b, t, i])
                    stiff = ti.Matrix([[k[0], 0.0, 0.0], [0.0, k[1], 0.0], [0.0, 0.0, k[2]]])
                    _ga, _gb, _aa, _ab, ba, _bb = bend_twist(w, v, c0, c1, c2, k * phi, stiff)
                    own = vec3(y[b, 0, 6 * i + 3], y[b, 0, 6 * i + 4], y[b, 0, 6 * i + 5])
                    d_end_q[b, t - 1, end] -= ba.transpose() @ own
            for g in range(d_parameter.shape[1]):
                for r in range(rows):
                    by_force[b, g, r] = lanes(0.0)
            explicit(
                b, t, x, q, first, past, slip, sliding, case_end_q, case_steps, case_joints, case_segments,
                case_particles, case_contacts, case_obstacles, case_grips, moving, euler, fresh, differs,
                slots, widths, by_force, by_past, by_slip, after,
            )  # fmt: skip
            for g in range(d_parameter.shape[1]):
                total = lanes(0.0)
                for r in range(rows):
                    total += y[b, 0, r] * by_force[b, g, r]
                for i in range(n):
                    if laws_act(joints, b, i):
                        for k in range(HISTORY):
                            total += d_past[b, i, k] * by_past[b, g, i, k]
                for k in range(d_slip.shape[1]):
                    for j in ti.static(range(3)):
                        total += d_slip[b, k][j] * by_slip[b, g, k, j]
                d_parameter[b, g] += total
            if moving == 1:
                inertia, drag = paces(steps, b, t, euler)
                for p in range(n):
                    r = 6 * (p + 1)
                    pull = vec3(y[b, 0, r], y[b, 0, r + 1], y[b, 0, r + 2])
                    stiffness = particles[b, p, INERTIA] * inertia + particles[b, p, DRAG] * drag
                    for back in ti.static(range(1, BACK + 1)):
                        # the way that leads there, and the one that leads on from there
                        share = stiffness[back - 1]
                        if ti.static(back < BACK):
                            share -= stiffness[back]
                        if t >= back:
                            d_x[b, t - back, p] += share * pull
                        elif t == back - 1:
                            d_first[b, p] += share * pull
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


__all__ = ["adjoint"]
