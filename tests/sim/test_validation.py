"""The rod against theory: the cases of docs/validation.md, to what each reached there and a little more."""

import numpy as np
import pytest

from stages import cases


@pytest.mark.parametrize("case", [cases.elastica, cases.catenary, cases.cantilever])
def test_shapes_come_closer_with_the_square_of_the_segments(case) -> None:
    found = case((15, 30, 60))
    assert found.order == pytest.approx([2.0, 2.0], abs=0.15)
    assert found.error[1] < 0.0025


def test_a_rope_of_thirty_particles_is_a_quarter_percent_from_the_elastica() -> None:
    assert cases.elastica((30,)).error[0] < 0.0025


def test_a_twisted_ring_leaves_its_plane_where_michell_says() -> None:
    ring = cases.michell(60)
    assert np.all(np.diff(ring.growth) > 0)
    assert ring.found == pytest.approx(ring.theory, rel=0.01)


@pytest.mark.parametrize("particles", [30, 60])
def test_a_standing_rope_falls_where_greenhill_says(particles: int) -> None:
    rope = cases.standing(particles)
    stands = rope.weight <= rope.theory
    assert rope.aside[stands].max() < 1e-6
    assert rope.aside[~stands] == pytest.approx(rope.exact[~stands], rel=0.035 * 30 / particles)
    assert rope.found == pytest.approx(rope.theory, rel=1e-3)


@pytest.mark.parametrize("coefficient", [0.1, 0.3, 0.6])
def test_tensions_round_a_rough_cylinder_are_eytelweins(coefficient: float) -> None:
    rope = cases.capstan(coefficient)
    assert rope.ratio == pytest.approx(rope.theory, rel=0.02)


def test_a_plastic_rope_springs_back_to_what_hardening_leaves() -> None:
    rope = cases.plastic()
    assert rope.moment == pytest.approx(rope.theory, rel=1e-3)
    assert rope.left == pytest.approx(rope.left_theory, rel=1e-3)


def test_a_held_bend_relaxes_exponentially_and_a_loaded_one_creeps() -> None:
    assert cases.relaxation().error < 1e-7
    assert cases.creep().error < 1e-3


def test_a_cantilever_swings_at_its_frequency_and_decays_no_more_than_the_scheme_has_it() -> None:
    beam = cases.oscillation()
    assert beam.continuous == pytest.approx(beam.theory, rel=1e-3)
    assert beam.rate == pytest.approx(beam.own_rate, rel=5e-3)
    assert beam.rate[0] < 1e-3 * beam.theory
