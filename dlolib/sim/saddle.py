"""Off an equilibrium that is none: where the energy has a direction along which it falls.

A rope that lies in a plane, or stands, is in equilibrium however soft it is, and Newton's method finds that.
No real rope stays there. The direction is the eigenvector of the Hessian's lowest eigenvalue, found with the
factors at hand.
"""

from dlolib.sim.assembly import clear_held
from dlolib.sim.band import solve
from dlolib.sim.runtime import ti

# A saddle is left where the energy falls this steeply, over what bends the whole rope: by so much of its
# length, along what so many inverse iterations find, and so often.
STEEP, ASIDE, FALLING, MOST_LEFT = 0.01, 1e-3, 8, 4


@ti.func
def scale_of(r: int, scale_x: float, scale_t: float) -> float:
    """Stiffness that belongs to unknown r: a position's or a turn's."""
    scale = scale_x
    if r % 6 > 2:
        scale = scale_t
    return scale


@ti.func
def fall(
    b: int, n: int, grips: ti.template(), clamped: ti.template(), upper: ti.template(), lower: ti.template(),
    y: ti.template(), added: float, scale_x: float, scale_t: float,
) -> float:  # fmt: skip
    """Put into column 1 a small step along which the energy falls most, from where it is a saddle.

    Inverse iteration, which begins with what a force does that goes along and beside the rope and grows from
    end to end: no symmetry of the rope's own hides the way from it.

    upper: factors of the Hessian, stiffer by `added`. Returns how steeply the energy falls: what would have
    to be added for it not to.
    """
    length = ti.sqrt(scale_t / scale_x) * (n - 1)
    rows = 6 * (n + 1)
    for r in range(rows):
        y[b, 1, r] = 0.0
    for p in range(n):
        r, grows = 6 * (p + 1), 1.0 + p / (n - 1.0)
        y[b, 1, r], y[b, 1, r + 1], y[b, 1, r + 2] = 2.0 * grows, 3.0 * grows, 4.0 * grows
    steep = 0.0
    for k in range(FALLING):
        clear_held(y, b, 1, n, b, grips, clamped)
        solve(upper, lower, b, y, b, 1, rows, 1)
        size, far = 0.0, 0.0
        for r in range(rows):
            size += y[b, 1, r] ** 2 * scale_of(r, scale_x, scale_t)
            # a turn counts as far as it takes the rope's other end
            reach = length if r % 6 > 2 else 1.0
            far = ti.max(far, reach * ti.abs(y[b, 1, r]))
        steep = added - 1.0 / ti.sqrt(size)
        for r in range(rows):
            if k + 1 < FALLING:
                y[b, 1, r] *= scale_of(r, scale_x, scale_t) / ti.sqrt(size)
            else:
                y[b, 1, r] *= ASIDE * length / far
    return steep
