"""The direct solver: each step's constraints all at once, by Newton's method on a banded Hessian.

XPBD's multipliers (3), solved together instead of one by one, are a Newton step of the implicit Euler
energy; iterated until it stands still, the shape depends on no iteration count.
"""

from dlolib.sim.assembly import (
    advance,
    assemble,
    clear_held,
    flags2,
    flags3,
    frames2,
    frames3,
    hold_ends,
    sample,
    scalars3,
    scalars4,
    vectors2,
    vectors3,
)
from dlolib.sim.band import factor, solve
from dlolib.sim.contact import grip_of
from dlolib.sim.joints import begin, laws_act
from dlolib.sim.rotations import conjugate, product, rotated
from dlolib.sim.runtime import APART, ti, vec3
from dlolib.sim.scene import FRICTION, SAMPLES, STIFFNESS

CONVERGED, UNCONVERGED, NOT_FINITE = 0, 1, 2
LARGEST_TURN = 0.5
# A Newton step this small that no longer shrinks is rounding: the stretch stiffness times the last bit of a
# position is a force, and a soft rope moves under it.
ROUNDING = 1e-7
# A Newton step leaves about its square times this [1/m]: curvatures of a rope without contact and history.
QUADRATIC_1_M = 1e4
# Newton's step at which contacts with noted limits are near enough to note them anew.
LAGGED_ENOUGH = 1e-4


@ti.func
def predict(
    b: int, t: int, x: ti.template(), q: ti.template(), first: ti.template(), end_x: ti.template(),
    end_q: ti.template(), grips: ti.template(), clamped: ti.template(),
):  # fmt: skip
    """Where the iteration begins: where the rope would be if it moved on as in the step before.

    What the held ends do beyond that is shared out along the rope, or their segments alone would stretch.
    """
    n = x.shape[2]
    for p in range(n):
        last = first[b, p] if t == 1 else x[b, ti.max(t - 2, 0), p]
        x[b, t, p] = 2.0 * x[b, t - 1, p] - last
    for i in range(n + 1):
        q[b, t, i] = q[b, t - 1, i]
        if t > 1:
            turn = product(conjugate(q[b, t - 2, i]), q[b, t - 1, i])
            q[b, t, i] = product(q[b, t - 1, i], turn).normalized()
    beyond_start, beyond_end = vec3(0.0), vec3(0.0)
    if clamped[b, 0] == 1:
        beyond_start = end_x[b, t - 1, 0] - x[b, t, 0]
        if grips[b, 0, 0] == 0.0:
            q[b, t, 0] = end_q[b, t - 1, 0]
    if clamped[b, 1] == 1:
        beyond_end = end_x[b, t - 1, 1] - x[b, t, n - 1]
        if grips[b, 1, 0] == 0.0:
            q[b, t, n] = end_q[b, t - 1, 1]
    for p in range(n):
        share = float(p) / float(n - 1)
        x[b, t, p] = x[b, t, p] + (1.0 - share) * beyond_start + share * beyond_end
    if clamped[b, 0] == 1:
        x[b, t, 0] = end_x[b, t - 1, 0]
    if clamped[b, 1] == 1:
        x[b, t, n - 1] = end_x[b, t - 1, 1]


@ti.func
def scale_of(r: int, scale_x: float, scale_t: float) -> float:
    """Stiffness that belongs to unknown r: a position's or a turn's."""
    scale = scale_x
    if r % 6 > 2:
        scale = scale_t
    return scale


@ti.func
def note_limits(
    b: int, t: int, x: ti.template(), contacts: ti.template(), obstacles: ti.template(), limits: ti.template()
):
    """At which stretch each contact slides, by how deep it is at index t."""
    n = x.shape[2]
    for p in range(n):
        for j in range(SAMPLES):
            if j == 0 or p + 1 < n:
                k = SAMPLES * p + j
                limit, normal, _slope, _bend = grip_of(sample(x, b, t, p, j), contacts[b, k, 1], obstacles, b)
                limits[b, 0, k] = limit
                for j in ti.static(range(3)):
                    limits[b, j + 1, k] = normal[j]


@ti.kernel
def roll_out(
    x: vectors3,
    q: frames3,
    first: vectors2,
    past: scalars4,
    slip: vectors3,
    sliding: flags3,
    end_x: vectors3,
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
    tolerance: ti.f64,
    most: ti.i32,
    upper: scalars3,
    lower: scalars3,
    y: scalars3,
    limits: scalars3,
    base_x: vectors2,
    base_q: frames2,
    status: flags2,
    iterations: flags2,
):
    """Steps 1 ... T of every rope, from the state at index 0; arrays as in `Scene` and `Rollout`."""
    for lane in range(x.shape[0] * APART):
        if lane % APART != 0:
            continue
        b = lane // APART
        n = x.shape[2]
        rows = 6 * (n + 1)
        length = segments[b, 0, 0]
        scale_t = joints[b, n // 2, STIFFNESS] / length
        scale_x = scale_t / length**2
        alive = True
        # what a full step leaves of itself where forces are smooth; else each step is as good as its word
        bend = QUADRATIC_1_M
        for i in range(n):
            if obstacles.shape[1] > 0 or laws_act(joints, b, i):
                bend = 1e300
        rough = 0
        for k in range(obstacles.shape[1]):
            if obstacles[b, k, FRICTION] > 0.0 and fresh == 0:
                rough = 1
        for t in range(1, x.shape[1]):
            predict(b, t, x, q, first, end_x, end_q, grips, clamped)
            if fresh == 1:
                for i in range(n):
                    begin(joints, past, b, t - 1, i, 0)
            done = not alive
            lowest, least = 1e300, 1e300
            fraction, shift, enough = 1.0, 0.0, 0.0
            step, last_step = 1e300, 1e300
            converged = False
            count = 0
            # friction first by the limits of the step before, which makes it a potential; then in full
            lagged, rounds, again = rough, 1, 1
            while not done and count < most:
                count += 1
                energy = assemble(
                    b, t, b, x, q, first, past, slip, sliding, end_q, steps, joints, segments, particles,
                    contacts, obstacles, grips, clamped, moving, momentum, fresh, symmetric, 0, lagged,
                    limits, upper, lower, y, True,
                )  # fmt: skip
                clear_held(y, b, 0, n, b, grips, clamped)
                # forces without a potential have no energy that falls; then the forces themselves may
                force = 0.0
                if symmetric == 0:
                    for r in range(rows):
                        force += y[b, 0, r] * y[b, 0, r] / scale_of(r, scale_x, scale_t)
                worse = energy > lowest + 1e-13 * ti.abs(lowest) + 1e-18
                if symmetric == 0 and lagged == 0:
                    worse = force > least and (worse or rough == 1)
                stands = False
                if worse and fraction > 1e-6 and shift == 0.0:
                    fraction *= 0.5
                    if rough == 1 and lagged == 0 and fraction < 0.1:
                        # the contacts' state goes to and fro: back to the last good shape, with its limits,
                        # and nearer with limits noted again and again
                        fraction = 0.0
                        lagged = 1
                        rounds = ti.min(4 * rounds, 256)
                        again = rounds
                        lowest, least = 1e300, 1e300
                else:
                    lowest, least = energy, force
                    hold_ends(upper, lower, b, n, b, grips, clamped)
                    if shift > 0.0:
                        for r in range(rows):
                            upper[b, r, 0] += shift * scale_of(r, scale_x, scale_t)
                    stands = factor(upper, lower, b, rows, symmetric, 1) > 0
                    if stands:
                        # not positive definite, a rope about to buckle: the same again with a shift, which
                        # begins a little below the one that was enough before
                        shift = ti.max(1e-3, 4.0 * ti.max(shift, enough / 64.0))
                        count -= 1
                        if shift > 1e12:
                            done = True
                            status[b, t - 1] = NOT_FINITE
                            alive = False
                    else:
                        enough = shift
                        shift = 0.0
                        solve(upper, lower, b, y, b, 0, rows)
                        # column 1 keeps the step while the line search looks along it
                        last_step = step
                        step = 0.0
                        for r in range(rows):
                            y[b, 1, r] = y[b, 0, r]
                            step = ti.max(step, ti.abs(y[b, 0, r]))
                        if not (step < 1e300):
                            done = True
                            status[b, t - 1] = NOT_FINITE
                            alive = False
                        fraction = ti.min(1.0, LARGEST_TURN / (step + 1e-300))
                        for p in range(n):
                            base_x[b, p] = x[b, t, p]
                        for i in range(n + 1):
                            base_q[b, i] = q[b, t, i]
                if not stands:
                    for p in range(n):
                        r = 6 * (p + 1)
                        x[b, t, p] = base_x[b, p] + fraction * vec3(
                            y[b, 1, r], y[b, 1, r + 1], y[b, 1, r + 2]
                        )
                    for i in range(n + 1):
                        r = 6 * i + 3
                        q[b, t, i] = rotated(
                            base_q[b, i], fraction * vec3(y[b, 1, r], y[b, 1, r + 1], y[b, 1, r + 2])
                        )
                if stands:
                    pass
                elif fraction == 0.0:
                    note_limits(b, t, x, contacts, obstacles, limits)
                    fraction = 1.0
                    step = 1e300
                elif lagged == 1:
                    if step < LAGGED_ENOUGH / rounds:
                        converged = step < tolerance
                        note_limits(b, t, x, contacts, obstacles, limits)
                        again -= 1
                        if again == 0:
                            lagged = 0
                        lowest, least = 1e300, 1e300
                        step = 1e300
                elif (
                    step * step * bend < tolerance
                    or step < tolerance
                    or (step < ROUNDING and step > 0.5 * last_step)
                ):
                    converged = True
                    done = True
            if rough == 1:
                note_limits(b, t, x, contacts, obstacles, limits)
            iterations[b, t - 1] = count
            if alive and not converged:
                status[b, t - 1] = UNCONVERGED
            advance(
                b, t, b, t, x, q, past, slip, sliding, steps, joints, contacts, obstacles, fresh, symmetric,
                0, past, slip,
            )  # fmt: skip
