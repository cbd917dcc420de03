"""A sphere: centre and radius."""

from collections.abc import Mapping

from dlolib.sim.rotations import identity
from dlolib.sim.runtime import ti, vec3

NAME = "sphere"


def pack(values: Mapping[str, tuple[float, ...]]) -> list[float]:
    """Centre, radius."""
    return [*values["center_m"], values["radius_m"][0]]


def half_thickness(values: Mapping[str, tuple[float, ...]]) -> float:
    """Its radius [m]."""
    return values["radius_m"][0]


def hull(values: Mapping[str, tuple[float, ...]]) -> list[float]:
    """Of a ball about its centre that holds it: radius [m], and no axis."""
    return [values["radius_m"][0], 0.0, 0.0, 0.0]


@ti.func
def signed_distance(p: vec3, o: ti.template(), b: int, k: int):
    """Distance to the surface [m], its gradient and Hessian, and 0: a sphere has no end sections."""
    r = p - vec3(o[b, k, 1], o[b, k, 2], o[b, k, 3])
    rho = ti.max(r.norm(), 1e-12)
    n = r / rho
    return rho - o[b, k, 4], n, (identity() - n.outer_product(n)) / rho, 0
