"""The obstacles the rod knows. A new one is a file here, a line below, and one in each table that
`dlolib.obstacles` names."""

from collections.abc import Sequence

import numpy as np

from dlolib.sim.rotations import identity
from dlolib.sim.runtime import mat3, ti, vec3
from dlolib.sim.scene import HULL, THIN
from dlolib.sim.shapes import box, capsule, cylinder, plane, sphere
from dlolib.types import Floats, Obstacle

ALL = (cylinder, sphere, plane, box, capsule)
WIDTH = HULL + 4
scalars3 = ti.types.ndarray(dtype=ti.f64, ndim=3)


def pack(obstacles: Sequence[Obstacle]) -> Floats:
    """Obstacles as rows (K, WIDTH): the shape's number, its values, half of its thickness in column THIN, and
    its hull in the last four."""
    numbers = {shape.NAME: number for number, shape in enumerate(ALL)}
    rows = np.zeros((len(obstacles), WIDTH))
    for row, obstacle in zip(rows, obstacles, strict=True):
        number = numbers[obstacle.shape]
        values = [float(number), *ALL[number].pack(obstacle.values)]
        row[: len(values)] = values
        row[THIN] = ALL[number].half_thickness(obstacle.values)
        row[HULL:] = ALL[number].hull(obstacle.values)
    return rows


@ti.real_func
def signed_distance(p: vec3, o: scalars3, b: ti.i32, k: ti.i32) -> tuple[ti.f64, vec3, mat3, ti.i32]:
    """Distance [m] from p to obstacle k of rope b, gradient, Hessian, 1 where an end section is nearest."""
    d, n, h, section = 1e30, vec3(0.0), 0.0 * identity(), 0
    kind = int(o[b, k, 0])
    for number in ti.static(range(len(ALL))):
        if kind == number:
            d, n, h, section = ALL[number].signed_distance(p, o, b, k)
    return d, n, h, section
