"""The next motion: the one of a menu that best settles what is still in question.

A model is out of question once it is behind the best by more than a tie, and by more than the forms of laws
may be off, a share of what it explains (`decide`). How far it is behind and that share both grow with a
motion: the one that shows a difference largest need not be the one that settles it. Where none of the menu
promises enough, a second one follows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from dlolib.diagnose.decide import Decision, imitated
from dlolib.diagnose.fitting import Fitted, Hypothesis, promise
from dlolib.diagnose.menu import FEWEST_ROWS, menu, then
from dlolib.diagnose.nuisances import PRIORS, held
from dlolib.diagnose.search import Searched
from dlolib.diagnose.study import DiagnoseSettings, Seen, Study
from dlolib.diagnose.whitening import Whitener, grid_of
from dlolib.diagnose.workers import Workers
from dlolib.errors import DloError
from dlolib.identify.parameters import Unknown
from dlolib.sim.recording import RecordingModel
from dlolib.types import Motion, Points, Recording

# Points of a frame of a motion that was not made yet, and the fewest frames of it.
POINTS, FEWEST_FRAMES = 30, 2
TINY = 1e-9
# What is left between two models scatters by twice the root of χ²: one time in twenty so many roots are
# missing. A motion that even then leaves so many times what must be is enough.
LESS, ENOUGH = 3.3, 2.0
# So many models beside the tie are looked at: laws that would stand for the best once it explains less.
BESIDE = 3


@dataclass(frozen=True)
class Asked:
    """A motion from the last pose on (t_s from 0), what it is, the ΔBIC of the tie that it promises, and how
    many times what must be, of the pair for which it is least: expected, and where chance leaves less."""

    motion: Motion
    says: str
    expected: float
    clear: float
    surely: float


@dataclass(frozen=True)
class Pair:
    """What a model would show, another that is fitted to it, and how far apart they must be.

    share: of what is explained, by which laws' forms may be off. least: χ² that chance leaves of them, where
    the one shown is the other with something further. further: parameters that the one shown has more.
    """

    shown: Fitted
    model: Fitted
    share: float
    least: float
    further: int

    def gain(self, left: float, frames: int) -> float:
        """What χ² left between them in so many frames is in BIC."""
        return left - self.further * float(np.log(frames))

    def over(self, left: float, elastic: float, frames: int, tie: float) -> float:
        """By how many times χ² left between them is more than must be; `elastic`: to the elastic rod."""
        allowed = max(tie, self.share * max(elastic - left, 0.0), TINY)
        clear = self.gain(left, frames) / allowed
        return min(clear, left / self.least) if self.least else clear


def next_motion(
    study: Study, searched: Searched, decision: Decision, settings: DiagnoseSettings, run: Workers
) -> Asked | None:
    """The shortest motion of the menu that settles the tie surely, or two of them; else the one that promises
    most. None where none can be made or none promises to."""
    recording = study.seen[0].recording
    motion = recording.motion
    if len(decision.tie) < 2 or len(motion.t_s) < FEWEST_ROWS:
        return None
    pairs = [paired(decision.tie[0], one, settings.chance) for one in rivals(searched, decision)]

    def promised(motions: Sequence[tuple[str, Motion]]) -> list[Asked]:
        frames = [frames_of(one, recording, settings.most_frames) for _, one in motions]
        jobs = [(one, many, pairs, searched.baseline) for (_, one), many in zip(motions, frames, strict=True)]
        found = run(_left_by, jobs, "next motion")
        some = []
        for (says, one), many, told in zip(motions, frames, found, strict=True):
            if told:
                whole = study.frames + many
                least = [least_over(pairs, told, whole, settings.tie, less) for less in (0.0, LESS)]
                some.append(Asked(one, says, pairs[0].gain(told[0][0], whole), *least))
        return some

    alone = promised(menu(motion))
    if not alone:
        return None
    best = _chosen(alone)
    if best.surely < ENOUGH:
        others = [one for one in alone if one is not best]
        more = [(f"{best.says}, then {one.says}", then(best.motion, one.motion)) for one in others]
        best = _chosen([best, *promised(more)])
    return best if best.clear > 1.0 else None


def _chosen(some: Sequence[Asked]) -> Asked:
    """The shortest that promises enough; where none does, the one that promises most."""
    enough = [one for one in some if one.surely >= ENOUGH]
    if enough:
        return min(enough, key=lambda one: float(one.motion.t_s[-1]))
    return max(some, key=lambda one: one.clear)


def least_over(
    pairs: Sequence[Pair], told: Sequence[tuple[float, float]], frames: int, tie: float, less: float
) -> float:
    """Of all pairs the least of `Pair.over`, where so many roots of what is left between them are missing.

    told: as `_left_by` gives it, of each pair.
    """
    missing = [(max(apart - less * np.sqrt(apart), 0.0), elastic) for apart, elastic in told]
    return min(pair.over(*one, frames, tie) for pair, one in zip(pairs, missing, strict=True))


def frames_of(motion: Motion, recording: Recording, most: int) -> int:
    """How many frames of a motion the camera takes that took the recording, up to so many that count."""
    every_s = float(np.median(np.diff(np.unique(recording.points.t_s))))
    return int(np.clip(motion.t_s[-1] / every_s, FEWEST_FRAMES, most))


def rivals(searched: Searched, decision: Decision) -> list[Fitted]:
    """What the best must be told from: the rest of the tie, and the best whose laws may stand for its own."""
    best, *tied = decision.tie
    known = {one.effects for one in decision.tie}
    more: dict[tuple[str, ...], Fitted] = {}
    for one in searched.models:
        if one.effects not in known and not set(best.effects) < set(one.effects) and imitated(one, best):
            more.setdefault(one.effects, one)
    return [*tied, *list(more.values())[:BESIDE]]


def paired(best: Fitted, other: Fitted, chance: float) -> Pair:
    """The best and a rival. Of a model and a larger one the larger is shown: it can do all the other does."""
    shown, model = (other, best) if set(best.effects) < set(other.effects) else (best, other)
    further = shown.parameters - model.parameters
    nested = set(model.effects) < set(shown.effects)
    least = float(stats.chi2.isf(chance, max(further, 1))) if nested else 0.0
    return Pair(shown, model, imitated(model, shown), least, further)


def _left_by(study: Study, job: tuple[Motion, int, Sequence[Pair], Fitted]) -> list[tuple[float, float]]:
    """Of each pair the χ² left between its two, and between the one shown and the elastic rod; of none where
    one of them cannot be simulated."""
    motion, frames, pairs, elastic = job
    try:
        longer = _longer(study, motion, frames)
        return [(left(longer, one.shown, one.model), left(longer, one.shown, elastic)) for one in pairs]
    except DloError:
        return []


def left(study: Study, shown: Fitted, model: Fitted) -> float:
    """χ² that stays when a model is fitted, by a linear step, to what another would show.

    What a recording has for itself is expected to be what it is in the model shown.
    """
    own = [unknown for unknown in study.nuisances if unknown not in model.unknowns]
    # the offsets at which the model shown leaves nothing
    offsets_m = [
        one.recording.points.xyz_m - one.model.predict(study.rod(k, shown.values(k))).xyz_m
        for k, one in enumerate(study.seen)
    ]
    expected = dict(zip(shown.unknowns, shown.theta.tolist(), strict=True))
    unknowns = (*model.unknowns, *own)
    other = Hypothesis(study, model.effects, unknowns, tuple(offsets_m), expected=expected)
    return promise(other, np.append(model.theta, [expected.get(one, 0.0) for one in own]))


def _longer(study: Study, more: Motion, frames: int) -> Study:
    """The study with a further recording, of the first's rope moved on with all that it remembers."""
    seen, number = study.seen[0], len(study.seen)
    recording = _continued(seen.recording, more, frames)
    whitener = Whitener(grid_of(recording, np.ones(frames * POINTS, dtype=bool)), seen.whitener.noise)
    if isinstance(seen.model, RecordingModel):
        model = replace(seen.model, recording=recording, sought=())  # it begins as it did
    else:
        model = RecordingModel(recording, seen.model.particles, None)  # from pose to pose in a straight line
    own = {Unknown(name, number): prior for name, prior in PRIORS.items() if held(recording, name)}
    return replace(study, seen=(*study.seen, Seen(model, whitener)), nuisances={**study.nuisances, **own})


def _continued(recording: Recording, more: Motion, frames: int) -> Recording:
    """The recording moved on, seen only in so many frames of the further motion."""
    motion = recording.motion
    begin = float(motion.t_s[-1])
    parts = {
        name: np.concatenate([getattr(motion, name), getattr(more, name)[1:]])
        for name in ("start_m", "start_q", "end_m", "end_q")
    }
    whole = Motion(np.concatenate([motion.t_s, begin + more.t_s[1:]]), **parts)
    t = begin + np.linspace(0, more.t_s[-1], frames + 1)[1:]
    s = np.linspace(0, recording.rope.length_m, POINTS)
    frame = np.repeat(np.arange(frames), POINTS)
    points = Points(frame, np.repeat(t, POINTS), np.tile(s, frames), np.zeros((frames * POINTS, 3)))
    return replace(recording, motion=whole, points=points)


__all__ = ["Asked", "next_motion"]
