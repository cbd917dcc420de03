"""The direct solver: each step's constraints all at once, by Newton's method on a banded Hessian.

XPBD's multipliers (3), solved together instead of one by one, are a Newton step of the implicit Euler
energy; iterated until it stands still, the shape depends on no iteration count. Its derivatives follow
from the implicit function theorem: one banded solve a step, backwards (`adjoint`) or forwards
(`sensitivities`).
"""

from dlolib.sim.assembly import (
    assemble,
    clear_held,
    flags1,
    flags2,
    frames2,
    frames3,
    hold_ends,
    scalars2,
    scalars3,
    vectors2,
    vectors3,
    vectors4,
)
from dlolib.sim.band import HALF, factor, row_times, solve
from dlolib.sim.rotations import conjugate, product, rotated
from dlolib.sim.runtime import ti, vec3
from dlolib.sim.strain import curvature, moment_to_rotations, rotations_to_strain

CONVERGED, UNCONVERGED, NOT_FINITE = 0, 1, 2
LARGEST_TURN = 0.5
# A Newton step this small that no longer shrinks is rounding: the stretch stiffness times the last bit of a
# position is a force, and a soft rope moves under it.
ROUNDING = 1e-7


@ti.func
def copy_band(source: ti.template(), target: ti.template(), b: int, rows: int):
    for r in range(rows):
        for k in ti.static(range(HALF + 1)):
            target[b, r, k] = source[b, r, k]


@ti.func
def factor_shifted(band: ti.template(), saved: ti.template(), b: int, n: int, scale_x: float, scale_t: float):
    """Factor the Hessian; where it is not positive definite (a rope about to buckle), shift it first."""
    rows = 6 * (n + 1)
    copy_band(band, saved, b, rows)
    shift = 0.0
    failed = 1
    while failed > 0 and shift < 1e12:
        for r in range(rows):
            for k in ti.static(range(HALF + 1)):
                band[b, r, k] = saved[b, r, k]
            scale = scale_x
            if r % 6 > 2:
                scale = scale_t
            band[b, r, 0] += shift * scale
        failed = factor(band, b, rows, 1)
        shift = ti.max(1e-3, 4.0 * shift)
    return failed


@ti.kernel
def roll_out(
    x: vectors3,
    q: frames3,
    before: vectors2,
    end_x: vectors3,
    end_q: frames3,
    joint_d: vectors2,
    joint_l: scalars2,
    joint_rest: vectors2,
    segment_l: scalars2,
    segment_k: vectors2,
    mass: scalars2,
    force: vectors2,
    drag: scalars2,
    obstacles: scalars3,
    radius: scalars2,
    contact: scalars2,
    clamped: flags2,
    rate: ti.f64,
    momentum: ti.f64,
    tolerance: ti.f64,
    most: ti.i32,
    band: scalars3,
    saved: scalars3,
    y: scalars3,
    base_x: vectors2,
    base_q: frames2,
    flight: vectors2,
    status: flags2,
    iterations: flags2,
):
    """Steps 1 ... T of every rope, from the state at index 0; see `Scene` and `Path` for the arrays."""
    for b in range(x.shape[0]):
        n = x.shape[2]
        rows = 6 * (n + 1)
        scale_x = joint_d[b, n // 2][0] / segment_l[b, 0] ** 3
        scale_t = joint_d[b, n // 2][0] / segment_l[b, 0]
        alive = True
        for t in range(1, x.shape[1]):
            # free flight (standing still, without momentum) is where inertia pulls to; the iteration begins
            # where the rope would be if it moved on as in the step before, whatever the clock
            for p in range(n):
                last = before[b, p] if t == 1 else x[b, ti.max(t - 2, 0), p]
                flight[b, p] = x[b, t - 1, p] + momentum * (x[b, t - 1, p] - last)
                x[b, t, p] = 2.0 * x[b, t - 1, p] - last
            for i in range(n + 1):
                q[b, t, i] = q[b, t - 1, i]
                if t > 1:
                    turn = product(conjugate(q[b, t - 2, i]), q[b, t - 1, i])
                    q[b, t, i] = product(q[b, t - 1, i], turn).normalized()
            # what the held ends do beyond that is shared out along the rope, or their segments alone stretch
            beyond_start, beyond_end = vec3(0.0), vec3(0.0)
            if clamped[b, 0] == 1:
                beyond_start = end_x[b, t - 1, 0] - x[b, t, 0]
                q[b, t, 0] = end_q[b, t - 1, 0]
            if clamped[b, 1] == 1:
                beyond_end = end_x[b, t - 1, 1] - x[b, t, n - 1]
                q[b, t, n] = end_q[b, t - 1, 1]
            for p in range(n):
                share = float(p) / float(n - 1)
                x[b, t, p] = x[b, t, p] + (1.0 - share) * beyond_start + share * beyond_end
            if clamped[b, 0] == 1:
                x[b, t, 0] = end_x[b, t - 1, 0]
            if clamped[b, 1] == 1:
                x[b, t, n - 1] = end_x[b, t - 1, 1]
            done = not alive
            lowest = 1e300
            fraction = 1.0
            length, last_length = 1e300, 1e300
            converged = False
            count = 0
            while not done and count < most:
                count += 1
                energy = assemble(
                    b, t, x, q, flight, t - 1, joint_d, joint_l, joint_rest, segment_l, segment_k, mass,
                    force, drag, obstacles, radius, contact, rate, band, y,
                )  # fmt: skip
                if energy > lowest + 1e-13 * ti.abs(lowest) + 1e-18 and fraction > 1e-6:
                    fraction *= 0.5
                else:
                    lowest = energy
                    fraction = 1.0
                    hold_ends(band, b, n, clamped)
                    clear_held(y, b, 0, n, clamped)
                    if factor_shifted(band, saved, b, n, scale_x, scale_t) > 0:
                        done = True
                        status[b, t - 1] = NOT_FINITE
                        alive = False
                    solve(band, b, y, b, 0, rows)
                    # column 1 keeps the step while the line search looks along it
                    last_length = length
                    length = 0.0
                    for r in range(rows):
                        y[b, 1, r] = y[b, 0, r]
                        length = ti.max(length, ti.abs(y[b, 0, r]))
                    if not (length < 1e300):
                        done = True
                        status[b, t - 1] = NOT_FINITE
                        alive = False
                    fraction = ti.min(1.0, LARGEST_TURN / (length + 1e-300))
                    for p in range(n):
                        base_x[b, p] = x[b, t, p]
                    for i in range(n + 1):
                        base_q[b, i] = q[b, t, i]
                for p in range(n):
                    r = 6 * (p + 1)
                    x[b, t, p] = base_x[b, p] + fraction * vec3(y[b, 1, r], y[b, 1, r + 1], y[b, 1, r + 2])
                for i in range(n + 1):
                    r = 6 * i + 3
                    q[b, t, i] = rotated(
                        base_q[b, i], fraction * vec3(y[b, 1, r], y[b, 1, r + 1], y[b, 1, r + 2])
                    )
                if length < tolerance or (length < ROUNDING and length > 0.5 * last_length):
                    converged = True
                    done = True
            iterations[b, t - 1] = count
            if alive and not converged:
                status[b, t - 1] = UNCONVERGED


@ti.kernel
def linearise(
    x: vectors3,
    q: frames3,
    joint_d: vectors2,
    joint_l: scalars2,
    joint_rest: vectors2,
    segment_l: scalars2,
    segment_k: vectors2,
    mass: scalars2,
    force: vectors2,
    drag: scalars2,
    obstacles: scalars3,
    radius: scalars2,
    contact: scalars2,
    clamped: flags2,
    rate: ti.f64,
    band: scalars3,
    saved: scalars3,
    y: scalars3,
    flight: vectors2,
    status: flags1,
):
    """Hessians of S converged states, x (S, 1, n): whole in `saved`, factored without the ends in `band`."""
    for m in range(x.shape[0]):
        n = x.shape[2]
        assemble(
            m, 0, x, q, flight, 0, joint_d, joint_l, joint_rest, segment_l, segment_k, mass, force, drag,
            obstacles, radius, contact, rate, band, y,
        )  # fmt: skip
        copy_band(band, saved, m, 6 * (n + 1))
        hold_ends(band, m, n, clamped)
        if factor(band, m, 6 * (n + 1), 0) > 0:
            status[m] = NOT_FINITE


@ti.kernel
def adjoint(
    x: vectors3,
    q: frames3,
    joint_d: vectors2,
    joint_l: scalars2,
    joint_rest: vectors2,
    mass: scalars2,
    drag: scalars2,
    clamped: flags2,
    rate: ti.f64,
    momentum: ti.f64,
    band: scalars3,
    saved: scalars3,
    y: scalars3,
    d_x: vectors3,
    d_before: vectors2,
    d_end_x: vectors3,
    d_end_q: vectors3,
    d_joint_d: vectors2,
    d_joint_rest: vectors2,
    d_force: vectors2,
):
    """Reverse pass of `roll_out`.

    On entry `d_x` holds the loss's derivative by every position; on exit its first index that by the
    initial state (and `d_before` by the positions before it). The other d_ arrays are added to:
    derivatives by the held positions, by turns of the held frames in their own axes, by the joints'
    stiffness and rest curvature, by the loads.
    """
    for b in range(x.shape[0]):
        n = x.shape[2]
        rows = 6 * (n + 1)
        for back in range(x.shape[1] - 1):
            t = x.shape[1] - 1 - back
            m = b * (x.shape[1] - 1) + t - 1
            for r in range(rows):
                y[b, 0, r] = 0.0
            for p in range(n):
                for c in ti.static(range(3)):
                    y[b, 0, 6 * (p + 1) + c] = d_x[b, t, p][c]
            clear_held(y, b, 0, n, clamped)
            solve(band, m, y, b, 0, rows)
            # lambda is in y: what the step reads, it feeds back to
            for p in range(n):
                r = 6 * (p + 1)
                pull = vec3(y[b, 0, r], y[b, 0, r + 1], y[b, 0, r + 2])
                d_force[b, p] = d_force[b, p] + pull
                inertia = mass[b, p] * rate * rate
                d_x[b, t - 1, p] = d_x[b, t - 1, p] + ((1.0 + momentum) * inertia + drag[b, p] * rate) * pull
                if t > 1:
                    d_x[b, t - 2, p] = d_x[b, t - 2, p] - momentum * inertia * pull
                else:
                    d_before[b, p] = d_before[b, p] - momentum * inertia * pull
            for c in ti.static(range(3)):
                if clamped[b, 0] == 1:
                    d_end_x[b, t - 1, 0][c] = (
                        d_end_x[b, t - 1, 0][c] + d_x[b, t, 0][c] - row_times(saved, m, y, b, 0, 6 + c)
                    )
                    d_end_q[b, t - 1, 0][c] = d_end_q[b, t - 1, 0][c] - row_times(saved, m, y, b, 0, 3 + c)
                if clamped[b, 1] == 1:
                    d_end_x[b, t - 1, 1][c] = (
                        d_end_x[b, t - 1, 1][c]
                        + d_x[b, t, n - 1][c]
                        - row_times(saved, m, y, b, 0, 6 * n + c)
                    )
                    d_end_q[b, t - 1, 1][c] = d_end_q[b, t - 1, 1][c] - row_times(
                        saved, m, y, b, 0, 6 * n + 3 + c
                    )
            for i in range(n):
                ra, rb = 6 * i + 3, 6 * i + 9
                ta = vec3(y[b, 0, ra], y[b, 0, ra + 1], y[b, 0, ra + 2])
                tb = vec3(y[b, 0, rb], y[b, 0, rb + 1], y[b, 0, rb + 2])
                work = rotations_to_strain(q[b, t, i], q[b, t, i + 1], ta, tb)
                strain = curvature(q[b, t, i], q[b, t, i + 1], joint_l[b, i]) - joint_rest[b, i]
                d_joint_d[b, i] = d_joint_d[b, i] - work * strain
                d_joint_rest[b, i] = d_joint_rest[b, i] + work * joint_d[b, i]


@ti.kernel
def sensitivities(
    x: vectors3,
    q: frames3,
    joint_d: vectors2,
    joint_l: scalars2,
    joint_rest: vectors2,
    mass: scalars2,
    drag: scalars2,
    clamped: flags2,
    rate: ti.f64,
    momentum: ti.f64,
    band: scalars3,
    saved: scalars3,
    y: scalars3,
    slot: flags1,
    by_joint_d: vectors3,
    by_joint_rest: vectors3,
    by_force: vectors3,
    by_frame: vectors3,
    last: vectors3,
    last_but_one: vectors3,
    out: vectors4,
):
    """Forward pass beside `roll_out`: derivatives of the positions by a handful of parameters.

    A parameter is a direction in the joints' stiffness, rest curvature, loads and the turns of the two
    held frames: the by_ arrays, [rope, parameter, joint | particle | end]. `slot[t - 1]` says where in
    `out` [rope, slot, parameter, particle] step t goes, -1 for nowhere.
    """
    for b in range(x.shape[0]):
        n = x.shape[2]
        rows = 6 * (n + 1)
        for t in range(1, x.shape[1]):
            # without inertia no step depends on the one before, and only the wanted ones are solved
            if slot[t - 1] >= 0 or rate > 0.0:
                m = b * (x.shape[1] - 1) + t - 1
                for c in range(by_frame.shape[1]):
                    for r in range(rows):
                        y[b, c, r] = 0.0
                    for i in range(n):
                        strain = curvature(q[b, t, i], q[b, t, i + 1], joint_l[b, i]) - joint_rest[b, i]
                        moment = by_joint_d[b, c, i] * strain - joint_d[b, i] * by_joint_rest[b, c, i]
                        ga, gb = moment_to_rotations(q[b, t, i], q[b, t, i + 1], moment)
                        for k in ti.static(range(3)):
                            y[b, c, 6 * i + 3 + k] = y[b, c, 6 * i + 3 + k] - ga[k]
                            y[b, c, 6 * i + 9 + k] = y[b, c, 6 * i + 9 + k] - gb[k]
                    for k in ti.static(range(3)):
                        for j in ti.static(range(3)):
                            y[b, c, 9 + k] = (
                                y[b, c, 9 + k] - saved[m, 3 + j, 6 + k - j] * by_frame[b, c, 0][j]
                            )
                            y[b, c, 6 * n - 3 + k] = (
                                y[b, c, 6 * n - 3 + k]
                                - saved[m, 6 * n - 3 + k, 6 + j - k] * by_frame[b, c, 1][j]
                            )
                    for p in range(n):
                        inertia = mass[b, p] * rate * rate
                        carried = ((1.0 + momentum) * inertia + drag[b, p] * rate) * last[b, c, p]
                        carried += by_force[b, c, p] - momentum * inertia * last_but_one[b, c, p]
                        for k in ti.static(range(3)):
                            y[b, c, 6 * (p + 1) + k] = y[b, c, 6 * (p + 1) + k] + carried[k]
                    clear_held(y, b, c, n, clamped)
                    solve(band, m, y, b, c, rows)
                    for p in range(n):
                        r = 6 * (p + 1)
                        last_but_one[b, c, p] = last[b, c, p]
                        last[b, c, p] = vec3(y[b, c, r], y[b, c, r + 1], y[b, c, r + 2])
                        if slot[t - 1] >= 0:
                            out[b, slot[t - 1], c, p] = last[b, c, p]
