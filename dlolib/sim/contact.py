"""Constraint 5 as a stiff one-sided spring between points of the rope and the obstacles.

The paper's C_c = (x - x_ic) . n_ic acts on particles alone; here the particles and the segments' middles
push, each for its share of the length, so that a cylinder does not sink in between two particles. The
spring sets in over `RAMP_M`, which keeps its energy twice differentiable where a contact opens or closes.
"""

from dlolib.sim.rotations import identity
from dlolib.sim.runtime import ti, vec3
from dlolib.sim.shapes import signed_distance

RAMP_M = 2e-4


@ti.func
def push(p: vec3, radius: float, stiffness: float, o: ti.template(), b: int):
    """Energy [J], its gradient [N] and Hessian [N/m] of all obstacles on a point of the rope's axis."""
    energy, gradient, hessian = 0.0, vec3(0.0), 0.0 * identity()
    for k in range(o.shape[1]):
        d, n, h, _section = signed_distance(p, o, b, k)
        depth = radius - d
        if depth > 0.0:
            force, slope, value = depth - RAMP_M / 2, 1.0, depth * (depth - RAMP_M) / 2 + RAMP_M * RAMP_M / 6
            if depth < RAMP_M:
                force, slope = depth * depth / (2 * RAMP_M), depth / RAMP_M
                value = depth * depth * depth / (6 * RAMP_M)
            energy += stiffness * value
            gradient -= stiffness * force * n
            hessian += stiffness * (slope * n.outer_product(n) - force * h)
    return energy, gradient, hessian


@ti.kernel
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
