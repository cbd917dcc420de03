"""Is an effect there to be found? The laboratory's own answer, before any diagnosis and without noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dlolib.errors import SimulationError
from dlolib.proof.noise import whiten
from dlolib.proof.play import play
from dlolib.proof.world import POINTS, Effects, Experiment
from dlolib.types import Floats, Noise

DETECTABLE = 40.0
ROUNDS, ENOUGH, TRIAL = 8, 0.01, 1e-3
# Gains are differences between ropes of the same bodies: fewer do (the table of the proof's report).
GAIN_BODIES, COARSEST = 58, POINTS - 1


@dataclass(frozen=True)
class Gain:
    """Chi-squared that the best other rope leaves, noise-free, and that rope's EI and GJ [N m²]."""

    value: float
    bending_stiffness: float
    torsional_stiffness: float


def gain(
    experiment: Experiment,
    truth: Floats,
    without: Effects,
    noise: Noise,
    bodies: int = GAIN_BODIES,
    doubtless: float = 0.25 * DETECTABLE,
) -> Gain:
    """How much the best rope with `without` alone leaves of what the true effects show.

    Gauss-Newton on EI, GJ and every parameter of `without`, by finite differences of the laboratory's own
    simulation, whitened with the true noise. The differences are the coarsest chain's: they only say which
    way to go.

    Args:
        experiment: what is known.
        truth: the rope's points (F, 30, 3) [m], played with as many bodies.
        without: what the other rope may have, started from the truth; nothing for the elastic one.
        noise: the true one.
        bodies: of the other rope's chain.
        doubtless: the search stops where it leaves so little.
    """
    start = _parameters(without)

    def shown(change: Floats, bodies: int) -> Floats:
        rope = replace(
            experiment,
            bending_stiffness=experiment.bending_stiffness * float(np.exp(change[0])),
            torsional_stiffness=experiment.torsional_stiffness * float(np.exp(change[1])),
        )
        return play(rope, _changed(without, start, change[2:]), bodies)

    def miss(change: Floats) -> Floats:
        return whiten(shown(change, bodies) - truth, noise).ravel()

    def slopes(change: Floats) -> Floats:
        here = shown(change, COARSEST)
        aside = [shown(change + TRIAL * side, COARSEST) - here for side in np.eye(len(change))]
        return np.stack([whiten(moved / TRIAL, noise).ravel() for moved in aside], axis=1)

    found, change = _descend(miss, slopes, np.zeros(2 + len(start)), doubtless)
    stiffness = np.array([experiment.bending_stiffness, experiment.torsional_stiffness]) * np.exp(change[:2])
    return Gain(found, *map(float, stiffness))


def _descend(
    miss: Callable[[Floats], Floats], slopes: Callable[[Floats], Floats], change: Floats, doubtless: float
) -> tuple[float, Floats]:
    """Least sum of squares and where, by Gauss-Newton steps that are halved until they help."""
    error = miss(change)
    least = float(error @ error)
    for _ in range(ROUNDS):
        if least <= doubtless:
            break
        step = -np.linalg.lstsq(slopes(change), error, rcond=1e-6)[0]
        step = step * min(1.0, 0.5 / max(np.abs(step).max(), 1e-12))
        better = _shorter(miss, change, np.asarray(step, dtype=float), least)
        if better is None:
            break
        change, error = better
        before, least = least, float(error @ error)
        if before - least < ENOUGH * before:
            break
    return least, change


def _shorter(
    miss: Callable[[Floats], Floats], change: Floats, step: Floats, least: float
) -> tuple[Floats, Floats] | None:
    for share in (1.0, 0.5, 0.2):
        try:
            error = miss(change + share * step)
        except SimulationError:
            continue
        if error @ error < least:
            return change + share * step, error
    return None


def _parameters(effects: Effects) -> list[tuple[str, str, float]]:
    """Effect, parameter and scale of a unit change, for everything that is not neutral."""
    return [
        (name, parameter, abs(value))
        for name, values in effects.items()
        for parameter, value in values.items()
        if value != 0 and np.isfinite(value) and parameter not in ("inertia", "radius")
    ]


def _changed(
    effects: Effects, parameters: list[tuple[str, str, float]], change: Floats
) -> Mapping[str, Mapping[str, float]]:
    changed = {name: dict(values) for name, values in effects.items()}
    for (name, parameter, scale), part in zip(parameters, change, strict=True):
        changed[name][parameter] += scale * float(part)
    return changed
