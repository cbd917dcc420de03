"""The iterative solver's kernels: the roll-out, and its reverse pass.

The reverse pass keeps only the states between steps; it runs each step once more and then has the
values before every projection on a tape, [rope, iteration, constraint].
"""

from dlolib.sim.assembly import flags2, frames2, frames3, scalars2, scalars3, vectors2, vectors3, vectors4
from dlolib.sim.iterative_constraints import (
    project_bend,
    project_contact,
    project_distance,
    project_stretch,
    pull_back_bend,
    pull_back_contact,
    pull_back_distance,
    pull_back_stretch,
)
from dlolib.sim.launch import kernel
from dlolib.sim.runtime import ti, vec3

scalars4 = ti.types.ndarray(dtype=ti.f64, ndim=4)
LARGEST_M = 1e6


@ti.func
def predict(
    b: int, t: int, x: ti.template(), q: ti.template(), before: ti.template(), end_x: ti.template(),
    end_q: ti.template(), onward: ti.template(), backward: ti.template(), fall: ti.template(),
    clamped: ti.template(), to: int, to_x: ti.template(), to_q: ti.template(),
):  # fmt: skip
    """x + dt v + dt^2 g of step t into index `to` of to_x and to_q; the held ends go along their path."""
    n = x.shape[2]
    for p in range(n):
        last = before[b, p] if t == 1 else x[b, ti.max(t - 2, 0), p]
        to_x[b, to, p] = onward[b, p] * x[b, t - 1, p] - backward[b, p] * last + fall[b, p]
    for i in range(n + 1):
        to_q[b, to, i] = q[b, t - 1, i]
    if clamped[b, 0] == 1:
        to_x[b, to, 0] = end_x[b, t - 1, 0]
        to_q[b, to, 0] = end_q[b, t - 1, 0]
    if clamped[b, 1] == 1:
        to_x[b, to, n - 1] = end_x[b, t - 1, 1]
        to_q[b, to, n] = end_q[b, t - 1, 1]


@ti.func
def iterate(
    b: int, t: int, iterations: int, recording: int, x: ti.template(), q: ti.template(),
    moment: ti.template(), push: ti.template(), stiffness: ti.template(), rest: ti.template(),
    segment_l: ti.template(), weight_x: ti.template(), weight_q: ti.template(), obstacles: ti.template(),
    radius: ti.template(), alpha: float, stretch_q: ti.template(), stretch_step: ti.template(),
    bend_a: ti.template(), bend_b: ti.template(), bend_moment: ti.template(), distance_x: ti.template(),
    distance_step: ti.template(), contact_x: ti.template(), contact_push: ti.template(), y: ti.template(),
):  # fmt: skip
    """All Gauss-Seidel iterations of one step; the tape has one slot an iteration, or a single one."""
    n = x.shape[2]
    for i in range(n):
        moment[b, i] = vec3(0.0)
        for k in range(obstacles.shape[1]):
            push[b, i, k] = 0.0
    for iteration in range(iterations):
        slot = iteration * recording
        for i in range(n - 1):
            project_stretch(b, t, slot, i, x, q, segment_l, weight_x, weight_q, stretch_q, stretch_step)
        for i in range(n):
            project_bend(b, t, slot, i, q, moment, stiffness, rest, weight_q, bend_a, bend_b, bend_moment)
        project_distance(b, t, slot, x, segment_l, weight_x, distance_x, distance_step, y)
        for p in range(n):
            for k in range(obstacles.shape[1]):
                if weight_x[b, p] > 0.0:
                    project_contact(
                        b, t, slot, p, k, x, push, obstacles, radius, alpha, weight_x, contact_x, contact_push
                    )


@kernel
def roll_out(
    x: vectors3,
    q: frames3,
    before: vectors2,
    end_x: vectors3,
    end_q: frames3,
    onward: scalars2,
    backward: scalars2,
    fall: vectors2,
    clamped: flags2,
    iterations: ti.i32,
    stiffness: vectors2,
    rest: frames2,
    segment_l: scalars2,
    weight_x: scalars2,
    weight_q: scalars2,
    obstacles: scalars3,
    radius: scalars2,
    alpha: ti.f64,
    moment: vectors2,
    push: scalars3,
    stretch_q: frames3,
    stretch_step: vectors3,
    bend_a: frames3,
    bend_b: frames3,
    bend_moment: vectors3,
    distance_x: vectors3,
    distance_step: scalars3,
    contact_x: vectors4,
    contact_push: scalars4,
    y: scalars3,
    status: flags2,
):
    """Steps 1 ... T of every rope, from the state at index 0; `Discrete` in iterative.py has the arrays."""
    for b in range(x.shape[0]):
        for t in range(1, x.shape[1]):
            predict(b, t, x, q, before, end_x, end_q, onward, backward, fall, clamped, t, x, q)
            iterate(
                b, t, iterations, 0, x, q, moment, push, stiffness, rest, segment_l, weight_x, weight_q,
                obstacles, radius, alpha, stretch_q, stretch_step, bend_a, bend_b, bend_moment, distance_x,
                distance_step, contact_x, contact_push, y,
            )  # fmt: skip
            for p in range(x.shape[2]):
                if not (x[b, t, p].norm() < LARGEST_M):
                    status[b, t - 1] = 1


@kernel
def adjoint(
    x: vectors3,
    q: frames3,
    before: vectors2,
    end_x: vectors3,
    end_q: frames3,
    onward: scalars2,
    backward: scalars2,
    fall: vectors2,
    clamped: flags2,
    iterations: ti.i32,
    stiffness: vectors2,
    rest: frames2,
    segment_l: scalars2,
    weight_x: scalars2,
    weight_q: scalars2,
    obstacles: scalars3,
    radius: scalars2,
    alpha: ti.f64,
    moment: vectors2,
    push: scalars3,
    stretch_q: frames3,
    stretch_step: vectors3,
    bend_a: frames3,
    bend_b: frames3,
    bend_moment: vectors3,
    distance_x: vectors3,
    distance_step: scalars3,
    contact_x: vectors4,
    contact_push: scalars4,
    y: scalars3,
    again_x: vectors3,
    again_q: frames3,
    bar_x: vectors2,
    bar_q: frames2,
    bar_along: vectors2,
    d_x: vectors3,
    d_before: vectors2,
    d_end_x: vectors3,
    d_end_q: frames3,
    d_fall: vectors2,
    d_stiffness: vectors2,
    d_rest: vectors2,
):
    """Reverse pass of `roll_out`.

    On entry `d_x` holds the loss's derivative by every position; on exit its first index that by the
    initial one, and `bar_q` that by the initial frames. The other d_ arrays are added to.
    """
    for b in range(x.shape[0]):
        n = x.shape[2]
        for back in range(x.shape[1] - 1):
            t = x.shape[1] - 1 - back
            predict(b, t, x, q, before, end_x, end_q, onward, backward, fall, clamped, 0, again_x, again_q)
            iterate(
                b, 0, iterations, 1, again_x, again_q, moment, push, stiffness, rest, segment_l, weight_x,
                weight_q, obstacles, radius, alpha, stretch_q, stretch_step, bend_a, bend_b, bend_moment,
                distance_x, distance_step, contact_x, contact_push, y,
            )  # fmt: skip
            # from here on moment and push hold the derivatives by the multipliers
            for p in range(n):
                bar_x[b, p] = d_x[b, t, p]
                moment[b, p] = vec3(0.0)
                for k in range(obstacles.shape[1]):
                    push[b, p, k] = 0.0
            for reverse in range(iterations):
                slot = iterations - 1 - reverse
                for p in range(n):
                    for k_back in range(obstacles.shape[1]):
                        if weight_x[b, p] > 0.0:
                            pull_back_contact(
                                b, slot, p, obstacles.shape[1] - 1 - k_back, bar_x, push, obstacles, radius,
                                alpha, weight_x, contact_x, contact_push,
                            )  # fmt: skip
                pull_back_distance(b, slot, bar_x, weight_x, distance_x, distance_step, y, bar_along)
                for i_back in range(n):
                    pull_back_bend(
                        b, slot, n - 1 - i_back, bar_q, moment, stiffness, rest, weight_q, bend_a, bend_b,
                        bend_moment, d_stiffness, d_rest,
                    )  # fmt: skip
                for i_back in range(n - 1):
                    pull_back_stretch(
                        b,
                        slot,
                        n - 2 - i_back,
                        bar_x,
                        bar_q,
                        segment_l,
                        weight_x,
                        weight_q,
                        stretch_q,
                        stretch_step,
                    )
            for side in range(2):
                if clamped[b, side] == 1:
                    d_end_x[b, t - 1, side] = bar_x[b, side * (n - 1)]
                    d_end_q[b, t - 1, side] = bar_q[b, side * n]
                    bar_x[b, side * (n - 1)] = 0.0 * bar_x[b, 0]
                    bar_q[b, side * n] = 0.0 * bar_q[b, 0]
            for p in range(n):
                d_fall[b, p] = d_fall[b, p] + bar_x[b, p]
                d_x[b, t - 1, p] = d_x[b, t - 1, p] + onward[b, p] * bar_x[b, p]
                if t > 1:
                    d_x[b, t - 2, p] = d_x[b, t - 2, p] - backward[b, p] * bar_x[b, p]
                else:
                    d_before[b, p] = d_before[b, p] - backward[b, p] * bar_x[b, p]
