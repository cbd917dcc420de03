"""Fits of every effect of the library, alone and in pairs: forward, then backward."""

from __future__ import annotations

import itertools
import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dlolib.diagnose.study import (
    DiagnoseSettings,
    Fitted,
    Study,
    corrected,
    fit,
    hypothesis,
    library,
    promise,
)
from dlolib.errors import SimulationError
from dlolib.identify.identify import FIRST_STIFFNESS_M4_S2
from dlolib.identify.intervals import FEWEST_POSES, poses
from dlolib.identify.parameters import Unknown
from dlolib.progress import track
from dlolib.sim.effects import EFFECTS, parameter
from dlolib.sim.effects.base import Hint, forms
from dlolib.sim.rod import STIFFNESSES
from dlolib.types import Floats

Terms = dict[str, tuple[str, ...]]
# Blocks of the recording in which the rope may be off, and from how many of them a fit may begin.
FRAME_BLOCKS, ROPE_BLOCKS, HINTS = 8, 8, 5
# A pair is fitted in full where a linear step from the best single effect promises this much in BIC.
PROMISING = -10.0
# Models whose BIC is further from the best than this, or than this share of its gain, are fitted well enough.
NEAR, NEAR_SHARE = 60.0, 0.3
# Models this near to the best are tried with fewer parameters, too.
NEAR_PRUNED = 30.0


@dataclass(frozen=True)
class Task:
    """One model to be fitted: effects with their parameters, and where its fits may begin."""

    terms: Terms
    starts: tuple[Mapping[str, float], ...]
    offsets_m: tuple[Floats, ...]
    best: int


@dataclass(frozen=True)
class Searched:
    """The rod with nothing missing, and every other model fitted, by BIC."""

    baseline: Fitted
    models: tuple[Fitted, ...]


# How often the baseline's mesh error is made anew.
CORRECTIONS = 2
Run = Callable[[Callable[[Study, Any], Any], Sequence[Any], str], list[Any]]


def search(study: Study, settings: DiagnoseSettings, run: Run) -> Searched:
    """Fit the baseline, every effect alone, and the pairs that promise something."""
    elastic = baseline(study)
    models = {one.effects: one for one in _singles(study, elastic, settings, run)}
    # one pose cannot tell two effects apart
    if settings.most_effects > 1 and models and sum(poses(one.model) for one in study.seen) >= FEWEST_POSES:
        _pairs(study, models, settings, run)
    _pruned(study, models, run)
    ordered = sorted(models.values(), key=lambda one: one.bic(study.count))
    return Searched(elastic, tuple(ordered))


def baseline(study: Study) -> Fitted:
    """The rod with nothing missing: EI and GJ, with the mesh's error at their own optimum."""
    density = study.rod(0, dict.fromkeys(STIFFNESSES, 1.0)).linear_density
    offsets = tuple(np.zeros_like(one.recording.points.xyz_m) for one in study.seen)
    starts = tuple({name: ratio * density for name in STIFFNESSES} for ratio in FIRST_STIFFNESS_M4_S2)
    found = _fit(study, Task({}, starts, offsets, len(starts)))
    for _ in range(CORRECTIONS):
        if found is None:
            mend = "check the recording's units and ends"
            raise SimulationError("no stiffness could be simulated", mend=mend)
        found = _refit(study, Task({}, (found.values(0),), offsets, 1))
    assert found is not None
    return found


def _singles(study: Study, baseline: Fitted, settings: DiagnoseSettings, run: Run) -> list[Fitted]:
    hints = _hints(study, baseline)
    tasks = [
        _task(study, baseline, {}, name, form, hints, settings.starts)
        for name, form in library(study, settings.without)
    ]
    return _refined(study, run(_fit, tasks, "effects"), baseline, run, "effects")


def _pairs(study: Study, models: dict[tuple[str, ...], Fitted], settings: DiagnoseSettings, run: Run) -> None:
    """Partners of the best effect, then of the other member of the best pair, until nothing changes."""
    tried: set[str] = set()
    for _ in range(4):
        best = min(models.values(), key=lambda one: one.bic(study.count))
        todo = [name for name in best.effects if name not in tried]
        if not todo:
            break
        for name in todo:
            tried.add(name)
            for one in _partners(study, models[(name,)], settings, run):
                key = tuple(sorted(one.effects))
                if key not in models or one.chi2 < models[key].chi2:
                    models[key] = replace(one, effects=key)


def _partners(study: Study, single: Fitted, settings: DiagnoseSettings, run: Run) -> list[Fitted]:
    """Pairs of a fitted effect with every other: screened by a linear step, the promising ones fitted."""
    hints = _hints(study, single)
    have = terms_of(single)
    tasks = [
        _task(study, single, have, name, form, hints, settings.starts)
        for name, form in library(study, settings.without, tuple(have))
    ]
    promised = run(_promise, tasks, f"partners of {single.effects[0]}")
    penalty = np.log(study.count)
    scored = [
        (single.chi2 - low - penalty * _more(task, have), task)
        for low, task in zip(promised, tasks, strict=True)
    ]
    scored = sorted((one for one in scored if one[0] > PROMISING), key=lambda one: -one[0])
    kept: list[Task] = []
    for _, task in scored:
        names = {tuple(k.terms) for k in kept}
        if len(names) < settings.partners or tuple(task.terms) in names:
            kept.append(task)
    what = f"pairs with {single.effects[0]}"
    return _refined(study, run(_fit, kept, what), single, run, what)


def _pruned(study: Study, models: dict[tuple[str, ...], Fitted], run: Run) -> None:
    """The best models with fewer parameters of their effects, where that is the better form of them."""
    best = min((one.bic(study.count) for one in models.values()), default=np.inf)
    tasks = []
    for one in models.values():
        if one.bic(study.count) > best + NEAR_PRUNED:
            continue
        terms = terms_of(one)
        choices = [[f for f in forms(EFFECTS[name]) if set(f) <= set(terms[name])] for name in terms]
        for chosen in itertools.product(*choices):
            fewer = dict(zip(terms, chosen, strict=True))
            if fewer != terms:
                tasks.append(Task(fewer, (one.values(0),), one.offsets_m, 1))
    for one in run(_refit, tasks, "forms"):
        key = () if one is None else tuple(sorted(one.effects))
        if one is not None and one.bic(study.count) < models[key].bic(study.count):
            models[key] = replace(one, effects=key)


def _more(task: Task, have: Terms) -> int:
    return sum(len(parts) for name, parts in task.terms.items() if name not in have)


def _task(
    study: Study, at: Fitted, have: Terms, name: str, form: tuple[str, ...], hints: Sequence[Hint], best: int
) -> Task:
    values = at.values(0)
    starts = tuple({**values, **start} for start in study.starts(name, form, hints))
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
        if key not in best or one.bic(study.count) < best[key].bic(study.count):
            best[key] = one
    return list(best.values())


def _coordinates(model_unknowns: Sequence[Unknown], values: Mapping[str, float]) -> Floats:
    return np.array([u.inward(values.get(u.name, _neutral(u.name))) for u in model_unknowns])


def _neutral(name: str) -> float:
    return 1.0 if name in STIFFNESSES else parameter(name).neutral


def _ranked(study: Study, task: Task) -> list[tuple[float, Floats]]:
    """What a linear step from each start promises, the best first."""
    model = hypothesis(study, task.terms, task.offsets_m)
    ranked = []
    for start in task.starts:
        theta = _coordinates(model.unknowns, start)
        try:
            ranked.append((promise(model, theta), theta))
        except SimulationError:
            continue
    return sorted(ranked, key=lambda one: one[0])


def _promise(study: Study, task: Task) -> float:
    ranked = _ranked(study, task)
    return ranked[0][0] if ranked else np.inf


def _fit(study: Study, task: Task) -> Fitted | None:
    """The best of the fits from the most promising starts."""
    ranked = _ranked(study, task)[: task.best]
    found = []
    for _, theta in ranked:
        try:
            found.append(fit(hypothesis(study, task.terms, task.offsets_m), theta))
        except SimulationError:
            continue
    if not found:
        return None
    return min(found, key=lambda one: one.chi2)


def _refit(study: Study, task: Task) -> Fitted | None:
    """The fit once more from its own optimum, with the mesh's error as it is there."""
    values = task.starts[0]
    try:
        model = hypothesis(study, task.terms, corrected(study, lambda _: values))
        return fit(model, _coordinates(model.unknowns, values))
    except SimulationError:
        return None


def _refined(
    study: Study, found: Sequence[Fitted | None], baseline: Fitted, run: Run, what: str
) -> list[Fitted]:
    """The best forms, those near the best of them with the mesh's error at their own optimum."""
    fits = _best_forms(study, [one for one in found if one is not None])
    best = min((one.bic(study.count) for one in fits), default=np.inf)
    margin = max(NEAR, NEAR_SHARE * (baseline.bic(study.count) - best))
    near = [one for one in fits if one.bic(study.count) < best + margin]
    tasks = [Task(terms_of(one), (one.values(0),), one.offsets_m, 1) for one in near]
    again = run(_refit, tasks, f"{what}, refined")
    better = {one.effects: new for one, new in zip(near, again, strict=True) if new is not None}
    return [better.get(one.effects, one) for one in fits]


def _hints(study: Study, at: Fitted) -> list[Hint]:
    """Where the rope is most off, in blocks of frames and rope of the first recording."""
    one = study.seen[0]
    simulated = one.model.predict(study.rod(0, at.values(0))).xyz_m + at.offsets_m[0]
    points = one.recording.points
    off = points.xyz_m - simulated
    frame = np.unique(points.frame, return_inverse=True)[1]
    block = frame * FRAME_BLOCKS // (frame.max() + 1)
    part = np.minimum(points.s_m / one.recording.rope.length_m * ROPE_BLOCKS, ROPE_BLOCKS - 1).astype(int)
    hints = []
    for number in np.unique(block * ROPE_BLOCKS + part):
        mine = block * ROPE_BLOCKS + part == number
        mean = off[mine].mean(axis=0)
        hints.append((float(mean @ mean) * mine.sum(), Hint(points.xyz_m[mine].mean(axis=0), mean)))
    return [hint for _, hint in sorted(hints, key=lambda h: -h[0])[:HINTS]]


_STUDY: list[Study] = []


def _begin(study: Study) -> None:
    _STUDY[:] = [study]


def _call(job: tuple[Callable[[Study, Any], Any], Any]) -> Any:
    return job[0](_STUDY[0], job[1])


@contextmanager
def runner(study: Study, workers: int) -> Iterator[Run]:
    """How many jobs of a study are done: one after the other here, or in processes, in the same order."""
    if workers == 1:
        yield lambda function, jobs, what: [function(study, job) for job in track(jobs, what)]
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, _begin, (study,)) as pool:
        yield lambda function, jobs, what: list(
            track(pool.map(_call, [(function, job) for job in jobs]), what, len(jobs))
        )


__all__ = ["Searched", "baseline", "runner", "search", "terms_of"]
