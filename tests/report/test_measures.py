"""What the report computes itself, on shapes whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from dlolib.obstacles import SHAPES
from dlolib.report.drawing import OUTLINES, ribbon, silhouette, widest
from dlolib.report.headline import clear
from dlolib.report.measures import by_arc_length, chain_error, nearest_on_axis, normal_residual
from dlolib.report.paper import stiffness_n_m2
from dlolib.report.pictures import project, shown, toward_camera
from dlolib.types import Camera, Obstacle

LINE = np.column_stack([np.linspace(0, 1, 11), np.zeros(11), np.zeros(11)])


def test_distance_is_to_the_axis_and_not_to_its_points() -> None:
    points = np.array([[0.33, 0.002, 0.0], [0.05, 0.0, -0.003], [1.2, 0.0, 0.0]])
    offset, arc = nearest_on_axis(points, LINE, LINE[:, 0])
    assert np.linalg.norm(offset, axis=1) == pytest.approx([0.002, 0.003, 0.2])
    assert arc == pytest.approx([0.33, 0.05, 1.0])


def frames(offset_m: float, times: list[float]) -> pd.DataFrame:
    rows = [{"frame": i, "t_s": t, "s_m": x, "x_m": x, "y_m": offset_m, "z_m": 0.0}
            for i, t in enumerate(times) for x in (0.1, 0.5, 0.9)]  # fmt: skip
    return pd.DataFrame(rows)


def test_chain_is_compared_with_the_axis_of_its_own_time() -> None:
    axes = np.array([LINE, LINE + np.array([0.0, 0.01, 0.0])])
    error = chain_error(frames(0.01, [0.0, 1.0]), np.array([0.0, 1.0]), axes, LINE[:, 0])
    assert error is not None
    assert error.distance_m == pytest.approx([0.01] * 3 + [0.0] * 3)
    assert error.rms_m == pytest.approx(0.01 / 2**0.5)


def test_no_frame_with_a_truth_gives_no_error() -> None:
    assert chain_error(frames(0.01, [0.3]), np.array([0.0, 1.0]), np.array([LINE, LINE]), LINE[:, 0]) is None


def test_residual_across_is_positive_to_the_left() -> None:
    shape = pd.DataFrame(
        {"s_m": LINE[:, 0], "x_m": LINE[:, 0], "z_m": 0.004, "sim_x_m": LINE[:, 0], ("sim_z_m"): 0.0}
    )
    _, across = normal_residual(shape, "x-z")
    assert across == pytest.approx(np.full(11, 0.004))


@pytest.mark.parametrize(("axes", "view"), [([0, 2], "x-z"), ([0, 1], "x-y"), ([1, 2], "y-z"), ([0], "x-z")])
def test_a_rope_is_looked_at_where_it_extends_most(axes: list[int], view: str) -> None:
    places = np.full((11, 3), 0.3)
    places[:, axes] += np.linspace(0, 1, 11)[:, None]
    places[4] = np.nan
    assert widest(places) == view


def test_bins_of_arc_length() -> None:
    s_m = np.array([0.0, 0.1, 0.9, 1.0])
    centres, means, rms = by_arc_length(s_m, np.array([1.0, 3.0, -2.0, 2.0]), bins=2)
    assert centres == pytest.approx([0.25, 0.75])
    assert means == pytest.approx([2.0, 0.0])
    assert rms == pytest.approx([5**0.5, 2.0])


def test_papers_stiffness_in_newton_metres() -> None:
    # facts measured by hand: 0.0089 is 2.6e-4 N m² at 40 g/m.
    assert stiffness_n_m2(0.0089) == pytest.approx(2.6e-4, rel=0.02)


def test_projection_and_line_of_sight() -> None:
    camera = Camera(np.array([[1.0, 0, 0, 0], [0, 0, 1.0, -0.7], [0, -1.0, 0, 0], [0, 0, 0, 1.0]]),
                    640, 576, 504.0, 504.0, 319.5, 287.5, 1000.0)  # fmt: skip
    point = np.array([[0.07, 0.0, 0.14]])
    assert project(point, camera)[0] == pytest.approx([319.5 + 50.4, 287.5 - 100.8])
    assert toward_camera(np.array([[0.0, -0.004, 0.0]]), np.zeros((1, 3)), camera) == pytest.approx([0.004])


def test_ribbon_has_the_ropes_thickness() -> None:
    outline = ribbon(LINE[:, [0, 1]], 0.004)
    assert outline[:, 1].max() - outline[:, 1].min() == pytest.approx(0.008)


def test_silhouettes() -> None:
    cylinder = Obstacle("cylinder", {"center_m": (0.1, 0.0, -0.2), "axis": (0.0, 1.0, 0.0), (
        "radius_m"
    ): (0.03,),
                                     "height_m": (0.06,)})  # fmt: skip
    front, top = silhouette(cylinder, "x-z"), silhouette(cylinder, "x-y")
    assert front is not None and top is not None
    assert np.ptp(front, axis=0) == pytest.approx([0.06, 0.06], rel=2e-3)
    assert np.ptp(top, axis=0) == pytest.approx([0.06, 0.06], rel=2e-3)
    assert front.mean(axis=0) == pytest.approx([0.1, -0.2], abs=2e-3)
    box = Obstacle(
        "box", {"center_m": (0.0, 0.0, 0.0), "quaternion": (1.0, 0.0, 0.0, 0.0), ("size_m"): (0.1, 0.2, 0.3)}
    )
    seen = silhouette(box, "x-z")
    assert seen is not None and np.ptp(seen, axis=0) == pytest.approx([0.1, 0.3])
    sphere = silhouette(Obstacle("sphere", {"center_m": (0.0, 0.0, 1.0), "radius_m": (0.05,)}), "x-z")
    assert sphere is not None and sphere[:, 1].max() == pytest.approx(1.05)
    capsule = silhouette(replace(cylinder, shape="capsule"), "x-y")
    assert capsule is not None and np.ptp(capsule, axis=0) == pytest.approx([0.06, 0.12], rel=2e-3)
    assert set(OUTLINES) == set(SHAPES) - {"plane"}
    assert silhouette(Obstacle("plane", {"point_m": (0, 0, 0), "normal": (0, 1, 0)}), "x-z") is None


def test_large_images_are_shrunk_and_small_ones_kept() -> None:
    image = np.arange(40 * 80 * 3, dtype=np.uint8).reshape(40, 80, 3)
    assert np.array_equal(shown(image, (10, 20, 5, 25), 360), image[10:20, 5:25])
    assert shown(image, (0, 40, 0, 80), 20).shape == (10, 20, 3)


def test_what_learning_calls_free_of_contact_is_clear() -> None:
    assert clear({"min_clearance_m": 0.002, "free_of_contact": True})
    assert not clear({"min_clearance_m": 0.0001, "contacts": 57, "free_of_contact": False})
