"""What may be right in the place of a model: its effects in other forms, or at other places."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.search import NEAR, Searched
from dlolib.diagnose.study import DiagnoseSettings, Study, library, placed
from dlolib.diagnose.tasks import Task, beginnings, fit_first, refit, settled, task_from, terms_of
from dlolib.diagnose.touch import touches
from dlolib.diagnose.workers import Workers

# Two fits are of one optimum where no parameter differs by more than so many of its deviations.
SAME = 2.0


def alternatives(
    study: Study, searched: Searched, model: Fitted, settings: DiagnoseSettings, run: Workers
) -> list[Fitted]:
    """A model with one of its effects in another form, and at the other optima of its own form."""
    forms = _fitted(study, list(_other_forms(study, searched, model, settings)), model, run, "other forms")
    places = _fitted(study, list(_other_places(study, searched, model)), model, run, "other places")
    return [*forms, *_apart(places, model)]


def _other_forms(
    study: Study, searched: Searched, model: Fitted, settings: DiagnoseSettings
) -> Iterator[Task]:
    """As far as the rest of it was fitted."""
    have = terms_of(model)
    for name, form in library(study, settings.without):
        rest = _without(searched, model, name)
        if name in have and rest is not None and set(form) != set(have[name]):
            yield from beginnings(study, rest, terms_of(rest), name, form, [], settings.starts)


def _other_places(study: Study, searched: Searched, model: Fitted) -> Iterator[Task]:
    """An effect that has a place in space from each place that promises something: a brief touch may leave
    two that are far apart, and no fit about one of them knows of the other."""
    for name in filter(placed, model.effects):
        rest = _without(searched, model, name)
        if rest is None:
            continue
        for touch in touches(study, rest):
            yield from beginnings(study, rest, terms_of(rest), name, terms_of(model)[name], [touch], 1)


def _without(searched: Searched, model: Fitted, name: str) -> Fitted | None:
    """The model without one of its effects, if that was fitted."""
    effects = tuple(other for other in model.effects if other != name)
    return next((one for one in (searched.baseline, *searched.models) if one.effects == effects), None)


def _fitted(study: Study, tasks: Sequence[Task], model: Fitted, run: Workers, what: str) -> list[Fitted]:
    """Those near the model, with the mesh's error at their own optimum."""
    found = [one for one in run(fit_first, tasks, what) if one is not None]
    near = [one for one in found if one.bic(study.frames) < model.bic(study.frames) + NEAR]
    again = run(refit, [task_from(one) for one in near], f"{what}, refined")
    return run(settled, [one for one in again if one is not None], f"{what}, settled")


def _apart(fits: Sequence[Fitted], model: Fitted) -> list[Fitted]:
    """One fit of each optimum but the model's own."""
    found = [model]
    for one in sorted(fits, key=lambda fit: fit.chi2):
        if not any(_one_optimum(one, other) for other in found):
            found.append(replace(one, effects=model.effects))
    return found[1:]


def _one_optimum(one: Fitted, other: Fitted) -> bool:
    """Whether a fit differs from another of the same parameters by no more than it is unsure of."""
    theirs = dict(zip(other.unknowns, other.theta, strict=True))
    apart = np.abs(one.theta - [theirs[unknown] for unknown in one.unknowns])
    return bool(np.all(apart <= SAME * np.sqrt(np.diag(one.covariance))))


__all__ = ["alternatives"]
