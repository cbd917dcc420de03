"""A box: centre, orientation and the lengths of its edges."""

from collections.abc import Mapping

from dlolib.sim.rotations import identity, matrix
from dlolib.sim.runtime import mat3, ti, vec3, vec4

NAME = "box"


def pack(values: Mapping[str, tuple[float, ...]]) -> list[float]:
    """Centre, unit quaternion, half sizes."""
    q = values["quaternion"]
    norm = sum(a * a for a in q) ** 0.5
    return [*values["center_m"], *(a / norm for a in q), *(s / 2 for s in values["size_m"])]


def half_thickness(values: Mapping[str, tuple[float, ...]]) -> float:
    """Half of its shortest edge [m]."""
    return min(values["size_m"]) / 2


def hull(values: Mapping[str, tuple[float, ...]]) -> list[float]:
    """Of a ball about its centre that holds it: radius [m], and no axis."""
    return [sum((s / 2) ** 2 for s in values["size_m"]) ** 0.5, 0.0, 0.0, 0.0]


@ti.func
def signed_distance(p: vec3, o: ti.template(), b: int, k: int):
    """Distance to the surface [m], its gradient and Hessian, and 0: a box has no end sections."""
    rotation = matrix(vec4(o[b, k, 4], o[b, k, 5], o[b, k, 6], o[b, k, 7]))
    local = rotation.transpose() @ (p - vec3(o[b, k, 1], o[b, k, 2], o[b, k, 3]))
    beyond = vec3(0.0)
    sign = vec3(1.0)
    outside = vec3(0.0)
    deepest = -1e30
    face = 0
    for a in ti.static(range(3)):
        if local[a] < 0.0:
            sign[a] = -1.0
        gap = sign[a] * local[a] - o[b, k, 8 + a]
        if gap > 0.0:
            beyond[a] = gap
            outside[a] = 1.0
        if gap > deepest:
            deepest = gap
            face = a
    # inside the nearest face; outside a face, an edge or a corner, whichever coordinates lie beyond
    d = deepest
    n = vec3(0.0)
    for a in ti.static(range(3)):
        if face == a:
            n[a] = sign[a]
    h = 0.0 * identity()
    if outside.sum() > 0.0:
        d = beyond.norm()
        n = sign * beyond / d
        free = mat3([[outside[0], 0.0, 0.0], [0.0, outside[1], 0.0], [0.0, 0.0, outside[2]]])
        h = (free - n.outer_product(n)) / d
    return d, rotation @ n, rotation @ h @ rotation.transpose(), 0
