"""Which model the recordings speak for, and whether they speak clearly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.heldout import WORSE, Foretold, refuted
from dlolib.diagnose.locate import Scan
from dlolib.diagnose.residuals import IDEALLY, explains, slow_modes
from dlolib.diagnose.search import Searched
from dlolib.diagnose.study import DiagnoseSettings, Study, ideal, placed

Effects = tuple[str, ...]
Status = Literal["no_mismatch", "explained", "ambiguous", "unexplained"]
# Slow residuals, or gains of a local probe, this unlikely are a mismatch even where no effect takes them up.
ALARMING = 1e-5
MOST_TIED = 3
# So many of the best models, and of those that earned their place, are compared on held-out motion, whatever
# was decided; a figure shows as many.
COMPARED = 10
# With nothing there, the best of all places in space gains what chance would at one of so many: set on 60
# recordings of the proof's laboratory with nothing missing, whose seeds no proof has (`make proof-touch`).
ANYWHERE = 100
# What an ideal law leaves because the rope's is of another form, as a share of what it explains, at most.
OFF = 0.01
# Other ideal laws in place of the rope's or beside it may explain more than that itself, by this share.
IMITATED = 0.1


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
    scans: Sequence[Scan] = (),
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
        # slow modes do not see what is short, a scan not what is all over
        alarming = min(slow_modes(base).p_value, *(one.p_value for one in scans), 1.0) < ALARMING
        return Decision("unexplained" if alarming else "no_mismatch", base)
    if best.effects in wrong or not explains(best, base):
        return Decision("unexplained", best, refuted=best.effects in wrong)
    tie = _tied(study, models, base, settings, foretold)
    tie += _doubtful(study, searched, best, settings, foretold)
    tie = [one for one in tie if one.effects not in wrong][:MOST_TIED]
    if len(tie) > 1:
        return Decision("ambiguous", best, tuple(tie))
    return Decision("explained", best)


def contenders(study: Study, searched: Searched, settings: DiagnoseSettings) -> list[Fitted]:
    """The models to be compared on held-out motion: the elastic rod, those that may win or tie, the wrong one
    of the winner's size, the best that earned their place and the best others. A roll-out on two meshes each
    is dear."""
    base, earned = searched.baseline, [one for one in searched.models if _earned(one, searched, settings)]
    wrong = wrong_same_size(searched.models, decide(study, searched, settings))
    some = [base, *searched.models[:COMPARED], *earned[:COMPARED], *_tied(study, earned, base, settings, {})]
    some += _doubtful(study, searched, earned[0], settings, {}) if earned else []
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
    """The first of the models, and those that are as good without having more than another of them has.

    As good is what is no further behind in BIC than a tie, or than laws' forms may put it, and no further on
    held-out motion than chance or these may.
    """
    if not models:
        return []
    best, frames = models[0], study.frames

    def behind(one: Fitted) -> float:
        """By how much in BIC, less what it foretells better of held-out motion."""
        told, by_best = foretold.get(one.effects), foretold.get(best.effects)
        ahead = 0.0 if told is None or by_best is None else -told.against(by_best)[0]
        return one.bic(frames) - best.bic(frames) - max(ahead, 0.0)

    def good(one: Fitted) -> bool:
        share = imitated(one, best)
        allowed = max(settings.tie, share * (base.chi2 - one.chi2))
        return behind(one) < allowed and _as_far(one, best, foretold, share)

    tie = [one for one in models if good(one)]
    return [one for one in tie if one is best or not any(set(o.effects) < set(one.effects) for o in tie)]


def imitated(model: Fitted, best: Fitted) -> float:
    """The share of what a model explains by which the best may explain more for its laws' forms alone.

    That is so where the model has an ideal law, and the best has others in its place or beside it; and where
    it has one and lacks what else the best has. A model without any has no form that others might stand for.
    """
    if not _has_law(model):
        return 0.0
    differ = set(model.effects) ^ set(best.effects)
    if all(map(ideal, differ)) and len(model.effects) <= len(best.effects):
        return IMITATED
    return IDEALLY if set(model.effects) < set(best.effects) else 0.0


def _has_law(model: Fitted) -> bool:
    return any(map(ideal, model.effects))


def _as_far(model: Fitted, best: Fitted, foretold: Mapping[Effects, Foretold], share: float) -> bool:
    """Whether a model foretells held-out motion as well as the best but for that share and for chance.

    Not asked where the best has a further ideal law beside the model's: both are then one law of another
    form, which neither foretells.
    """
    further = set(best.effects) - set(model.effects)
    if _has_law(model) and set(model.effects) < set(best.effects) and all(map(ideal, further)):
        return True
    told, by_best, elastic = (foretold.get(effects) for effects in (model.effects, best.effects, ()))
    if told is None or by_best is None or elastic is None:
        return True
    worse, error = told.against(by_best)
    return worse <= share * max(elastic.against(told)[0], 0.0) + WORSE * (error or 0.0)


def _doubtful(
    study: Study,
    searched: Searched,
    best: Fitted,
    settings: DiagnoseSettings,
    foretold: Mapping[Effects, Foretold],
) -> list[Fitted]:
    """What the best model lacks perhaps: the best of those with a further effect that is not worth its place.

    Such a one gains more than chance would but no more than a law's form may be off, and held-out motion does
    not speak against it by more than chance. Or it gains no more than chance might but more in BIC than a
    tie, and held-out motion speaks for it.
    """
    by_best, frames = foretold.get(best.effects), study.frames

    def doubted(one: Fitted) -> bool:
        told = foretold.get(one.effects)
        worse, error = (0.0, None) if told is None or by_best is None else told.against(by_best)
        if _beyond_chance(one, searched, settings):
            return not _beyond_form(one, searched) and worse <= WORSE * (error or 0.0)
        return one.bic(frames) + settings.tie < best.bic(frames) and worse <= 0

    found = [one for one in searched.models if set(best.effects) < set(one.effects) and doubted(one)]
    least = min((one.bic(frames) for one in found), default=np.inf)
    return [one for one in found if one.bic(frames) < least + settings.tie]


def _earned(model: Fitted, searched: Searched, settings: DiagnoseSettings) -> bool:
    """Whether every effect is worth its place beside any fewer of them, down to none."""
    return _beyond_chance(model, searched, settings) and _beyond_form(model, searched)


def _beyond_chance(model: Fitted, searched: Searched, settings: DiagnoseSettings) -> bool:
    """Whether every effect gains more than chance would, one with a place in space at any of many places."""

    def chance(fewer: Fitted) -> float:
        anywhere = any(map(placed, set(model.effects) - set(fewer.effects)))
        return settings.chance / (ANYWHERE if anywhere else 1)

    return all(model.by_chance(fewer) < chance(fewer) for fewer in _fewer(model, searched))


def _beyond_form(model: Fitted, searched: Searched) -> bool:
    """Whether what stands beside an ideal law gains more than that law's form may be off."""
    base = searched.baseline
    laws = [fewer for fewer in _fewer(model, searched) if _has_law(fewer)]
    return all(fewer.chi2 - model.chi2 >= OFF * (base.chi2 - fewer.chi2) for fewer in laws)


def _fewer(model: Fitted, searched: Searched) -> list[Fitted]:
    """The models with some of its effects, down to none."""
    return [one for one in (searched.baseline, *searched.models) if set(one.effects) < set(model.effects)]


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
