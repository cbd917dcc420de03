"""The search's own choices, on fits that are made up."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dlolib.diagnose import search, tasks
from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.search import _refined, _settled
from dlolib.diagnose.study import DiagnoseSettings, Study
from dlolib.diagnose.tasks import Promise, Task, Terms
from dlolib.diagnose.workers import Workers
from dlolib.errors import SimulationError
from dlolib.identify.parameters import Unknown

STUDY = cast(Study, SimpleNamespace(frames=70))


def fitted(chi2: float, effects: tuple[str, ...] = (), parts: Sequence[str] = ()) -> Fitted:
    names = ["bending_stiffness", *(f"{effects[-1]}.{part}" for part in parts)]
    unknowns = tuple(map(Unknown, names))
    theta = np.ones(len(names))
    return Fitted(effects, unknowns, theta, chi2, np.eye(len(names)), (), (), 0, {}, (), 1)


LUMP, SLOPED = ("s", "mass"), ("s", "mass", "gradient")


@pytest.mark.parametrize(("again", "left"), [(8100.0, 8100.0), (8395.0, 8400.0), (8500.0, 8400.0)])
def test_the_elastic_rod_goes_where_an_effect_that_does_nothing_led(
    again: float, left: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only if it is better off there by more than another start is worth."""
    singles = [fitted(8099.0, ("end_angle",), ("start_1",)), fitted(8390.0, ("mass_profile",), LUMP)]

    def run(function: Callable[[Study, Task], Any], jobs: Sequence[Task], what: str) -> list[Fitted | None]:
        assert all(job.terms == {} and job.starts[0] == {Unknown("bending_stiffness"): np.e} for job in jobs)
        return [fitted(again), None]

    monkeypatch.setattr(search, "settled", lambda study, one: one)
    elastic = search._nothing_else(STUDY, fitted(8400.0), singles, cast(Workers, run))
    assert elastic.chi2 == left


def test_which_form_is_best_shows_with_the_mesh_error_of_each() -> None:
    """The larger form is ahead until the mesh's error is that at each one's own optimum."""
    baseline = fitted(8400.0)
    found = [fitted(8182.6, ("mass_profile",), LUMP), fitted(8165.2, ("mass_profile",), SLOPED)]
    found.append(fitted(8390.0, ("end_angle",), ("start_1",)))
    after = {LUMP: 8163.6, SLOPED: 8160.0}

    def run(function: Callable[[Study, Task], Any], jobs: Sequence[Task], what: str) -> list[Fitted | None]:
        chosen = [job.terms["mass_profile"] for job in jobs]
        return [fitted(after[parts], ("mass_profile",), parts) for parts in chosen]

    best = _refined(STUDY, found, baseline, cast(Workers, run), "effects")
    assert [one.effects for one in best] == [("mass_profile",), ("end_angle",)]
    assert [u.name for u in best[0].unknowns[1:]] == ["mass_profile.s", "mass_profile.mass"]
    assert best[0].chi2 == after[LUMP]


def test_the_winner_is_one_whose_mesh_error_stands() -> None:
    """A pair is ahead of its first effect only as long as the mesh's error of that does not stand."""
    baseline = fitted(10770.1)
    alone = fitted(8110.2, ("anisotropic_bending",), ("stiffness_ratio",))
    pair = fitted(8090.7, ("anisotropic_bending", "rest_curvature"), ("kappa_1", "kappa_2"))
    far = fitted(10000.0, ("mass_profile",), LUMP)
    stand = {id(alone): 8091.7, id(pair): 8090.2}

    def run(function: Callable[[Study, Fitted], Any], jobs: Sequence[Fitted], what: str) -> list[Fitted]:
        return [replace(job, chi2=stand[id(job)]) for job in jobs]

    best = _settled(STUDY, [pair, alone, far], baseline, cast(Workers, run))
    assert [one.effects for one in best] == [alone.effects, pair.effects, far.effects]


def test_who_comes_near_when_the_winner_settles_is_settled_too() -> None:
    baseline, winner = fitted(9000.0), fitted(8100.0, ("end_angle",), ("start_1",))
    second = fitted(8165.0, ("mass_profile",), LUMP)
    stand = {id(winner): 8180.0, id(second): 8190.0}

    def run(function: Callable[[Study, Fitted], Any], jobs: Sequence[Fitted], what: str) -> list[Fitted]:
        return [replace(job, chi2=stand[id(job)]) for job in jobs]

    best = _settled(STUDY, [winner, second], baseline, cast(Workers, run))
    assert [(one.effects, one.chi2) for one in best] == [(winner.effects, 8180.0), (second.effects, 8190.0)]


def test_of_two_forms_of_a_pair_the_one_of_less_bic_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    key = ("end_twist", "mass_profile")
    small, large = fitted(8000.0, key, ("gradient",)), fitted(7999.0, key, SLOPED)
    models = {
        ("end_twist",): fitted(8200.0, ("end_twist",), ("start",)),
        ("mass_profile",): fitted(8201.0, ("mass_profile",), ("gradient",)),
    }
    found = {("end_twist",): small, ("mass_profile",): large}
    monkeypatch.setattr(search, "_partners", lambda study, fewer, *_: [found[fewer.effects]])
    monkeypatch.setattr(search, "backed", lambda *_: None)
    monkeypatch.setattr(search, "_done", lambda *_: False)
    study = cast(Study, SimpleNamespace(frames=70, rigid=lambda point: False))
    search._grown(study, models, fitted(9000.0), 2, DiagnoseSettings(), cast(Workers, None), {})
    assert models[key].chi2 == small.chi2


def test_more_is_sought_again_beside_what_had_been_left_in_a_worse_optimum(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A hidden obstacle was left 37 mm off its place, out of which inertia led that does nothing; with the
    soft spot beside it, sought from there alone, nothing was explained."""
    touch, pair = ("touch",), ("soft", "touch")
    models = {touch: fitted(11327.0, touch), ("inertia",): fitted(51070.0, ("inertia",))}

    def partners(study: Study, fewer: Fitted, *_: object) -> list[Fitted]:
        led = {11327.0: fitted(11330.0, pair), 51070.0: fitted(8218.0, ("inertia", "touch"))}
        return [led.get(fewer.chi2, fitted(8018.0, pair))]

    def backed(study: Study, models: search.Models, size: int, run: Workers) -> None:
        if ("inertia", "touch") in models:
            models[touch] = fitted(8142.0, touch)

    monkeypatch.setattr(search, "_partners", partners)
    monkeypatch.setattr(search, "_parts", lambda *_: [])
    monkeypatch.setattr(search, "backed", backed)
    monkeypatch.setattr(search, "_done", lambda *_: False)
    study = cast(Study, SimpleNamespace(frames=70, rigid=lambda point: False))
    search._grown(study, models, fitted(67373.0), 2, DiagnoseSettings(), cast(Workers, None), {})
    best = search._best(study, models)
    assert (best.effects, best.chi2) == (pair, 8018.0)


@pytest.mark.parametrize(("parts", "best"), [(9, ("lateral_load", "touch")), (8, ("curl", "touch"))])
def test_what_explains_by_many_parameters_is_not_the_last_that_is_tried(
    parts: int, best: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An uneven curvature at rest passed for a load beside a hidden obstacle, of which it left no trace."""
    models = {(name,): fitted(chi2, (name,)) for name, chi2 in (("curl", 8277.0), ("lateral_load", 8524.0))}
    many = fitted(7900.0, ("curl", "touch"), [str(k) for k in range(parts)])
    found = {("curl",): many, ("lateral_load",): fitted(7800.0, ("lateral_load", "touch"))}
    monkeypatch.setattr(search, "_partners", lambda study, fewer, *_: [found[fewer.effects]])
    monkeypatch.setattr(search, "_parts", lambda *_: [])
    monkeypatch.setattr(search, "backed", lambda *_: None)
    monkeypatch.setattr(search, "_done", lambda *_: True)
    study = cast(Study, SimpleNamespace(frames=70, rigid=lambda point: False))
    search._grown(study, models, fitted(13237.0), 2, DiagnoseSettings(), cast(Workers, None), {})
    assert search._best(study, models).effects == best


def test_a_pair_that_ties_in_its_best_form_leads_further(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a soft place near the clamp passed for is found beside the clamp's compliance alone, and that only
    once its pair with a lump needs no gradient any more."""
    soft, lump, clamp = (f"{name}_profile" for name in ("stiffness", "mass", "clamp"))
    singles = [fitted(7950.0, (soft,)), fitted(7955.0, (lump,)), fitted(7952.0, (clamp,))]
    beside = {
        soft: [fitted(7930.0, (lump, soft))],
        lump: [fitted(7930.0, (lump, soft)), fitted(7940.0, (lump, clamp), ("a", "b"))],
        clamp: [fitted(7900.0, (clamp, soft))],
    }

    def pruned(study: Study, models: search.Models, run: Workers) -> None:
        models[clamp, lump] = fitted(7934.0, (clamp, lump))

    monkeypatch.setattr(search, "baseline", lambda study: fitted(9000.0))
    monkeypatch.setattr(search, "_singles", lambda *_: singles)
    monkeypatch.setattr(search, "_partners", lambda study, fewer, *_: beside[fewer.effects[0]])
    monkeypatch.setattr(search, "_pruned", pruned)
    monkeypatch.setattr(search, "_settled", lambda study, models, *_: search._ordered(study, models))
    monkeypatch.setattr(search, "_nothing_else", lambda study, elastic, *_: elastic)
    for name, found in (("backed", None), ("amiss", True), ("explains", True)):
        monkeypatch.setattr(search, name, lambda *_, found=found: found)
    study = cast(Study, SimpleNamespace(frames=70, poses=100, rigid=lambda _: False))
    best = search.search(study, DiagnoseSettings(), cast(Workers, None)).models[0]
    assert best.effects == (clamp, soft)


def test_what_no_linear_step_foretells_is_fitted_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction that holds the rope fast has no derivative: beside inertia it was passed over."""
    found = [("contact_friction", ("coefficient",)), ("plastic_bending", ("yield_curvature",))]
    found += [("lateral_load", ("x", "y", "z")), ("end_twist", ("end",))]

    def beginning(
        study: Study, at: Fitted, have: Terms, name: str, form: tuple[str, ...], *_: Any
    ) -> list[Task]:
        return [Task({**have, name: form}, (), (), 1)]

    def run(function: Callable[[Study, Task], Any], jobs: Sequence[Task], what: str) -> list[Any]:
        if what.startswith("fits"):
            return [fitted(7000.0, tuple(job.terms), list(job.terms.values())[-1]) for job in jobs]
        return [(Promise(7000.0 if "end_twist" in job.terms else 9999.0, np.zeros(1)),) for job in jobs]

    monkeypatch.setattr(search, "library", lambda *_: found)
    monkeypatch.setattr(search, "touches", lambda *_: [])
    monkeypatch.setattr(search, "beginnings", beginning)
    monkeypatch.setattr(search, "_refined", lambda study, fits, *_: fits)
    inert = fitted(8000.0, ("inertia_drag",), ("drag",))
    best = search._partners(STUDY, inert, DiagnoseSettings(), cast(Workers, run))
    assert {one.effects[-1] for one in best} == {"contact_friction", "plastic_bending", "end_twist"}


def test_a_fit_that_cannot_go_on_from_where_it_was_left_stays_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a bound least squares begins a little within, where the rope may have no equilibrium."""
    left = fitted(40.0, ("inertia_drag",))

    def fit(model: object, theta: object, iterations: int = 30, tolerance: float = 0.0) -> Fitted:
        if iterations == tasks.ROUGH or model == "solved":
            return left if model == "unsolved" else replace(left, chi2=45.0)
        raise SimulationError("no equilibrium")

    starts = [(Promise(10.0, np.zeros(1)), "unsolved"), (Promise(20.0, np.zeros(1)), "solved")]
    monkeypatch.setattr(tasks, "fit", fit)
    monkeypatch.setattr(tasks, "_ranked", lambda *_: starts)
    assert tasks.fit_first(cast(Study, None), Task({}, (), (), 2)) is left
