"""A half space: a point of its surface and the normal that points out of it."""

from collections.abc import Mapping
from math import inf

from dlolib.sim.rotations import identity
from dlolib.sim.runtime import ti, vec3

NAME = "plane"


def pack(values: Mapping[str, tuple[float, ...]]) -> list[float]:
    """Point, unit normal."""
    normal = values["normal"]
    norm = sum(a * a for a in normal) ** 0.5
    return [*values["point_m"], *(a / norm for a in normal)]


def half_thickness(values: Mapping[str, tuple[float, ...]]) -> float:
    """A half space is infinitely thick."""
    return inf


def hull(values: Mapping[str, tuple[float, ...]]) -> list[float]:
    """Nothing holds a half space."""
    return [inf, 0.0, 0.0, 0.0]


@ti.func
def signed_distance(p: vec3, o: ti.template(), b: int, k: int):
    """Distance to the surface [m], its gradient and Hessian, and 0: a plane has no end sections."""
    n = vec3(o[b, k, 4], o[b, k, 5], o[b, k, 6])
    return (p - vec3(o[b, k, 1], o[b, k, 2], o[b, k, 3])).dot(n), n, 0.0 * identity(), 0
