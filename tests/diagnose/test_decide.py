"""Which of the fitted models the recordings speak for: made-up fits that leave white noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest

from dlolib.diagnose.decide import COMPARED, contenders, decide
from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.heldout import Foretold, refuted
from dlolib.diagnose.modes import SLOWER
from dlolib.diagnose.residuals import explains, helps, slow_modes
from dlolib.diagnose.search import Searched
from dlolib.diagnose.study import DiagnoseSettings
from dlolib.diagnose.whitening import Grid, ModesOfNoise, Whitener, decay
from dlolib.identify.parameters import Unknown
from dlolib.sim.effects import EFFECTS
from dlolib.types import Noise

FRAMES, COLUMNS = 90, 28
NOISE = np.random.default_rng(5).standard_normal((FRAMES, COLUMNS, 3))
SLOW = np.cos(np.pi * (np.arange(FRAMES) + 0.5) / FRAMES)[:, None, None] * np.ones((FRAMES, COLUMNS, 3))
ALL_SEEN = ModesOfNoise(FRAMES * COLUMNS, np.eye(64).reshape(8, 8, 8, 8))
STUDY = SimpleNamespace(frames=FRAMES)


def left(effects, chi2, parameters=2):
    """A fit with these effects that leaves so much more in χ² than noise, all of it slow."""
    slow = SLOW * np.sqrt(chi2 / np.sum(SLOW**2))
    names = ["bending_stiffness", "torsional_stiffness", *(f"mass_profile.{k}" for k in range(parameters))]
    unknowns = tuple(map(Unknown, names))
    count, size = len(unknowns), NOISE.size
    return Fitted(
        effects, unknowns, np.zeros(count), size + chi2, np.eye(count), (NOISE + slow,),
        (ALL_SEEN,), size, dict.fromkeys(SLOWER, float(count)), (), 1,
    )  # fmt: skip


def decided(*models, foretold=None, scans=(), base=7000.0):
    ranked = sorted(models, key=lambda one: one.bic(FRAMES))
    searched = Searched(left((), base, 0), tuple(ranked))
    return decide(STUDY, searched, DiagnoseSettings(), foretold, scans)


def told(change, error=0.0):
    """What is left of 24 held-out frames, more than the elastic rod leaves by so much, with that standard
    error."""
    apart = np.tile([0.1, -0.1], 12) + error / np.sqrt(24) * np.tile([1.0, -1.0], 12)
    return Foretold(np.full(24, 84.0 + change / 24) + apart, np.zeros(1))


def whitener(shape, seen=None, correlation=0.0):
    """Of a grid (F, columns) of which so much was seen."""
    row, column = np.nonzero(np.ones(shape, bool) if seen is None else seen)
    grid = Grid(np.arange(shape[0]), row, column, shape[1])
    return Whitener(grid, Noise(0.001, correlation, correlation))


def rest(whitener, values_m):
    """A model that leaves these at the points."""
    model = replace(left((), 0.0, 0), unknowns=(), taken=dict.fromkeys(SLOWER, 0.0))
    return replace(model, residuals=(whitener(values_m),), noise=(whitener.noise_modes,))


@pytest.mark.parametrize("shape", [(8, 8), (2, 6), (4, 8)])
def test_a_small_recording_has_quick_modes_too(shape):
    noise = 0.001 * np.random.default_rng(3).standard_normal((shape[0] * shape[1], 3))
    assert 0.3 < slow_modes(rest(whitener(shape), noise)).energy < 3
    assert slow_modes(rest(whitener(shape), noise + 0.03)).p_value < 1e-6


def lost_at_random(rng):
    return rng.random((60, 30)) > 0.4


def hidden_from_frame_10_on(rng):
    return np.arange(60)[:, None] + 10 * np.arange(30) < 70


@pytest.mark.parametrize("lost", [lost_at_random, hidden_from_frame_10_on])
@pytest.mark.parametrize("correlation", [0.0, 1.5])
def test_noise_is_noise_however_much_was_not_seen(lost, correlation):
    """Correlated noise whose gaps are filled as fits best lies in slow modes more than in quick ones."""
    rng = np.random.default_rng(5)
    lags = [np.abs(np.subtract.outer(r, r)) for r in (np.arange(60), np.arange(30))]
    frames, places = (np.linalg.cholesky(decay(lag, max(correlation, 1e-9))) for lag in lags)
    seen = lost(rng)
    white = whitener((60, 30), seen, correlation)
    raw = 0.001 * rng.standard_normal((200, 3, 60, 30))
    noise = np.moveaxis(frames @ raw @ places.T, 1, 3)
    likely = [slow_modes(rest(white, one[seen])).p_value for one in noise]
    assert kstest(likely, "uniform").pvalue > 1e-3


@pytest.mark.parametrize(("p_value", "status"), [(1e-4, "no_mismatch"), (1e-6, "unexplained")])
def test_what_a_local_probe_sees_is_missing_though_slow_modes_do_not(p_value, status):
    assert decided(scans=[SimpleNamespace(p_value=p_value)], base=0.0).status == status


def test_the_best_model_explains_where_no_other_is_near():
    found = decided(left(("mass_profile",), 0.0), left(("lateral_load",), 60.0))
    assert (found.status, found.winner.effects) == ("explained", ("mass_profile",))


def test_what_foretells_worse_than_the_elastic_rod_explains_nothing():
    lump, load = left(("mass_profile",), 0.0), left(("lateral_load",), 5.0)
    good, bad = told(-50.0), told(50.0)
    found = decided(lump, load, foretold={(): told(0.0), lump.effects: bad, load.effects: good})
    assert (found.status, found.winner, found.refuted) == ("unexplained", lump, True)
    found = decided(lump, load, foretold={(): told(0.0), lump.effects: good, load.effects: bad})
    assert (found.status, found.winner, found.refuted) == ("explained", lump, False)


@pytest.mark.parametrize(("ahead", "status"), [(5.0, "explained"), (40.0, "ambiguous")])
def test_what_another_foretells_better_makes_up_for_what_it_fits_worse(ahead, status):
    lump, load = left(("mass_profile",), 0.0), left(("lateral_load",), 30.0)
    foretold = {(): told(0.0), lump.effects: told(-40.0), load.effects: told(-40.0 - ahead)}
    found = decided(lump, load, foretold=foretold)
    assert (found.status, found.winner) == (status, lump)


def test_worse_than_the_elastic_rod_is_worse_by_more_than_chance():
    elastic = Foretold(np.full(24, 84.0), np.zeros(1))
    each = np.tile([2.0, -1.0], 12)
    foretold = {(): elastic, ("lump",): Foretold(elastic.chi2 + each, np.zeros(1))}
    assert refuted(foretold) == set()
    assert refuted(foretold | {("load",): Foretold(elastic.chi2 + each + 1.0, np.zeros(1))}) == {("load",)}
    assert refuted({("load",): elastic}) == set()


def test_whatever_may_be_named_or_stand_for_the_wrong_one_is_compared_on_held_out_motion():
    base = left((), 7000.0, 0)
    load, length = left(("lateral_load",), 10.0), left(("length_error",), 15.0)
    others = [name for name in EFFECTS if name not in ("lateral_load", "length_error", "mass_profile")]
    # no second effect of these pairs is worth its place: many models before the best one that is
    pairs = [left(("lateral_load", name), 5.0 - 0.1 * k, 3) for k, name in enumerate(others)]
    worse = [left((name,), 900.0 + k, 3) for k, name in enumerate(others)]
    wrong = left(("mass_profile",), 950.0)
    models = sorted([load, length, *pairs, *worse, wrong], key=lambda one: one.bic(FRAMES))
    assert load not in models[:COMPARED]
    found = contenders(STUDY, Searched(base, tuple(models)), DiagnoseSettings())
    # what is far behind may foretell so much better that it ties
    asked = (base, *models[:COMPARED], load, length, worse[0], wrong)
    assert all(any(one is other for other in found) for one in asked)
    assert len(found) < 2 * COMPARED + 6


@pytest.mark.parametrize("gain, status", [(30.0, "no_mismatch"), (40.0, "explained")])
def test_what_may_be_anywhere_gains_more_than_chance_would_at_one_place(gain, status):
    """Of four parameters 30 in χ² are beyond chance where no place is sought."""
    for effect, told in (("hidden_obstacle", status), ("mass_profile", "explained")):
        assert decided(left((effect,), 0.0, 4), base=gain).status == told


def test_models_as_good_tie():
    found = decided(left(("mass_profile",), 0.0), left(("lateral_load",), 5.0))
    assert found.status == "ambiguous"
    assert [one.effects for one in found.tie] == [("mass_profile",), ("lateral_load",)]


@pytest.mark.parametrize(("change", "status"), [(-80.0, "ambiguous"), (-60.0, "explained")])
def test_what_ties_foretells_held_out_motion_as_well_but_for_chance(change, status):
    """The standard error of the difference is some 10."""
    mass, load = left(("mass_profile",), 0.0), left(("lateral_load",), 5.0)
    foretold = {(): told(0.0), mass.effects: told(-100.0), load.effects: told(change, 10.0)}
    assert decided(mass, load, foretold=foretold).status == status


@pytest.mark.parametrize(("behind", "status"), [(500.0, "ambiguous"), (900.0, "explained")])
@pytest.mark.parametrize("beside", [(), ("viscoelastic_bending",), ("internal_friction",)])
def test_an_ideal_law_ties_with_others_that_its_form_may_be_behind(behind, status, beside):
    friction = left(("internal_friction",), behind)
    # more laws than the best has are no sign of its form
    more = left(("internal_friction", "nonlinear_bending", "viscoelastic_bending"), 50.0)
    found = decided(left(("plastic_bending", *beside), 0.0), friction, more)
    assert found.status == status and more not in found.tie


def test_an_ideal_law_beside_what_is_none_stands_for_no_form():
    """Plastic bending gained 125 in BIC beside a stiffness that differs between the axes, and was doubted."""
    alone = left(("anisotropic_bending",), 130.0)
    both = left(("anisotropic_bending", "plastic_bending"), 0.0, 4)
    found = decided(alone, both)
    assert (found.status, found.winner) == ("explained", both)


@pytest.mark.parametrize(("change", "status"), [(-950.0, "ambiguous"), (-800.0, "explained")])
def test_what_a_form_is_behind_it_is_behind_on_held_out_motion_too(change, status):
    plastic, friction = left(("plastic_bending",), 0.0), left(("internal_friction",), 300.0)
    foretold = {(): told(0.0), plastic.effects: told(-1000.0), friction.effects: told(change)}
    assert decided(plastic, friction, foretold=foretold).status == status


def test_two_ideal_laws_side_by_side_may_be_one_of_another_form_that_neither_foretells():
    both, friction = (
        left(("internal_friction", "plastic_bending"), 0.0, 4),
        left(("internal_friction",), 300.0),
    )
    foretold = {(): told(0.0), both.effects: told(-1000.0), friction.effects: told(-500.0)}
    assert decided(both, friction, foretold=foretold).tie == (both, friction)


def test_a_tie_holds_no_model_with_more_than_another_of_it_has():
    plastic, friction = left(("plastic_bending",), 0.0), left(("internal_friction",), 300.0)
    more = [left(("internal_friction", name), 2.0) for name in ("mass_profile", "lateral_load", "end_twist")]
    found = decided(plastic, friction, *more)
    assert [one.effects for one in found.tie] == [("plastic_bending",), ("internal_friction",)]


@pytest.mark.parametrize(
    ("law", "gain", "status"),
    [
        # what a law's form may leave is 5 % of the 7000 that it explains
        ("internal_friction", 200.0, "ambiguous"),
        ("internal_friction", 500.0, "explained"),
        ("lateral_load", 200.0, "explained"),
    ],
)
def test_what_no_more_than_an_ideal_laws_form_may_leave_makes_room_for_is_doubtful(law, gain, status):
    alone, both = left((law,), gain), left((law, "mass_profile"), 0.0, 4)
    found = decided(alone, both)
    assert (found.status, found.winner) == (status, both)
    assert found.tie == ((both, alone) if status == "ambiguous" else ())


@pytest.mark.parametrize(
    ("law", "gain", "ahead", "status"),
    [
        # less than 1 % of the 7000 that the law explains: it may be there, or the law's form be off
        ("viscoelastic_bending", 50.0, -20.0, "ambiguous"),
        ("viscoelastic_bending", 50.0, 20.0, "ambiguous"),
        ("viscoelastic_bending", 50.0, 40.0, "explained"),
        ("viscoelastic_bending", 10.0, -20.0, "explained"),
    ],
)
def test_what_may_stand_beside_an_ideal_law_or_be_its_form_is_a_tie(law, gain, ahead, status):
    """Unless held-out motion speaks against it by more than chance: the standard error is 10 here."""
    alone, both = left((law,), gain), left((law, "end_angle"), 0.0, 4)
    other = left((law, "mass_profile"), 9.0, 4)
    foretold = {(): told(0.0), alone.effects: told(-40.0)}
    foretold |= {one.effects: told(-40.0 + ahead, 10.0) for one in (both, other)}
    found = decided(alone, both, other, foretold=foretold)
    assert (found.status, found.winner) == (status, alone)
    assert found.tie == ((alone, both) if status == "ambiguous" else ())


@pytest.mark.parametrize(
    ("gain", "ahead", "status"),
    [(15.0, -5.0, "ambiguous"), (15.0, 5.0, "explained"), (9.0, -5.0, "explained")],
)
def test_a_further_effect_that_may_be_chance_is_doubtful_where_held_out_motion_speaks_for_it(
    gain, ahead, status
):
    """One parameter more costs 4.5 in BIC; a tie is 6."""
    alone, both = left(("mass_profile",), gain), left(("lateral_load", "mass_profile"), 0.0, 3)
    foretold = {(): told(0.0), alone.effects: told(-40.0), both.effects: told(-40.0 + ahead)}
    found = decided(alone, both, foretold=foretold)
    assert (found.status, found.winner) == (status, alone)
    assert found.tie == ((alone, both) if status == "ambiguous" else ())


@pytest.mark.parametrize(
    ("effect", "rest", "status"),
    [
        ("mass_profile", 1500.0, "unexplained"),
        ("plastic_bending", 1500.0, "unexplained"),
        # 3 % of the gain: an ideal law's form may be off by so much
        ("mass_profile", 200.0, "unexplained"),
        ("plastic_bending", 200.0, "explained"),
    ],
)
def test_what_the_best_model_leaves_is_owned_up_to(effect, rest, status):
    assert decided(left((effect,), rest)).status == status


@pytest.mark.parametrize(("rest", "named"), [(1500.0, False), (800.0, True)])
def test_what_takes_up_most_of_it_is_named_all_the_same(rest, named):
    """What remains is more than a quarter of what is explained, or less."""
    assert helps(left(("mass_profile",), rest), left((), 7000.0, 0)) is named


def test_what_is_quick_is_no_noise_where_that_is_known_to_be_less():
    """Residuals three times the noise, in quick modes most of all: not explained, however white they are."""
    model = left(("mass_profile",), 500.0)
    loud = replace(model, residuals=(3 * model.residuals[0],), chi2=9 * model.chi2)
    elastic = left((), 150000.0, 0)
    assert explains(model, elastic) and not explains(loud, elastic)
