"""Inertia and drag of a particle over a step: Park's backward difference, of second order in time.

With x_k the position k steps back and h their length, the velocity at the end of a step is
(10 x_0 - 15 x_1 + 6 x_2 - x_3) / 6 h, and the acceleration the same of the velocity. Implicit Euler's,
(x_0 - x_1) / h, would damp a mode of angular frequency w by a share w h / 2 of the critical damping, as much
as the air does; at w h = 0.1 Park's does by a millionth, and slows it down by 0.17 %. No mode grows at any
step, and what is faster than the steps dies out in a few of them.

A roll-out begins with a velocity, and as if it had moved with its first step's acceleration before. Where its
first shape is not known well, its first steps are implicit Euler's: they damp what rings of that.

Park, An improved stiffly stable method for direct integration of nonlinear structural dynamic equations,
J. Appl. Mech. 42 (1975).
"""

import numpy as np

from dlolib.sim.runtime import ti, vec3
from dlolib.sim.scene import DRAG, INERTIA
from dlolib.types import Floats

VELOCITY = np.array([10.0, -15.0, 6.0, -1.0]) / 6.0
ACCELERATION = np.convolve(VELOCITY, VELOCITY)
# So many ways back a step looks, from each position to the one before.
BACK = len(ACCELERATION) - 1
ways = ti.types.vector(BACK, ti.f64)


def of_positions(difference: Floats, t: int) -> Floats:
    """The weights of a difference (K,) in the step to index t >= 1 of a roll-out, of the positions at indices
    t, t - 1, ..., -1 at last: (min(t + 2, BACK + 1),).

    Index 0 is the initial state; -1 lies behind it by what its velocity makes of a step. Before the roll-out
    the rope was where the acceleration that leads to index 1 has it.
    """
    found = np.zeros(max(t + 2, BACK + 1))
    found[: len(difference)] = difference
    before = found[t + 1 :].copy()
    found[t + 1 :] = 0.0
    for j, weight in enumerate(before, start=1):
        # x_0 - j v h + j^2 a h^2 / 2, with v h = x_0 - x_(-1) and a h^2 = 2 (x_1 - x_0 - v h)
        found[t - 1 : t + 2] += weight * np.array([j**2, 1 - j - 2 * j**2, j + j**2])
    return found[: min(t + 2, BACK + 1)]


def of_ways(difference: Floats, t: int) -> list[float]:
    """The same weights of the ways from each of these positions to the one before: BACK numbers."""
    summed = np.cumsum(of_positions(difference, t))[:-1]
    return [*map(float, summed), *[0.0] * (BACK - len(summed))]


# For steps to index 1 ... BACK; later ones are as the last.
BY_ACCELERATION, BY_VELOCITY = (
    [of_ways(difference, t) for t in range(1, BACK + 1)] for difference in (ACCELERATION, VELOCITY)
)
# Of implicit Euler's steps: the velocity, or the acceleration of what starts at rest; the acceleration.
ALONE, EULER = [1.0] + [0.0] * (BACK - 1), [1.0, -1.0] + [0.0] * (BACK - 2)


@ti.func
def weights(table: ti.template(), by_euler: ti.template(), t: int, euler: int) -> ways:
    """A table's in the step to index t, or implicit Euler's in so many first steps; with fewer than none
    every step starts at rest."""
    found = ways(table[0])
    for row in ti.static(range(1, BACK)):
        if t > row:
            found = ways(table[row])
    if euler < 0:
        found = ways(ALONE)
    elif t <= euler:
        found = ways(by_euler)
    return found


@ti.func
def paces(steps: ti.template(), b: int, t: int, euler: int):
    """What inertia takes per mass [1/s^2], and drag per damping [1/s], of a particle's way in the step to
    index t, of that before, and so on; of these as they would be in as much time."""
    rate = 1.0 / steps[b, t, 0]
    inertia = rate * rate * weights(BY_ACCELERATION, EULER, t, euler)
    drag = rate * weights(BY_VELOCITY, ALONE, t, euler)
    for k in ti.static(range(1, BACK)):
        longer = steps[b, t, 0] / steps[b, ti.max(t - k, 0), 0]
        inertia[k] *= longer
        drag[k] *= longer
    return inertia, drag


@ti.func
def way(x: ti.template(), first: ti.template(), b: int, t: int, p: int) -> vec3:
    """What particle p moved in the step to index t [m]; to index 0 from `first`, none before."""
    found = vec3(0.0)
    if t > 0:
        found = x[b, t, p] - x[b, t - 1, p]
    elif t == 0:
        found = x[b, 0, p] - first[b, p]
    return found


@ti.func
def slowed(
    x: ti.template(), first: ti.template(), particles: ti.template(), inertia: ways, drag: ways, case: int,
    b: int, t: int, p: int,
):  # fmt: skip
    """Minus the force of inertia and drag on particle p [N], and how it grows with the particle's position
    [N/m]; `inertia` and `drag` are the step's `paces`, `case` is the row of its mass and damping."""
    stiffness = particles[case, p, INERTIA] * inertia + particles[case, p, DRAG] * drag
    force = vec3(0.0)
    for k in ti.static(range(BACK)):
        force += stiffness[k] * way(x, first, b, t - k, p)
    return force, stiffness[0]
