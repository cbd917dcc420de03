"""Stiffnesses as arrays along the rope: the rope that the effects describe, and its derivatives."""

import numpy as np
import pytest
from sim.ropes import EI, GJ, GRAVITY, ROPE, settled

from dlolib.errors import ParameterError
from dlolib.sim.effects.stiffness_profile import profile
from dlolib.sim.profile import Profile
from dlolib.sim.rod import Rod, setup
from dlolib.sim.scene import REST, STIFFNESS
from dlolib.types import Ends

PLACE = {"stiffness_profile.s": 0.2, "stiffness_profile.factor": 0.4, "stiffness_profile.width": 0.05}


def pieces(count: int) -> np.ndarray:
    """The soft spot's stiffness over that elsewhere, in the middle of so many pieces."""
    return profile((np.arange(count) + 0.5) * ROPE.length_m / count, 0.2, 0.4, 0.05)


def soft(count: int, particles: int = 30) -> Rod:
    ei, gj = (tuple((whole * pieces(count)).tolist()) for whole in (EI, GJ))
    return Rod(ROPE, EI, GJ, particles=particles, profile=Profile(bending=ei, torsional=gj))


@pytest.mark.parametrize("particles", [12, 30])
def test_a_fine_array_is_the_stiffness_profile(particles: int) -> None:
    named, given = Rod(ROPE, EI, GJ, PLACE, particles), soft(4000, particles)
    joints = [setup(rod, GRAVITY, Ends()).joints[:, STIFFNESS:REST] for rod in (named, given)]
    assert joints[1] == pytest.approx(joints[0], rel=1e-4)
    assert np.abs(settled(named).x - settled(given).x).max() < 1e-6
    assert np.abs(settled(given).x - settled(Rod(ROPE, EI, GJ, particles=particles)).x).max() > 1e-3


def test_an_array_of_the_segments_comes_near_it() -> None:
    assert np.abs(settled(Rod(ROPE, EI, GJ, PLACE)).x - settled(soft(29)).x).max() < 1e-3


def test_one_value_is_the_uniform_rope() -> None:
    plain = setup(Rod(ROPE, EI, GJ), GRAVITY, Ends())
    given = setup(Rod(ROPE, EI, GJ, profile=Profile((EI,) * 29, (GJ,) * 7)), GRAVITY, Ends())
    assert given.joints == pytest.approx(plain.joints, rel=1e-12)
    assert np.array_equal(given.segments, plain.segments)


def test_an_axial_array_is_axial_stretch() -> None:
    named = setup(Rod(ROPE, EI, GJ, {"axial_stretch.axial_stiffness": 20.0}), GRAVITY, Ends())
    given = setup(Rod(ROPE, EI, GJ, profile=Profile(axial=(20.0,) * 29)), GRAVITY, Ends())
    assert given.segments == pytest.approx(named.segments, rel=1e-12)
    sheared = setup(Rod(ROPE, EI, GJ, profile=Profile(shear=(20.0,))), GRAVITY, Ends()).segments
    assert sheared[:, 1:3] == pytest.approx(named.segments[:, [3, 3]], rel=1e-12)
    assert np.array_equal(sheared[:, 3], setup(Rod(ROPE, EI, GJ), GRAVITY, Ends()).segments[:, 3])


def test_a_changed_stiffness_scales_its_array() -> None:
    twice = soft(29).with_values({"bending_stiffness": 2 * EI})
    assert twice.profile.bending == pytest.approx(2 * EI * pieces(29))
    assert twice.profile.torsional == pytest.approx(GJ * pieces(29))
    assert twice.with_particles(15).profile == twice.profile


@pytest.mark.parametrize("bad", [(), (EI, 0.0), (EI, -EI), (np.nan,), (np.inf,)])
def test_no_stiffness_is_refused(bad: tuple[float, ...]) -> None:
    with pytest.raises(ParameterError, match="profile.bending .*; give one or more above 0"):
        Profile(bending=bad)
