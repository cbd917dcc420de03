"""The next motion: the one of a menu after which what is still in question can be told apart best.

A model is out of question once it fits worse than the best by more than chance, and by more than the forms of
laws may be off, a share of what it explains (`decide`). Both it and that share grow with a motion: the one
that shows a difference largest need not be the one that tells the two apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlolib.diagnose.decide import Decision, imitated
from dlolib.diagnose.fitting import Fitted, Hypothesis, promise
from dlolib.diagnose.menu import FEWEST_ROWS, menu
from dlolib.diagnose.nuisances import PRIORS, held
from dlolib.diagnose.search import Searched
from dlolib.diagnose.study import DiagnoseSettings, Seen, Study
from dlolib.diagnose.whitening import Whitener, grid_of
from dlolib.diagnose.workers import Workers
from dlolib.errors import DloError
from dlolib.identify.parameters import Unknown
from dlolib.sim.poses import model_of
from dlolib.types import Motion, Points, Recording

# Frames of a motion that was not made yet, and points of each.
FRAMES, POINTS = 60, 30
# So many models beside the tie are looked at: laws that would stand for the best once it explains less.
BESIDE = 3


@dataclass(frozen=True)
class Asked:
    """A motion from the last pose on (t_s from 0), what it is, and the ΔBIC of the tie that it promises."""

    motion: Motion
    says: str
    expected: float


@dataclass(frozen=True)
class Told:
    """What a motion tells of pairs of models, and of the best and the elastic rod: χ² left between them."""

    pairs: tuple[float, ...]
    elastic: float

    def over(self, tie: float, shares: Sequence[float]) -> float:
        """By how many times every pair is further apart than chance and forms allow, `shares` of what is
        explained."""
        explained = [max(self.elastic - left, 0.0) for left in self.pairs]
        allowed = [tie + share * much for share, much in zip(shares, explained, strict=True)]
        return min(left / some for left, some in zip(self.pairs, allowed, strict=True))


def next_motion(
    study: Study, searched: Searched, decision: Decision, settings: DiagnoseSettings, run: Workers
) -> Asked | None:
    """The motion of the menu that tells the tie apart best; None where none can be made or none would."""
    motion = study.seen[0].recording.motion
    if len(decision.tie) < 2 or len(motion.t_s) < FEWEST_ROWS or np.isnan(motion.end_m).all():
        return None
    best, others = decision.tie[0], rivals(searched, decision)
    # of a model and a larger one the larger is the one to be played: it can show all that the other does
    pairs = [(other, best) if set(best.effects) < set(other.effects) else (best, other) for other in others]
    shares = [imitated(model, shown) for shown, model in pairs]
    motions = menu(motion)
    found = run(_told_by, [(one, best, searched.baseline, pairs) for _, one in motions], "next motion")
    asked, most = None, 1.0
    for (says, one), told in zip(motions, found, strict=True):
        clear = 0.0 if told is None else told.over(settings.tie, shares)
        if told is not None and clear > most:
            asked, most = Asked(one, says, told.pairs[0]), clear
    return asked


def rivals(searched: Searched, decision: Decision) -> list[Fitted]:
    """What the best must be told from: the rest of the tie, and the best of other laws in its place."""
    best, *tied = decision.tie
    known = {one.effects for one in decision.tie}
    more: dict[tuple[str, ...], Fitted] = {}
    for one in searched.models:
        if one.effects not in known and not set(best.effects) < set(one.effects) and imitated(one, best):
            more.setdefault(one.effects, one)
    return [*tied, *list(more.values())[:BESIDE]]


Job = tuple[Motion, Fitted, Fitted, Sequence[tuple[Fitted, Fitted]]]


def _told_by(study: Study, job: Job) -> Told | None:
    motion, best, elastic, pairs = job
    try:
        longer = _longer(study, motion)
        return Told(tuple(_left(longer, *pair) for pair in pairs), _left(longer, best, elastic))
    except DloError:
        return None


def _left(study: Study, shown: Fitted, model: Fitted) -> float:
    """χ² that stays when a model is fitted, by a linear step, to what another would show."""
    own = [unknown for unknown in study.nuisances if unknown not in model.unknowns]
    # the offsets at which the model shown leaves nothing
    offsets_m = [
        one.recording.points.xyz_m - one.model.predict(study.rod(k, shown.values(k))).xyz_m
        for k, one in enumerate(study.seen)
    ]
    other = Hypothesis(study, model.effects, (*model.unknowns, *own), tuple(offsets_m))
    return promise(other, np.append(model.theta, np.zeros(len(own))))


def _longer(study: Study, more: Motion) -> Study:
    """The study with a further recording, of the first's rope moved on."""
    seen, number = study.seen[0], len(study.seen)
    recording = _continued(seen.recording, more)
    whitener = Whitener(grid_of(recording, np.ones(FRAMES * POINTS, dtype=bool)), seen.whitener.noise)
    model = model_of(recording, seen.model.particles, getattr(seen.model, "step_s", None))
    own = {Unknown(name, number): prior for name, prior in PRIORS.items() if held(recording, name)}
    return replace(study, seen=(*study.seen, Seen(model, whitener)), nuisances={**study.nuisances, **own})


def _continued(recording: Recording, more: Motion) -> Recording:
    """The recording moved on, seen only in the further motion."""
    motion = recording.motion
    begin = float(motion.t_s[-1])
    parts = {
        name: np.concatenate([getattr(motion, name), getattr(more, name)[1:]])
        for name in ("start_m", "start_q", "end_m", "end_q")
    }
    whole = Motion(np.concatenate([motion.t_s, begin + more.t_s[1:]]), **parts)
    t = begin + np.linspace(0, more.t_s[-1], FRAMES + 1)[1:]
    s = np.linspace(0, recording.rope.length_m, POINTS)
    frame = np.repeat(np.arange(FRAMES), POINTS)
    points = Points(frame, np.repeat(t, POINTS), np.tile(s, FRAMES), np.zeros((FRAMES * POINTS, 3)))
    return replace(recording, motion=whole, points=points)


__all__ = ["Asked", "next_motion"]
