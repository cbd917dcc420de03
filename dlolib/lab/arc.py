"""The motion of the paper's experiment: an arc in the x-z plane, out and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dlolib.types import Floats, Motion

# Turns the third axis (the rope's tangent) onto +x and the first onto +y.
ALONG_X = (0.5, 0.5, 0.5, 0.5)
EASE = 0.1


def arc_motion(
    waypoints: int = 400,
    interval_s: float = 0.05,
    center_m: ArrayLike = (0.18, 0.0, 0.0),
    radius_m: float = 0.2,
    sweep_rad: float = 1.6,
    start_m: ArrayLike = (0.0, 0.0, 0.0),
) -> Motion:
    """The end on an arc in the x-z plane, from the centre's +x side upwards and back again.

    The paper's experiment VI.A: an arc of 400 waypoints. On the default one an elastic rope of 0.445 m
    and 3e-4 N m² bends to 19-31 1/m (a yield curvature of 8 1/m shows), keeps clear of itself, and
    moves by 0.3 to 0.8 mm (mean over the rope) for 10 % of EI. It starts, turns round and ends gently.

    Args:
        waypoints: rows of the motion.
        interval_s: from one to the next [s].
        center_m: centre of the arc [m], shape (3,).
        radius_m: its radius [m].
        sweep_rad: angle out [rad], and back.
        start_m: where the rope's start is clamped [m], shape (3,).

    Returns:
        The motion, with both ends' tangents along +x throughout.
    """
    angle = sweep_rad * _out_and_back(np.linspace(0, 1, waypoints))
    turned = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)
    pose = np.tile(ALONG_X, (waypoints, 1))
    return Motion(
        t_s=interval_s * np.arange(waypoints, dtype=np.float64),
        start_m=np.tile(np.asarray(start_m, dtype=float), (waypoints, 1)),
        start_q=pose,
        end_m=np.asarray(center_m, dtype=float) + radius_m * turned,
        end_q=pose.copy(),
    )


def _out_and_back(u: Floats) -> Floats:
    """From 0 to 1 and back at even speed, with a parabolic ease at the ends of both halves."""
    half = 1 - np.abs(2 * u - 1)
    rise = np.where(half < EASE, half**2 / (2 * EASE), half - EASE / 2)
    late = 1 - half
    return np.asarray(np.where(late < EASE, 1 - EASE - late**2 / (2 * EASE), rise) / (1 - EASE))
