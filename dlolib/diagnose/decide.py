"""Which model the recordings speak for, and whether they speak clearly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.heldout import Foretold, refuted
from dlolib.diagnose.residuals import explains, slow_modes
from dlolib.diagnose.search import Searched
from dlolib.diagnose.study import DiagnoseSettings, Study, ideal

Effects = tuple[str, ...]
Status = Literal["no_mismatch", "explained", "ambiguous", "unexplained"]
# Slow residuals this unlikely are a mismatch even where no effect takes them up.
ALARMING = 1e-5
MOST_TIED = 3
# So many of the best models are compared on held-out motion, whatever was decided; a figure shows as many.
COMPARED = 10
# What an ideal law leaves because the rope's is of another form, as a share of what it explains, at most.
OFF = 0.01
# Another ideal law in place of the rope's may explain more than that itself, by this share at most.
IMITATED = 0.02


@dataclass(frozen=True)
class Decision:
    """The winner (the baseline, where nothing is missing) and, where it is a tie, all models of it.

    refuted: the winner foretells worse than the elastic rod.
    """

    status: Status
    winner: Fitted
    tie: tuple[Fitted, ...] = ()
    refuted: bool = False


def decide(
    study: Study,
    searched: Searched,
    settings: DiagnoseSettings,
    foretold: Mapping[Effects, Foretold] | None = None,
) -> Decision:
    """The verdict's status, winner and tie.

    Held-out motion has two things to say: what foretells it worse than the elastic rod explains nothing, and
    what another model foretells better of it makes up for what it fits worse.
    """
    frames, base, foretold = study.frames, searched.baseline, foretold or {}
    wrong = refuted(foretold)
    models = [one for one in searched.models if _earned(one, searched, settings)]
    best = models[0] if models else base
    if not models or best.bic(frames) > base.bic(frames):
        slow = slow_modes(base.residuals, len(base.unknowns))
        return Decision("unexplained" if slow.p_value < ALARMING else "no_mismatch", base)
    if best.effects in wrong or not explains(best, base):
        return Decision("unexplained", best, refuted=best.effects in wrong)
    tie = [one for one in _tied(study, models, base, settings, foretold) if one.effects not in wrong]
    tie = tie[:MOST_TIED]
    if len(tie) > 1:
        return Decision("ambiguous", best, tuple(tie))
    return Decision("explained", best)


def contenders(study: Study, searched: Searched, settings: DiagnoseSettings) -> list[Fitted]:
    """The models to be compared on held-out motion: the elastic rod, those that may win or tie, the wrong one
    of the winner's size, and the best others. A roll-out on two meshes each is dear."""
    base, earned = searched.baseline, [one for one in searched.models if _earned(one, searched, settings)]
    wrong = wrong_same_size(searched.models, decide(study, searched, settings))
    some = [base, *searched.models[:COMPARED], *_tied(study, earned, base, settings, {})]
    return list({one.effects: one for one in (*some, wrong) if one is not None}.values())


def wrong_same_size(models: Sequence[Fitted], decision: Decision) -> Fitted | None:
    """The best model with as many parameters as the winner that is not of the tie."""
    right = {one.effects for one in (decision.tie or (decision.winner,))}
    many = decision.winner.parameters
    return next((m for m in models if m.effects and m.effects not in right and m.parameters == many), None)


def _tied(
    study: Study,
    models: Sequence[Fitted],
    base: Fitted,
    settings: DiagnoseSettings,
    foretold: Mapping[Effects, Foretold],
) -> list[Fitted]:
    """The first of the models, and those that are as good without having all of its effects and more."""
    if not models:
        return []
    best, frames = models[0], study.frames

    def behind(one: Fitted) -> float:
        """By how much in BIC, less what it foretells better of held-out motion."""
        told, by_best = foretold.get(one.effects), foretold.get(best.effects)
        ahead = 0.0 if told is None or by_best is None else -told.against(by_best)[0]
        return one.bic(frames) - best.bic(frames) - max(ahead, 0.0)

    good = [one for one in models if behind(one) < _margin(one, best, base, settings)]
    return [one for one in good if one is best or not set(best.effects) < set(one.effects)]


def _margin(model: Fitted, best: Fitted, base: Fitted, settings: DiagnoseSettings) -> float:
    """By how much more in BIC a model is as good as the best: where it has another ideal law in its place,
    that may be no more than the laws' forms."""
    differ = set(model.effects) ^ set(best.effects)
    forms = all(map(ideal, differ)) and len(model.effects) == len(best.effects)
    return max(settings.tie, IMITATED * (base.chi2 - best.chi2) if forms else 0.0)


def _earned(model: Fitted, searched: Searched, settings: DiagnoseSettings) -> bool:
    """Whether every effect is worth its place beside any fewer of them, down to none."""
    base = searched.baseline
    fewer = [one for one in (base, *searched.models) if set(one.effects) < set(model.effects)]
    return all(_better(model, one, base, settings) for one in fewer)


def _better(model: Fitted, fewer: Fitted, base: Fitted, settings: DiagnoseSettings) -> bool:
    """Whether more effects gain more than chance would, and more than a law's form is off."""
    gain = fewer.chi2 - model.chi2
    if any(map(ideal, fewer.effects)) and gain < OFF * (base.chi2 - fewer.chi2):
        return False
    return model.by_chance(fewer) < settings.chance


def probabilities(study: Study, searched: Searched) -> dict[str, float]:
    """Of each effect: the share of the models with it, by exp(-BIC / 2)."""
    models = [searched.baseline, *searched.models]
    scores = np.array([one.bic(study.frames) for one in models])
    weights = np.exp(-0.5 * (scores - scores.min()))
    weights /= weights.sum()
    names = {name for one in models for name in one.effects}
    return {
        name: float(sum(w for w, one in zip(weights, models, strict=True) if name in one.effects))
        for name in names
    }
