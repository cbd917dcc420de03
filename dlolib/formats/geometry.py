"""Exact signed distances to the obstacles that files may name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.types import Floats, Obstacle


def signed_distance(obstacle: Obstacle, points: Floats) -> Floats:
    """Distance [m] of points (..., 3) to the obstacle's surface, shape (...); negative inside.

    A cylinder is finite, its axis through its centre; a plane is solid on the side away from its
    normal; a box has the full edge lengths `size_m` along the axes of its quaternion.

    Raises:
        ValueError: for a shape that has no distance here.
    """
    place = np.asarray(points, dtype=np.float64)
    value = {name: np.array(numbers, dtype=np.float64) for name, numbers in obstacle.values.items()}
    if obstacle.shape == "sphere":
        return _length(place - value["center_m"]) - float(value["radius_m"][0])
    if obstacle.shape == "plane":
        height: Floats = (place - value["point_m"]) @ _unit(value["normal"])
        return height
    if obstacle.shape == "cylinder":
        offset = place - value["center_m"]
        along = offset @ _unit(value["axis"])
        radial = _length(offset - along[..., None] * _unit(value["axis"]))
        beyond = (radial - value["radius_m"][0], np.abs(along) - value["height_m"][0] / 2)
        return _outside(np.stack(beyond, axis=-1))
    if obstacle.shape == "box":
        turn = Rotation.from_quat(value["quaternion"], scalar_first=True).as_matrix()
        return _outside(np.abs((place - value["center_m"]) @ turn) - value["size_m"] / 2)
    raise ValueError(f"no signed distance for the shape {obstacle.shape!r}")


def nearest_distance(obstacles: Sequence[Obstacle], points: Floats) -> Floats:
    """Distance [m] of points (..., 3) to the nearest obstacle, shape (...); infinite without obstacles."""
    place = np.asarray(points, dtype=np.float64)
    nearest = np.full(place.shape[:-1], np.inf)
    for obstacle in obstacles:
        nearest = np.minimum(nearest, signed_distance(obstacle, place))
    return nearest


def _outside(beyond: Floats) -> Floats:
    """Distance from how far a point is beyond each pair of faces, shape (..., pairs)."""
    distance: Floats = _length(np.maximum(beyond, 0.0)) + np.minimum(beyond.max(axis=-1), 0.0)
    return distance


def _length(vectors: Floats) -> Floats:
    return np.asarray(np.linalg.norm(vectors, axis=-1), dtype=np.float64)


def _unit(vector: Floats) -> Floats:
    unit: Floats = vector / np.linalg.norm(vector)
    return unit
