"""How right the rod is: shapes, stiffnesses and gradients, and the benchmarks of others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
from mujoco import minimize
from scipy.optimize import least_squares

from dlolib.sim.continuum import MOST_CORRECTIONS, mesh_error, refined, stands
from dlolib.sim.mesh import FINER
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.sim.sides import Prediction
from dlolib.sim.simulate import Clock, Rollout
from dlolib.types import Ends, Floats, Points, Recording
from stages import peers
from stages.gradients import derivative_errors
from stages.peers import EI, GJ, GRAVITY, MOTION, ROPE, STEP_S
from stages.timing import Figure, in_turn


def elastica() -> Iterator[Figure]:
    """Quasi-static shapes over the arc against the elastica, and the segments' lengths."""
    exact = peers.exact_shapes()
    errors = []
    for n in (15, 30, 60):
        race = peers.ours(n, Clock(None))
        rollout: Rollout = race.go()
        errors.append(100 * peers.error_of(race, exact))
        if n == 30:
            lengths = np.linalg.norm(np.diff(rollout.x[0], axis=1), axis=2)
            stretch = 100 * float(np.abs(lengths / rollout.scene.segment_l[0] - 1).max())
    orders = np.log(np.array(errors[:-1]) / errors[1:]) / np.log([29 / 14, 59 / 29])
    yield Figure(
        errors[1],
        f"{len(peers.SHOWN)} shapes on the arc, quasi-static; n = 15, 30, 60: "
        f"{', '.join(f'{e:.3g}' for e in errors)} %, orders {', '.join(f'{o:.2f}' for o in orders)}",
    )
    yield Figure(stretch, "largest change of a segment's length on the same arc, n = 30")


def clean(rod: Rod, step_s: float, frame_every: int) -> Recording:
    """What a rope ten times finer in space and time does on the arc, at 30 even arc lengths a frame."""
    s = np.linspace(0, ROPE.length_m, 30)
    times = MOTION.t_s[frame_every::frame_every]
    blank = Points(
        np.repeat(np.arange(len(times)), 30), np.repeat(times, 30), np.tile(s, len(times)),
        np.zeros((30 * len(times), 3)),
    )  # fmt: skip
    recording = Recording("clean", ROPE, GRAVITY, Ends(), MOTION, blank, quasi_static=False)
    xyz = RecordingModel(recording, rod.particles, step_s).predict(rod).xyz_m
    return replace(recording, points=replace(blank, xyz_m=xyz))


def spread() -> Iterator[Figure]:
    """EI from one clean recording at several discretisations, with the correction and without.

    The correction is `identify`'s: what a finer mesh adds to the shapes, made anew at the fit's own optimum.
    Its several starts, intervals and held-out frames are left out, which would take an hour.
    """
    recording = clean(Rod(ROPE, EI, GJ, particles=240), 1e-3, 20)
    said, spreads = [], []
    for corrections in (MOST_CORRECTIONS, 0):
        grid = [(n, step_s) for n in (15, 30, 60, 120) for step_s in (0.005, 0.01, 0.02)]
        found = [_fit_ours(recording, n, step_s, 1.5 * EI, corrections)[0] for n, step_s in grid]
        spreads.append(100 * (max(found) - min(found)) / EI)
        off = [100 * (value / EI - 1) for value in found]
        name = "on" if corrections else "off"
        said.append(f"{name}: {spreads[-1]:.2f} % ({min(off):+.2f} to {max(off):+.2f} %)")
    yield Figure(
        spreads[0],
        f"n = 15, 30, 60, 120 by dt = 5, 10, 20 ms; correction {'; '.join(said)}. The recording "
        "is our own rod's with 240 particles at 1 ms",
    )


def _fit_ours(
    recording: Recording, n: int, step_s: float, first: float, corrections: int = 0
) -> tuple[float, float]:
    """EI [N m²] and the sum of squares by Levenberg-Marquardt on forward sensitivities."""
    model, true = RecordingModel(recording, n, step_s), recording.points.xyz_m
    theta, offset = np.array([np.log(first)]), np.zeros_like(true)

    def rod(theta: Floats) -> Rod:
        return Rod(ROPE, float(np.exp(theta[0])), GJ, particles=n)

    last: list[tuple[Floats, Prediction]] = []

    def predicted(theta: Floats) -> Prediction:
        # points and derivatives come from one simulation
        if not last or not np.array_equal(last[0][0], theta):
            last[:] = [(theta.copy(), model.predict(rod(theta), ["bending_stiffness"]))]
        return last[0][1]

    def residual(theta: Floats) -> Floats:
        return np.asarray((predicted(theta).xyz_m + offset - true).ravel())

    def jacobian(theta: Floats) -> Floats:
        return np.asarray(predicted(theta).by_parameter.reshape(-1, 1) * np.exp(theta[0]))

    for number in range(corrections + 1):
        end = least_squares(residual, theta, jacobian, x_scale=[0.1], xtol=1e-6)
        theta = end.x
        if number < corrections:
            before, offset = offset, mesh_error(model, refined(model, FINER), rod(theta))
            if stands(before, offset, ROPE.length_m):
                break
    return float(np.exp(theta[0])), float(end.cost)


def against_sysid() -> Iterator[Figure]:
    """EI from one recording: MuJoCo's least squares (finite differences) on its flex, ours on the rod."""
    recording = clean(Rod(ROPE, EI, GJ, particles=240), 1e-3, 20)
    frames = np.unique(np.searchsorted(MOTION.t_s, recording.points.t_s - 1e-9))
    true = recording.points.xyz_m.reshape(len(frames), 30, 3)
    first = float(np.log(1.5))

    def residual(theta: Floats) -> Floats:
        columns = []
        for value in np.ravel(theta):
            model, data = peers.flex_scene(30, EI * float(np.exp(value)))
            start = peers.flex_at_rest(model, data)
            kept = np.array(peers.flex_run(model, data, start))
            columns.append((kept[frames - 1] - true).ravel())
        return np.stack(columns, axis=1)

    ends: dict[str, Any] = {}
    bounds = [np.array([[-1.0]]), np.array([[1.0]])]

    def theirs() -> None:
        ends["theirs"] = minimize.least_squares(
            np.array([[first]]), residual, bounds, eps=1e-4, verbose=minimize.Verbosity.SILENT
        )

    def ours() -> None:
        ends["ours"] = _fit_ours(recording, 30, STEP_S, 1.5 * EI)

    slow, quick = in_turn([theirs, ours], 1)
    value, cost = ends["ours"]
    x, log = ends["theirs"]
    points = true.size / 3
    rms = [1e3 * np.sqrt(2 * c / points) for c in (float(log[-1].objective), cost)]
    yield Figure(
        slow / quick,
        f"mujoco.minimize.least_squares (what mujoco.sysid calls) on its flex {slow:.2f} s, ours "
        f"{quick:.3f} s, from 1.5 EI; residuals {rms[0]:.2f} and {rms[1]:.2f} mm RMS, "
        f"EI {100 * (np.exp(float(np.ravel(x)[0])) - 1):+.1f} and {100 * (value / EI - 1):+.1f} %; a "
        f"settling of {peers.COMING + peers.RESTING} steps is part of theirs",
    )


def gradients() -> Iterator[Figure]:
    """Forward sensitivities and adjoint of every effect's parameters against extrapolated differences."""
    found = derivative_errors()
    errors, left_out, idle = found.relative, found.left_out, found.idle
    worst = sorted(errors, key=lambda label: -errors[label])
    share = 100 * len(left_out) / (len(left_out) + len(errors))
    first = ", ".join(f"{label} {errors[label]:.1e}" for label in worst[:4])
    listed = f" ({'; '.join(left_out)})" if left_out else ""
    yield Figure(
        errors[worst[0]],
        f"{len(errors)} derivatives; worst: {first}; median {float(np.median(list(errors.values()))):.1e}. "
        "Sensitivities against Richardson's differences, "
        f"adjoint against sensitivities; an event changed within the stencil in {share:.0f} %{listed}; "
        f"{len(idle)} move nothing{': ' + ', '.join(idle) if idle else ''}; "
        f"scenes not solved: {', '.join(found.unsolved) or 'none'}",
    )


SCORES = {
    "catenary": "shape_error",
    "cantilever": "tip_deflection_error",
    "pendulum": "period_error",
    "twist": "critical_twist_error",
}


def cosserat() -> Iterator[Figure]:
    """cosseratbench's experiments: our error times seconds over the best other solver's."""
    if not find_spec("cosseratbench"):
        yield Figure(None, "cosseratbench is not installed: the extra `bench`")
        return
    from cosseratbench import registry
    from cosseratbench.experiment import run as run_experiment

    from dlolib.bench.cosserat import RodSolver

    ratios: dict[str, float] = {}
    said: list[str] = []
    failed: dict[str, list[str]] = {}
    for name, metric in SCORES.items():
        experiment = registry.load_experiment(name)
        ours = run_experiment(experiment, RodSolver())
        others = {}
        for solver in ("pyelastica", "mujoco"):
            try:
                result = run_experiment(experiment, registry.load_solver(solver))
                if result.outcome == "completed" and np.isfinite(result.metrics[metric]):
                    others[solver] = result.metrics[metric] * (result.wall_time or 0.0)
                    said.append(f"{name} {solver} {result.metrics[metric]:.2e} in {result.wall_time:.2f} s")
                else:
                    failed.setdefault(f"{solver}: {result.failure or result.outcome}", []).append(name)
            except Exception as error:  # an adapter that does not fit its library
                why = f"{solver}: {type(error).__name__}: {str(error).splitlines()[0]}"
                failed.setdefault(why, []).append(name)
        if ours.outcome != "completed":
            yield Figure(None, f"{name}: {ours.failure or ours.missing}")
            return
        said.append(f"{name} ours {ours.metrics[metric]:.2e} in {ours.wall_time:.3f} s")
        if others:
            ratios[name] = ours.metrics[metric] * (ours.wall_time or 0.0) / min(others.values())
    slid = run_experiment(registry.load_experiment("capstan"), RodSolver())
    slide = slid.metrics.get("slide")
    said.append(f"capstan ours {slid.failure if slide is None else f'slide {slide:.1e} m'}")
    said.append("crossing and pile: unsupported, no contact between rods")
    said.extend(f"{', '.join(names)} failed with {why}" for why, names in failed.items())
    if not ratios:
        yield Figure(None, f"no other solver completed: {'; '.join(said)}")
        return
    worst = max(ratios, key=lambda name: ratios[name])
    yield Figure(ratios[worst], f"worst {worst}; {'; '.join(said)}")
