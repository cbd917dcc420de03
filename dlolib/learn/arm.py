"""What the arm makes of a commanded path: it stops at obstacles and where the rope is taut."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import autograd.numpy as anp
import numpy as np
from autograd.extend import defjvp, defvjp, primitive

from dlolib.sim.clearance import nearest
from dlolib.types import Floats, Obstacle

# Share of the rope's length that the end may be away from the start.
REACH = 0.98
DIFFERENCE_M = 1e-6


def within_reach(points_m: Floats, start_m: Floats, reach_m: float) -> Floats:
    """Points (..., 3) drawn towards the start where they are further away than `reach_m`."""
    offset = points_m - start_m
    distance = anp.sqrt(anp.sum(offset**2, axis=-1, keepdims=True) + 1e-12)
    drawn: Floats = points_m - offset * anp.maximum(1 - reach_m / distance, 0.0)
    return drawn


def outside(obstacles: Sequence[Obstacle], gap_m: float) -> Callable[[Floats], Floats]:
    """A differentiable map of points (..., 3) to the nearest places at least `gap_m` outside the obstacles.

    A held end is a part of the rope and cannot be inside an obstacle; the simulator, which takes the
    ends' places as given, would let it pass. Differentiation follows the surface: with p' = p + (gap -
    d) n the derivative is I - n nᵀ + (gap - d) ∇n, ∇n by central differences.
    """

    @primitive  # type: ignore[untyped-decorator]  # autograd has no types
    def push_out(points_m: Floats) -> Floats:
        found = nearest(points_m, obstacles)
        depth = np.maximum(gap_m - found.distance_m, 0.0)
        pushed: Floats = points_m + depth[..., None] * found.normal
        return pushed

    def along_surface(tangent: Floats, answer: Floats, points_m: Floats) -> Floats:
        found = nearest(points_m, obstacles)
        depth = np.maximum(gap_m - found.distance_m, 0.0)[..., None]
        size = np.linalg.norm(tangent, axis=-1, keepdims=True)
        step = DIFFERENCE_M * tangent / np.where(size > 0, size, 1.0)
        ahead, behind = nearest(points_m + step, obstacles), nearest(points_m - step, obstacles)
        bend = (ahead.normal - behind.normal) * size / (2 * DIFFERENCE_M)
        along = np.sum(found.normal * tangent, axis=-1, keepdims=True) * found.normal
        moved: Floats = tangent + np.where(depth > 0, depth * bend - along, 0.0)
        return moved

    defjvp(push_out, along_surface)
    # a distance's Hessian is symmetric: backwards it is the same
    defvjp(push_out, lambda answer, points_m: lambda tangent: along_surface(tangent, answer, points_m))
    if not obstacles:
        return lambda points_m: points_m
    mapped: Callable[[Floats], Floats] = push_out
    return mapped
