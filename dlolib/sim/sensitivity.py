"""Derivatives of a roll-out forwards in time, beside `direct.roll_out`: `derivatives` says of what."""

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
    vectors3,
    vectors4,
)
from dlolib.sim.band import HALF, solve
from dlolib.sim.derivatives import block2, block3, gathered, of_end, scalars5, spread
from dlolib.sim.joints import law_acts, laws_act
from dlolib.sim.runtime import APART, ti, vec2, vec3
from dlolib.sim.scene import DRAG, INERTIA, SAMPLES
from dlolib.sim.strain import darboux, moment_to_rotations, rotations_to_strain


@ti.func
def bent_of(bent: ti.template(), b: int, c: int, i: int) -> vec2:
    """What `keep_bent` kept last of joint i: how its two curvatures [1/m] change with parameter c."""
    return vec2(bent[b, c, i, 0], bent[b, c, i, 1])


@ti.func
def bent_by(turn: ti.template(), b: int, c: int, i: int, joint: ti.template(), length: float) -> vec2:
    """How the two curvatures [1/m] of joint i change with parameter c, by its frames' turns; `joint` is what
    `darboux` says of them."""
    _phi, w, v, c0, c1, _c2 = joint
    change = rotations_to_strain(w, v, c0, c1, turn[b, c, i], turn[b, c, i + 1]) / length
    return vec2(change[0], change[1])


@ti.func
def keep_bent(
    bent: ti.template(), turn: ti.template(), q: ti.template(), joints: ti.template(), steps: ti.template(),
    b: int, t: int,
):  # fmt: skip
    """Into bent[b, c, i] how the curvatures of joints with laws change at index t, from turns [b, c]."""
    for i in range(joints.shape[1]):
        if laws_act(joints, b, i):
            length, _before = joint_lengths(joints, steps, b, t, i)
            joint = darboux(q[b, t, i], q[b, t, i + 1])
            for c in range(bent.shape[1]):
                now = bent_by(turn, b, c, i, joint, length)
                bent[b, c, i, 0], bent[b, c, i, 1] = now[0], now[1]


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
            joint = darboux(q[b, t, i], q[b, t, i + 1])
            for c in range(bent.shape[1]):
                before = bent_of(bent, b, c, i) * (1 - fresh)
                now = bent_by(next_turn, b, c, i, joint, length)
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


__all__ = ["sensitivities"]
