"""Which model the recordings speak for, and whether they speak clearly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dlolib.diagnose.residuals import explains, slow_modes
from dlolib.diagnose.search import Searched
from dlolib.diagnose.study import DiagnoseSettings, Fitted, Study

Status = Literal["no_mismatch", "explained", "ambiguous", "unexplained"]
# Slow residuals this unlikely are a mismatch even where no effect takes them up.
ALARMING = 1e-5
MOST_TIED = 3


@dataclass(frozen=True)
class Decision:
    """The winner (the baseline, where nothing is missing) and, where it is a tie, all models of it."""

    status: Status
    winner: Fitted
    tie: tuple[Fitted, ...]


def decide(study: Study, searched: Searched, settings: DiagnoseSettings) -> Decision:
    """The verdict's status, winner and tie."""
    count, base = study.count, searched.baseline
    models = [one for one in searched.models if _earned(one, searched, settings, count)]
    best = models[0] if models else base
    gain = base.bic(count) - best.bic(count)
    if gain < settings.alarm:
        slow = slow_modes(base.residuals, len(base.unknowns))
        return Decision("unexplained" if slow.p_value < ALARMING else "no_mismatch", base, ())
    if not explains(best, base):
        return Decision("unexplained", best, ())
    tie = [one for one in models if one.bic(count) < best.bic(count) + settings.tie]
    tie = [one for one in tie if one is best or not set(best.effects) < set(one.effects)][:MOST_TIED]
    if len(tie) > 1:
        return Decision("ambiguous", best, tuple(tie))
    return Decision("explained", best, ())


def _earned(model: Fitted, searched: Searched, settings: DiagnoseSettings, count: int) -> bool:
    """Whether every effect is worth its place: without any one of them the rest is worse by more than a
    tie."""
    fewer = [one for one in searched.models if set(one.effects) < set(model.effects)]
    return all(one.bic(count) - model.bic(count) > settings.second for one in fewer)


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
