"""The steps of a roll-out once more, each factored at its converged state: `derivatives` says what for.

Steps are independent of each other here, so that all of them are done at once.
"""

from dlolib.sim.assembly import (
    ENDS,
    assemble,
    bands,
    bent_before,
    flags1,
    flags2,
    flags3,
    frames3,
    hold_ends,
    is_held,
    joint_lengths,
    row_of,
    sample,
    scalars3,
    scalars4,
    vectors2,
    vectors3,
)
from dlolib.sim.band import HALF, entry, factor
from dlolib.sim.contact import friction
from dlolib.sim.effects import LAWS
from dlolib.sim.equilibrium import NOT_FINITE
from dlolib.sim.joints import curvature, law_derivatives, laws_act
from dlolib.sim.launch import kernel
from dlolib.sim.runtime import NEAR, ti, vec3, vec4
from dlolib.sim.scene import LAWS as FIRST
from dlolib.sim.scene import SAMPLES


@ti.func
def keep_held(
    upper: ti.template(), lower: ti.template(), m: int, n: int, symmetric: int, b: int, grips: ti.template(),
    clamped: ti.template(), columns: ti.template(),
):  # fmt: skip
    """Into columns[m, k - 1] those of K that belong to the k-th of what is prescribed, within the band."""
    for k in range(1, ENDS):
        if is_held(k, b, grips, clamped):
            for j in range(3):
                c = row_of(k, n) + j
                for i in range(2 * HALF + 1):
                    r = c - HALF + i
                    if r >= 0 and r < 6 * (n + 1):
                        columns[m, k - 1, j, i] = entry(upper, lower, m, r, c, symmetric)


@kernel
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
    euler: ti.i32,
    fresh: ti.i32,
    symmetric: ti.i32,
    upper: bands,
    lower: bands,
    columns: scalars4,
    y: scalars3,
    bends: scalars4,
    rubs: scalars3,
    status: flags1,
):
    """K of every converged step, slot b T + t - 1, factored without what is prescribed.

    Its columns of what is prescribed are kept: (S, ENDS - 1, 3, 17), rows -8 to 8 off the diagonal. Beside
    it how the laws of every joint and the friction of every contact point depend on the step before: bends
    (S, n, laws, 20), five 2 x 2 matrices as `law_derivatives` returns them; rubs (S, K, 19), the spring's
    stiffness and two 3 x 3 matrices as `friction` does.
    """
    for lane in range(upper.shape[0] * NEAR):
        if lane % NEAR != 0:
            continue
        m = lane // NEAR
        n = x.shape[2]
        count = x.shape[1] - 1
        b, t = m // count, m % count + 1
        assemble(
            b, t, m, x, q, first, past, slip, sliding, end_q, steps, joints, segments, particles, contacts,
            obstacles, grips, clamped, moving, euler, fresh, symmetric, 1, 0, y, 0, first,
            upper, lower, y, False,
        )  # fmt: skip
        keep_held(upper, lower, m, n, symmetric, b, grips, clamped, columns)
        hold_ends(upper, lower, m, n, b, grips, clamped, symmetric)
        if factor(upper, lower, m, upper, lower, 6 * (n + 1), symmetric, 0) > 0:
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


__all__ = ["linearise"]
