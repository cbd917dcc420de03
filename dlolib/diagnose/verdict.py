"""What was found, put together as a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dlolib.diagnose.ask import Asked
from dlolib.diagnose.branches import told_sides
from dlolib.diagnose.decide import Decision, probabilities, wrong_same_size
from dlolib.diagnose.estimates import Alternatives, estimates
from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.heldout import BlackBox, Foretold
from dlolib.diagnose.locate import Scan
from dlolib.diagnose.noise import NoiseTold
from dlolib.diagnose.nuisances import mounted_otherwise
from dlolib.diagnose.residuals import helps, slow_modes
from dlolib.diagnose.say import named, summary
from dlolib.diagnose.search import Searched
from dlolib.diagnose.study import Study
from dlolib.identify.identify import rms
from dlolib.identify.problem import axes
from dlolib.types import (
    Candidate,
    Detectable,
    Floats,
    NextMotion,
    Quality,
    SeenNoise,
    Verdict,
)

NEXT = "next_motion.csv"


@dataclass(frozen=True)
class Found:
    """All that a verdict is made of.

    noise: of the first recording, and where it comes from. others: the winner with its effects in other
    forms, or elsewhere. foretold: what contenders, by their effects, leave of the held-out frames.
    """

    study: Study
    noise: NoiseTold
    searched: Searched
    decision: Decision
    others: tuple[Fitted, ...]
    scans: tuple[Scan, ...]
    detectable: tuple[Detectable, ...]
    foretold: Mapping[tuple[str, ...], Foretold]
    black_box: BlackBox | None
    asked: Asked | None


def verdict_of(found: Found) -> Verdict:
    """The verdict."""
    study, decision = found.study, found.decision
    noise, source = found.noise.noise, found.noise.whence
    base = _quality(found, found.searched.baseline)
    best = _quality(found, decision.winner, _beside(found)) if decision.winner.effects else base
    share = probabilities(study, found.searched)
    told = decision.status in ("explained", "ambiguous") or helps(decision.winner, found.searched.baseline)
    names = decision.winner.effects if told else ()
    # what each recording has for itself goes with the model that `Verdict.fit` hands on
    kept = decision.winner if told else found.searched.baseline
    effects = tuple(named(study, name, share[name], best.parameters) for name in names)
    mismatch = decision.status != "no_mismatch"
    where = sorted((p for s in found.scans for p in s.places), key=lambda p: -p.strength) if mismatch else []
    recordings = tuple(one.recording.name for one in study.seen)
    asked = None if found.asked is None else found.asked.says
    words = summary(decision, effects, where, base, best, asked, len(study.seen) > 1)
    return Verdict(
        summary=" ".join([words, *mounted_otherwise(kept.point, recordings), *told_sides(study)]),
        recordings=recordings,
        status=decision.status,
        noise=SeenNoise(noise.sigma_m, noise.correlation_points, noise.correlation_frames, source),
        baseline=base,
        nuisances={name: estimates(study, kept, k) for k, name in enumerate(recordings)},
        where=tuple(where),
        effects=effects,
        candidates=_candidates(found),
        equivalent=tuple(one.effects for one in decision.tie),
        augmented=best,
        detectable=found.detectable,
        next_motion=_next_motion(found),
        rope=study.seen[0].recording.rope,
    )


def _next_motion(found: Found) -> NextMotion | None:
    if found.asked is None:
        return None
    one, other = found.decision.tie[:2]
    return NextMotion(NEXT, found.asked.says, (one.effects, other.effects), found.asked.expected)


def simulated(study: Study, model: Fitted, k: int) -> Floats:
    """The points of recording k in a fitted model, (P, 3) [m]."""
    return np.asarray(study.seen[k].model.predict(study.rod(k, model.values(k))).xyz_m + model.offsets_m[k])


def _rmse(study: Study, model: Fitted) -> float:
    """Distances of observed and simulated points [m], over the observed axes."""
    off = []
    for k, one in enumerate(study.seen):
        left = simulated(study, model, k)[:, axes(one.model)] - one.observed_m
        off.append(np.linalg.norm(left, axis=1))
    return rms(np.concatenate(off))


def _beside(found: Found) -> Alternatives:
    """What may be right in the winner's place."""
    base = found.searched.baseline
    return Alternatives(base, (base, *found.searched.models, *found.others))


def _quality(found: Found, model: Fitted, beside: Alternatives | None = None) -> Quality:
    slow = slow_modes(model)
    ahead = found.foretold.get(model.effects)
    return Quality(
        estimates(found.study, model, None, beside), _rmse(found.study, model),
        None if ahead is None else ahead.rmse_m, slow.energy, slow.p_value,
    )  # fmt: skip


def _candidates(found: Found) -> tuple[Candidate, ...]:
    """Every model fitted, best first; the wrong one of the winner's size and the black box marked."""
    study, base = found.study, found.searched.baseline
    frames = study.frames
    models = sorted((base, *found.searched.models), key=lambda one: one.bic(frames))
    best = models[0].bic(frames)
    wrong = wrong_same_size(models, found.decision)
    rows = []
    for one in models:
        change, error, rmse_m = _ahead(found, found.foretold.get(one.effects))
        slow = slow_modes(one).energy
        row = Candidate(
            one.effects, "library", one.bic(frames) - best, change, error, slow, _rmse(study, one), rmse_m
        )
        rows.append(row)
        if one is wrong:
            rows.append(replace(row, kind="wrong_same_size"))
    if found.black_box is not None:
        box = found.black_box
        change, error, rmse_m = _ahead(found, box.heldout)
        behind = max(box.bic(frames) - best, 0.0)
        row = Candidate((), "black_box", behind, change, error, box.energy, box.fitted.rmse_m, rmse_m)
        rows.append(row)
    return tuple(sorted(rows, key=lambda one: one.delta_bic))


def _ahead(found: Found, one: Foretold | None) -> tuple[float | None, float | None, float | None]:
    """Change in χ² on the held-out frames against the baseline, its standard error, and the distance [m]."""
    base = found.foretold.get(found.searched.baseline.effects)
    if one is None or base is None:
        return None, None, None
    return (*one.against(base), one.rmse_m)


__all__ = ["NEXT", "Found", "simulated", "verdict_of"]
