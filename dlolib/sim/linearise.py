"""The steps of a roll-out once more, one by one: each factored at its converged state, or its forces alone.

Steps are independent of each other here, so that all of them are done at once. `derivatives` says what for.
"""

from dlolib.sim.assembly import (
    advance,
    assemble,
    bands,
    bent_before,
    flags1,
    flags2,
    flags3,
    frames3,
    hold_ends,
    joint_lengths,
    sample,
    scalars3,
    scalars4,
    vectors2,
    vectors3,
)
from dlolib.sim.band import factor
from dlolib.sim.contact import friction
from dlolib.sim.direct import NOT_FINITE
from dlolib.sim.effects import LAWS
from dlolib.sim.joints import begin, curvature, law_derivatives, laws_act
from dlolib.sim.runtime import NEAR, ti, vec3, vec4
from dlolib.sim.scene import LAWS as FIRST
from dlolib.sim.scene import SAMPLES


@ti.func
def copy_band(source: ti.template(), target: ti.template(), b: int, rows: int):
    for r in range(rows):
        target[b, r] = source[b, r]


@ti.kernel
def linearise(
    x: vectors3,
    q: frames3,
    first: vectors2,
    past: scalars4,
    slip: vectors3,
    sliding: flags3,
    end_q: frames3,
    steps: scalars3,
    joints: scalars3,
    segments: scalars3,
    particles: scalars3,
    contacts: scalars3,
    obstacles: scalars3,
    grips: scalars3,
    clamped: flags2,
    moving: ti.i32,
    momentum: ti.f64,
    fresh: ti.i32,
    symmetric: ti.i32,
    upper: bands,
    lower: bands,
    whole_upper: bands,
    whole_lower: bands,
    y: scalars3,
    bends: scalars4,
    rubs: scalars3,
    status: flags1,
):
    """K of every converged step, slot b T + t - 1: whole, and factored without what is prescribed.

    Beside it how the laws of every joint and the friction of every contact point depend on the step before:
    bends (S, n, laws, 20), five 2 x 2 matrices as `law_derivatives` returns them; rubs (S, K, 19), the
    spring's stiffness and two 3 x 3 matrices as `friction` does.
    """
    for lane in range(upper.shape[0] * NEAR):
        if lane % NEAR != 0:
            continue
        m = lane // NEAR
        n = x.shape[2]
        count = x.shape[1] - 1
        b, t = m // count, m % count + 1
        # both parts are wanted of a symmetric K too
        assemble(
            b, t, m, x, q, first, past, slip, sliding, end_q, steps, joints, segments, particles, contacts,
            obstacles, grips, clamped, moving, momentum, fresh, 0, 1, 0, y, 0, first,
            upper, lower, y, True, False,
        )  # fmt: skip
        copy_band(upper, whole_upper, m, 6 * (n + 1))
        copy_band(lower, whole_lower, m, 6 * (n + 1))
        hold_ends(upper, lower, m, n, b, grips, clamped)
        if factor(upper, lower, m, 6 * (n + 1), symmetric, 0) > 0:
            status[m] = NOT_FINITE
        dt = steps[b, t, 0] * (1 - fresh)
        for i in range(n):
            if laws_act(joints, b, i):
                now_l, before_l = joint_lengths(joints, steps, b, t, i)
                kappa = curvature(q, b, t, i, now_l)
                before = bent_before(joints, q, b, t, i, before_l, fresh)
                for k in ti.static(range(len(LAWS))):
                    if joints[b, i, FIRST + 2 * k] != 0.0:
                        blocks = law_derivatives(k, joints, past, b, t - 1, i, kappa, before, dt)
                        for part in ti.static(range(5)):
                            for r in ti.static(range(2)):
                                for c in ti.static(range(2)):
                                    bends[m, i, k, 4 * part + 2 * r + c] = blocks[part][r, c]
        if slip.shape[2] > 1 and fresh == 0:
            for p in range(n):
                for j in range(SAMPLES):
                    if j == 0 or p + 1 < n:
                        k = SAMPLES * p + j
                        _e, hold, _s, by_p, by_past, _on = friction(
                            sample(x, b, t, p, j), sample(x, b, t - 1, p, j), slip[b, t - 1, k],
                            contacts[b, k, 1], contacts[b, k, 0], obstacles, b, sliding[b, t, k], vec4(-1.0),
                            vec3(0.0),
                        )  # fmt: skip
                        rubs[m, k, 0] = hold
                        for r in ti.static(range(3)):
                            for c in ti.static(range(3)):
                                rubs[m, k, 1 + 3 * r + c] = by_p[r, c]
                                rubs[m, k, 10 + 3 * r + c] = by_past[r, c]


@ti.kernel
def residuals(
    x: vectors3,
    q: frames3,
    first: vectors2,
    past: scalars4,
    slip: vectors3,
    sliding: flags3,
    end_q: frames3,
    steps: scalars3,
    joints: scalars3,
    segments: scalars3,
    particles: scalars3,
    contacts: scalars3,
    obstacles: scalars3,
    grips: scalars3,
    clamped: flags2,
    moving: ti.i32,
    momentum: ti.f64,
    fresh: ti.i32,
    symmetric: ti.i32,
    unused: bands,
    y: scalars3,
    out_past: scalars4,
    out_slip: vectors3,
):
    """Minus the forces of every step, slot b T + t - 1, and the histories that follow it, at fixed states."""
    for lane in range(y.shape[0] * NEAR):
        if lane % NEAR != 0:
            continue
        m = lane // NEAR
        count = x.shape[1] - 1
        b, t = m // count, m % count + 1
        if fresh == 1:
            # what was before the first shape depends on the parameters too
            for i in range(x.shape[2]):
                begin(joints, past, b, t - 1, i, 1)
        assemble(
            b, t, m, x, q, first, past, slip, sliding, end_q, steps, joints, segments, particles, contacts,
            obstacles, grips, clamped, moving, momentum, fresh, symmetric, 1, 0, y, 0, first,
            unused, unused, y, False, False,
        )  # fmt: skip
        advance(
            b, t, m, 0, x, q, past, slip, sliding, steps, joints, contacts, obstacles, fresh, symmetric, 1,
            out_past, out_slip,
        )  # fmt: skip


__all__ = ["linearise", "residuals"]
