"""What the committed layouts must be, so that learning them means something."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dlolib.errors import LayoutError
from dlolib.formats import nearest_distance, read_layout
from dlolib.learn.goal import check_learnable
from dlolib.types import Layout, Obstacle

LAYOUTS = sorted(Path("data/layouts").glob("layout_*"))
YIELD_CURVATURE_1_M = 8.0
GAP_HALF_M = 0.02
CLEARANCE_M = 0.002


@pytest.fixture(params=LAYOUTS, ids=lambda path: path.name)
def layout(request: pytest.FixtureRequest) -> Layout:
    return read_layout(request.param)


def middle_and_direction(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    centres = np.array([o.values["center_m"] for o in layout.obstacles])
    across = centres[1] - centres[0]
    return centres.mean(axis=0), across / np.linalg.norm(across)


def test_there_are_four() -> None:
    assert len(LAYOUTS) == 4


def test_two_cylinders_of_the_paper(layout: Layout) -> None:
    assert [o.values["radius_m"] for o in layout.obstacles] == [(0.03,), (0.03,)]
    centres = np.array([o.values["center_m"] for o in layout.obstacles])
    assert np.linalg.norm(centres[1] - centres[0]) == pytest.approx(0.1, abs=1e-5)


def test_the_goal_is_a_rope_clear_of_the_cylinders(layout: Layout) -> None:
    length = np.linalg.norm(np.diff(layout.goal_m, axis=0), axis=1).sum()
    assert length == pytest.approx(layout.rope.length_m, rel=1e-3)
    assert nearest_distance(layout.obstacles, layout.goal_m).min() - layout.rope.radius_m > 0.008


def test_a_quarter_of_the_goal_lies_in_the_gap_between_them(layout: Layout) -> None:
    # the gap: the 40 mm between the two planes that touch both cylinders' facing sides
    middle, across = middle_and_direction(layout)
    inside = np.abs((layout.goal_m - middle) @ across) <= GAP_HALF_M
    assert inside.mean() >= 0.25


def test_the_straight_way_touches_a_cylinder(layout: Layout) -> None:
    a, b = layout.grasp.position_m, layout.goal_m[-1]
    assert np.linalg.norm(b - a) >= 0.1
    way = a + np.linspace(0, 1, 200)[:, None] * (b - a)
    assert nearest_distance(layout.obstacles, way).min() < layout.rope.radius_m


def test_layout_2_bends_past_the_laboratorys_yield_curvature() -> None:
    layout = read_layout(Path("data/layouts/layout_2"))
    x, z = layout.goal_m[:, 0], layout.goal_m[:, 2]
    angle = np.unwrap(np.arctan2(np.gradient(z), np.gradient(x)))
    assert (np.abs(np.gradient(angle, layout.goal_s_m)) > YIELD_CURVATURE_1_M).mean() >= 0.3


def test_a_layout_without_a_plane_for_its_arcs_is_refused(layout: Layout) -> None:
    above = layout.goal_m[-1] + [0, 0, 0.1]
    with pytest.raises(LayoutError, match="straight above"):
        check_learnable(replace(layout, grasp=replace(layout.grasp, position_m=above)), CLEARANCE_M)


def test_a_goal_drawn_shorter_than_the_rope_is_refused(layout: Layout) -> None:
    few = [0, 30, 60, 89]  # points enough to tell how long it is
    check_learnable(replace(layout, goal_s_m=layout.goal_s_m[few], goal_m=layout.goal_m[few]), CLEARANCE_M)
    small = layout.start.position_m + 0.5 * (layout.goal_m - layout.start.position_m)
    with pytest.raises(
        LayoutError, match=r"goal\.csv: the way along the goal is 0\.222\d m, .* 0\.445 m long"
    ):
        check_learnable(replace(layout, goal_m=small), CLEARANCE_M)


def test_an_end_further_away_than_the_end_is_moved_is_refused(layout: Layout) -> None:
    start = layout.start.position_m
    for share, refused in ((0.979, False), (0.981, True)):
        far = start + np.array([share * layout.rope.length_m, 0.0, 0.0])
        taut = replace(layout, grasp=replace(layout.grasp, position_m=far), obstacles=())
        if refused:
            with pytest.raises(
                LayoutError, match="grasp.position_m: is 0.4365 m from the start, and the end"
            ):
                check_learnable(taut, CLEARANCE_M)
        else:
            check_learnable(taut, CLEARANCE_M)
    goal_m = layout.goal_m.copy()
    goal_m[-1] = start + np.array([0.99 * layout.rope.length_m, 0.0, 0.0])
    with pytest.raises(LayoutError, match="the last point of goal.csv: is 0.4405 m from the start"):
        check_learnable(replace(layout, goal_m=goal_m, obstacles=()), CLEARANCE_M)


def test_an_end_that_is_held_across_the_goal_is_said(
    layout: Layout, caplog: pytest.LogCaptureFixture
) -> None:
    """As with a quaternion (x, y, z, w), or of a frame whose first axis is the rope's."""
    check_learnable(layout, CLEARANCE_M)
    few = [0, 30, 60, 89]
    check_learnable(replace(layout, goal_s_m=layout.goal_s_m[few], goal_m=layout.goal_m[few]), CLEARANCE_M)
    assert not caplog.records
    for end in ("start", "grasp"):
        pose = getattr(layout, end)
        wrong = replace(pose, quaternion=np.roll(pose.quaternion, -1))
        check_learnable(replace(layout, **{end: wrong}), CLEARANCE_M)
        assert f"{end}.quaternion: its third axis is " in caplog.records.pop().getMessage()


def test_beside_obstacles_the_thickness_must_be_known(layout: Layout) -> None:
    thin = replace(layout, rope=replace(layout.rope, diameter_m=None))
    with pytest.raises(LayoutError, match="object.diameter_m: not known"):
        check_learnable(thin, CLEARANCE_M)
    check_learnable(replace(thin, obstacles=()), CLEARANCE_M)


@pytest.mark.parametrize("end", ["start", "grasp"])
def test_an_obstacle_nearer_to_a_held_end_than_the_clearance_is_refused(layout: Layout, end: str) -> None:
    held = layout.start if end == "start" else layout.grasp
    below = held.position_m - [0.0, 0.0, layout.rope.radius_m + 0.01 + 0.001]
    sphere = Obstacle("sphere", {"center_m": tuple(below), "radius_m": (0.01,)})
    near = replace(layout, obstacles=(*layout.obstacles, sphere))
    with pytest.raises(LayoutError, match=rf"{end}.position_m: .* 1.0 mm from obstacle 2 .sphere."):
        check_learnable(near, CLEARANCE_M)
    check_learnable(near, 0.0005)
