"""Fits of every effect of the library, alone and in pairs: forward, then backward."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlolib.diagnose.fitting import Fitted, hypothesis
from dlolib.diagnose.residuals import amiss, explains
from dlolib.diagnose.study import (
    DiagnoseSettings,
    Point,
    Study,
    abrupt,
    forms_of,
    library,
    placed,
    stiffens,
)
from dlolib.diagnose.tasks import (
    AHEAD,
    Task,
    Terms,
    as_it_was,
    beginnings,
    coordinates,
    fit_first,
    promises,
    refit,
    settled,
    task_from,
    task_without,
    terms_of,
)
from dlolib.diagnose.touch import touches
from dlolib.diagnose.workers import Workers
from dlolib.errors import SimulationError
from dlolib.identify.identify import FIRST_STIFFNESS_M4_S2
from dlolib.identify.intervals import FEWEST_POSES
from dlolib.identify.parameters import Unknown
from dlolib.sim.effects import LAWS
from dlolib.sim.effects.base import sizes
from dlolib.sim.rod import STIFFNESSES
from dlolib.sim.upright import ROLLS
from dlolib.types import Floats

Effects = tuple[str, ...]
Models = dict[Effects, Fitted]
# The BIC from which more was sought beside a model.
Tried = dict[Effects, float]
# One more effect is fitted in full where a linear step from the fit without it promises this much in BIC.
PROMISING = 0.0
# Models whose BIC is further from the best than this, or than this share of its gain, are fitted well enough.
NEAR, NEAR_SHARE = 60.0, 0.3
# Models this near to the best are tried with fewer parameters, too.
NEAR_PRUNED = 30.0
# How often effects are looked for beside the best ones, and from how many models on.
ROUNDS, BEGINNINGS = 4, 3
# More parameters than these of two effects may stand for what a simpler pair explains better.
MANY = 8


@dataclass(frozen=True)
class Searched:
    """The rod with nothing missing, and every other model fitted, by BIC."""

    baseline: Fitted
    models: tuple[Fitted, ...]


def search(study: Study, settings: DiagnoseSettings, run: Workers, known: Sequence[Fitted] = ()) -> Searched:
    """Fit the baseline, every effect alone, and the pairs that promise something, or all of them; and what is
    known to fit well, with its parts.

    A second effect is sought where the elastic rod may leave more than noise, further ones only where the
    best model does not explain what is seen.
    """
    elastic = baseline(study)
    singles = _singles(study, elastic, settings, run)
    elastic = _nothing_else(study, elastic, singles, run)
    models = {one.effects: one for one in singles}
    if known:
        for one in run(refit, [task_from(one) for one in known], "known models"):
            if one is not None:
                _keep(study, models, one)
        backed(study, models, 2, run)
    tried: Tried = {}
    # one pose cannot tell two effects apart
    together = models and study.poses >= FEWEST_POSES
    for size in range(2, settings.most_effects + 1 if together else 0):
        best = _best(study, models)
        if size == 2 and settings.full:
            _beside(
                study, models, [one.effects for one in _ordered(study, models.values())], tried, settings, run
            )
        elif size == 2 and not (amiss(elastic) or best.by_chance(elastic) < settings.chance):
            break
        if size > 2 and (len(best.effects) < size - 1 or _done(study, best, elastic)):
            break
        _grown(study, models, elastic, size, settings, run, tried)
    _pruned(study, models, run)
    # in their best forms other pairs may tie, and lead further
    if _beside(study, models, _parts(study, models, 2, settings.tie), tried, settings, run):
        backed(study, models, 2, run)
        _pruned(study, models, run)
    return Searched(elastic, _settled(study, list(models.values()), elastic, run))


def searched_again(study: Study, before: Searched, run: Workers) -> Searched:
    """The same models after the noise has become known better: the best fitted once more, the others as they
    were."""
    elastic = once_more(before.baseline, study)
    near = {one.effects for one in _near(study, before.models, before.baseline)}
    as_they_were = run(as_it_was, [task_from(one) for one in before.models], "as they were")
    kept = [one for one in as_they_were if one is not None]
    best = [one for one in kept if one.effects in near]
    again = run(refit, [task_from(one) for one in best], "once more")
    better = {one.effects: new for one, new in zip(best, again, strict=True) if new is not None}
    models = [better.get(one.effects, one) for one in kept]
    return Searched(elastic, _settled(study, models, elastic, run))


def once_more(one: Fitted, study: Study) -> Fitted:
    """A model fitted to another study of the same recordings, from where it is."""
    again = refit(study, task_from(one)) or as_it_was(study, task_from(one))
    return settled(study, again or one)


def _settled(study: Study, fits: Sequence[Fitted], baseline: Fitted, run: Workers) -> tuple[Fitted, ...]:
    """All models by BIC, those that gain and are near the best with a mesh's error that stands.

    Another may be the best then, and others near it.
    """
    models, stand = list(fits), set()
    while near := [one for one in _near(study, models, baseline, 0.0) if id(one) not in stand]:
        again = dict(zip(map(id, near), run(settled, near, "settled"), strict=True))
        models = [again.get(id(one), one) for one in models]
        stand |= set(map(id, again.values()))
    return _ordered(study, models)


def _ordered(study: Study, models: Iterable[Fitted]) -> tuple[Fitted, ...]:
    return tuple(sorted(models, key=lambda one: one.bic(study.frames)))


def simulated_once(study: Study) -> None:
    """Simulate the elastic rod and one with a law: a process makes its kernels then, which takes seconds."""
    law = LAWS[0]
    for terms in ({}, {law.NAME: sizes(law)}):
        model = hypothesis(study, terms, _no_offsets(study))
        with contextlib.suppress(SimulationError):
            model.at(coordinates(model.unknowns, _stiffness(study, FIRST_STIFFNESS_M4_S2[-1])))


def baseline(study: Study) -> Fitted:
    """The rod with nothing missing: EI and GJ, with the mesh's error at their own optimum."""
    rolls = [{Unknown(name): roll} for name in study.rolls for roll in ROLLS] or [{}]
    starts = tuple({**_stiffness(study, ratio), **roll} for ratio in FIRST_STIFFNESS_M4_S2 for roll in rolls)
    found = fit_first(study, Task({}, starts, _no_offsets(study), len(starts)))
    if found is None:
        mend = "check the recording's units, ends and gravity"
        raise SimulationError("no stiffness could be simulated", mend=mend)
    return settled(study, found)


def _stiffness(study: Study, ratio_m4_s2: float) -> Point:
    """Both stiffnesses by their ratio to the rope's density [m^4/s^2]."""
    density = study.rod(0, dict.fromkeys(STIFFNESSES, 1.0)).linear_density
    return {Unknown(name): ratio_m4_s2 * density for name in STIFFNESSES}


def _no_offsets(study: Study) -> tuple[Floats, ...]:
    return tuple(np.zeros_like(one.recording.points.xyz_m) for one in study.seen)


def _singles(study: Study, baseline: Fitted, settings: DiagnoseSettings, run: Workers) -> list[Fitted]:
    found = [one for one in run(fit_first, _more_of(study, baseline, settings), "effects") if one is not None]
    return _refined(study, _nested(study, found, run), baseline, run, "effects")


def _nothing_else(study: Study, elastic: Fitted, singles: Sequence[Fitted], run: Workers) -> Fitted:
    """The elastic rod fitted once more from where the best effects left it, if that is better: an effect is
    tried from more stiffnesses than it was, and may have led out of a worse optimum and do nothing itself."""
    best = _ordered(study, singles)[:BEGINNINGS]
    again = run(refit, [task_without(one, name) for one in best for name in one.effects], "elastic again")
    found = min((one for one in again if one is not None), key=lambda one: one.chi2, default=elastic)
    return settled(study, found) if found.chi2 < elastic.chi2 - AHEAD else elastic


def _more_of(study: Study, at: Fitted, settings: DiagnoseSettings) -> list[Task]:
    """Every other effect beside those of a model, from there."""
    have = terms_of(at)
    known = library(study, settings.without, tuple(have))
    touched = touches(study, at) if any(placed(name) for name, _ in known) else []
    return [
        task
        for name, form in known
        for task in beginnings(study, at, have, name, form, touched, settings.starts)
    ]


def _nested(study: Study, found: Sequence[Fitted], run: Workers) -> list[Fitted]:
    """Forms of one effect that fit worse than one with fewer parameters fitted once more from there: they had
    ended in a worse optimum."""
    tasks = []
    for one in found:
        own = set(one.unknowns)
        parts = [p for p in found if p.effects == one.effects and set(p.unknowns) < own and p.chi2 < one.chi2]
        if parts:
            best = min(parts, key=lambda part: part.chi2)
            tasks.append(Task(terms_of(one), (best.point,), best.offsets_m, 1))
    return [*found, *(one for one in run(refit, tasks, "larger forms") if one is not None)]


def _best(study: Study, models: Models) -> Fitted:
    return min(models.values(), key=lambda one: one.bic(study.frames))


def _grown(
    study: Study, models: Models, elastic: Fitted, size: int, settings: DiagnoseSettings, run: Workers,
    tried: Tried,
) -> None:  # fmt: skip
    """Forward and backward: one more effect beside those of the best model, then beside all but one of those
    of the best ones so found, until nothing changes.

    Where much is missing a linear step from the best model foretells little, and what is found may not
    explain what is seen, or by many parameters, such as an uneven curvature at rest has, which leaves a
    second effect no sense: then the same from the next best models. More than two are sought forward alone,
    from the best model. A rigid rope explains by its ends alone what moves them: then the same from the best
    model whose rope is none.
    """
    beginnings, rounds = (BEGINNINGS, ROUNDS) if size == 2 else (1, 1)
    ranked = [one for one in _ordered(study, models.values()) if len(one.effects) == size - 1]
    first = ranked[:beginnings]
    if all(study.rigid(one.point) for one in first):
        first += [one for one in ranked if not study.rigid(one.point)][:1]
    for begin in first:
        todo = [begin.effects]
        for _ in range(rounds):
            _beside(study, models, todo, tried, settings, run)
            todo = _parts(study, models, size, settings.tie)
        best = _best(study, models)
        if best.parameters <= elastic.parameters + MANY and _done(study, best, elastic):
            break
    backed(study, models, size, run)
    best = _best(study, models)
    # a part that was left in a worse optimum leads elsewhere from its own
    if len(best.effects) < size and _beside(study, models, [best.effects], tried, settings, run):
        backed(study, models, size, run)


def _beside(
    study: Study, models: Models, begin: Sequence[Effects], tried: Tried, settings: DiagnoseSettings,
    run: Workers,
) -> bool:  # fmt: skip
    """One more effect beside each of these models where none was sought yet, or from a fit far worse than it
    has now; whether there was one."""
    now = {one: models[one].bic(study.frames) for one in begin if one in models}
    todo = [one for one, bic in now.items() if bic + NEAR < tried.get(one, np.inf)]
    for one in todo:
        tried[one] = now[one]
        for more in _partners(study, models[one], settings, run):
            _keep(study, models, more)
    return bool(todo)


def _keep(study: Study, models: Models, one: Fitted) -> None:
    """The better of two fits with the same effects."""
    key = tuple(sorted(one.effects))
    if key not in models or one.bic(study.frames) < models[key].bic(study.frames):
        models[key] = replace(one, effects=key)


def backed(study: Study, models: Models, size: int, run: Workers) -> None:
    """Parts of the best models fitted once more from there: alone they may have ended in a worse optimum, out
    of which an effect led that does nothing."""
    best = _best(study, models).bic(study.frames)
    near = [one for one in models.values() if len(one.effects) == size]
    near = [one for one in near if one.bic(study.frames) < best + NEAR_PRUNED]
    tasks = [task_without(one, left) for one in near for left in one.effects]
    for one in run(refit, tasks, "parts"):
        if one is not None:
            _keep(study, models, one)


def _done(study: Study, best: Fitted, elastic: Fitted) -> bool:
    """Whether no more effects need to be sought."""
    return explains(best, elastic) and not study.rigid(best.point)


def _parts(study: Study, models: Models, size: int, tie: float) -> list[Effects]:
    """All but one of the effects of the best model, if it has as many, and of those that tie with it and are
    better than any part of them."""
    ranked, frames = _ordered(study, models.values()), study.frames
    if not ranked:
        return []
    best = ranked[0]
    found: list[Effects] = []
    for one in ranked if len(best.effects) == size else ():
        parts = list(itertools.combinations(one.effects, size - 1)) if len(one.effects) == size else []
        alone = min((models[part].bic(frames) for part in parts if part in models), default=np.inf)
        if one is best or one.bic(frames) + tie < min(alone, best.bic(frames) + 2 * tie):
            found += parts
    return found


def _partners(study: Study, fewer: Fitted, settings: DiagnoseSettings, run: Workers) -> list[Fitted]:
    """Every other effect beside those of a model: screened by a linear step, the promising ones fitted, and
    those of which none tells: what sets in past a threshold, and, where it promises something from any
    stiffness, what a rope is too stiff for want of. In full, all of them beside one."""
    have, tasks = terms_of(fewer), _more_of(study, fewer, settings)
    beside = " and ".join(fewer.effects)
    told = run(promises, tasks, f"beside {beside}")
    tasks = [replace(task, promises=told) for task, told in zip(tasks, told, strict=True)]
    penalty = np.log(study.frames)
    gains = [
        fewer.chi2 - (task.promises[0].chi2 if task.promises else np.inf) - penalty * _more(task, have)
        for task in tasks
    ]
    added = [list(task.terms)[-1] for task in tasks]
    ranked = [added[k] for k in np.argsort(gains)[::-1] if gains[k] > PROMISING]
    first = list(dict.fromkeys(ranked))[: settings.partners]
    kept = [
        task
        for task, name, gain in zip(tasks, added, gains, strict=True)
        if (settings.full and len(have) == 1)
        or abrupt(name)
        or (name in ranked and stiffens(name))
        or (name in first and gain > PROMISING)
    ]
    found = [one for one in run(fit_first, kept, f"fits beside {beside}") if one is not None]
    return _refined(study, found, fewer, run, f"beside {beside}")


def _pruned(study: Study, models: Models, run: Workers) -> None:
    """The best models with fewer parameters of their effects, where that is the better form of them."""
    best = min((one.bic(study.frames) for one in models.values()), default=np.inf)
    tasks = []
    for one in models.values():
        if one.bic(study.frames) > best + NEAR_PRUNED:
            continue
        terms = terms_of(one)
        choices = [[f for f in forms_of(study, name) if set(f) <= set(terms[name])] for name in terms]
        for chosen in itertools.product(*choices):
            fewer = dict(zip(terms, chosen, strict=True))
            if fewer != terms:
                tasks.append(Task(fewer, (one.point,), one.offsets_m, 1))
    for one in run(refit, tasks, "forms"):
        if one is not None:
            _keep(study, models, one)


def _more(task: Task, have: Terms) -> int:
    return sum(len(parts) for name, parts in task.terms.items() if name not in have)


def _by_effects(study: Study, found: Sequence[Fitted], margin: float) -> list[Fitted]:
    """Of each set of effects the form of least BIC, and those that are behind it by less than a margin."""
    least: dict[Effects, float] = {}
    for one in found:
        key = tuple(sorted(one.effects))
        least[key] = min(one.bic(study.frames), least.get(key, np.inf))
    return [one for one in found if one.bic(study.frames) <= least[tuple(sorted(one.effects))] + margin]


def _refined(
    study: Study, found: Sequence[Fitted], baseline: Fitted, run: Workers, what: str
) -> list[Fitted]:
    """The best forms; those that gain and are near the best with the mesh's error at their own optimum.

    That error is worth as much as forms differ by: which is the best shows with it alone.
    """
    fits = _by_effects(study, found, NEAR_PRUNED)
    near = _near(study, fits, baseline)
    again = run(refit, [task_from(one) for one in near], f"{what}, refined")
    better = {id(one): new for one, new in zip(near, again, strict=True) if new is not None}
    return _by_effects(study, [better.get(id(one), one) for one in fits], 0.0)


def _near(study: Study, fits: Sequence[Fitted], baseline: Fitted, share: float = NEAR_SHARE) -> list[Fitted]:
    """Those that gain and are near the best, or behind it by no more than a share of what it gains."""
    best = min((one.bic(study.frames) for one in fits), default=np.inf)
    margin = max(NEAR, share * (baseline.bic(study.frames) - best))
    below = min(best + margin, baseline.bic(study.frames))
    return [one for one in fits if one.bic(study.frames) < below]


__all__ = ["Searched", "backed", "baseline", "once_more", "search", "searched_again", "simulated_once"]
