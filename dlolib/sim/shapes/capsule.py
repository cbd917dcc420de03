"""A capsule: a cylinder closed by half spheres; centre, axis, radius and height (between their centres)."""

from collections.abc import Mapping

from dlolib.sim.rotations import identity
from dlolib.sim.runtime import ti, vec3

NAME = "capsule"


def pack(values: Mapping[str, tuple[float, ...]]) -> list[float]:
    """Centre, unit axis, radius, half height."""
    axis = values["axis"]
    norm = sum(a * a for a in axis) ** 0.5
    return [*values["center_m"], *(a / norm for a in axis), values["radius_m"][0], values["height_m"][0] / 2]


def half_thickness(values: Mapping[str, tuple[float, ...]]) -> float:
    """Its radius [m]."""
    return values["radius_m"][0]


def hull(values: Mapping[str, tuple[float, ...]]) -> list[float]:
    """Of an endless tube about its centre that holds it: radius [m] and unit axis."""
    return [values["radius_m"][0], *pack(values)[3:6]]


@ti.func
def signed_distance(p: vec3, o: ti.template(), b: int, k: int):
    """Distance to the surface [m], its gradient and Hessian, and 0: a capsule has no end sections."""
    axis = vec3(o[b, k, 4], o[b, k, 5], o[b, k, 6])
    r = p - vec3(o[b, k, 1], o[b, k, 2], o[b, k, 3])
    along = r.dot(axis)
    nearest = ti.min(ti.max(along, -o[b, k, 8]), o[b, k, 8])
    away = r - nearest * axis
    rho = ti.max(away.norm(), 1e-12)
    n = away / rho
    across = identity() - n.outer_product(n)
    if nearest == along:
        across -= axis.outer_product(axis)
    return rho - o[b, k, 7], n, across / rho, 0
