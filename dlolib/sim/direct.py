"""The direct solver: each step's constraints all at once, by Newton's method on a banded Hessian.

XPBD's multipliers (3), solved together instead of one by one, are a Newton step of the step's energy;
iterated until it stands still (`equilibrium`), the shape depends on no iteration count.
"""

from dlolib.sim.assembly import (
    advance,
    bands,
    flags2,
    flags3,
    frames2,
    frames3,
    scalars3,
    scalars4,
    vectors2,
    vectors3,
)
from dlolib.sim.equilibrium import CONVERGED, NOT_FINITE, TOO_FAR, UNCONVERGED, equilibrium
from dlolib.sim.foretell import MOST_PIECES, lead, pieces_of, predict
from dlolib.sim.joints import begin
from dlolib.sim.launch import kernel
from dlolib.sim.runtime import APART, ti


@kernel
def roll_out(
    plain: ti.template(),
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
    euler: ti.i32,
    fresh: ti.i32,
    placed: ti.i32,
    symmetric: ti.i32,
    tolerance: ti.f64,
    most: ti.i32,
    upper: bands,
    lower: bands,
    factors: bands,
    under: bands,
    y: scalars3,
    limits: scalars3,
    expected: vectors2,
    begin_x: vectors2,
    begin_q: frames2,
    base_x: vectors2,
    base_q: frames2,
    status: flags2,
    iterations: flags2,
):
    """Steps 1 ... T of every rope, from the state at index 0; arrays as in `Scene` and `Rollout`.

    `plain` ropes (see `assemble`) have a kernel of their own. `placed`: the first step's iteration begins
    where index 1 stands already.
    """
    for lane in range(x.shape[0] * APART):
        if lane % APART != 0:
            continue
        b = lane // APART
        added, alive = 0.0, True
        for t in range(1, x.shape[1]):
            if fresh == 1:
                for i in range(x.shape[2]):
                    begin(joints, past, b, b, t - 1, i, 0)
            foretold = placed == 0 or t > 1
            if foretold:
                predict(b, t, x, q, first, end_x, end_q, grips, clamped)
            if ti.static(not plain):
                if obstacles.shape[1] > 0 and fresh == 1:
                    # a rope on its way to a first shape may come to lie on something
                    lead(b, t, 0.0, 1.0, x, q, end_x, end_q, grips, clamped)
            pieces, found, whole = 1, CONVERGED, steps[b, t, 0]
            if ti.static(not plain):
                if obstacles.shape[1] > 0 and fresh == 0 and foretold:
                    pieces = pieces_of(
                        b, t, x, q, end_x, end_q, steps, segments, contacts, obstacles, grips, clamped
                    )  # fmt: skip
                    if pieces > MOST_PIECES and moving == 0:
                        # a rope that fell off something does not go on as it fell
                        lead(b, t, 0.0, 1.0, x, q, end_x, end_q, grips, clamped)
                        pieces = pieces_of(
                            b, t, x, q, end_x, end_q, steps, segments, contacts, obstacles, grips, clamped
                        )  # fmt: skip
            if alive and pieces > MOST_PIECES:
                alive, found = False, TOO_FAR
            for piece in range(pieces if alive else 0):
                share = (piece + 1.0) / pieces
                steps[b, t, 0] = share * whole
                if pieces > 1:
                    lead(b, t, piece / float(pieces), share, x, q, end_x, end_q, grips, clamped)
                found, count, added = equilibrium(
                    b, t, x, q, first, past, slip, sliding, end_q, steps, joints, segments, particles,
                    contacts, obstacles, grips, clamped, moving, euler, fresh, symmetric, tolerance, most,
                    added, upper, lower, factors, under, y, limits, expected, begin_x, begin_q, base_x,
                    base_q, plain,
                )  # fmt: skip
                iterations[b, t - 1] += count
                if found != CONVERGED:
                    break
            steps[b, t, 0] = whole
            status[b, t - 1] = found
            alive = alive and found != NOT_FINITE
            if ti.static(not plain):
                advance(b, t, x, q, past, slip, sliding, steps, joints, contacts, obstacles, fresh)


__all__ = ["CONVERGED", "NOT_FINITE", "TOO_FAR", "UNCONVERGED", "roll_out"]
