"""A model to be fitted: its effects, where its fits may begin, and the fits."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlolib.diagnose.fitting import (
    Fitted,
    Hypothesis,
    awake,
    fit,
    fitted,
    hypothesis,
    mesh_error,
    promise,
)
from dlolib.diagnose.study import Point, Study, placed, stiffens
from dlolib.errors import SimulationError
from dlolib.identify.parameters import Unknown
from dlolib.identify.problem import axes
from dlolib.sim.continuum import MOST_CORRECTIONS
from dlolib.sim.effects import parameter
from dlolib.sim.effects.base import Touch
from dlolib.types import Floats

Terms = dict[str, tuple[str, ...]]
# So many times as many starts are fitted where a place is sought in space: linear steps tell little of those.
BLIND = 2
# Evaluations of a fit before it is asked whether another start leads to one better by this in χ²; the share
# of χ² at which a first fit's steps end.
ROUGH, AHEAD, FIRST_TOLERANCE = 6, 10.0, 1e-5
# A mesh's error stands once it changes by no more than this in χ², which then is right to some 0.2.
STANDS = 0.01


@dataclass(frozen=True)
class Promise:
    """The χ² that a linear step from theta, in the fit's coordinates, would reach."""

    chi2: float
    theta: Floats


@dataclass(frozen=True)
class Task:
    """One model to be fitted: effects with their parameters, and where its fits may begin; `best` starts are
    fitted in full. promises: what was found of the starts, the best first, where that is known already.
    """

    terms: Terms
    starts: tuple[Point, ...]
    offsets_m: tuple[Floats, ...]
    best: int
    promises: tuple[Promise, ...] | None = None


def terms_of(model: Fitted) -> Terms:
    """The parameters fitted of each effect."""
    terms: Terms = {name: () for name in model.effects}
    for unknown in model.unknowns:
        name, _, part = unknown.name.partition(".")
        if unknown.recording is None and name in terms:
            terms[name] = (*terms[name], part)
    return terms


def task_from(one: Fitted) -> Task:
    """A fitted model once more, from where it is."""
    return Task(terms_of(one), (one.point,), one.offsets_m, 1)


def task_without(one: Fitted, left: str) -> Task:
    """The same from there without one of its effects."""
    terms = {name: parts for name, parts in terms_of(one).items() if name != left}
    point = {u: value for u, value in one.point.items() if u.name.partition(".")[0] != left}
    return Task(terms, (point,), one.offsets_m, 1)


def beginnings(
    study: Study,
    at: Fitted,
    have: Terms,
    name: str,
    form: tuple[str, ...],
    touches: Sequence[Touch],
    best: int,
) -> list[Task]:
    """One more effect beside those of a fitted model, from there; `best` of its starts are fitted in full.

    Where a rope is too stiff for want of the effect, linear steps from a softer one promise nothing although
    a fit from there wins: then each stiffness is a task of its own.
    """
    effect = [
        {Unknown(part): value for part, value in start.items()} for start in study.starts(name, form, touches)
    ]
    starts = [
        [{**at.point, **stiffness, **start} for start in effect]
        for stiffness in study.beginnings(at.point, name)
    ]
    groups = starts if stiffens(name) else [[start for some in starts for start in some]]
    most = best * (BLIND if placed(name) else 1)
    return [Task({**have, name: form}, tuple(some), at.offsets_m, most) for some in groups]


def coordinates(unknowns: Sequence[Unknown], start: Point) -> Floats:
    """A start in the fit's coordinates; what it does not name is neutral."""
    return np.array([u.inward(start[u] if u in start else parameter(u.name).neutral) for u in unknowns])


def promises(study: Study, task: Task) -> tuple[Promise, ...]:
    """What a linear step from each of the starts promises, the best first; those that cannot be simulated
    promise nothing."""
    return tuple(one for one, _ in _ranked(study, task))


def _ranked(study: Study, task: Task) -> list[tuple[Promise, Hypothesis]]:
    """The same with models to fit from there, each of which keeps what it simulated."""
    if task.promises is not None:
        return [(one, hypothesis(study, task.terms, task.offsets_m)) for one in task.promises]
    ranked: list[tuple[Promise, Hypothesis]] = []
    for start in task.starts:
        model, again = (hypothesis(study, task.terms, task.offsets_m) for _ in range(2))
        theta = coordinates(model.unknowns, start)
        with contextlib.suppress(SimulationError):
            ranked.append((Promise(promise(model, theta), theta), model))
            woken = awake(model, theta)
            if woken is not None:
                ranked.append((Promise(promise(again, woken), woken), again))
    return sorted(ranked, key=lambda one: one[0].chi2)


def fit_first(study: Study, task: Task) -> Fitted | None:
    """The best of the fits from the most promising starts; those soon left far behind are not finished.

    Where no fit comes to what the best start promised linear steps tell little: then up to twice as many
    starts are tried, and all fits finished.
    """
    ranked = _ranked(study, task)
    rough: list[tuple[Fitted, Hypothesis]] = []
    margin = AHEAD
    for tried, (start, model) in enumerate(ranked[: 2 * task.best]):
        if tried >= task.best:
            if _least(rough) < ranked[0][0].chi2 + AHEAD:
                break
            margin = np.inf
        with contextlib.suppress(SimulationError):
            rough.append((fit(model, start.theta, ROUGH, FIRST_TOLERANCE), model))
    ahead = [(one, model) for one, model in rough if one.chi2 < _least(rough) + margin]
    ends = [_finished(one, model) for one, model in ahead]
    return min(ends, key=lambda one: one.chi2, default=None)


def _finished(rough: Fitted, model: Hypothesis) -> Fitted:
    """A rough fit to its end; as it is where it ends on a bound, a little within which the rope has no
    equilibrium: least squares begins there."""
    try:
        return fit(model, rough.theta, tolerance=FIRST_TOLERANCE)
    except SimulationError:
        return rough


def _least(rough: Sequence[tuple[Fitted, Hypothesis]]) -> float:
    return min((one.chi2 for one, _ in rough), default=np.inf)


def refit(study: Study, task: Task) -> Fitted | None:
    """The fit once more from its own optimum, with the mesh's error as it is there."""
    model = hypothesis(study, task.terms, mesh_error(study, task.starts[0], task.offsets_m))
    try:
        return fit(model, coordinates(model.unknowns, task.starts[0]))
    except SimulationError:
        return None


def settled(study: Study, one: Fitted) -> Fitted:
    """The fit again and again with the mesh's error as it is at its own optimum, until that stands.

    A rope that all but snaps bends much otherwise on another mesh: once may leave more in χ² than an effect
    would gain.
    """
    for _ in range(MOST_CORRECTIONS):
        offsets_m = mesh_error(study, one.point, one.offsets_m)
        if _apart(study, one.offsets_m, offsets_m) < STANDS:
            break
        model = hypothesis(study, terms_of(one), offsets_m)
        try:
            one = fit(model, coordinates(model.unknowns, one.point))
        except SimulationError:
            break
    return one


def _apart(study: Study, before_m: Sequence[Floats], after_m: Sequence[Floats]) -> float:
    """What lies between two mesh errors, as χ²."""
    whitened = [
        one.whitener((after - before)[:, axes(one.model), None])
        for one, before, after in zip(study.seen, before_m, after_m, strict=True)
    ]
    return float(sum(np.sum(part**2) for part in whitened))


def as_it_was(study: Study, task: Task) -> Fitted | None:
    """The model at its start, as this study sees it."""
    model = hypothesis(study, task.terms, task.offsets_m)
    try:
        return fitted(model, coordinates(model.unknowns, task.starts[0]))
    except SimulationError:
        return None


__all__ = [
    "Promise",
    "Task",
    "Terms",
    "as_it_was",
    "beginnings",
    "coordinates",
    "fit_first",
    "promises",
    "refit",
    "settled",
    "task_from",
    "task_without",
    "terms_of",
]  # fmt: skip
