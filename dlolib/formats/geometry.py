"""Exact signed distances to the obstacles that files may name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.types import Floats, Obstacle

Values = Mapping[str, Floats]


def signed_distance(obstacle: Obstacle, points: Floats) -> Floats:
    """Distance [m] of points (..., 3) to the obstacle's surface, shape (...); negative inside.

    A cylinder is finite, its axis through its centre, a capsule likewise with half spheres beyond its height;
    a plane is solid on the side away from its normal; a box has the full edge lengths `size_m` along the
    axes of its quaternion.

    Raises:
        ValueError: for a shape that has no distance here.
    """
    if obstacle.shape not in DISTANCES:
        raise ValueError(f"no signed distance for the shape {obstacle.shape!r}")
    value = {name: np.array(numbers, dtype=np.float64) for name, numbers in obstacle.values.items()}
    return DISTANCES[obstacle.shape](value, np.asarray(points, dtype=np.float64))


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


def _sphere(value: Values, place: Floats) -> Floats:
    return np.asarray(_length(place - value["center_m"]) - float(value["radius_m"][0]))


def _plane(value: Values, place: Floats) -> Floats:
    return np.asarray((place - value["point_m"]) @ _unit(value["normal"]))


def _cylinder(value: Values, place: Floats) -> Floats:
    offset = place - value["center_m"]
    along = offset @ _unit(value["axis"])
    radial = _length(offset - along[..., None] * _unit(value["axis"]))
    beyond = (radial - value["radius_m"][0], np.abs(along) - value["height_m"][0] / 2)
    return _outside(np.stack(beyond, axis=-1))


def _capsule(value: Values, place: Floats) -> Floats:
    offset, axis, half = place - value["center_m"], _unit(value["axis"]), value["height_m"][0] / 2
    nearest = np.clip(offset @ axis, -half, half)[..., None] * axis
    return np.asarray(_length(offset - nearest) - float(value["radius_m"][0]))


def _box(value: Values, place: Floats) -> Floats:
    turn = Rotation.from_quat(value["quaternion"], scalar_first=True).as_matrix()
    return _outside(np.abs((place - value["center_m"]) @ turn) - value["size_m"] / 2)


DISTANCES: dict[str, Callable[[Values, Floats], Floats]] = {
    "sphere": _sphere,
    "plane": _plane,
    "cylinder": _cylinder,
    "box": _box,
    "capsule": _capsule,
}
