"""Kernels launched at once: what is as declared, and what is not."""

import numpy as np
import pytest

from dlolib.sim.launch import kernel
from dlolib.sim.runtime import ti, vec3
from dlolib.types import Floats


@kernel
def add_up(
    what: ti.template(),
    points: ti.types.ndarray(dtype=vec3, ndim=1),
    share: ti.f64,
    times: ti.i32,
    total: ti.types.ndarray(dtype=ti.f64, ndim=1),
):
    """The points' coordinates, so many times a share of them; their squares where `what` says so."""
    for i in range(points.shape[0]):
        for k in ti.static(range(3)):
            value = points[i][k]
            if ti.static(what == "squares"):
                value *= points[i][k]
            total[i] += times * share * value


POINTS = np.arange(12.0).reshape(4, 3)


def summed(points: Floats, share: float = 0.5, times: int = 2, what: str = "values") -> Floats:
    total = np.zeros(len(points))
    add_up(what, points, share, times, total)
    return total


def test_each_launch_takes_the_arrays_and_numbers_of_its_own() -> None:
    for points in (POINTS, POINTS + 1, POINTS[:2], POINTS[:0]):
        np.testing.assert_array_equal(summed(points), points.sum(axis=1))
    np.testing.assert_array_equal(summed(POINTS, 0.25, 1), 0.25 * POINTS.sum(axis=1))


def test_each_choice_of_its_templates_is_a_kernel_of_its_own() -> None:
    for _ in range(2):
        np.testing.assert_array_equal(summed(POINTS), POINTS.sum(axis=1))
        np.testing.assert_array_equal(summed(POINTS, what="squares"), (POINTS**2).sum(axis=1))


@pytest.mark.parametrize("points", [np.asfortranarray(POINTS), POINTS.astype(np.float32)])
@pytest.mark.parametrize("first", [True, False])
def test_an_array_that_lies_otherwise_is_read_as_it_is(points: Floats, first: bool) -> None:
    what = f"values {points.dtype} {points.flags.c_contiguous} {first}"
    for one in (points, POINTS) if first else (POINTS, points, POINTS):
        np.testing.assert_array_equal(summed(one, what=what), POINTS.sum(axis=1))


@pytest.mark.parametrize(
    "points",
    [POINTS.reshape(3, 4), POINTS[:, None], POINTS.ravel(), POINTS[::2]],
    ids=["four numbers each", "a dimension more", "one less", "not contiguous"],
)
def test_an_array_that_is_not_as_declared_is_refused(points: Floats) -> None:
    summed(POINTS)
    with pytest.raises(ValueError):
        summed(points)


def test_a_fraction_is_no_integer() -> None:
    summed(POINTS)
    with pytest.raises(TypeError):
        summed(POINTS, times=1.5)  # type: ignore[arg-type]
