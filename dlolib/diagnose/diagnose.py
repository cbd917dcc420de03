"""From recordings to a verdict: what physics is missing, where, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlolib.diagnose.ask import Asked, next_motion
from dlolib.diagnose.decide import Decision, decide, probabilities, slow_modes
from dlolib.diagnose.detect import Size, asked, detectable
from dlolib.diagnose.heldout import Foretold, black_box, foretell
from dlolib.diagnose.locate import Reversal, Scan, reversal, scan
from dlolib.diagnose.noise import Whitener, estimate_noise, grid_of, tells_noise
from dlolib.diagnose.say import named, summary
from dlolib.diagnose.search import Searched, baseline, runner, search
from dlolib.diagnose.study import Bools, DiagnoseSettings, Fitted, Study, acting_only, seen_as
from dlolib.errors import ParameterError, SimulationError
from dlolib.identify.identify import FIRST_STIFFNESS_M4_S2, rms
from dlolib.identify.problem import axes
from dlolib.sim.rod import unit_of
from dlolib.types import (
    Candidate,
    Detectable,
    Estimate,
    Floats,
    NextMotion,
    Noise,
    Quality,
    Recording,
    SeenNoise,
    Verdict,
)

FEWEST_POINTS, FEWEST_FRAMES = 12, 2
# Fewer frames than this are not worth splitting.
SPLIT = 8
Z95 = 1.959964
NEXT = "next_motion.csv"
# What the noise is taken for until an elastic rod is fitted.
FIRST_NOISE = Noise(1e-3, 0.0, 0.0)


@dataclass(frozen=True)
class Diagnosis:
    """The verdict and what its figures and tables are drawn from.

    simulated_m: points of the baseline and of the winner, for each recording (P, 3) [m].
    """

    verdict: Verdict
    study: Study
    searched: Searched
    decision: Decision
    scans: tuple[Scan, ...]
    reversal: Reversal
    asked: Asked | None
    simulated_m: tuple[tuple[Floats, Floats], ...]


def diagnose(recordings: Sequence[Recording], settings: DiagnoseSettings) -> Diagnosis:
    """Diagnose recordings of one object together.

    Raises:
        ParameterError: too little was seen, or the recordings are of different objects.
    """
    _check(recordings)
    used = [_fitted_points(recording, settings) for recording in recordings]
    noises = _noises(recordings, used, settings)
    study = _study(recordings, used, noises, settings)
    heldout = _heldout(recordings, used, noises, settings)
    with runner(study, settings.workers) as run:
        searched = search(study, settings, run)
        decision = decide(study, searched, settings)
        sizes = asked(study, settings.without)
        seen = run(
            _size_job, [(searched.baseline, size, settings.alarm) for size in sizes], "what can be seen"
        )
    scans = tuple(scan(study, searched.baseline, k, settings.seed) for k in range(len(recordings)))
    motion = next_motion(study, *decision.tie[:2]) if len(decision.tie) > 1 else None
    foretold = _foretold(study, heldout, searched)
    verdict = _verdict(
        study, searched, decision, scans, noises, foretold, heldout, tuple(seen), motion, settings
    )
    simulated = tuple(
        (_simulated(study, searched.baseline, k), _simulated(study, decision.winner, k))
        for k in range(len(recordings))
    )
    return Diagnosis(
        verdict, study, searched, decision, scans, reversal(study, searched.baseline), motion, simulated
    )


def _size_job(study: Study, job: tuple[Fitted, Size, float]) -> Detectable:
    base, size, alarm = job
    return detectable(study, base, size, alarm)


def _check(recordings: Sequence[Recording]) -> None:
    first = recordings[0]
    for recording in recordings:
        if recording.rope.name != first.rope.name or recording.rope.length_m != first.rope.length_m:
            problem = f"{recording.name} is of {recording.rope.name}, {first.name} of {first.rope.name}"
            raise ParameterError(problem, mend="diagnose recordings of one object together")
        points = recording.points
        if len(points.s_m) < FEWEST_POINTS or len(np.unique(points.frame)) < FEWEST_FRAMES:
            problem = (
                f"{recording.name} has {len(points.s_m)} points in {len(np.unique(points.frame))} frames"
            )
            mend = f"a diagnosis needs {FEWEST_FRAMES} frames and {FEWEST_POINTS} points"
            raise ParameterError(problem, place="points.csv", mend=mend)


def _fitted_points(recording: Recording, settings: DiagnoseSettings) -> Bools:
    """Which points (P,) are fitted: all but the held-out frames, the last ones where none are declared."""
    frame = recording.points.frame
    if recording.heldout_frames is not None:
        first, last = recording.heldout_frames
        return np.asarray((frame < first) | (frame > last))
    frames = np.unique(frame)
    if len(frames) < SPLIT:
        return np.ones(len(frame), dtype=bool)
    kept = len(frames) - int(settings.heldout_share * len(frames))
    return np.asarray(frame < frames[kept]) if kept < len(frames) else np.ones(len(frame), dtype=bool)


def _noises(
    recordings: Sequence[Recording], used: Sequence[Bools], settings: DiagnoseSettings
) -> list[tuple[Noise, str]]:
    """Of each recording; where nothing stands still, from the quick part of what an elastic rod leaves."""
    left = [recording.points.xyz_m for recording in recordings]
    if not all(tells_noise(recording) for recording in recordings):
        first = _study(recordings, used, [(FIRST_NOISE, "")] * len(recordings), settings)
        base = baseline(first)
        left = []
        for k, (recording, mine) in enumerate(zip(recordings, used, strict=True)):
            off = np.zeros_like(recording.points.xyz_m)
            off[mine] = _simulated(first, base, k) - recording.points.xyz_m[mine]
            left.append(off)
    found = []
    for recording, off, mine in zip(recordings, left, used, strict=True):
        planar = [0, 2] if recording.planar == "xz" else [0, 1, 2]
        found.append(estimate_noise(recording, off[:, planar], mine))
    return found


def _study(
    recordings: Sequence[Recording], used: Sequence[Bools], noises: Sequence[tuple[Noise, str]],
    settings: DiagnoseSettings,
) -> Study:  # fmt: skip
    seen = []
    for recording, mine, (noise, _) in zip(recordings, used, noises, strict=True):
        covariance = recording.points.covariance_m2
        planar = [0, 2] if recording.planar == "xz" else [0, 1, 2]
        known = None if covariance is None else covariance[mine][:, planar][:, :, planar]
        seen.append(seen_as(recording, mine, Whitener(grid_of(recording, mine), noise, known), settings))
    return acting_only(Study(tuple(seen)), FIRST_STIFFNESS_M4_S2)


def _heldout(
    recordings: Sequence[Recording], used: Sequence[Bools], noises: Sequence[tuple[Noise, str]],
    settings: DiagnoseSettings,
) -> Study | None:  # fmt: skip
    if not all((~mine).any() for mine in used):
        return None
    return _study(recordings, [~mine for mine in used], noises, settings)


def _foretold(study: Study, heldout: Study | None, searched: Searched) -> dict[tuple[str, ...], Foretold]:
    """Of the baseline and every model that the held-out motion can be simulated with, by its effects."""
    found: dict[tuple[str, ...], Foretold] = {}
    if heldout is None:
        return found
    for one in (searched.baseline, *searched.models):
        try:
            found[one.effects] = foretell(study, heldout, one)
        except SimulationError:
            continue
    return found


def _simulated(study: Study, model: Fitted, k: int) -> Floats:
    return np.asarray(study.seen[k].model.predict(study.rod(k, model.values(k))).xyz_m + model.offsets_m[k])


def _rmse(study: Study, model: Fitted) -> float:
    """Distances of observed and simulated points [m], over the observed axes."""
    off = []
    for k, one in enumerate(study.seen):
        left = _simulated(study, model, k)[:, axes(one.model)] - one.observed_m
        off.append(np.linalg.norm(left, axis=1))
    return rms(np.concatenate(off))


def estimates(study: Study, model: Fitted, recording: int | None) -> dict[str, Estimate]:
    """Parameters shared by all recordings, or those of one, with 95 % intervals from the curvature of χ²."""
    scale = slow_quick_scale(model)
    found = {}
    for n, (unknown, theta) in enumerate(zip(model.unknowns, model.theta, strict=True)):
        if unknown.recording != recording:
            continue
        half = Z95 * float(np.sqrt(max(model.covariance[n, n], 0.0) * scale))
        low, high = study.bounds(unknown)
        ends = [
            unknown.outward(end) if low < end < high and np.isfinite(end) else None
            for end in (theta - half, theta + half)
        ]
        name = unknown.name
        unit = unit_of(name)
        density = study.seen[0].recording.rope.linear_density_kg_m
        if unknown.stiffness and density is None:
            name, unit = f"{name}_over_density", "m^4/s^2"
        found[name] = Estimate(unknown.outward(float(theta)), ends[0], ends[1], unit)
    return found


def slow_quick_scale(model: Fitted) -> float:
    """Variance of the whitened residuals: more than 1 where the noise was taken for too small."""
    count = sum(grid.size for grid in model.residuals)
    return max(1.0, model.chi2 / max(count - len(model.theta), 1))


def _quality(study: Study, model: Fitted, foretold: dict[tuple[str, ...], Foretold]) -> Quality:
    slow = slow_modes(model.residuals, len(model.unknowns))
    ahead = foretold.get(model.effects)
    return Quality(
        estimates(study, model, None), _rmse(study, model), None if ahead is None else ahead.rmse_m,
        slow.energy, slow.p_value,
    )  # fmt: skip


def _candidates(
    study: Study, searched: Searched, decision: Decision, foretold: dict[tuple[str, ...], Foretold],
    heldout: Study | None, seed: int,
) -> tuple[Candidate, ...]:  # fmt: skip
    """Every model fitted, best first; the wrong one of the winner's size and the black box marked."""
    count, base = study.count, searched.baseline
    models = sorted((base, *searched.models), key=lambda one: one.bic(count))
    best = models[0].bic(count)
    right = {one.effects for one in (decision.tie or (decision.winner,))}
    wrong = next(
        (
            m
            for m in models
            if m.effects and m.effects not in right and m.parameters == decision.winner.parameters
        ),
        None,
    )

    def change(ahead: Foretold | None) -> tuple[float | None, float | None, float | None]:
        if ahead is None or base.effects not in foretold:
            return None, None, None
        return (*ahead.against(foretold[base.effects]), ahead.rmse_m)

    found = []
    for one in models:
        delta, error, ahead = change(foretold.get(one.effects))
        slow = slow_modes(one.residuals, len(one.unknowns)).energy
        row = Candidate(
            one.effects, "library", one.bic(count) - best, delta, error, slow, _rmse(study, one), ahead
        )
        found.append(row)
        if one is wrong:
            found.append(Candidate(**{**vars(row), "kind": "wrong_same_size"}))
    if heldout is not None and base.effects in foretold:
        inside, outside = black_box(study, heldout, base, seed)
        delta, error, ahead = change(outside)
        energy = float(inside.chi2.sum()) / study.count
        bic = float(inside.chi2.sum()) + base.parameters * float(np.log(count))
        found.append(
            Candidate((), "black_box", max(bic - best, 0.0), delta, error, energy, inside.rmse_m, ahead)
        )
    return tuple(sorted(found, key=lambda one: one.delta_bic))


def _verdict(
    study: Study, searched: Searched, decision: Decision, scans: Sequence[Scan],
    noises: Sequence[tuple[Noise, str]], foretold: dict[tuple[str, ...], Foretold], heldout: Study | None,
    seen: tuple[Detectable, ...], motion: Asked | None, settings: DiagnoseSettings,
) -> Verdict:  # fmt: skip
    noise, source = noises[0]
    base, best = _quality(study, searched.baseline, foretold), _quality(study, decision.winner, foretold)
    share = probabilities(study, searched)
    names = decision.winner.effects if decision.status in ("explained", "ambiguous") else ()
    effects = tuple(named(study, decision.winner, name, share[name], best.parameters) for name in names)
    mismatch = decision.status != "no_mismatch"
    where = sorted((p for s in scans for p in s.places), key=lambda p: -p.strength) if mismatch else []
    asks = None
    if motion is not None:
        pair = (decision.tie[0].effects, decision.tie[1].effects)
        asks = NextMotion(NEXT, motion.says, pair, motion.expected)
    return Verdict(
        summary=summary(decision, effects, where, base, best),
        recordings=tuple(one.recording.name for one in study.seen),
        status=decision.status,
        noise=SeenNoise(noise.sigma_m, noise.correlation_points, noise.correlation_frames, source),
        baseline=base,
        nuisances={
            one.recording.name: estimates(study, decision.winner, k) for k, one in enumerate(study.seen)
        },
        where=tuple(where),
        effects=effects,
        candidates=_candidates(study, searched, decision, foretold, heldout, settings.seed),
        equivalent=tuple(one.effects for one in decision.tie),
        augmented=best,
        detectable=seen,
        next_motion=asks,
    )  # fmt: skip


__all__ = ["NEXT", "Diagnosis", "diagnose", "estimates"]
