"""Which model the recordings speak for, and whether they speak clearly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats
from scipy.fft import dctn

from dlolib.diagnose.search import Searched
from dlolib.diagnose.study import DiagnoseSettings, Fitted, Study
from dlolib.types import Floats

Status = Literal["no_mismatch", "explained", "ambiguous", "unexplained"]
# The slow modes of the residuals, over frames and along the rope, in which missing physics shows.
MODES = 8
# A model whose slow residuals are this unlikely does not explain the recording, if they also are more than
# this share of what it explains: a law's form is never quite that of the rope.
UNLIKELY, NEGLIGIBLE = 1e-3, 0.05
# Slow residuals this unlikely are a mismatch even where no effect takes them up.
ALARMING = 1e-5
MOST_TIED = 3


@dataclass(frozen=True)
class SlowModes:
    """Energy of the residuals' slow modes over its expectation, and how likely so much is by chance.

    excess: of χ², over what noise alone would leave there.
    """

    energy: float
    p_value: float
    excess: float


@dataclass(frozen=True)
class Decision:
    """The winner (the baseline, where nothing is missing) and, where it is a tie, all models of it."""

    status: Status
    winner: Fitted
    tie: tuple[Fitted, ...]


def slow_modes(residuals: Sequence[Floats], parameters: int) -> SlowModes:
    """The test of whitened residuals (F, columns, A) of each recording: slow modes against quick ones.

    The quick modes give the scale, so that a noise estimate that is a little off does not matter.
    """
    slow, slow_count, quick, quick_count = 0.0, -parameters, 0.0, 0
    for grid in residuals:
        squares = dctn(grid, axes=(0, 1), norm="ortho") ** 2
        low = squares[:MODES, :MODES]
        slow += float(low.sum())
        slow_count += low.size
        quick += float(squares.sum() - low.sum())
        quick_count += squares.size - low.size
    scale = quick / quick_count
    energy = slow / max(slow_count, 1) / scale
    p = float(stats.f.sf(energy, max(slow_count, 1), quick_count))
    return SlowModes(energy, p, slow / scale - slow_count)


def decide(study: Study, searched: Searched, settings: DiagnoseSettings) -> Decision:
    """The verdict's status, winner and tie."""
    count, base = study.count, searched.baseline
    models = [one for one in searched.models if _earned(one, searched, settings, count)]
    best = models[0] if models else base
    gain = base.bic(count) - best.bic(count)
    if gain < settings.alarm:
        slow = slow_modes(base.residuals, len(base.unknowns))
        return Decision("unexplained" if slow.p_value < ALARMING else "no_mismatch", base, ())
    slow = slow_modes(best.residuals, len(best.unknowns))
    if slow.p_value < UNLIKELY and slow.excess > NEGLIGIBLE * (base.chi2 - best.chi2):
        return Decision("unexplained", best, ())
    tie = [one for one in models if one.bic(count) < best.bic(count) + settings.tie]
    tie = [one for one in tie if one is best or not set(best.effects) < set(one.effects)][:MOST_TIED]
    if len(tie) > 1:
        return Decision("ambiguous", best, tuple(tie))
    return Decision("explained", best, ())


def _earned(model: Fitted, searched: Searched, settings: DiagnoseSettings, count: int) -> bool:
    """Whether every effect of a pair is worth its place: it beats the other one alone by more than a tie."""
    if len(model.effects) < 2:
        return True
    alone = [one for one in searched.models if len(one.effects) == 1 and one.effects[0] in model.effects]
    return all(one.bic(count) - model.bic(count) > settings.second for one in alone)


def probabilities(study: Study, searched: Searched) -> dict[str, float]:
    """Of each effect: the share of the models with it, by exp(-BIC / 2)."""
    models = [searched.baseline, *searched.models]
    scores = np.array([one.bic(study.count) for one in models])
    weights = np.exp(-0.5 * (scores - scores.min()))
    weights /= weights.sum()
    names = {name for one in models for name in one.effects}
    return {
        name: float(sum(w for w, one in zip(weights, models, strict=True) if name in one.effects))
        for name in names
    }
