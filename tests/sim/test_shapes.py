"""Every obstacle through one test: sign, unit gradient, gradient and Hessian against differences."""

import numpy as np
import pytest

from dlolib.formats import signed_distance
from dlolib.obstacles import SHAPES
from dlolib.sim import shapes
from dlolib.sim.clearance import SAMPLES_PER_SEGMENT, clearance
from dlolib.sim.runtime import ti, vec3
from dlolib.sim.scene import HULL, THIN
from dlolib.types import Obstacle

EXAMPLES = {
    "cylinder": {
        "center_m": (0.1, 0.0, 0.2),
        "axis": (0.3, 1.0, 0.1),
        "radius_m": (0.03,),
        "height_m": (0.06,),
    },
    "sphere": {"center_m": (0.1, 0.0, 0.2), "radius_m": (0.03,)},
    "plane": {"point_m": (0.1, 0.0, 0.2), "normal": (0.2, 0.1, 1.0)},
    "box": {"center_m": (0.1, 0.0, 0.2), "quaternion": (0.9, 0.1, 0.2, 0.3), "size_m": (0.04, 0.06, 0.08)},
    "capsule": {
        "center_m": (0.1, 0.0, 0.2),
        "axis": (0.3, 1.0, 0.1),
        "radius_m": (0.03,),
        "height_m": (0.06,),
    },
}
INSIDE = {
    "cylinder": (0.1, 0.0, 0.2),
    "sphere": (0.1, 0.01, 0.2),
    "plane": (0.1, 0.0, 0.1),
    "box": (0.1, 0.0, 0.2),
    "capsule": (0.11, 0.0, 0.2),
}


@ti.kernel
def evaluate(
    points: ti.types.ndarray(dtype=vec3, ndim=1),
    obstacles: ti.types.ndarray(dtype=ti.f64, ndim=3),
    d: ti.types.ndarray(dtype=ti.f64, ndim=1),
    n: ti.types.ndarray(dtype=vec3, ndim=1),
    h: ti.types.ndarray(dtype=ti.types.matrix(3, 3, ti.f64), ndim=1),
):
    for i in range(points.shape[0]):
        distance, normal, hessian, _section = shapes.signed_distance(points[i], obstacles, 0, 0)
        d[i] = distance
        n[i] = normal
        h[i] = hessian


def at(shape: str, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    packed = shapes.pack([Obstacle(shape, EXAMPLES[shape])])[None]
    d, n, h = np.zeros(len(points)), np.zeros((len(points), 3)), np.zeros((len(points), 3, 3))
    evaluate(np.ascontiguousarray(points), packed, d, n, h)
    return d, n, h


def test_every_shape_of_the_formats_is_known() -> None:
    assert {shape.NAME for shape in shapes.ALL} == set(SHAPES) == set(EXAMPLES)


@pytest.mark.parametrize("shape", EXAMPLES)
def test_nothing_lies_deeper_than_half_of_the_thickness(shape: str) -> None:
    u = np.linspace(-0.06, 0.06, 41)
    around = np.array(INSIDE[shape]) + np.stack(np.meshgrid(u, u, u), axis=-1).reshape(-1, 3)
    packed = shapes.pack([Obstacle(shape, EXAMPLES[shape])])
    deepest, half = -at(shape, around)[0].min(), packed[0, THIN]
    assert np.isinf(half) if shape == "plane" else 0.9 * half < deepest <= half + 1e-12


@pytest.mark.parametrize("shape", EXAMPLES)
def test_no_point_is_nearer_than_its_hull(shape: str) -> None:
    points = np.array([0.1, 0.0, 0.2]) + np.random.default_rng(5).uniform(-0.2, 0.2, (2000, 3))
    row = shapes.pack([Obstacle(shape, EXAMPLES[shape])])[0]
    r = points - row[1:4]
    aside = np.sqrt(np.maximum((r**2).sum(axis=1) - (r @ row[HULL + 1 :]) ** 2, 0.0))
    beyond = aside - row[HULL]
    assert (beyond <= at(shape, points)[0] + 1e-12).all()
    assert np.isinf(row[HULL]) if shape == "plane" else (beyond > 0.05).mean() > 0.5


@pytest.mark.parametrize("shape", EXAMPLES)
def test_negative_inside_positive_outside(shape: str) -> None:
    d, _, _ = at(shape, np.array([INSIDE[shape], (0.3, 0.2, 0.9)]))
    assert d[0] < 0 < d[1]


@pytest.mark.parametrize("shape", EXAMPLES)
def test_the_distance_is_that_of_the_formats(shape: str) -> None:
    points = np.array([0.1, 0.0, 0.2]) + np.random.default_rng(3).uniform(-0.12, 0.12, (400, 3))
    assert at(shape, points)[0] == pytest.approx(signed_distance(Obstacle(shape, EXAMPLES[shape]), points))


@pytest.mark.parametrize("shape", EXAMPLES)
def test_gradient_and_hessian_are_those_of_the_distance(shape: str) -> None:
    rng = np.random.default_rng(7)
    points = np.array([0.1, 0.0, 0.2]) + 0.12 * rng.uniform(-1, 1, (400, 3))
    d, n, h = at(shape, points)
    step = 1e-6
    by = np.stack(
        [(at(shape, points + step * e)[0] - at(shape, points - step * e)[0]) / (2 * step) for e in np.eye(3)],
        1,
    )
    bend = np.stack(
        [(at(shape, points + step * e)[1] - at(shape, points - step * e)[1]) / (2 * step) for e in np.eye(3)],
        2,
    )
    # a stencil across an edge, where the nearest part changes, tells nothing; there are few
    smooth = np.abs(bend).max(axis=(1, 2)) < 1e3
    assert smooth.mean() > 0.95
    assert np.linalg.norm(n, axis=1) == pytest.approx(1.0, abs=1e-9)
    assert n[smooth] == pytest.approx(by[smooth], abs=1e-6)
    assert h[smooth] == pytest.approx(bend[smooth], abs=1e-4 * max(1.0, np.abs(h).max()))
    assert np.isfinite(d).all()


@pytest.mark.parametrize("names", [*((name,) for name in SHAPES), tuple(SHAPES)])
def test_clearance_is_that_of_all_samples_of_all_segments(names: tuple[str, ...]) -> None:
    """Of ropes that lie off an obstacle, and through it; of one that leads straight away from its middle."""
    obstacles = [Obstacle(name, EXAMPLES[name]) for name in names]
    middle = np.array(INSIDE[names[0]])
    steps = np.random.default_rng(2).normal(scale=0.015, size=(200, 12, 3))
    ropes = middle + np.cumsum(steps, axis=1)
    away = middle + np.linspace(0.0, 0.3, 12)[:, None] * [0.0, 0.0, 1.0]
    ropes = np.concatenate([ropes, ropes + np.array([0.0, 0.0, 0.12]), away[None], away[None, ::-1]])
    share = np.arange(SAMPLES_PER_SEGMENT + 1)[:, None] / SAMPLES_PER_SEGMENT
    samples = (ropes[:, :-1, None] + share * np.diff(ropes, axis=1)[:, :, None]).reshape(len(ropes), -1, 3)
    expected = np.min([signed_distance(one, samples) for one in obstacles], axis=(0, 2)) - 0.004
    np.testing.assert_allclose(clearance(ropes, 0.004, obstacles), expected, atol=1e-12)
