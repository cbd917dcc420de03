"""The loss (19), (20): what counts as contact, which way it draws, and its derivative."""

from dataclasses import replace

import numpy as np
import pytest

from dlolib.learn.arm import outside
from dlolib.learn.loss import path_loss
from dlolib.learn.settings import LearnSettings
from dlolib.types import Obstacle

RADIUS_M = 0.004
CYLINDER = Obstacle(
    "cylinder",
    {"center_m": (0.0, 0.0, 0.0), "axis": (0.0, 1.0, 0.0), "radius_m": (0.03,), "height_m": (0.06,)},
)
GOAL = np.array([[-0.1, 0.0, 0.0], [-0.1, 0.0, 0.1]])
FAR = np.array([0.3, 0.0, 0.0])
SETTINGS = LearnSettings()


def at(place: tuple[float, float, float], loss: str = "contact") -> tuple[float, np.ndarray, int]:
    """Loss of a rope of two particles at two steps, the last one at a place; its derivative there."""
    positions = np.array([[FAR, FAR], [FAR, place]])
    found = path_loss(positions, GOAL, [CYLINDER], RADIUS_M, LearnSettings(loss=loss))
    return found.value, found.d_positions, found.contacts


def beside(angle: float, gap_m: float) -> tuple[float, float, float]:
    """A place on the axis of a rope whose surface is so far from the cylinder's, y off the middle."""
    r = 0.03 + RADIUS_M + gap_m
    return r * np.cos(angle), 0.001, r * np.sin(angle)


def test_away_from_obstacles_it_is_the_mean_squared_error() -> None:
    value, slope, contacts = at((0.2, 0.0, 0.0))
    plain, plain_slope, _ = at((0.2, 0.0, 0.0), "mse")
    assert value == plain == pytest.approx(np.mean((np.array([FAR, (0.2, 0, 0)]) - GOAL) ** 2))
    assert np.array_equal(slope, plain_slope)
    assert contacts == 0


def test_with_the_obstacle_in_the_way_contact_draws_towards_the_goal() -> None:
    place = beside(-0.5, 0.001)
    pull = at(place)[1] - at(place, "mse")[1]
    assert pull[1, 1, 0] > 0
    assert pull[1, 1, 1:] == pytest.approx([0, 0])


def test_a_layout_that_is_turned_about_the_upright_has_the_same_loss() -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    goal = np.array([[-0.2, 0.0, 0.0], [-0.1, 0.0, 0.1]])
    positions = np.array([[FAR, FAR], [FAR, beside(-0.5, 0.001)]])
    turned = replace(CYLINDER, values={**CYLINDER.values, "axis": tuple(turn @ (0.0, 1.0, 0.0))})
    one = path_loss(positions, goal, [CYLINDER], RADIUS_M, SETTINGS)
    other = path_loss(positions @ turn.T, goal @ turn.T, [turned], RADIUS_M, SETTINGS)
    assert np.linalg.norm(one.d_positions[1, 1]) > 0
    assert other.value == pytest.approx(one.value)
    assert other.d_positions == pytest.approx(one.d_positions @ turn.T)


def test_on_the_goals_side_contact_pushes_off() -> None:
    # beyond its goal's x, seen from the cylinder, nothing is in the way any more
    near_goal = np.array([[-0.02, 0.0, 0.0], [-0.02, 0.0, 0.1]])
    place = beside(np.pi, 0.001)
    positions = np.array([[FAR, FAR], [FAR, place]])
    slopes = [
        path_loss(positions, near_goal, [CYLINDER], RADIUS_M, LearnSettings(loss=loss)).d_positions[1, 1]
        for loss in ("contact", "mse")
    ]
    push = slopes[0] - slopes[1]
    assert push[0] > 0  # minus the outward normal, which points to -x
    assert push[2] == pytest.approx(0, abs=1e-12)


def test_on_an_end_section_x_and_y_are_drawn_to_the_goal() -> None:
    place = (0.01, 0.03 + RADIUS_M + 0.001, 0.0)
    pull = at(place)[1] - at(place, "mse")[1]
    assert np.sign(pull[1, 1]).tolist() == [1.0, 1.0, 0.0]


def test_contacts_are_counted_below_the_clearance() -> None:
    assert at(beside(0.3, 0.0015))[2] == 1
    assert at(beside(0.3, 0.0025))[2] == 0


def test_derivative_of_the_loss_where_contacts_stay_the_same() -> None:
    positions = np.array([[FAR, FAR], [FAR, beside(-0.5, 0.001)]])

    def value(shift: float) -> float:
        moved = positions.copy()
        moved[1, 1, 0] += shift
        return path_loss(moved, GOAL, [CYLINDER], RADIUS_M, SETTINGS).value

    slope = path_loss(positions, GOAL, [CYLINDER], RADIUS_M, SETTINGS).d_positions[1, 1, 0]
    assert slope == pytest.approx((value(1e-6) - value(-1e-6)) / 2e-6, rel=1e-4)


def test_the_arm_is_held_outside_and_differentiated_along_the_surface() -> None:
    from autograd import jacobian

    push_out = outside([CYLINDER], 0.01)
    points = np.array([[0.02, 0.0, 0.01], [0.2, 0.0, 0.0]])
    pushed = push_out(points)
    assert np.hypot(pushed[0, 0], pushed[0, 2]) == pytest.approx(0.04)
    assert np.array_equal(pushed[1], points[1])
    found = jacobian(push_out)(points)[0, :, 0]
    h = 1e-6
    differences = [
        (push_out(points + step)[0] - push_out(points - step)[0]) / (2 * h)
        for step in (h * np.stack([axis, np.zeros(3)]) for axis in np.eye(3))
    ]
    assert found == pytest.approx(np.array(differences).T, abs=1e-5)
