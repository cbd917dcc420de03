"""The way of the moved end: arc-like sub-trajectories of five parameters, the paper's equations (13) to (17).

Written in `autograd.numpy`, so that `autograd` gives the derivatives.
"""

from __future__ import annotations

import autograd.numpy as anp

from dlolib.types import Floats

# The paper's "max vector" Λ for T = (φ, s, θ, Δx, Δz): radians a step, share of |AB|, radians, metres,
# metres. Table I lists s first; only this order makes sense, since s ≤ 0.008 would put every centre at A
# and 1.5 rad a step would be no arc.
TABLE_I_BOUNDS = (0.008, 1.5, 0.5, 0.05, 0.05)
PARAMETERS = len(TABLE_I_BOUNDS)
UP = (0.0, 0.0, 1.0)


def rotate(vectors: Floats, axis: Floats, angle_rad: Floats) -> Floats:
    """Turn vectors about a unit axis (Rodrigues' formula, the paper's τ∘rot(v, φ)).

    Args:
        vectors: shape (3,).
        axis: unit vector, shape (3,).
        angle_rad: shape (M,): one angle for each turned vector.

    Returns:
        Shape (M, 3).
    """
    angle = anp.reshape(angle_rad, (-1, 1))
    along = anp.dot(vectors, axis) * axis
    turned: Floats = (
        along + anp.cos(angle) * (vectors - along) + anp.sin(angle) * anp.cross(axis, vectors)[None, :]
    )
    return turned


def centre(parameters: Floats, a_m: Floats, b_m: Floats) -> Floats:
    """Centre C [m], shape (3,), of the arc with parameters (φ, s, θ, Δx, Δz): (13) to (15)."""
    _, share, _, right, up = parameters
    across: Floats = b_m - a_m
    middle: Floats = share * across + a_m + right * anp.array([1.0, 0.0, 0.0]) + up * anp.array(UP)
    return middle


def plane_normal(tilt_rad: Floats, a_m: Floats, b_m: Floats) -> Floats:
    """Unit normal, shape (3,), of the plane of the arc, tilted by θ about the line AB: (16).

    The paper's N has the length |D|; a rotation needs the direction alone.
    """
    across = b_m - a_m
    unit = across / anp.sqrt(anp.sum(across**2))
    tilted = rotate(anp.array(UP), unit, anp.reshape(tilt_rad, (1,)))[0]
    normal = -anp.cross(unit, tilted)
    unit_normal: Floats = normal / anp.sqrt(anp.sum(normal**2))
    return unit_normal


def arc(parameters: Floats, from_m: Floats, a_m: Floats, b_m: Floats, steps: int) -> Floats:
    """Points of one sub-trajectory, the paper's ε_1 .. ε_steps: (17).

    (17) as printed lacks "+ C": the point is turned about C, ε_i = (ε_{i-1} - C)∘rot(N, φ) + C. The
    centre and axis stay the same within a sub-trajectory, so its i-th point is the first turned by i φ.

    Args:
        parameters: (φ [rad a step], s, θ [rad], Δx [m], Δz [m]), shape (5,).
        from_m: where the end is before the first step, shape (3,).
        a_m, b_m: the path's beginning A and end B [m], shape (3,), not both at one place nor one above
            the other (the plane of (16) is then undefined).
        steps: number of points.

    Returns:
        Positions [m], shape (steps, 3).
    """
    middle = centre(parameters, a_m, b_m)
    normal = plane_normal(parameters[2], a_m, b_m)
    turned: Floats = rotate(from_m - middle, normal, parameters[0] * anp.arange(1, steps + 1)) + middle
    return turned
