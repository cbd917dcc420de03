"""Distances to obstacles, against a dense sampling of their surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from dlolib.formats import nearest_distance, signed_distance
from dlolib.formats.geometry import DISTANCES
from dlolib.obstacles import SHAPES
from dlolib.types import Floats, Obstacle

TURN = Rotation.from_rotvec([0.3, -0.5, 0.8])
AXIS = tuple(TURN.apply([0, 0, 1]).tolist())
CENTER = (0.1, -0.2, 0.3)
BODIES = {
    "sphere": Obstacle("sphere", {"center_m": CENTER, "radius_m": (0.05,)}),
    "cylinder": Obstacle(
        "cylinder", {"center_m": CENTER, "axis": AXIS, "radius_m": (0.05,), "height_m": (0.06,)}
    ),
    "plane": Obstacle("plane", {"point_m": CENTER, "normal": AXIS}),
    "box": Obstacle(
        "box",
        {
            "center_m": CENTER,
            "quaternion": tuple(TURN.as_quat(scalar_first=True).tolist()),
            "size_m": (0.1, 0.06, 0.04),
        },
    ),
    "capsule": Obstacle(
        "capsule", {"center_m": CENTER, "axis": AXIS, "radius_m": (0.04,), "height_m": (0.06,)}
    ),
}


def inside(shape: str, points: Floats) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """By the definition of each body, in its own axes."""
    x, y, z = (TURN.inv().apply(points - CENTER)).T
    return {
        "sphere": np.hypot(np.hypot(x, y), z) < 0.05,
        "cylinder": (np.hypot(x, y) < 0.05) & (abs(z) < 0.03),
        "plane": z < 0,
        "box": (abs(x) < 0.05) & (abs(y) < 0.03) & (abs(z) < 0.02),
        "capsule": np.hypot(np.hypot(x, y), np.maximum(abs(z) - 0.03, 0)) < 0.04,
    }[shape]


@pytest.mark.parametrize("shape", list(SHAPES))
def test_sign_size_and_gradient(shape: str) -> None:
    rng = np.random.default_rng(0)
    points = CENTER + rng.uniform(-0.1, 0.1, (4000, 3))
    distance = signed_distance(BODIES[shape], points)
    assert ((distance < 0) == inside(shape, points)).all()
    # Distance to the nearest point on the other side of the surface, found by sampling.
    sign = distance < 0
    for mine, other in ((sign, ~sign), (~sign, sign)):
        sampled, _ = KDTree(points[other]).query(points[mine])
        assert (sampled >= np.abs(distance[mine]) - 1e-12).all()
        assert np.median(sampled - np.abs(distance[mine])) < 0.012
    step = 1e-6
    slopes = [(signed_distance(BODIES[shape], points + step * axis) - distance) / step for axis in np.eye(3)]
    assert_allclose(np.median(np.linalg.norm(slopes, axis=0)), 1.0, atol=1e-5)


@pytest.mark.parametrize(
    ("shape", "offset", "expected"),
    [
        ("cylinder", (0.08, 0, 0.07), 0.05),
        ("cylinder", (0, 0, 0), -0.03),
        ("cylinder", (0.045, 0, 0), -0.005),
        ("box", (0.08, 0, 0.06), 0.05),
        ("box", (0, 0, 0.015), -0.005),
        ("sphere", (0.03, 0.04, 0), 0.0),
        ("plane", (5, 4, -0.2), -0.2),
        ("capsule", (0.05, 0, 0.02), 0.01),
        ("capsule", (0.03, 0, 0.07), 0.01),
        ("capsule", (0, 0.02, -0.04), np.sqrt(5) / 100 - 0.04),
    ],
)
def test_known_distances(shape: str, offset: tuple[float, ...], expected: float) -> None:
    point = CENTER + TURN.apply(offset)
    assert_allclose(signed_distance(BODIES[shape], point), expected, atol=1e-12)


def test_the_nearest_of_several() -> None:
    point = CENTER + TURN.apply([[0.08, 0, 0.07]])
    assert_allclose(nearest_distance([BODIES["cylinder"], BODIES["plane"]], point), [0.05])
    assert np.isinf(nearest_distance([], point)).all()


def test_every_shape_has_a_distance() -> None:
    assert set(DISTANCES) == set(SHAPES)


def test_an_unknown_shape() -> None:
    with pytest.raises(ValueError, match="torus"):
        signed_distance(Obstacle("torus", {}), np.zeros(3))
