"""Fits of every effect of the library, alone and in pairs: forward, then backward."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlolib.diagnose.fitting import Fitted, awake, corrected, fit, hypothesis, promise
from dlolib.diagnose.residuals import amiss, explains
from dlolib.diagnose.study import DiagnoseSettings, Point, Study, abrupt, library
from dlolib.diagnose.workers import Workers
from dlolib.errors import SimulationError
from dlolib.identify.identify import FIRST_STIFFNESS_M4_S2
from dlolib.identify.intervals import FEWEST_POSES, poses
from dlolib.identify.parameters import Unknown
from dlolib.sim.effects import EFFECTS, parameter
from dlolib.sim.effects.base import Hint, forms
from dlolib.sim.rod import STIFFNESSES
from dlolib.types import Floats

Terms = dict[str, tuple[str, ...]]
Effects = tuple[str, ...]
Models = dict[Effects, "Fitted"]
# Blocks of the recording in which the rope may be off, and from how many of them a fit may begin.
FRAME_BLOCKS, ROPE_BLOCKS, HINTS = 8, 8, 5
# One more effect is fitted in full where a linear step from the fit without it promises this much in BIC.
PROMISING = 0.0
# Models whose BIC is further from the best than this, or than this share of its gain, are fitted well enough.
NEAR, NEAR_SHARE = 60.0, 0.3
# Models this near to the best are tried with fewer parameters, too.
NEAR_PRUNED = 30.0


@dataclass(frozen=True)
class Task:
    """One model to be fitted: effects with their parameters, and where its fits may begin."""

    terms: Terms
    starts: tuple[Point, ...]
    offsets_m: tuple[Floats, ...]
    best: int


@dataclass(frozen=True)
class Searched:
    """The rod with nothing missing, and every other model fitted, by BIC."""

    baseline: Fitted
    models: tuple[Fitted, ...]


# How often the baseline's mesh error is made anew; how often effects are looked for beside the best ones, and
# from how many models on.
CORRECTIONS, ROUNDS, BEGINNINGS = 2, 4, 3
# Evaluations of a fit before it is asked whether another start leads to one better by this in χ²; the share
# of χ² at which a first fit's steps end.
ROUGH, AHEAD, FIRST_TOLERANCE = 6, 10.0, 1e-5


def search(study: Study, settings: DiagnoseSettings, run: Workers) -> Searched:
    """Fit the baseline, every effect alone, and the pairs that promise something.

    A second effect is sought where the best of these may leave more than noise, a third only where the best
    pair does not explain what is seen.
    """
    elastic = baseline(study)
    models = {one.effects: one for one in _singles(study, elastic, settings, run)}
    # one pose cannot tell two effects apart
    together = models and sum(poses(one.model) for one in study.seen) >= FEWEST_POSES
    for size in range(2, settings.most_effects + 1 if together else 0):
        best = _best(study, models)
        if size == 2 and not amiss(min(best, elastic, key=lambda one: one.bic(study.frames))):
            break
        if size > 2 and (len(best.effects) < size - 1 or _done(study, best, elastic)):
            break
        _grown(study, models, elastic, size, settings, run)
    _pruned(study, models, run)
    return Searched(elastic, _ordered(study, models.values()))


def searched_again(study: Study, before: Searched, run: Workers) -> Searched:
    """The same models from where they were, after the noise has become known better."""
    elastic = _refit(study, Task({}, (before.baseline.point,), before.baseline.offsets_m, 1))
    tasks = [Task(terms_of(one), (one.point,), one.offsets_m, 1) for one in before.models]
    again = [one for one in run(_refit, tasks, "once more") if one is not None]
    return Searched(elastic or before.baseline, _ordered(study, again))


def _ordered(study: Study, models: Iterable[Fitted]) -> tuple[Fitted, ...]:
    return tuple(sorted(models, key=lambda one: one.bic(study.frames)))


def baseline(study: Study) -> Fitted:
    """The rod with nothing missing: EI and GJ, with the mesh's error at their own optimum."""
    density = study.rod(0, dict.fromkeys(STIFFNESSES, 1.0)).linear_density
    offsets = tuple(np.zeros_like(one.recording.points.xyz_m) for one in study.seen)
    starts = tuple({Unknown(n): ratio * density for n in STIFFNESSES} for ratio in FIRST_STIFFNESS_M4_S2)
    found = _fit(study, Task({}, starts, offsets, len(starts)))
    for _ in range(CORRECTIONS):
        if found is None:
            mend = "check the recording's units and ends"
            raise SimulationError("no stiffness could be simulated", mend=mend)
        found = _refit(study, Task({}, (found.point,), offsets, 1))
    assert found is not None
    return found


def _singles(study: Study, baseline: Fitted, settings: DiagnoseSettings, run: Workers) -> list[Fitted]:
    hints = _hints(study, baseline)
    tasks = [
        _task(study, baseline, {}, name, form, hints, settings.starts)
        for name, form in library(study, settings.without)
    ]
    return _refined(study, run(_fit, tasks, "effects"), baseline, run, "effects")


def _best(study: Study, models: Models) -> Fitted:
    return min(models.values(), key=lambda one: one.bic(study.frames))


def _grown(
    study: Study, models: Models, elastic: Fitted, size: int, settings: DiagnoseSettings, run: Workers
) -> None:
    """Forward and backward: one more effect beside those of the best model, then beside all but one of those
    of the best ones so found, until nothing changes.

    Where much is missing a linear step from the best model foretells little, and what is found may not
    explain what is seen: then the same from the next best models. Three effects are sought forward alone,
    from the best pair. A rigid rope explains by its ends alone what moves them: then the same from the best
    model whose rope is none.
    """
    beginnings, rounds = (BEGINNINGS, ROUNDS) if size == 2 else (1, 1)
    ranked = [one for one in _ordered(study, models.values()) if len(one.effects) == size - 1]
    first = ranked[:beginnings]
    if all(study.rigid(one.point) for one in first):
        first += [one for one in ranked if not study.rigid(one.point)][:1]
    tried: set[Effects] = set()
    for begin in first:
        todo = [begin.effects]
        for _ in range(rounds):
            todo = [one for one in todo if one in models and one not in tried]
            for one in todo:
                tried.add(one)
                for more in _partners(study, models[one], settings, run):
                    key = tuple(sorted(more.effects))
                    if key not in models or more.chi2 < models[key].chi2:
                        models[key] = replace(more, effects=key)
            todo = _parts(study, models, size, settings.tie)
        if _done(study, _best(study, models), elastic):
            break


def _done(study: Study, best: Fitted, elastic: Fitted) -> bool:
    """Whether no more effects need to be sought."""
    return explains(best, elastic) and not study.rigid(best.point)


def _parts(study: Study, models: Models, size: int, tie: float) -> list[Effects]:
    """All but one of the effects of the best model, if it has as many, and of those that tie with it and are
    better than any part of them."""
    ranked, frames = _ordered(study, models.values()), study.frames
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
    those of which none tells."""
    hints = _hints(study, fewer)
    have = terms_of(fewer)
    tasks = [
        _task(study, fewer, have, name, form, hints, settings.starts)
        for name, form in library(study, settings.without, tuple(have))
    ]
    beside = " and ".join(fewer.effects)
    promised = run(_promise, tasks, f"beside {beside}")
    penalty = np.log(study.frames)
    gains = [
        fewer.chi2 - low - penalty * _more(task, have) for low, task in zip(promised, tasks, strict=True)
    ]
    added = [list(task.terms)[-1] for task in tasks]
    ranked = [added[k] for k in np.argsort(gains)[::-1] if gains[k] > PROMISING]
    first = list(dict.fromkeys(ranked))[: settings.partners]
    kept = [
        task
        for task, name, gain in zip(tasks, added, gains, strict=True)
        if abrupt(name) or (name in first and gain > PROMISING)
    ]
    return _refined(study, run(_fit, kept, f"fits beside {beside}"), fewer, run, f"beside {beside}")


def _pruned(study: Study, models: Models, run: Workers) -> None:
    """The best models with fewer parameters of their effects, where that is the better form of them."""
    best = min((one.bic(study.frames) for one in models.values()), default=np.inf)
    tasks = []
    for one in models.values():
        if one.bic(study.frames) > best + NEAR_PRUNED:
            continue
        terms = terms_of(one)
        choices = [[f for f in forms(EFFECTS[name]) if set(f) <= set(terms[name])] for name in terms]
        for chosen in itertools.product(*choices):
            fewer = dict(zip(terms, chosen, strict=True))
            if fewer != terms:
                tasks.append(Task(fewer, (one.point,), one.offsets_m, 1))
    for one in run(_refit, tasks, "forms"):
        key = () if one is None else tuple(sorted(one.effects))
        if one is not None and one.bic(study.frames) < models[key].bic(study.frames):
            models[key] = replace(one, effects=key)


def _more(task: Task, have: Terms) -> int:
    return sum(len(parts) for name, parts in task.terms.items() if name not in have)


def _task(
    study: Study, at: Fitted, have: Terms, name: str, form: tuple[str, ...], hints: Sequence[Hint], best: int
) -> Task:
    starts = tuple(
        {**at.point, **stiffness, **{Unknown(part): value for part, value in start.items()}}
        for stiffness in study.softer(at.point)
        for start in study.starts(name, form, hints)
    )
    return Task({**have, name: form}, starts, at.offsets_m, best)


def terms_of(model: Fitted) -> Terms:
    """The parameters fitted of each effect."""
    terms: Terms = {name: () for name in model.effects}
    for unknown in model.unknowns:
        name, _, part = unknown.name.partition(".")
        if unknown.recording is None and name in terms:
            terms[name] = (*terms[name], part)
    return terms


def _best_forms(study: Study, found: Sequence[Fitted]) -> list[Fitted]:
    """Of each set of effects the form of least BIC."""
    best: dict[tuple[str, ...], Fitted] = {}
    for one in found:
        key = tuple(sorted(one.effects))
        if key not in best or one.bic(study.frames) < best[key].bic(study.frames):
            best[key] = one
    return list(best.values())


def _coordinates(unknowns: Sequence[Unknown], start: Point) -> Floats:
    """A start in the fit's coordinates; what it does not name is neutral."""
    return np.array([u.inward(start[u] if u in start else parameter(u.name).neutral) for u in unknowns])


def _ranked(study: Study, task: Task) -> list[tuple[float, Floats]]:
    """What a linear step from each start promises, the best first."""
    model = hypothesis(study, task.terms, task.offsets_m)
    ranked = []
    for start in task.starts:
        theta = _coordinates(model.unknowns, start)
        with contextlib.suppress(SimulationError):
            ranked.append((promise(model, theta), theta))
            woken = awake(model, theta)
            if woken is not None:
                ranked.append((promise(model, woken), woken))
    return sorted(ranked, key=lambda one: one[0])


def _promise(study: Study, task: Task) -> float:
    ranked = _ranked(study, task)
    return ranked[0][0] if ranked else np.inf


def _fit(study: Study, task: Task) -> Fitted | None:
    """The best of the fits from the most promising starts; those soon left far behind are not finished."""
    rough = []
    for _, theta in _ranked(study, task)[: task.best]:
        model = hypothesis(study, task.terms, task.offsets_m)
        try:
            rough.append((fit(model, theta, ROUGH, FIRST_TOLERANCE), model))
        except SimulationError:
            continue
    if not rough:
        return None
    best = min(one.chi2 for one, _ in rough)
    ahead = [(one, model) for one, model in rough if one.chi2 < best + AHEAD]
    ends = [fit(model, one.theta, tolerance=FIRST_TOLERANCE) for one, model in ahead]
    return min(ends, key=lambda one: one.chi2)


def _refit(study: Study, task: Task) -> Fitted | None:
    """The fit once more from its own optimum, with the mesh's error as it is there."""
    start = task.starts[0]
    try:
        model = hypothesis(study, task.terms, corrected(study, start))
        return fit(model, _coordinates(model.unknowns, start))
    except SimulationError:
        return None


def _refined(
    study: Study, found: Sequence[Fitted | None], baseline: Fitted, run: Workers, what: str
) -> list[Fitted]:
    """The best forms; those that gain and are near the best with the mesh's error at their own optimum."""
    fits = _best_forms(study, [one for one in found if one is not None])
    best = min((one.bic(study.frames) for one in fits), default=np.inf)
    margin = max(NEAR, NEAR_SHARE * (baseline.bic(study.frames) - best))
    below = min(best + margin, baseline.bic(study.frames))
    near = [one for one in fits if one.bic(study.frames) < below]
    tasks = [Task(terms_of(one), (one.point,), one.offsets_m, 1) for one in near]
    again = run(_refit, tasks, f"{what}, refined")
    better = {one.effects: new for one, new in zip(near, again, strict=True) if new is not None}
    return [better.get(one.effects, one) for one in fits]


def _hints(study: Study, at: Fitted) -> list[Hint]:
    """Where the rope is most off, in blocks of frames and rope of each recording."""
    hints = []
    for k, one in enumerate(study.seen):
        simulated = one.model.predict(study.rod(k, at.values(k))).xyz_m + at.offsets_m[k]
        points = one.recording.points
        off = points.xyz_m - simulated
        frame = np.unique(points.frame, return_inverse=True)[1]
        block = frame * FRAME_BLOCKS // (frame.max() + 1)
        share = points.s_m / one.recording.rope.length_m
        part = np.minimum(share * ROPE_BLOCKS, ROPE_BLOCKS - 1).astype(int)
        for number in np.unique(block * ROPE_BLOCKS + part):
            mine = block * ROPE_BLOCKS + part == number
            mean = off[mine].mean(axis=0)
            hints.append((float(mean @ mean) * mine.sum(), Hint(points.xyz_m[mine].mean(axis=0), mean)))
    return [hint for _, hint in sorted(hints, key=lambda h: -h[0])[:HINTS]]


__all__ = ["Searched", "baseline", "search", "searched_again", "terms_of"]
