"""The paper's iterative solver and the direct one on a rope that is known exactly: reports/solvers.json.

Beside the pipeline (`make solvers`): the end goes the paper's way, one waypoint a time step, and what is
recorded is the exact elastica between the same ends, so that no solver of ours has a part in the truth.
Each solver then simulates that rope, and is asked which EI fits its recording best.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from dlolib.files import write_json
from dlolib.identify import IdentifySettings, identify
from dlolib.lab.arc import arc_motion
from dlolib.lab.elastica import Elastica, planar_elastica
from dlolib.params import Lab, Rod, load_block
from dlolib.progress import track
from dlolib.sim import rod as rods
from dlolib.sim.recording import RecordingModel, held_path
from dlolib.sim.scene import LENGTH
from dlolib.sim.simulate import ALL, Clock, Path, State, roll_out
from dlolib.sim.start import settle
from dlolib.types import Ends, Floats, Motion, Points, Recording, Rope
from stages import REPORTS, run
from stages.identify import settings

GRAVITY_M_S2 = np.array([0.0, 0.0, -9.81])
ITERATIONS = (10, 20, 50, 100, 200, 400, 1000)
# EI over the true one, at which the residual is taken. Where the last is the best, no EI is.
SCAN = (*(float(f"{factor:.3g}") for factor in np.geomspace(0.1, 10.0, 13)), 100.0, 1000.0)
FINE = 10  # points of the elastica between two particles

Predict = Callable[[float], Floats]
"""The simulated points (P, 3) [m] of a rope with an EI [N m²]."""


def main() -> None:
    rod, lab = load_block(Rod), load_block(Lab)
    rope = Rope("exact", lab.rope.length_m, lab.rope.diameter_m, lab.rope.linear_density_kg_m)
    true, step_s = lab.rope.bending_stiffness_n_m2, rod.time_step_s
    motion = arc_motion(lab.waypoints + 1, step_s)
    recording = exact(rope, true, motion, rod.particles, lab.frame_every)
    fit = replace(
        settings(), particles=rod.particles, parameters=("bending_stiffness",), heldout_share=0.0, sweeps=None
    )
    figures: dict[str, Any] = {
        "command": "make solvers",
        "true_ei_n_m2": true,
        "length_m": rope.length_m,
        "particles": rod.particles,
        "step_s": step_s,
        "steps": lab.waypoints,
        "frames": len(np.unique(recording.points.frame)),
        "marked_iterations": rod.sweeps,
        "identification": {key: value for key, value in asdict(fit).items() if key != "sweeps"},
        "scan_ei_n_m2": [factor * true for factor in SCAN],
    }
    jobs = track(_jobs(recording, fit, true), "solvers", total=len(ITERATIONS) + 3)
    figures["solvers"] = list(jobs)
    write_json(REPORTS / "solvers.json", figures)
    for one in figures["solvers"]:
        ei = one["bending_stiffness"]
        found = f"EI {ei['value']:.3g} N m^2" if ei else "no EI"
        print(f"{_name(one)}: shape {100 * one['shape_error']:.2f} % of the length; {found}")


def exact(rope: Rope, ei: float, motion: Motion, points: int, frame_every: int) -> Recording:
    """The exact elastica at every so many rows of the motion, at `points` even arc lengths."""
    frames = np.arange(frame_every, len(motion.t_s), frame_every)
    weight = (rope.linear_density_kg_m or 1.0) * 9.81
    shapes: list[Floats] = []
    branch: Elastica | None = None
    for row in (0, *frames):
        end = (float(motion.end_m[row, 0]), float(motion.end_m[row, 2]))
        branch = planar_elastica(
            rope.length_m, ei, weight, (0.0, 0.0), 0.0, end, 0.0, branch, FINE * (points - 1) + 1
        )
        _, x, z, _ = branch
        shapes.append(np.stack([x, np.zeros_like(x), z], axis=1)[::FINE])
    s = np.linspace(0, rope.length_m, points)
    seen = Points(
        np.repeat(np.arange(len(frames)), points),
        np.repeat(motion.t_s[frames], points),
        np.tile(s, len(frames)),
        np.concatenate(shapes[1:]),
    )
    return Recording(
        "exact", rope, GRAVITY_M_S2, Ends(), motion, seen, quasi_static=False, planar="xz",
        source="exact elastica",
    )  # fmt: skip


def _jobs(recording: Recording, fit: IdentifySettings, true: float) -> Iterator[dict[str, Any]]:
    """One solver after the other: the direct ones, then the iterative one with more and more iterations."""
    still = replace(recording, quasi_static=True)
    for name, given in (("direct", recording), ("direct, quasi-static", still)):
        yield _measured(name, None, given, _model(given, fit), true, fit)
    yield _measured("direct, the paper's ends", None, recording, _paper_ends(recording, fit), true, None)
    for iterations in ITERATIONS:
        own = replace(fit, sweeps=iterations)
        yield _measured("iterative", iterations, recording, _model(recording, own), true, own)


def _measured(
    solver: str, iterations: int | None, recording: Recording, predict: Predict, true: float,
    fit: IdentifySettings | None,
) -> dict[str, Any]:  # fmt: skip
    """Shape error at the true EI, residual over EI, and the EI that fits best; without `fit` by search."""
    off = _distance(predict(true), recording)
    residuals = [_rms(_distance(predict(factor * true), recording)) for factor in SCAN]
    found: dict[str, Any] | None = None
    best = int(np.argmin(residuals))
    if best < len(SCAN) - 1 and fit is not None:
        identified = identify([recording], fit).fit
        found, rmse = asdict(identified.parameters["bending_stiffness"]), identified.rmse_m
    elif best < len(SCAN) - 1:
        near = np.log([SCAN[max(best - 1, 0)] * true, SCAN[best + 1] * true])
        end = minimize_scalar(
            lambda log_ei: _rms(_distance(predict(float(np.exp(log_ei))), recording)),
            bounds=(near[0], near[1]), method="bounded", options={"xatol": 1e-4},
        )  # fmt: skip
        found = {"value": float(np.exp(end.x)), "low": None, "high": None, "unit": "N m^2"}
        rmse = float(end.fun)
    else:
        rmse = residuals[-1]
    return {
        "solver": solver,
        "iterations": iterations,
        "shape_error": float(off.max()) / recording.rope.length_m,
        "rmse_at_truth_m": _rms(off),
        "bending_stiffness": found,
        "rmse_m": rmse,
        "scan_rmse_m": residuals,
    }


def _model(recording: Recording, fit: IdentifySettings) -> Predict:
    model = RecordingModel(recording, fit.particles, fit.time_step_s, fit.sweeps)
    return lambda ei: model.predict(rods.Rod(recording.rope, ei, ei, particles=fit.particles)).xyz_m


def _paper_ends(recording: Recording, fit: IdentifySettings) -> Predict:
    """What the iterations lead to: the direct solver, its end constraints over a whole segment each."""
    model = RecordingModel(recording, fit.particles, fit.time_step_s)
    plain = model.setup(rods.Rod(recording.rope, 1.0, 1.0, particles=fit.particles))
    path = held_path(recording.motion, plain)
    rows = np.unique(np.searchsorted(recording.motion.t_s, recording.points.t_s - 1e-9))

    def predict(ei: float) -> Floats:
        rest = model.at_rest(rods.Rod(recording.rope, ei, ei, particles=fit.particles))
        joints = rest.scene.joints.copy()
        joints[:, [0, -1], LENGTH] = rest.scene.segment_l[:, [0, -1]]
        made = replace(rest.scene, joints=joints)
        still = settle(made, rest.final, path).final
        onward = Path(path.x[:, 1:], path.q[:, 1:])
        moved = roll_out(made, State(still.x, still.x.copy(), still.q), onward, Clock(fit.time_step_s, ALL))
        return np.asarray(moved.x[0, rows].reshape(-1, 3))

    return predict


def _distance(xyz_m: Floats, recording: Recording) -> Floats:
    return np.asarray(np.linalg.norm(xyz_m - recording.points.xyz_m, axis=1))


def _rms(distance: Floats) -> float:
    return float(np.sqrt(np.mean(distance**2)))


def _name(one: dict[str, Any]) -> str:
    return one["solver"] if one["iterations"] is None else f"{one['iterations']} iterations"


if __name__ == "__main__":
    run(main, *sys.argv[1:])
