"""Identification of a rope's stiffness from recordings: Section V.A, by least squares or as published."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.optimize import Bounds, OptimizeResult, least_squares

from dlolib.errors import ParameterError, SimulationError
from dlolib.identify.intervals import jackknife
from dlolib.identify.parameters import SOFTEST_M4_S2, Unknown, acting, candidates, unbent
from dlolib.identify.problem import Bools, Problem, axes, check_held_ends, check_one_object
from dlolib.progress import track
from dlolib.sim.continuum import (
    LEFT,
    MOST_CORRECTIONS,
    MOST_FINER,
    known_mesh_error,
    refined,
    stands,
)
from dlolib.sim.effects import of_the_rope
from dlolib.sim.mesh import FINER, Mesh
from dlolib.sim.poses import model_of, near
from dlolib.sim.rod import Rod, unit_of
from dlolib.sim.steps import dynamic_step
from dlolib.sim.upright import ROLL, ROLLS
from dlolib.types import Estimate, Fit, Floats, Recording

LOG = logging.getLogger(__name__)

# EI over linear density where the search begins [m^4/s^2]: a decade either side is tried as well.
FIRST_STIFFNESS_M4_S2 = (1e-3, 1e-2, 1e-1)
START_FACTORS = (1.0, 0.1, 10.0)
# A value this near to its bound, in what counts as a change of one, is at it.
AT_BOUND = 1e-3
# Residuals of less than rounding [m²].
TINY = 1e-24


@dataclass(frozen=True)
class IdentifySettings(Mesh):
    """How to identify, on which mesh.

    Args:
        sweeps: None for the direct solver; the paper's iterative one with so many iterations a step.
        parameters: names to fit, or None for those that act (see `parameters.candidates`).
        iterations: at most this many steps of least squares.
        heldout_share: share of the frames, the last ones, left out to foretell them, where the recording
            does not say which.
    """

    sweeps: int | None = None
    parameters: tuple[str, ...] | None = None
    iterations: int = 50
    heldout_share: float = 0.25


@dataclass(frozen=True)
class Identified:
    """The fit, the rods at it, and how well they foretell what was left out.

    loss: one row an iteration: iteration, loss_m (equation (12), over the first recording's frames) and
    the values by name. simulated_m: simulated points (P, 3) of each recording. heldout_rmse_m is None
    where nothing could be left out.
    """

    fit: Fit
    rods: tuple[Rod, ...]
    loss: pd.DataFrame
    simulated_m: tuple[Floats, ...]
    rmse_m: tuple[float, ...]
    heldout_rmse_m: float | None
    heldout_frames: int


def identify(
    recordings: Sequence[Recording],
    settings: IdentifySettings,
    given: Sequence[Rod] | None = None,
) -> Identified:
    """Fit one object's stiffness to its recordings by Levenberg-Marquardt on forward sensitivities.

    Material parameters are shared, each recording has its own clamp angles and, where only a picture's plane
    was seen, its own vertical (its nuisances). Parameters that move no point stay at their neutral values.

    Args:
        recordings: of one object.
        settings: see there.
        given: the rod of each recording, whose further physics holds while EI and GJ are fitted; first shapes
            are sought from that without it, as in a diagnosis.

    Raises:
        ParameterError: a name in `settings.parameters` is unknown or does not act; nothing loads the rope;
            recordings of different objects, or all of their frames held out.
    """
    check_one_object(recordings)
    for recording in recordings:
        check_held_ends(recording)
        if _declared(recording).all():
            held = f"{recording.name}: every frame is held out"
            raise ParameterError(held, place="heldout_frames", mend="leave frames to fit")
    check_loaded(recordings, SOFTEST_M4_S2, "it weighs nothing")
    problem, theta, history = _finely(recordings, settings, given)
    if Unknown("bending_stiffness") in problem.unknowns:
        stiff = float(problem.rod(0, theta).bending_stiffness)
        check_loaded(recordings, stiff, f"at the best EI, {stiff:.2g} N m^2, its weight does not bend it")
    _say_bounded(problem, theta)
    low, high = jackknife(problem, theta)
    # frames that a recording declares as held out were never in the fit; of others the last are left out now
    heldout = [_heldout(recording, settings) for recording in recordings]
    without = replace(problem, used=tuple(~left for left in heldout))
    declared = all(r.heldout_frames is not None for r in recordings)
    foretold = theta if declared else _solve(without, theta, settings, []).x
    found = _result(problem, theta, low, high, history, heldout, foretold)
    return found if given is None else replace(found, fit=_with_held(found.fit, problem, given))


def _finely(
    recordings: Sequence[Recording], settings: IdentifySettings, given: Sequence[Rod] | None
) -> tuple[Problem, Floats, list[Floats]]:
    """The problem at its optimum, and the way there, on the mesh that fits best: one leaves too much out of a
    rope that snaps, or slides along an obstacle, and then finer ones are tried."""
    tried, finer = [_fitted(recordings, settings, given)], 2
    left = 0.0 if settings.sweeps is not None else _left_by_meshes(*tried[0][:2])
    while left > LEFT and finer <= MOST_FINER:
        segments, longest_m = finer * (settings.particles - 1), settings.longest_segment_m / finer
        mesh = replace(settings, particles=segments + 1, longest_segment_m=longest_m)
        try:
            tried.append(_fitted(recordings, mesh, given))
        except (ParameterError, SimulationError):
            break  # a finer rope that cannot be simulated tells nothing, nor one of too many particles
        before, left, finer = left, _left_by_meshes(*tried[-1][:2]), 2 * finer
        if left > before:
            break
    return min(tried, key=lambda one: _cost(*one[:2]))


def _left_by_meshes(problem: Problem, theta: Floats) -> float:
    """What the correction of the meshes' error leaves of it, over the variance of what the fit leaves: how
    far from it finer meshes put the points that count.

    0 of recordings that are not quasi-static, of which the time step leaves more out, and where the finer
    rope has no equilibrium.
    """
    total = 0.0
    for k, model in enumerate(problem.models):
        if not model.recording.quasi_static:
            continue
        fine, rod = replace(model, particles=2 * model.particles - 1), problem.rod(k, theta)
        try:
            error = known_mesh_error(fine, refined(fine, FINER), rod)
            finer_m = fine.predict(rod.with_particles(fine.particles)).xyz_m
        except SimulationError:
            continue
        left = finer_m + (0.0 if error is None else error) - problem.simulated(k, theta)
        total += float(np.sum(left[problem.used[k]][:, axes(model)] ** 2))
    return total / max(float(np.mean(problem.residuals(theta) ** 2)), TINY)


def _fitted(
    recordings: Sequence[Recording], settings: IdentifySettings, given: Sequence[Rod] | None
) -> tuple[Problem, Floats, list[Floats]]:
    """The problem at its optimum, with what the mesh leaves out as it is there, and the way there."""
    problem, theta = _begin(recordings, settings, given)
    problem, theta = _acting_only(problem, theta, settings)
    history: list[Floats] = []
    theta = _best_start(problem, theta, settings, history)
    for _ in track(range(MOST_CORRECTIONS), "what the mesh leaves out"):
        better = _corrected(problem, theta, settings)
        lengths = [recording.rope.length_m for recording in recordings]
        if all(map(stands, problem.offsets, better.offsets, lengths)):
            break
        problem = better
        theta = _solve(problem, theta, settings, history).x
    return problem, theta, history


def _begin(
    recordings: Sequence[Recording], settings: IdentifySettings, given: Sequence[Rod] | None
) -> tuple[Problem, Floats]:
    """The problem with every candidate, at the stiffness given or the best of a few, decades apart."""
    models, rods, used = [], [], []
    for k, recording in enumerate(recordings):
        n = settings.particles_for(recording.rope.length_m)
        step_s = settings.time_step_s
        if settings.sweeps is None:
            step_s = dynamic_step(recording.motion, step_s)
        model = model_of(recording, n, step_s, settings.sweeps)
        if given is not None:
            model = near(model, replace(given[k], effects={}))
        models.append(model)
        rods.append(Rod(recording.rope, 1.0, 1.0, {} if given is None else given[k].effects, n))
        used.append(~_declared(recording))
    offsets = tuple(np.zeros_like(r.points.xyz_m) for r in recordings)
    problem = Problem(tuple(models), tuple(rods), tuple(used), offsets, candidates(recordings))
    if given is not None:
        return problem, _coordinates(problem, given[0].bending_stiffness)
    rolls = ROLLS if Unknown(ROLL) in problem.unknowns else (0.0,)
    starts = [
        _coordinates(problem, ratio * rods[0].linear_density, roll)
        for ratio in FIRST_STIFFNESS_M4_S2
        for roll in rolls
    ]
    return problem, min(starts, key=lambda start: _cost(problem, start))


def _cost(problem: Problem, start: Floats) -> float:
    """The sum of squares [m²] at a start; a rope so soft or stiff may tear on this way."""
    try:
        return float(np.sum(problem.residuals(start) ** 2))
    except SimulationError:
        return float("inf")


def _coordinates(problem: Problem, stiffness: float, roll: float = 0.0) -> Floats:
    """Where EI and GJ are this [N m²], one end is rolled by so much more [rad], and all else is as in the
    rods."""

    def value(unknown: Unknown) -> float:
        if unknown.stiffness:
            return stiffness
        known = problem.rods[unknown.recording or 0].value(unknown.name)
        return known + roll if unknown.name == ROLL else known

    return np.array([u.inward(value(u)) for u in problem.unknowns])


def _best_start(problem: Problem, theta: Floats, settings: IdentifySettings, history: list[Floats]) -> Floats:
    """The best optimum from several stiffnesses: a taut or a stiff rope has others, far from the truth."""
    found: list[tuple[float, Floats, list[Floats]]] = []
    for factor in track(START_FACTORS, "stiffnesses to start from"):
        start = theta + np.array([np.log(factor) if u.stiffness else 0.0 for u in problem.unknowns])
        start = np.clip(start, *problem.bounds)
        steps: list[Floats] = []
        try:
            end = _solve(problem, start, settings, steps)
        except SimulationError:
            continue
        found.append((float(end.cost), end.x, steps))
    if not found:
        mend = "check the recording's units, ends and gravity"
        raise SimulationError("no stiffness could be simulated", mend=mend)
    _, best, steps = min(found, key=lambda one: one[0])
    history.extend(steps)
    return best


def _acting_only(problem: Problem, theta: Floats, settings: IdentifySettings) -> tuple[Problem, Floats]:
    jacobian = problem.jacobian(theta)
    positions = acting(problem.unknowns, jacobian)
    if settings.parameters is not None:
        named = {u.name for u in problem.unknowns}
        for name in settings.parameters:
            if name not in named:
                raise ParameterError(
                    f"cannot fit {name} here", mend=f"choose from {', '.join(sorted(named))}"
                )
        positions = [k for k in positions if problem.unknowns[k].name in settings.parameters]
    if not positions:
        raise ParameterError(
            "no parameter acts on these recordings", mend="record a motion that bends the rope"
        )
    return _keeping_rods(problem, theta, positions), theta[positions]


def check_loaded(recordings: Sequence[Recording], stiffness: float, why: str) -> None:
    """Refuse ropes of an EI [N m²] that nothing but their clamps bends: their shape tells GJ / EI alone."""
    if all(unbent(recording, stiffness) for recording in recordings):
        raise ParameterError(
            f"no load tells how stiff the rope is: {why}",
            place="gravity_m_s2",
            mend="correct gravity, or quasi_static where it swings, or record it with a mass at its tip",
        )


def _say_bounded(problem: Problem, theta: Floats) -> None:
    """A value that is as large or as small as it may be is no measurement."""
    for unknown, at, low, high in zip(problem.unknowns, theta, *problem.bounds, strict=True):
        if min(at - low, high - at) < AT_BOUND * unknown.scale:
            weighed = problem.rods[0].rope.linear_density_kg_m is not None
            value = f"{unknown.outward(float(at)):.3g} {unit_of(unknown.name, weighed)}".rstrip()
            LOG.warning(
                "warning: %s = %s is the bound of what is looked for: no measurement", unknown.name, value
            )


def _keeping_rods(problem: Problem, theta: Floats, positions: Sequence[int]) -> Problem:
    """Only some unknowns, the others fixed at theta in the rods themselves."""
    rods = tuple(problem.rod(k, theta) for k in range(len(problem.models)))
    return replace(problem, rods=rods, unknowns=tuple(problem.unknowns[k] for k in positions))


def _corrected(problem: Problem, theta: Floats, settings: IdentifySettings) -> Problem:
    """The problem with what the continuous rod adds to the shapes at theta.

    That depends little on the parameters: made anew at the fit's own optimum until it stands, it lets the fit
    return those of the continuous rod. The iterative solver's stiffness depends on its mesh altogether and is
    left as it is.
    """
    if settings.sweeps is not None:
        return problem
    found = [
        known_mesh_error(model, refined(model, FINER), problem.rod(k, theta))
        for k, model in enumerate(problem.models)
    ]
    offsets = tuple(
        np.zeros_like(model.recording.points.xyz_m) if error is None else error
        for model, error in zip(problem.models, found, strict=True)
    )
    return replace(problem, offsets=offsets)


def _declared(recording: Recording) -> Bools:
    """Which points (P,) the recording itself holds out."""
    frame, declared = recording.points.frame, recording.heldout_frames
    if declared is None:
        return np.zeros(len(frame), dtype=bool)
    return np.asarray((frame >= declared[0]) & (frame <= declared[1]))


def _heldout(recording: Recording, settings: IdentifySettings) -> Bools:
    """Which points (P,) are foretold: the declared ones, or the last share of the frames."""
    if recording.heldout_frames is not None:
        return _declared(recording)
    frames = np.unique(recording.points.frame)
    last = frames[len(frames) - int(np.floor(settings.heldout_share * len(frames))) :]
    return np.isin(recording.points.frame, last)


def _solve(
    problem: Problem, theta: Floats, settings: IdentifySettings, history: list[Floats]
) -> OptimizeResult:
    history.append(theta.copy())

    def note(intermediate_result: OptimizeResult) -> None:
        history.append(intermediate_result.x.copy())

    return least_squares(
        problem.residuals, theta, problem.jacobian, x_scale=np.array([u.scale for u in problem.unknowns]),
        bounds=Bounds(*problem.bounds),
        max_nfev=settings.iterations, ftol=1e-8, xtol=1e-8, gtol=1e-12, callback=note,
    )  # fmt: skip


def paper_loss(problem: Problem, theta: Floats) -> float:
    """Equation (12) [m]: the mean distance a point, summed over the frames of the first recording."""
    distance = np.linalg.norm(problem.distances(0, theta), axis=1)
    return float(pd.Series(distance).groupby(problem.models[0].recording.points.frame).mean().sum())


def _result(
    problem: Problem, theta: Floats, low: Floats, high: Floats, history: Sequence[Floats],
    heldout: Sequence[Bools], foretold: Floats,
) -> Identified:  # fmt: skip
    parameters: dict[str, Estimate] = {}
    nuisances: dict[str, dict[str, Estimate]] = {}
    for u, value, a, b in zip(problem.unknowns, theta, low, high, strict=True):
        estimate = _estimate(problem, u, float(value), float(a), float(b))
        if u.recording is not None:
            nuisances.setdefault(problem.models[u.recording].recording.name, {})[u.name] = estimate
        else:
            parameters[estimate_name(problem, u)] = estimate
    distances = [np.linalg.norm(problem.distances(k, theta), axis=1) for k in range(len(problem.models))]
    counted = np.concatenate([d[u] for d, u in zip(distances, problem.used, strict=True)])
    left = [
        np.linalg.norm(problem.distances(k, foretold), axis=1)[out]
        for k, out in enumerate(heldout)
        if out.any()
    ]
    frames = sum(
        len(np.unique(m.recording.points.frame[u])) for m, u in zip(problem.models, problem.used, strict=True)
    )
    rods = tuple(problem.rod(k, theta) for k in range(len(problem.models)))
    return Identified(
        fit=Fit(parameters, rms(counted), frames, len(counted), nuisances, problem.models[0].recording.rope),
        rods=rods,
        loss=_history(problem, history),
        simulated_m=tuple(problem.simulated(k, theta) for k in range(len(problem.models))),
        rmse_m=tuple(rms(d) for d in distances),
        heldout_rmse_m=rms(np.concatenate(left)) if left else None,
        heldout_frames=sum(
            len(np.unique(m.recording.points.frame[o])) for m, o in zip(problem.models, heldout, strict=True)
        ),
    )


def _with_held(fit: Fit, problem: Problem, given: Sequence[Rod]) -> Fit:
    """The fit with the physics that held while it was made: without it, it is that of no rope."""
    parameters, nuisances = dict(fit.parameters), {name: dict(own) for name, own in fit.nuisances.items()}
    for k, rod in enumerate(given):
        fitted = {u.name for u in problem.unknowns if u.recording in (None, k)}
        held = {name: value for name, value in rod.effects.items() if name not in fitted}
        along, _ = of_the_rope(held)
        for name, value in held.items():
            of = problem.models[k].recording.name
            place = parameters if name in along else nuisances.setdefault(of, {})
            place[name] = Estimate(value, None, None, unit_of(name, _weighed(problem)))
    return replace(fit, parameters=parameters, nuisances=nuisances)


def rms(values: Floats) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _estimate(problem: Problem, unknown: Unknown, value: float, low: float, high: float) -> Estimate:
    unit = unit_of(unknown.name, _weighed(problem))
    from_, to = (unknown.outward(end) if np.isfinite(end) else None for end in (low, high))
    return Estimate(unknown.outward(value), from_, to, unit)


def estimate_name(problem: Problem, unknown: Unknown) -> str:
    """The parameter's name in fit.json: stiffness over density where the density was not measured."""
    ratio = unknown.stiffness and not _weighed(problem)
    return f"{unknown.name}_over_density" if ratio else unknown.name


def _weighed(problem: Problem) -> bool:
    return problem.models[0].recording.rope.linear_density_kg_m is not None


def _history(problem: Problem, history: Sequence[Floats]) -> pd.DataFrame:
    rows = []
    for iteration, theta in enumerate(history):
        values = {
            u.name: u.outward(float(t))
            for u, t in zip(problem.unknowns, theta, strict=True)
            if u.recording in (None, 0)
        }
        rows.append({"iteration": iteration, "loss_m": paper_loss(problem, theta), **values})
    return pd.DataFrame(rows)


__all__ = ["Identified", "IdentifySettings", "axes", "check_loaded", "identify", "paper_loss", "rms"]
