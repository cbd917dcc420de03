"""A finite cylinder: centre, axis, radius and height (the distance between its end sections)."""

from collections.abc import Mapping

from dlolib.sim.rotations import identity
from dlolib.sim.runtime import ti, vec3

NAME = "cylinder"


def pack(values: Mapping[str, tuple[float, ...]]) -> list[float]:
    """Centre, unit axis, radius, half height."""
    axis = values["axis"]
    norm = sum(a * a for a in axis) ** 0.5
    return [*values["center_m"], *(a / norm for a in axis), values["radius_m"][0], values["height_m"][0] / 2]


def half_thickness(values: Mapping[str, tuple[float, ...]]) -> float:
    """Its radius, or half of its height where that is less [m]."""
    return min(values["radius_m"][0], values["height_m"][0] / 2)


def hull(values: Mapping[str, tuple[float, ...]]) -> list[float]:
    """Of an endless tube about its centre that holds it: radius [m] and unit axis."""
    return [values["radius_m"][0], *pack(values)[3:6]]


@ti.func
def signed_distance(p: vec3, o: ti.template(), b: int, k: int):
    """Distance to the surface [m], its gradient and Hessian, and 1 where an end section is nearest."""
    centre = vec3(o[b, k, 1], o[b, k, 2], o[b, k, 3])
    axis = vec3(o[b, k, 4], o[b, k, 5], o[b, k, 6])
    r = p - centre
    along = r.dot(axis)
    side = 1.0
    if along < 0.0:
        side = -1.0
    radial = r - along * axis
    rho = ti.max(radial.norm(), 1e-12)
    e = radial / rho
    dr = rho - o[b, k, 7]
    da = side * along - o[b, k, 8]
    around = axis.cross(e)
    # outside both the mantle and the section: the rim is nearest
    d = ti.sqrt(ti.max(dr * dr + da * da, 1e-24))
    n = (dr * e + da * side * axis) / d
    t = (-da * e + dr * side * axis) / d
    h = t.outer_product(t) / d + (dr / d / rho) * around.outer_product(around)
    section = 0
    if da > dr:
        section = 1
    if dr <= 0.0 or da <= 0.0:
        if dr > da:
            d, n = dr, e
            h = around.outer_product(around) / rho
        else:
            d, n = da, side * axis
            h = 0.0 * identity()
    return d, n, h, section
