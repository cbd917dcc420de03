"""The way of the moved end: arc-like sub-trajectories of five parameters, the paper's equations (13) to (17).

Written in `autograd.numpy`, so that `autograd` gives the derivatives.
"""

from __future__ import annotations

import autograd.numpy as anp
import numpy as np

from dlolib.types import Floats

# The paper's "max vector" Λ for T = (φ, s, θ, Δx, Δz): radians a step, share of |AB|, radians, metres,
# metres. Table I lists s first; only this order makes sense, since s ≤ 0.008 would put every centre at A
# and 1.5 rad a step would be no arc.
TABLE_I_BOUNDS = (0.008, 1.5, 0.5, 0.05, 0.05)
PARAMETERS = len(TABLE_I_BOUNDS)
UP = np.array([0.0, 0.0, 1.0])


def centre(parameters: Floats, a_m: Floats, b_m: Floats) -> Floats:
    """Centres C [m], shape (..., 3), of arcs with parameters (φ, s, θ, Δx, Δz), (..., 5): (13) to (15).

    The paper's ropes lie in x-z; Δx here is along that of the horizontal axes on which B is further from A.
    """
    along_x = np.eye(3)[np.argmax(np.abs((b_m - a_m)[:2]))]
    moves = np.stack([np.zeros(3), b_m - a_m, np.zeros(3), along_x, UP])
    middle: Floats = anp.dot(parameters, moves) + a_m
    return middle


def plane_normal(tilt_rad: Floats, a_m: Floats, b_m: Floats) -> Floats:
    """Unit normals, shape (..., 3), of the planes of arcs, tilted by θ (...,) about the line AB: (16).

    The paper's N has the length |D|; a rotation needs the direction alone. D is the upright tilted about AB,
    and N is normal to AB and D: it is the upright plane's own normal tilted as far.
    """
    across = (b_m - a_m) / np.linalg.norm(b_m - a_m)
    upright = np.cross(UP, across)
    upright /= np.linalg.norm(upright)
    tilt = anp.expand_dims(tilt_rad, -1)
    normal: Floats = anp.cos(tilt) * upright + anp.sin(tilt) * np.cross(across, upright)
    return normal


def arc(parameters: Floats, from_m: Floats, a_m: Floats, b_m: Floats, steps: int) -> Floats:
    """Points of sub-trajectories, the paper's ε_1 .. ε_steps: (17).

    (17) as printed lacks "+ C": the point is turned about C, ε_i = (ε_{i-1} - C)∘rot(N, φ) + C. The
    centre and axis stay the same within a sub-trajectory, so its i-th point is the first turned by i φ
    (Rodrigues' formula).

    Args:
        parameters: (φ [rad a step], s, θ [rad], Δx [m], Δz [m]), shape (..., 5).
        from_m: where the end is before the first step, shape (..., 3).
        a_m, b_m: the path's beginning A and end B [m], shape (3,), not both at one place nor one above
            the other (the plane of (16) is then undefined).
        steps: number of points.

    Returns:
        Positions [m], shape (..., steps, 3).
    """
    middle = centre(parameters, a_m, b_m)
    normal = plane_normal(parameters[..., 2], a_m, b_m)
    spoke = from_m - middle
    aside = anp.cross(normal, spoke)
    along = anp.sum(normal * spoke, axis=-1, keepdims=True) * normal
    angle = parameters[..., :1] * np.arange(1, steps + 1)
    turned = (
        anp.expand_dims(anp.cos(angle), -1) * anp.expand_dims(spoke - along, -2)
        + anp.expand_dims(anp.sin(angle), -1) * anp.expand_dims(aside, -2)
    )  # fmt: skip
    points: Floats = turned + anp.expand_dims(along + middle, -2)
    return points
