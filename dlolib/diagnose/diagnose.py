"""From recordings to a verdict: what physics is missing, where, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dlolib.diagnose.alternatives import alternatives
from dlolib.diagnose.ask import next_motion
from dlolib.diagnose.branches import on_the_side_seen
from dlolib.diagnose.decide import contenders, decide
from dlolib.diagnose.detect import asked, detectable, sized
from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.heldout import black_box, foretell
from dlolib.diagnose.locate import Reversal, reversal, scan
from dlolib.diagnose.meshes import fine_enough
from dlolib.diagnose.noise import NoiseTold, known_noise, noise_left
from dlolib.diagnose.nuisances import before, between
from dlolib.diagnose.search import Searched, baseline, once_more, search, searched_again, simulated_once
from dlolib.diagnose.study import Bools, DiagnoseSettings, Seen, Study, acting_only, seen_as
from dlolib.diagnose.verdict import Found, simulated, verdict_of
from dlolib.diagnose.whitening import Whitener, grid_of, lasting
from dlolib.diagnose.workers import Workers
from dlolib.errors import ParameterError
from dlolib.identify.identify import FIRST_STIFFNESS_M4_S2, check_loaded
from dlolib.identify.parameters import SOFTEST_M4_S2
from dlolib.identify.problem import axes, check_held_ends, check_one_object, seen_axes
from dlolib.sim.upright import ROLL, as_logged, unrolled
from dlolib.types import Floats, Noise, Recording, Verdict

FEWEST_POINTS, FEWEST_FRAMES = 12, 2
# Fewer frames than this are not worth splitting.
SPLIT = 8
# What the noise is taken for until an elastic rod is fitted.
FIRST_NOISE = Noise(1e-3, 0.0, 0.0)
Known = Sequence[NoiseTold | None]


@dataclass(frozen=True)
class Diagnosis:
    """The verdict and what its figures and tables are drawn from.

    simulated_m: points of the baseline and of the winner, for each recording (P, 3) [m].
    """

    verdict: Verdict
    found: Found
    reversal: Reversal
    simulated_m: tuple[tuple[Floats, Floats], ...]


def diagnose(recordings: Sequence[Recording], settings: DiagnoseSettings) -> Diagnosis:
    """Diagnose recordings of one object together.

    Raises:
        ParameterError: too little was seen, or the recordings are of different objects.
    """
    _check(recordings)
    known = [known_noise(recording) for recording in recordings]
    with Workers(settings.workers) as run:
        study, told = _study(recordings, known, run, settings)
        searched = search(study, settings, run)
        sided, fits = on_the_side_seen(study, searched, settings, run)
        if sided is not study:
            study = sided
            searched = search(study, settings, run, fits)
        best = _best(searched)
        finer = fine_enough(study, best, settings, partial(once_more, best))
        if finer is not study:
            study = finer
            run.begin(study)
            # the best model on the first mesh, too, lest it be missed on this one
            searched = search(study, settings, run, [*fits, *searched.models[:1]])
        if not all(known):
            told = _told_by(study, _best(searched), known)
            study = _with_noise(study, told)
            run.begin(study)
            searched = searched_again(study, searched, run)
        base, compared = searched.baseline, contenders(study, searched, settings)
        beside = sized(study, base, settings.chance)
        sizes = [(beside, size) for size in asked(study, settings.without)]
        seen = run(detectable, sizes, "what can be seen")
        scans = run(scan, [(base, k, settings.seed) for k in range(len(recordings))], "where")
        foretold, boxes = [], [None]
        if study.ahead:
            foretold = run(foretell, compared, "held-out frames")
            boxes = run(black_box, [(base, settings.seed)], "black box")
        pairs = zip(compared, foretold, strict=False)
        ahead = {one.effects: told for one, told in pairs if told is not None}
        decision = decide(study, searched, settings, ahead, scans)
        others = alternatives(study, searched, decision.winner, settings, run)
        motion = next_motion(study, searched, decision, settings, run)
    if motion is not None:
        motion = replace(motion, motion=as_logged(motion.motion, recordings[0]))
    found = Found(
        study, told[0], searched, decision, tuple(others), tuple(scans), tuple(seen), ahead, boxes[0], motion
    )  # fmt: skip
    points = [
        (simulated(study, base, k), simulated(study, decision.winner, k)) for k in range(len(recordings))
    ]
    return Diagnosis(verdict_of(found), found, reversal(study, base), tuple(points))


def _check(recordings: Sequence[Recording]) -> None:
    check_one_object(recordings)
    check_loaded(recordings, SOFTEST_M4_S2, "it weighs nothing")
    for recording in recordings:
        fitted = _fitted_points(recording, 0.0)
        points, frames = int(fitted.sum()), len(np.unique(recording.points.frame[fitted]))
        if points < FEWEST_POINTS or frames < FEWEST_FRAMES:
            problem = f"{recording.name} has {points} points in {frames} frames that are not held out"
            mend = f"a diagnosis needs {FEWEST_FRAMES} frames and {FEWEST_POINTS} points"
            raise ParameterError(problem, place="points.csv", mend=mend)
        check_held_ends(recording)


def _study(
    recordings: Sequence[Recording], known: Known, run: Workers, settings: DiagnoseSettings
) -> tuple[Study, list[NoiseTold]]:
    """The recordings with their noise, and what tells of it."""
    told = [one or NoiseTold(FIRST_NOISE, "") for one in known]
    raw = _with_noise(raw_study(recordings, settings, [one.wider for one in told]), told)
    run.begin(raw, simulated_once)
    study = acting_only(raw, FIRST_STIFFNESS_M4_S2)
    study = fine_enough(study, baseline(study), settings, baseline)
    if not all(known):
        told = _told_by(study, baseline(study), known)
        study = _with_noise(study, told)
    run.begin(study)
    return study, told


def raw_study(
    recordings: Sequence[Recording], settings: DiagnoseSettings, wider: Sequence[float] | None = None
) -> Study:
    """The recordings as a study, whose noise is not known yet; `wider`, by how much more than their points'
    covariances say they scatter."""
    scales = dict(zip((one.name for one in recordings), wider or (), strict=bool(wider)))
    declared = any(one.heldout_frames is not None for one in recordings)
    used = [_fitted_points(one, 0.0 if declared else settings.heldout_share) for one in recordings]

    def seen(one: Recording, some: Bools) -> Seen:
        grid, covariance = grid_of(one, some), _covariance(one, some, scales.get(one.name, 1.0))
        always = lasting(one, some, grid, covariance)
        whitener = Whitener(grid, FIRST_NOISE, covariance, always)
        return seen_as(one, some, whitener, settings)

    both = list(zip(recordings, used, strict=True))
    most = settings.most_frames
    ahead = {k: seen(one, _thinned(one, ~mine, most)) for k, (one, mine) in enumerate(both) if not mine.all()}
    fitted = tuple(seen(one, _thinned(one, mine, most)) for one, mine in both)
    rolls = (ROLL,) if any(map(unrolled, recordings)) else ()
    return Study(fitted, between(recordings), before(recordings), rolls=rolls, ahead=ahead)


def _told_by(study: Study, model: Fitted, known: Known) -> list[NoiseTold]:
    """The noise of every recording: what is known of it, or what a model leaves of it tells."""
    told = []
    for k, (one, told_before) in enumerate(zip(study.seen, known, strict=True)):
        left = simulated(study, model, k)[:, axes(one.model)] - one.observed_m
        told.append(told_before or noise_left(one.recording, left))
    return told


def _with_noise(study: Study, told: Sequence[NoiseTold]) -> Study:
    def changed(one: Seen, k: int) -> Seen:
        return replace(one, whitener=replace(one.whitener, noise=told[k].noise))

    seen = tuple(changed(one, k) for k, one in enumerate(study.seen))
    return replace(study, seen=seen, ahead={k: changed(one, k) for k, one in study.ahead.items()})


def _best(searched: Searched) -> Fitted:
    return searched.models[0] if searched.models else searched.baseline


def _covariance(recording: Recording, used: Bools, wider: float) -> Floats | None:
    covariance = recording.points.covariance_m2
    if covariance is None:
        return None
    seen = seen_axes(recording)
    return np.asarray(wider**2 * covariance[used][:, seen][:, :, seen])


def _fitted_points(recording: Recording, share: float) -> Bools:
    """Which points (P,) are fitted: all but the held-out frames; where none are declared, but this share of
    the frames, the last ones."""
    frame = recording.points.frame
    if recording.heldout_frames is not None:
        first, last = recording.heldout_frames
        return np.asarray((frame < first) | (frame > last))
    frames = np.unique(frame)
    kept = len(frames) - int(share * len(frames)) if len(frames) >= SPLIT else len(frames)
    return np.asarray(frame <= frames[kept - 1])


def _thinned(recording: Recording, some: Bools, most: int) -> Bools:
    """Which of some points (P,) are looked at: those of all their frames, or of so many that the whole
    recording has no more than `most`, evenly spread and from the first of them on; two frames at least."""
    frame = recording.points.frame
    mine, number = np.unique(frame[some], return_inverse=True)
    every = int(np.ceil(len(np.unique(frame)) / most))
    kept = np.zeros_like(some)
    kept[some] = number % min(every, max(len(mine) - 1, 1)) == 0
    return kept


__all__ = ["Diagnosis", "diagnose", "raw_study"]
