"""Contact pushes out of the obstacle, and friction stays in its cone."""

import numpy as np
import pytest

from dlolib.errors import ParameterError
from dlolib.proof.contact import Contact
from dlolib.types import Obstacle

BAR = Obstacle(
    "cylinder",
    {"center_m": (0.1, 0.0, 0.0), "axis": (0.0, 1.0, 0.0), "radius_m": (0.03,), "height_m": (1.0,)},
)
LYING = np.array([[x, 0.0, 0.0339] for x in np.linspace(0.095, 0.105, 5)])


def test_it_pushes_away_from_the_axis() -> None:
    touch = Contact(BAR, 0.004, 0.0, 4).touch(LYING)
    assert touch.force[:, 2].min() > 0
    assert np.abs(touch.force[:, 1]).max() == 0


@pytest.mark.parametrize("load_n_m", [0.4, 24.0])
def test_a_rope_lies_on_the_bar(load_n_m: float) -> None:
    """By its weight or pulled taut: within 0.04 mm of touching, where a tracker is 1.5 mm off."""
    contact = Contact(BAR, 0.004, 0.0, 1)

    def push(depth_m: float) -> float:
        lying = np.array([[x, 0.0, 0.034 - depth_m] for x in (0.0975, 0.1025)])
        # the touched points stand 1.25 mm beside the bar's top
        touched = contact.touch(lying - np.array([0.0, 0.0, 0.00125**2 / (2 * 0.034)]))
        return float(touched.force[:, 2].sum()) / 0.005

    assert push(-4e-5) < load_n_m < push(4e-5)


@pytest.mark.parametrize("slip_m", [1e-6, 1e-4, 1e-2])
def test_friction_stays_in_the_cone(slip_m: float) -> None:
    contact = Contact(BAR, 0.004, 0.3, 4)
    contact.keep(LYING)
    touch = contact.touch(LYING + np.array([0.0, slip_m, 0.0]))
    push = np.linalg.norm(touch.force[:, [0, 2]], axis=1)
    held = -touch.force[:, 1]
    assert (held > 0).all()
    assert (held <= 0.3 * push * (1 + 1e-9)).all()
    if slip_m == 1e-2:
        np.testing.assert_allclose(held, 0.3 * push, rtol=1e-6)


def test_slopes_are_differences() -> None:
    contact = Contact(BAR, 0.004, 0.3, 4)
    contact.keep(LYING)
    moved = LYING + np.array([0.0, 2e-5, 0.0])
    touch, step = contact.touch(moved), 1e-8
    for axis, side in enumerate(np.eye(3) * step):
        change = contact.touch(moved + side).force - contact.touch(moved - side).force
        np.testing.assert_allclose(touch.slope[..., axis], change / (2 * step), atol=1.0)
    assert np.abs(touch.slope).max() > 50


def test_other_obstacles_are_refused() -> None:
    with pytest.raises(ParameterError, match="box"):
        Contact(Obstacle("box", {"center_m": (0.0, 0.0, 0.0)}), 0.004, 0.0, 4)
