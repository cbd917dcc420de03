"""Where the iteration of a step begins: foretold from the steps before, or carried on with the held ends.

A step that takes a rope further than an obstacle near it allows (`farthest`) is made in several pieces, each
the equilibrium at a share of its way and time: else it might come out on the other side.
"""

from dlolib.sim.assembly import sample
from dlolib.sim.rotations import matrix
from dlolib.sim.runtime import ti, vec3
from dlolib.sim.scene import SAMPLES, THIN
from dlolib.sim.shapes import signed_distance

# What comes next is foretold by a polynomial of an order up to this, which one particle in so many chooses.
MOST_ORDER, LOOKED_AT = 5, 5
orders = ti.types.vector(MOST_ORDER + 1, ti.f64)
# A piece of a step takes a rope no further than this share of its own radius and half of an obstacle's
# thickness; what is thinner than so much [m] is not looked at more finely. An obstacle that is no nearer than
# that [m], or than twice the way, is none. So many pieces at most; a step that needs more is refused.
PASSED, FINEST_M, NEAR_M, MOST_PIECES = 0.5, 5e-4, 0.05, 64


@ti.func
def ahead(values: ti.template(), b: int, t: int, k: int, order: int):
    """values[b, t, k] by the polynomial of this order through those before, all its differences summed."""
    found = values[b, t - 1, k]
    last = [values[b, ti.max(t - 1 - j, 0), k] for j in ti.static(range(MOST_ORDER + 1))]
    for level in ti.static(range(1, MOST_ORDER + 1)):
        for j in ti.static(range(MOST_ORDER + 1 - level)):
            last[j] -= last[j + 1]
        if level <= order:
            found += last[0]
    return found


@ti.func
def best_order(x: ti.template(), b: int, t: int) -> int:
    """The order that would have foretold the step before best, by one particle in so many."""
    best, least = ti.min(t - 1, 1), 1e300
    if t > MOST_ORDER + 1:
        off = orders(0.0)
        for k in range(x.shape[2] // LOOKED_AT):
            p = (k + 1) * LOOKED_AT - 1
            last = [x[b, t - 1 - j, p] for j in ti.static(range(MOST_ORDER + 2))]
            for level in ti.static(range(1, MOST_ORDER + 2)):
                for j in ti.static(range(MOST_ORDER + 2 - level)):
                    last[j] -= last[j + 1]
                # what a polynomial misses is the next difference
                off[level - 1] += last[0].dot(last[0])
        for order in ti.static(range(1, MOST_ORDER + 1)):
            if off[order] < least:
                best, least = order, off[order]
    return best


@ti.func
def predict(
    b: int, t: int, x: ti.template(), q: ti.template(), first: ti.template(), end_x: ti.template(),
    end_q: ti.template(), grips: ti.template(), clamped: ti.template(),
):  # fmt: skip
    """Where the iteration begins: where the rope would be if it moved on as in the steps before.

    What the held ends do beyond that is shared out along the rope, or their segments alone would stretch.
    """
    n = x.shape[2]
    order = best_order(x, b, t)
    for p in range(n):
        x[b, t, p] = ahead(x, b, t, p, order)
        if t == 1:
            x[b, t, p] += x[b, 0, p] - first[b, p]
    for i in range(n + 1):
        q[b, t, i] = ahead(q, b, t, i, order).normalized()
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
def lead(
    b: int, t: int, begin: float, share: float, x: ti.template(), q: ti.template(), end_x: ti.template(),
    end_q: ti.template(), grips: ti.template(), clamped: ti.template(),
):  # fmt: skip
    """Carry the rope on from one share of the way of the step to index t to another, with its held ends.

    From 0 it begins where the step before left it.
    """
    n = x.shape[2]
    way_start, way_end = vec3(0.0), vec3(0.0)
    if clamped[b, 0] == 1:
        way_start = (share - begin) * (end_x[b, t - 1, 0] - x[b, t - 1, 0])
    if clamped[b, 1] == 1:
        way_end = (share - begin) * (end_x[b, t - 1, 1] - x[b, t - 1, n - 1])
    for p in range(n):
        if begin == 0.0:
            x[b, t, p] = x[b, t - 1, p]
        along = float(p) / float(n - 1)
        x[b, t, p] = x[b, t, p] + (1.0 - along) * way_start + along * way_end
    for i in range(n + 1):
        if begin == 0.0:
            q[b, t, i] = q[b, t - 1, i]
    for end in ti.static(range(2)):
        if clamped[b, end] == 1 and grips[b, end, 0] == 0.0:
            held, before = end_q[b, t - 1, end], q[b, t - 1, end * n]
            if held.dot(before) < 0.0:
                held = -held
            q[b, t, end * n] = (before + share * (held - before)).normalized()


@ti.func
def way_of(
    b: int, t: int, x: ti.template(), q: ti.template(), end_x: ti.template(), end_q: ti.template(),
    segments: ti.template(), grips: ti.template(), clamped: ti.template(),
) -> float:  # fmt: skip
    """How far the step to index t may take any particle from where the step before left it [m].

    As far as it is foretold to (it stands there), as its held ends go, and as far as what they turn swings.
    """
    n = x.shape[2]
    far, length = 0.0, 0.0
    for p in range(n):
        far = ti.max(far, (x[b, t, p] - x[b, t - 1, p]).norm())
        if p + 1 < n:
            length += segments[b, p, 0]
    for end in ti.static(range(2)):
        if clamped[b, end] == 1:
            far = ti.max(far, (end_x[b, t - 1, end] - x[b, t - 1, end * (n - 1)]).norm())
            if grips[b, end, 0] == 0.0:
                turned = matrix(end_q[b, t - 1, end]) - matrix(q[b, t - 1, end * n])
                far = ti.max(far, length * vec3(turned[0, 2], turned[1, 2], turned[2, 2]).norm())
    return far


@ti.func
def passed(b: int, k: int, contacts: ti.template(), obstacles: ti.template()) -> float:
    """How far a rope may go at once [m], not to come out behind obstacle k."""
    return ti.max(PASSED * (obstacles[b, k, THIN] + contacts[b, 0, 1]), FINEST_M)


@ti.func
def farthest(
    b: int, t: int, far: float, x: ti.template(), steps: ti.template(), segments: ti.template(),
    contacts: ti.template(), obstacles: ti.template(),
) -> float:  # fmt: skip
    """How far a rope that goes `far` may go at once [m], not to come out behind an obstacle near it."""
    n = x.shape[2]
    most = 1e300
    for k in range(obstacles.shape[1]):
        radius = contacts[b, 0, 1]
        thin = passed(b, k, contacts, obstacles)
        near = False
        for p in range(n - 1 if thin < most else 0):
            if not near:
                reach = radius + 0.6 * segments[b, p, 0] * steps[b, t, 1] + ti.max(2.0 * far, NEAR_M)
                d, _n, _h, _section = signed_distance(sample(x, b, t - 1, p, SAMPLES // 2), obstacles, b, k)
                near = d < reach
        if near:
            most = thin
    return most


@ti.func
def pieces_of(
    b: int, t: int, x: ti.template(), q: ti.template(), end_x: ti.template(), end_q: ti.template(),
    steps: ti.template(), segments: ti.template(), contacts: ti.template(), obstacles: ti.template(),
    grips: ti.template(), clamped: ti.template(),
) -> int:  # fmt: skip
    """In how many pieces the step to index t is to be made: more than `MOST_PIECES` are too many."""
    far = way_of(b, t, x, q, end_x, end_q, segments, grips, clamped)
    most_m = farthest(b, t, far, x, steps, segments, contacts, obstacles)
    return ti.max(int(ti.ceil(ti.min(far / most_m, MOST_PIECES + 1.0))), 1)
