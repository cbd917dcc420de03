"""Intervals know of the noise, of models that explain as much, and of laws that are never quite right."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dlolib.diagnose.decide import OFF
from dlolib.diagnose.estimates import Z95, Alternatives, estimates
from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.modes import SLOWER
from dlolib.diagnose.say import _frames
from dlolib.diagnose.whitening import ModesOfNoise
from dlolib.identify.parameters import Unknown

FRAMES = 90
NOISE = np.random.default_rng(5).standard_normal((FRAMES, 28, 3))
ALL_SEEN = ModesOfNoise(NOISE[..., 0].size, np.eye(64).reshape(8, 8, 8, 8))
ROPE = SimpleNamespace(linear_density_kg_m=0.04)
STUDY = SimpleNamespace(
    frames=FRAMES,
    seen=(SimpleNamespace(recording=SimpleNamespace(rope=ROPE)),),
    bounds=lambda unknown: (-np.inf, np.inf),
)


def model(chi2=0.0, deviation=0.01, effects=None, **values):
    """A fit that leaves so much more in χ² than noise; values by `effect__parameter`, EI first."""
    names = [name.replace("__", ".") for name in values]
    unknowns = tuple(map(Unknown, names))
    theta = np.array([u.inward(value) for u, value in zip(unknowns, values.values(), strict=True)])
    covariance = deviation**2 * np.eye(len(theta))
    if effects is None:
        effects = tuple(dict.fromkeys(name.partition(".")[0] for name in names[1:]))
    taken = dict.fromkeys(SLOWER, float(len(names)))
    return Fitted(
        effects,
        unknowns,
        theta,
        NOISE.size + chi2,
        covariance,
        (NOISE,),
        (ALL_SEEN,),
        NOISE.size,
        taken,
        (),
        1,
    )


def interval(winner, name, *others, base=None):
    base = base or model(5000.0, bending_stiffness=3e-4)
    found = estimates(STUDY, winner, None, Alternatives(base, (base, *others)))[name]
    return found.low, found.high


LUMP = model(bending_stiffness=3e-4, mass_profile__gradient=0.1)


def test_alone_an_interval_is_that_of_the_noise():
    own = estimates(STUDY, LUMP, None)["bending_stiffness"]
    # the scale of white noise is 1 but for chance
    assert np.log([own.low / 3e-4, own.high / 3e-4]) == pytest.approx([-0.01 * Z95, 0.01 * Z95], rel=0.05)
    assert interval(LUMP, "bending_stiffness") == pytest.approx((own.low, own.high), rel=1e-4)


def test_places_where_nothing_was_seen_are_no_evidence_of_a_good_fit():
    """As much χ² from half of the points is twice the noise."""
    half = replace(LUMP, coordinates=NOISE.size // 2)
    ends = [estimates(STUDY, one, None)["bending_stiffness"] for one in (LUMP, half)]
    widths = [np.log(own.high / own.low) for own in ends]
    assert widths[1] == pytest.approx(np.sqrt(2) * widths[0], rel=0.05)


def test_another_model_that_is_as_good_has_its_say():
    # BIC as good, EI a tenth higher: half of the mixture is there
    rival = model(bending_stiffness=3.3e-4, end_twist__start=0.1)
    low, high = interval(LUMP, "bending_stiffness", rival)
    # the upper fortieth of both is the upper twentieth of the higher one
    assert np.log(high / 3.3e-4) == pytest.approx(0.01 * 1.645, rel=0.1)
    assert low <= np.exp(-0.01 * Z95) * 3e-4
    worse = model(30.0, bending_stiffness=3.3e-4, end_twist__start=0.1)
    assert interval(LUMP, "bending_stiffness", worse) == pytest.approx(
        interval(LUMP, "bending_stiffness"), rel=1e-4
    )


def test_a_size_that_a_model_lacks_is_neutral_in_it():
    other_form = model(bending_stiffness=3e-4, mass_profile__mass=1e-3)
    low, high = interval(LUMP, "mass_profile.gradient", other_form)
    assert low == 0.0 and high > 0.1
    # of a stiffness it is infinite, and nothing bounds it from above
    soft = model(bending_stiffness=3e-4, axial_stretch__axial_stiffness=20.0)
    low, high = interval(soft, "axial_stretch.axial_stiffness", LUMP)
    assert low < 20.0 and high is None


def test_where_something_is_is_not_asked_of_models_without_it():
    place = model(bending_stiffness=3e-4, mass_profile__mass=1e-3, mass_profile__s=0.2)
    assert interval(place, "mass_profile.s", LUMP) == pytest.approx(interval(place, "mass_profile.s"))


def test_a_law_may_have_moved_what_its_form_may_leave():
    plastic = model(bending_stiffness=3e-4, plastic_bending__yield_curvature=8.0)
    base = model(4000.0, bending_stiffness=2e-4)
    low, high = interval(plastic, "plastic_bending.yield_curvature", base=base)
    half = 0.01 * np.sqrt(Z95**2 + OFF * 4000.0)
    assert np.log([low / 8.0, high / 8.0]) == pytest.approx([-half, half], rel=0.05)
    # what is no law of bending is as it is said
    low, high = interval(LUMP, "bending_stiffness", base=base)
    assert np.log(high / 3e-4) == pytest.approx(0.01 * Z95, rel=0.05)


def test_the_frames_of_a_place_are_those_seen_then() -> None:
    points = SimpleNamespace(frame=np.array([4, 4, 5, 6, 7]), t_s=np.array([1.0, 1.0, 2.0, 3.0, 4.0]))
    one = SimpleNamespace(recording=SimpleNamespace(points=points))
    assert _frames(one, 1.5, 3.0).tolist() == [5, 6] and not len(_frames(one, 4.5, 9.0))
