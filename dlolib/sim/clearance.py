"""How far a rope's surface stays from the obstacles, along its segments and not only at particles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlolib.sim import shapes
from dlolib.sim.contact import nearest_obstacle
from dlolib.types import Floats, Obstacle

# Points a segment: between two of them, 1.5 mm apart, a segment bows 0.01 mm into a 30 mm cylinder.
SAMPLES_PER_SEGMENT = 10


@dataclass(frozen=True)
class Nearest:
    """For each point (...,): distance [m], outward normal (..., 3), number of the obstacle, and whether the
    nearest part of it is an end section. Distance is infinite, obstacle -1 where there is none."""

    distance_m: Floats
    normal: Floats
    obstacle: np.ndarray[tuple[int, ...], np.dtype[np.int32]]
    section: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


def nearest(points_m: Floats, obstacles: Sequence[Obstacle]) -> Nearest:
    """The nearest obstacle of each point; points_m (..., 3)."""
    flat = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 3)
    distance, normal = np.full(len(flat), np.inf), np.zeros((len(flat), 3))
    which, section = np.full(len(flat), -1, np.int32), np.zeros(len(flat), np.int32)
    if obstacles:
        nearest_obstacle(flat, shapes.pack(obstacles)[None], distance, normal, which, section)
    shape = points_m.shape[:-1]
    return Nearest(
        distance.reshape(shape),
        normal.reshape(*shape, 3),
        which.reshape(shape),
        section.reshape(shape).astype(bool),
    )


def clearance(positions_m: Floats, radius_m: float, obstacles: Sequence[Obstacle]) -> Floats:
    """Smallest distance from the rope's surface to an obstacle [m], negative inside.

    Args:
        positions_m: particles, shape (..., n, 3).
        radius_m: the rope's radius.

    Returns:
        shape (...,); infinite without obstacles.
    """
    if not obstacles:
        return np.full(positions_m.shape[:-2], np.inf)
    at_particles = nearest(positions_m, obstacles).distance_m
    least = at_particles.min(axis=-1)
    a, way = positions_m[..., :-1, :], np.diff(positions_m, axis=-2)
    # a distance changes no faster than one moves: nearer than this no point of a segment is
    bound = 0.5 * (at_particles[..., :-1] + at_particles[..., 1:] - np.linalg.norm(way, axis=-1))
    may = bound < least[..., None]
    share = np.arange(1, SAMPLES_PER_SEGMENT)[:, None] / SAMPLES_PER_SEGMENT
    within = np.full(may.shape, np.inf)
    if may.any():
        within[may] = nearest(a[may][:, None] + share * way[may][:, None], obstacles).distance_m.min(axis=-1)
    return np.asarray(np.minimum(least, within.min(axis=-1)) - radius_m)
