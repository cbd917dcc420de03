"""Equations (13) to (18): arcs, the controller, their derivatives."""

import autograd.numpy as anp
import numpy as np
import pytest
from autograd.test_util import check_grads

from dlolib.learn.arcs import PARAMETERS, TABLE_I_BOUNDS, arc, centre, plane_normal
from dlolib.learn.policy import Policy, xavier

A, B = np.array([0.4, 0.0, 0.1]), np.array([0.27, 0.0, 0.12])
T = np.array([0.006, 0.5, 0.2, 0.01, -0.02])


def test_every_point_of_an_arc_is_equally_far_from_its_centre() -> None:
    points = arc(T, A, A, B, 30)
    radius = np.linalg.norm(points - centre(T, A, B), axis=1)
    assert radius == pytest.approx(np.full(30, radius[0]), rel=1e-12)


def test_an_arc_advances_by_phi_a_step() -> None:
    upright = np.array([0.006, 0.5, 0.0, 0.0, 0.0])
    points, middle = arc(upright, A, A, B, 30), centre(upright, A, B)
    before, after = points[10] - middle, points[11] - middle
    cosine = before @ after / np.linalg.norm(before) / np.linalg.norm(after)
    assert np.arccos(cosine) == pytest.approx(0.006, rel=1e-6)


def test_without_tilt_the_arc_stays_in_the_vertical_plane() -> None:
    assert np.abs(plane_normal(anp.array(0.0), A, B)) == pytest.approx([0, 1, 0], abs=1e-12)


def test_no_rotation_stays() -> None:
    still = np.array([0.0, 0.3, 0.1, 0.01, 0.02])
    assert arc(still, A, A, B, 5) == pytest.approx(np.tile(A, (5, 1)), abs=1e-12)


def test_derivatives_of_the_controlled_arc() -> None:
    goal = np.random.default_rng(0).normal(size=(6, 3)) * 0.1
    weights = xavier(18 + PARAMETERS, (7, 5), 1)
    policy = Policy(weights, np.array(TABLE_I_BOUNDS), goal, 0.445)

    def end(positions: np.ndarray) -> np.ndarray:
        parameters = policy.parameters(weights, positions, np.zeros(PARAMETERS))
        return arc(parameters, A, A, B, 4)

    check_grads(end, modes=["rev"], order=1)(goal + 0.05)


def test_the_controller_stays_within_its_bounds() -> None:
    weights = [(100 * w, b) for w, b in xavier(18 + PARAMETERS, (7, 5), 1)]
    policy = Policy(weights, np.array(TABLE_I_BOUNDS), np.zeros((6, 3)), 0.445)
    found = policy.parameters(weights, np.ones((6, 3)), np.zeros(PARAMETERS))
    assert (np.abs(found) <= np.array(TABLE_I_BOUNDS) + 1e-15).all()


def test_initial_weights_come_from_their_seed() -> None:
    first, again, other = (xavier(23, (7, 5), seed) for seed in (1, 1, 2))
    assert np.array_equal(first[0][0], again[0][0])
    assert not np.array_equal(first[0][0], other[0][0])


def test_initial_weights_are_xaviers() -> None:
    """Uniform within ±sqrt(6 / (in + out)), biases 0: Glorot and Bengio (2010), equation (16)."""
    weights = xavier(200, (120, 80), 3)
    assert [weight.shape for weight, _ in weights] == [(200, 120), (120, 80), (80, PARAMETERS)]
    for weight, bias in weights:
        limit = np.sqrt(6.0 / sum(weight.shape))
        assert 0.97 * limit < np.abs(weight).max() <= limit
        assert weight.std() == pytest.approx(limit / np.sqrt(3), rel=0.05)
        assert not bias.any()


@pytest.mark.parametrize("first_arc", [-0.75, 0.75])
def test_the_first_arc_turns_at_that_share_of_its_bound_about_a_centre_between(first_arc: float) -> None:
    weights = [(0 * weight, bias) for weight, bias in xavier(18 + PARAMETERS, (7, 5), 1, first_arc)]
    policy = Policy(weights, np.array(TABLE_I_BOUNDS), np.zeros((6, 3)), 0.445)
    found = policy.parameters(weights, np.ones((6, 3)), np.zeros(PARAMETERS))
    assert found == pytest.approx([first_arc * TABLE_I_BOUNDS[0], 0.5, 0.0, 0.0, 0.0])
