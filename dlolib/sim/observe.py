"""From the simulated rope to what a recording would show of it."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from dlolib.sim.effects.base import Camera
from dlolib.types import Floats, Points, Recording


def point_weights(points: Points, length_m: float, particles: int) -> Floats:
    """Cubic spline through the particles, as weights (P, n) that give each point at its arc length."""
    nodes = np.linspace(0, length_m, particles)
    spline = make_interp_spline(nodes, np.eye(particles), k=3)
    return np.asarray(spline(np.clip(points.s_m, 0, length_m)))


def viewing_axis(recording: Recording) -> Floats:
    """The camera's +z in world axes, (3,); world +y where the recording names no camera."""
    if recording.world_from_camera is None:
        return np.array([0.0, 1.0, 0.0])
    return np.asarray(recording.world_from_camera[:3, 2], dtype=float)


def seen(xyz_m: Floats, camera: Camera, axis: Floats) -> Floats:
    """True points (..., 3) [m] as a camera with a wrong pose shows them."""
    if camera == Camera():
        return xyz_m
    turn = Rotation.from_rotvec(camera.rotation).as_matrix()
    return np.asarray(xyz_m @ turn.T + camera.depth_m * axis + np.array(camera.shift_m))


def turned(vectors: Floats, camera: Camera) -> Floats:
    """Derivatives of true points (..., 3) as derivatives of seen ones."""
    if camera.rotation == Camera().rotation:
        return vectors
    return np.asarray(vectors @ Rotation.from_rotvec(camera.rotation).as_matrix().T)


__all__ = ["point_weights", "seen", "turned", "viewing_axis"]
