"""Constraint 5: obstacles push points of the rope out, and Coulomb friction holds them back.

The paper's C_c = (x - x_ic) . n_ic acts on particles alone; here points along the segments are pushed, each
for its share of the length, so that a cylinder does not sink in between two particles. The
push is a stiff one-sided spring that sets in over `RAMP_M`, which keeps its energy twice differentiable where
a contact opens or closes. Friction is a tangential spring whose end slides once its force exceeds μ times the
push (return mapping; Wriggers, Computational Contact Mechanics, 2006, section 5.2): its stretch is the
contact's history.
"""

from dlolib.sim.launch import kernel
from dlolib.sim.rotations import identity
from dlolib.sim.runtime import ti, vec3, vec4
from dlolib.sim.scene import FRICTION, HULL
from dlolib.sim.shapes import signed_distance

RAMP_M = 2e-5
# So far from a hull rounding does not matter [m].
CLEAR_M = 1e-6
# Tangential stiffness over the normal one.
TANGENT = 0.5


@ti.func
def spring(depth: float):
    """Force over stiffness [m], its derivative and its potential [m^2] of a contact this deep."""
    force, slope, value = 0.0, 0.0, 0.0
    if depth > RAMP_M:
        force, slope, value = depth - RAMP_M / 2, 1.0, depth * (depth - RAMP_M) / 2 + RAMP_M * RAMP_M / 6
    elif depth > 0.0:
        force, slope = depth * depth / (2 * RAMP_M), depth / RAMP_M
        value = depth * depth * depth / (6 * RAMP_M)
    return force, slope, value


@ti.func
def beyond(p: vec3, reach: float, o: ti.template(), b: int, k: int) -> bool:
    """Whether obstacle k is certainly further from p than that [m]: a look at its hull, which is quicker than
    to ask for the distance."""
    r = p - vec3(o[b, k, 1], o[b, k, 2], o[b, k, 3])
    along = r.dot(vec3(o[b, k, HULL + 1], o[b, k, HULL + 2], o[b, k, HULL + 3]))
    most = o[b, k, HULL] + reach + CLEAR_M
    return r.dot(r) - along * along > most * most


@ti.func
def push(p: vec3, radius: float, stiffness: float, o: ti.template(), b: int):
    """Energy [J], its gradient [N] and Hessian [N/m] of all obstacles on a point of the rope's axis."""
    energy, gradient, hessian = 0.0, vec3(0.0), 0.0 * identity()
    for k in range(o.shape[1]):
        if not beyond(p, radius, o, b, k):
            d, n, h, _section = signed_distance(p, o, b, k)
            if d < radius:
                force, slope, value = spring(radius - d)
                energy += stiffness * value
                gradient -= stiffness * force * n
                hessian += stiffness * (slope * n.outer_product(n) - force * h)
    return energy, gradient, hessian


@ti.func
def within(p: vec3, reach: float, o: ti.template(), b: int) -> bool:
    """Whether any obstacle is nearer to p than that [m]."""
    found = False
    for k in range(o.shape[1]):
        if not beyond(p, reach, o, b, k):
            d, _n, _h, _section = signed_distance(p, o, b, k)
            found = found or d < reach
    return found


@ti.func
def friction(
    p: vec3, before: vec3, past: vec3, radius: float, stiffness: float, o: ti.template(), b: int, branch: int,
    frozen: vec4, pulled: vec3,
):  # fmt: skip
    """Friction of a point with the rough obstacle that it is deepest in.

    Args:
        p, before: where the point is, and where it was at the step before [m].
        past: the tangential spring's stretch then [m].
        branch: 0 to stick, 1 to slide, -1 as it comes out.
        frozen: stretch at which it slides [m] and the surface's normal, which make the force that of a
            potential; or -1 first: by where the point is now.
        pulled: of a frozen limit, the stretch that Newton's step before expected, no longer than the limit.

    Returns:
        energy [J], of a frozen limit; the spring's stiffness [N/m], 0 where nothing rough is touched;
        its stretch [m], and the stretch's derivatives by p and by past (that by before is minus the latter);
        and whether it slides.
    """
    energy, hold, slides = 0.0, 0.0, 0
    stretch, by_p, by_past = vec3(0.0), 0.0 * identity(), 0.0 * identity()
    limit, n, by_depth, h = frozen[0], vec3(frozen[1], frozen[2], frozen[3]), 0.0, 0.0 * identity()
    if frozen[0] < 0.0:
        limit, n, by_depth, h = grip_of(p, radius, o, b)
    if limit > 0.0:
        hold = TANGENT * stiffness
        v = past + p - before
        along = identity() - n.outer_product(n)
        stretch = along @ v
        size = stretch.norm()
        by_p, by_past = along - n.dot(v) * h - n.outer_product(h @ v), along
        energy = 0.5 * hold * size * size
        slides = branch
        if branch < 0:
            slides = 0
            if size > limit:
                slides = 1
        if slides == 1:
            energy = hold * limit * (size - 0.5 * limit)
            e = stretch / ti.max(size, 1e-300)
            # one frozen whose force was expected to be less may come to stick where it goes: the primal-dual
            # step (Chan, Golub and Mulet, SIAM J. Sci. Comput. 20, 1999), which does not go to and fro
            to = e
            if frozen[0] >= 0.0:
                to = pulled / limit
            slide = identity() - 0.5 * (e.outer_product(to) + to.outer_product(e))
            slide *= limit / ti.max(size, 1e-300)
            stretch = limit * e
            by_p = slide @ by_p - by_depth * e.outer_product(n)
            by_past = slide @ along
    return energy, hold, stretch, by_p, by_past, slides


@ti.func
def grip_of(p: vec3, radius: float, o: ti.template(), b: int):
    """Of the rough obstacle in which p is deepest: the stretch [m] at which p slides, 0 if it touches none;
    the surface's normal; the limit's derivative by the depth; the normal's by p."""
    deepest, limit, by_depth = 0.0, 0.0, 0.0
    normal, bend = vec3(0.0), 0.0 * identity()
    for k in range(o.shape[1]):
        mu = o[b, k, FRICTION]
        if mu > 0.0 and not beyond(p, radius, o, b, k):
            d, n, h, _section = signed_distance(p, o, b, k)
            if radius - d > deepest:
                deepest = radius - d
                force, slope, _value = spring(deepest)
                limit, by_depth = mu * force / TANGENT, mu * slope / TANGENT
                normal, bend = n, h
    return limit, normal, by_depth, bend


@kernel
def nearest_obstacle(
    points: ti.types.ndarray(dtype=vec3, ndim=1),
    obstacles: ti.types.ndarray(dtype=ti.f64, ndim=3),
    distance: ti.types.ndarray(dtype=ti.f64, ndim=1),
    normal: ti.types.ndarray(dtype=vec3, ndim=1),
    which: ti.types.ndarray(dtype=ti.i32, ndim=1),
    section: ti.types.ndarray(dtype=ti.i32, ndim=1),
):
    """Lower `distance` to that of the nearest obstacle of rope 0, and say which it is and how it lies."""
    for i in range(points.shape[0]):
        for k in range(obstacles.shape[1]):
            d, n, _h, s = signed_distance(points[i], obstacles, 0, k)
            if d < distance[i]:
                distance[i] = d
                normal[i] = n
                which[i] = k
                section[i] = s
