"""Plastic bending with linear kinematic hardening (formats.md, `plastic_bending`)."""

from __future__ import annotations

import numpy as np

from dlolib.types import Floats

TINY = 1e-12


def return_mapping(
    curvature: Floats, plastic: Floats, yield_curvature_1_m: float, hardening_ratio: float
) -> Floats:
    """The plastic curvature after an increment: M = EI (κ - κp), |M - H EI κp| ≤ EI κy.

    The radial return for linear kinematic hardening, exact for one increment (Simo and Hughes,
    Computational Inelasticity, box 1.5, here with a norm over both axes).

    Args:
        curvature: κ after the increment [1/m], shape (J, 2).
        plastic: κp before it [1/m], shape (J, 2).
        yield_curvature_1_m: κy [1/m].
        hardening_ratio: H.

    Returns:
        κp after the increment [1/m], shape (J, 2).
    """
    relative = curvature - (1 + hardening_ratio) * plastic
    size = np.linalg.norm(relative, axis=-1, keepdims=True)
    excess = np.maximum(size - yield_curvature_1_m, 0) / (1 + hardening_ratio)
    return np.asarray(plastic + excess * relative / np.maximum(size, TINY))


def rotation_vectors(quaternions: Floats) -> Floats:
    """Rotation vectors [rad] (J, 3) of unit quaternions (J, 4), the short way round."""
    turned = np.where(quaternions[:, :1] < 0, -quaternions, quaternions)
    sine = np.linalg.norm(turned[:, 1:], axis=1, keepdims=True)
    angle = 2 * np.arctan2(sine, turned[:, :1])
    return np.asarray(turned[:, 1:] * np.where(sine > TINY, angle / np.maximum(sine, TINY), 2.0))
