"""What these recordings could have shown at all: the size from which on each effect is seen."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import optimize, stats

from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.study import Study
from dlolib.errors import DloError
from dlolib.identify.problem import axes
from dlolib.sim.effects import EFFECTS, parameter
from dlolib.sim.effects.base import Parameter, forms, sizes
from dlolib.sim.rod import unit_of
from dlolib.types import Detectable, Floats

POWER = 0.95
# Sizes are sought to this many decades, over so many of them; what is larger than so many scales is absurd.
CLOSE, DECADES, ABSURD = 0.02, 8.0, 3.0
# Logarithm of a gain that is far from the one needed; its growth with a decade where it goes with the square.
FAR, SQUARED, SECANTS = 50.0, 2 * np.log(10), 6


@dataclass(frozen=True)
class Size:
    """One parameter whose size is asked for, the effect's others at usual ones (`Study.middle`)."""

    name: str
    part: str
    others: dict[str, float]


def asked(study: Study, without: tuple[str, ...]) -> list[Size]:
    """Every parameter of the library that says how large an effect is."""
    found = []
    contact = any(one.recording.obstacles for one in study.seen)
    for name, effect in EFFECTS.items():
        if name in (*without, "prior_history") or (name == "contact_friction" and not contact):
            continue
        for part in sizes(effect):
            form = next(f for f in forms(effect) if part in f)
            others = {p: study.middle(f"{name}.{p}") for p in form if p != part and p not in sizes(effect)}
            found.append(Size(name, part, {f"{name}.{p}": value for p, value in others.items()}))
    return found


def gain_needed(chance: float, parameters: int) -> float:
    """The gain in χ², noise apart, that an effect with so many parameters needs for 95 % power."""
    threshold = stats.chi2.isf(chance, parameters)
    return float(
        optimize.brentq(
            lambda gain: stats.ncx2.sf(threshold, parameters, gain) - POWER, 1e-6, 1e3 + 10 * threshold
        )
    )


@dataclass(frozen=True)
class Sized:
    """What a size is sought beside: the baseline, its points of each recording, and all that its own
    parameters can do, as orthonormal columns (R, N); and the chance of a false alarm.
    """

    base: Fitted
    clean_m: tuple[Floats, ...]
    basis: Floats
    chance: float


def sized(study: Study, base: Fitted, chance: float) -> Sized:
    """The baseline simulated once for all sizes."""
    clean = tuple(one.model.predict(study.rod(k, base.values(k))).xyz_m for k, one in enumerate(study.seen))
    return Sized(base, clean, _basis(study, base), chance)


def detectable(study: Study, job: tuple[Sized, Size]) -> Detectable:
    """The size of an effect that is seen with 95 % power; the baseline's own parameters give way."""
    beside, size = job
    full = f"{size.name}.{size.part}"
    known = parameter(full)
    form = min((f for f in forms(EFFECTS[size.name]) if size.part in f), key=len)
    needed = gain_needed(beside.chance, len(form))
    absent: Floats | float = 0.0
    if known.neutral == 0.0:  # drag is sought of a rope that is inert
        with contextlib.suppress(DloError):
            absent = _changed(study, beside, {**size.others, full: 0.0})

    @cache
    def excess(decades: float) -> float:
        try:
            changed = _changed(study, beside, {**size.others, full: _value(known, decades)}) - absent
        except DloError:
            return FAR
        gain = float(changed @ changed - np.sum((beside.basis.T @ changed) ** 2))
        return float(np.clip(np.log(max(gain, 1e-300) / needed), -FAR, FAR))

    root = _root(excess, _largest(known))
    unit = unit_of(full, study.seen[0].recording.rope.linear_density_kg_m is not None)
    return Detectable(size.name, size.part, None if root is None else _value(known, root), unit)


def _root(excess: Callable[[float], float], high: float) -> float | None:
    """The decades at which the excess is 0, None where that is beyond the largest.

    Most gains go with the square of the size, so that a secant from a small size leads there at once.
    """
    small, low = high - DECADES / 2, high - DECADES
    guess = small - excess(small) / SQUARED
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
        # it warns of gains that do not grow: those are sought by bisection
        found = optimize.root_scalar(excess, x0=small, x1=guess, xtol=CLOSE, maxiter=SECANTS)
    if found.converged and low < found.root < high and excess(guess) < FAR:
        return float(found.root)
    if excess(high) < 0:
        return None
    return low if excess(low) > 0 else float(optimize.brentq(excess, low, high, xtol=CLOSE))


def _value(known: Parameter, decades: float) -> float:
    """The parameter at a size: away from what is neutral, softer where it is a ratio, down from infinity."""
    size = 10.0**decades
    if np.isinf(known.neutral):
        return float(min(max(known.starts) / size, known.high))
    if known.low > 0:
        return float(known.neutral / (1 + size))
    return float(known.neutral + known.scale * size)


def _largest(known: Parameter) -> float:
    """The size, in decades, at which the parameter meets its bound, or is absurd."""
    if np.isinf(known.neutral):
        return float(np.log10(max(known.starts) / known.low))
    if known.low > 0:
        return float(np.log10(known.neutral / known.low - 1))
    return min(float(np.log10((known.high - known.neutral) / known.scale)), ABSURD)


def _basis(study: Study, base: Fitted) -> Floats:
    """What the baseline's parameters can do, as orthonormal columns (R, N)."""
    rows = []
    for k, one in enumerate(study.seen):
        names = [u.name for u in base.unknowns if u.recording in (None, k)]
        by = one.model.predict(study.rod(k, base.values(k)), names).by_parameter[:, axes(one.model)]
        mine = [n for n, u in enumerate(base.unknowns) if u.recording in (None, k)]
        white = one.whitener(by).reshape(-1, len(mine))
        block = np.zeros((len(white), len(base.unknowns)))
        block[:, mine] = white
        rows.append(block)
    return np.asarray(np.linalg.qr(np.concatenate(rows))[0])


def _changed(study: Study, beside: Sized, values: dict[str, float]) -> Floats:
    """Whitened change of all points (R,)."""
    parts = []
    for k, (one, clean) in enumerate(zip(study.seen, beside.clean_m, strict=True)):
        made = one.model.predict(study.rod(k, {**beside.base.values(k), **values})).xyz_m
        parts.append(one.whitener((made - clean)[:, axes(one.model)]).ravel())
    return np.concatenate(parts)


__all__ = ["Size", "Sized", "asked", "detectable", "gain_needed", "sized"]
