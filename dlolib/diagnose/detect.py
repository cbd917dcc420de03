"""What these recordings could have shown at all: the size from which on each effect is seen."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy import optimize, stats

from dlolib.diagnose.fitting import Fitted, Hypothesis, fit
from dlolib.diagnose.study import Study, held_somewhere
from dlolib.diagnose.tasks import coordinates
from dlolib.errors import DloError
from dlolib.identify.parameters import Unknown
from dlolib.identify.problem import axes
from dlolib.sim.effects import EFFECTS, parameter
from dlolib.sim.effects.base import Parameter, forms, sizes
from dlolib.sim.rod import unit_of
from dlolib.types import Detectable, Floats

POWER = 0.95
# Sizes are sought to this many decades, over so many of them; what is larger than so many scales is absurd.
CLOSE, DECADES, ABSURD = 0.02, 8.0, 3.0
# Of what the baseline takes up more than this share, it takes more or less than a linear step tells.
MOSTLY = 0.9
# A stiffness whose logarithm deviates by more is next to unknown.
UNKNOWN = 1.0
# Logarithm of next to nothing of the gain that is needed.
NOTHING = np.log(0.1)
# Logarithm of a gain that is far from the one needed; its growth with a decade where it goes with the square.
FAR, SQUARED, SECANTS = 50.0, 2 * np.log(10), 6


# By how much the points of each recording move, (P, 3) [m].
Moved = tuple[Floats, ...]


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
            if not held_somewhere(study, name, form):
                continue
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
    base = _usual(study, base)
    clean = tuple(one.model.predict(study.rod(k, base.values(k))).xyz_m for k, one in enumerate(study.seen))
    return Sized(base, clean, _basis(study, base), chance)


def _usual(study: Study, base: Fitted) -> Fitted:
    """With a usual GJ where the recordings tell next to nothing of it and it ran off: a rope limp or rigid in
    twist for no reason would decide what is seen."""
    gj = Unknown("torsional_stiffness")
    if gj not in base.unknowns:
        return base
    n = base.unknowns.index(gj)
    if base.covariance[n, n] < UNKNOWN**2:
        return base
    return replace(base, theta=coordinates(base.unknowns, {**base.point, **study.usual(base.point)[0]}))


def detectable(study: Study, job: tuple[Sized, Size]) -> Detectable:
    """The size of an effect that is seen with 95 % power; the baseline's own parameters give way.

    They do so linearly, and in full where that is nearly all: a load along gravity looks like another
    stiffness, however large it is, and is seen in no size.
    """
    beside, size = job
    full = f"{size.name}.{size.part}"
    known = parameter(full)
    form = min((f for f in forms(EFFECTS[size.name]) if size.part in f), key=len)
    needed = gain_needed(beside.chance, len(form))
    absent: Moved | None = None
    if known.neutral == 0.0:  # drag is sought of a rope that is inert
        with contextlib.suppress(DloError):
            absent = _moved(study, beside, {**size.others, full: 0.0})

    def moved(decades: float) -> Moved:
        found = _moved(study, beside, {**size.others, full: _value(known, decades)})
        return found if absent is None else tuple(a - b for a, b in zip(found, absent, strict=True))

    def excess(gain: Callable[[Moved], float]) -> Callable[[float], float]:
        """The logarithm of the gain of a size over the one needed."""

        @cache
        def of(decades: float) -> float:
            try:
                return float(np.clip(np.log(max(gain(moved(decades)), 1e-300) / needed), -FAR, FAR))
            except DloError:
                return FAR

        return of

    high = _largest(known)
    root = _root(excess(lambda some: _gain(study, beside, some)), high)
    with contextlib.suppress(DloError):
        if root is not None and _given_way(study, beside, moved(root)) > MOSTLY:
            root = _beyond(root, excess(lambda some: _left(study, beside, some))(root), high)
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


def _beyond(decades: float, left: float, high: float) -> float | None:
    """The decades of a size that is seen where one leaves so much (as a logarithm) less than is needed; None
    where it leaves next to nothing, so that no size would do that still is a change of the same kind."""
    further = decades + max(-left, 0.0) / SQUARED
    return None if left < NOTHING or further > high else further


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


def _moved(study: Study, beside: Sized, values: dict[str, float]) -> Moved:
    """By how much the points of each recording move, (P, 3) [m]."""
    return tuple(
        one.model.predict(study.rod(k, {**beside.base.values(k), **values})).xyz_m - clean
        for k, (one, clean) in enumerate(zip(study.seen, beside.clean_m, strict=True))
    )


def _white(study: Study, moved_m: Moved) -> Floats:
    """The same, whitened, of all recordings (R,)."""
    pairs = zip(study.seen, moved_m, strict=True)
    return np.concatenate([one.whitener(moved[:, axes(one.model)]).ravel() for one, moved in pairs])


def _gain(study: Study, beside: Sized, moved_m: Moved) -> float:
    """χ² that a linear step of the baseline leaves of such a change."""
    white = _white(study, moved_m)
    return float(white @ white - np.sum((beside.basis.T @ white) ** 2))


def _given_way(study: Study, beside: Sized, moved_m: Moved) -> float:
    """The share of it that this step takes up."""
    white = _white(study, moved_m)
    return 1.0 - _gain(study, beside, moved_m) / float(white @ white)


def _left(study: Study, beside: Sized, moved_m: Moved) -> float:
    """χ² that the baseline leaves of it at its best."""
    base = beside.base
    offsets = [
        one.recording.points.xyz_m - clean - moved
        for one, clean, moved in zip(study.seen, beside.clean_m, moved_m, strict=True)
    ]
    expected = dict(zip(base.unknowns, base.theta.tolist(), strict=True))
    return fit(Hypothesis(study, (), base.unknowns, tuple(offsets), expected=expected), base.theta).chi2


__all__ = ["Size", "Sized", "asked", "detectable", "gain_needed", "sized"]
