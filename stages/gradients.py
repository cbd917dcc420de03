"""Every effect's derivatives against extrapolated differences: what `make bench` calls `gradient_error`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from dlolib.errors import SimulationError
from dlolib.sim import simulate
from dlolib.sim.differentiate import gradient, sensitivities
from dlolib.sim.effects import EFFECTS
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.types import Ends, Floats, Motion, Obstacle, Points, Recording
from stages.peers import EI, GJ, GRAVITY, MOTION, ROPE, STEP_S, STEPS

# Where each effect's parameters are differentiated: values at which it acts.
ACTING: dict[str, dict[str, float]] = {
    "rest_curvature": {"kappa_1": 0.5, "kappa_2": 2.0},
    "plastic_bending": {"yield_curvature": 6.0, "hardening_ratio": 0.2},
    "internal_friction": {"saturation_curvature": 2.0, "transition_curvature": 4.0},
    "viscoelastic_bending": {"modulus_ratio": 0.4, "relaxation_time": 0.3},
    "nonlinear_bending": {"cubic": -2e-4},
    "anisotropic_bending": {"stiffness_ratio": 1.5},
    "stiffness_profile": {"s": 0.2, "factor": 0.5, "width": 0.1},
    "mass_profile": {"s": 0.2, "mass": 0.003, "gradient": 0.3},
    "axial_stretch": {"axial_stiffness": 50.0},
    "end_angle": {"start_1": 0.05, "start_2": 0.1, "end_1": -0.05, "end_2": 0.1},
    "end_compliance": {"start_stiffness": 0.01, "end_stiffness": 0.02},
    "end_twist": {"start": 0.3, "end": -0.2},
    "grasp_slip": {"length": 0.01, "time": 0.2, "duration": 0.1},
    "length_error": {"relative": 0.01},
    "lateral_load": {"x": 0.02, "y": 0.05, "z": -0.03},
    "contact_friction": {"coefficient": 0.3},
    "hidden_obstacle": {"x": 0.2, "y": 0.005, "z": -0.125, "radius": 0.03},
    "inertia_drag": {"inertia": 1.0, "drag": 0.05},
    "clock_offset": {"time": 0.015},
    "camera_pose": {"rotation_1": 0.01, "rotation_2": 0.02, "rotation_3": -0.01, "depth": 0.003},
    "prior_history": {"kappa_1": 2.0, "kappa_2": 9.0},
}
# What an effect needs beside it to show. Not plasticity: joints that stand still on their yield surface
# yield or not by rounding, which counts as an event.
BESIDE = {
    "prior_history": {
        "internal_friction.saturation_curvature": 2.0,
        "internal_friction.transition_curvature": 4.0,
    }
}
SHAPES: dict[str, dict[str, tuple[float, ...]]] = {
    "cylinder": {"center_m": (0.2, 0.0, -0.125), "axis": (0, 1, 0), "radius_m": (0.03,), "height_m": (0.1,)},
    "sphere": {"center_m": (0.2, 0.005, -0.125), "radius_m": (0.03,)},
    "plane": {"point_m": (0.0, 0.0, -0.095), "normal": (0.05, 0.0, 1.0)},
    "box": {"center_m": (0.2, 0.0, -0.13), "quaternion": (1, 0, 0, 0), "size_m": (0.08, 0.1, 0.06)},
    "capsule": {"center_m": (0.2, 0.0, -0.125), "axis": (0.5, 1, 0), "radius_m": (0.03,), "height_m": (0.1,)},
}
PARTICLES = 20
# Newton's tolerance under differences, which see what it leaves.
SHARP_M = 1e-11
ROWS = 41


@dataclass
class Errors:
    """Relative error of each derivative by its label; those left out, since an event changed within the
    stencil; those of parameters that move nothing in their scene; and scenes that could not be solved."""

    relative: dict[str, float] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    idle: list[str] = field(default_factory=list)
    unsolved: list[str] = field(default_factory=list)


def derivative_errors() -> Errors:
    """Of every scene."""
    usual, simulate.TOLERANCE = simulate.TOLERANCE, SHARP_M
    try:
        errors = Errors()
        for scene in scenes():
            try:
                _add(errors, *scene)
            except SimulationError as error:
                errors.unsolved.append(f"{scene[0]} ({error.problem})")
        return errors
    finally:
        simulate.TOLERANCE = usual


def _add(errors: Errors, name: str, recording: Recording, rod: Rod, parameters: list[str]) -> None:
    model = RecordingModel(recording, PARTICLES, STEP_S)
    by_sensitivity = model.predict(rod, parameters).by_parameter
    for k, parameter in enumerate(parameters):
        # a narrower stencil where a joint is near its yield surface
        true, events = _extrapolated(model, rod, parameter, 4e-4)
        if events:
            true, events = _extrapolated(model, rod, parameter, 2e-5)
        label = f"{name}: {parameter}"
        if events:
            errors.left_out.append(label)
            continue
        scale = float(np.linalg.norm(true))
        if scale == 0:
            errors.idle.append(label)
        else:
            errors.relative[label] = _known(np.linalg.norm(by_sensitivity[..., k] - true) / scale)
    errors.relative[f"{name}: adjoint"] = _known(_adjoint_error(model, rod, parameters))


def _known(error: Any) -> float:
    """An error, infinite where it is no number: nothing is worse."""
    return float(np.nan_to_num(error, nan=np.inf))


def scenes() -> Iterator[tuple[str, Recording, Rod, list[str]]]:
    """Every effect on a short arc, and every shape, smooth and rough: name, recording, rod, parameters."""
    own = ["bending_stiffness", "torsional_stiffness"]
    for effect in EFFECTS:
        values = {f"{effect}.{name}": value for name, value in ACTING.get(effect, {}).items()}
        rod = Rod(ROPE, EI, GJ, {**values, **BESIDE.get(effect, {})}, PARTICLES)
        timed = effect in ("viscoelastic_bending", "inertia_drag", "clock_offset")
        obstacles = (Obstacle("cylinder", SHAPES["cylinder"]),) if effect == "contact_friction" else ()
        yield effect, _short(obstacles, not timed), rod, [*own, *values]
    for shape, size in SHAPES.items():
        friction = {"contact_friction.coefficient": 0.3}
        for name, effects in ((shape, {}), (f"rough {shape}", friction)):
            yield name, _short((Obstacle(shape, size),), True), Rod(ROPE, EI, GJ, effects, PARTICLES), own


def _short(obstacles: tuple[Obstacle, ...], quasi_static: bool) -> Recording:
    """An arc of a tenth of the rows that leaves its plane, five frames."""
    rows = np.linspace(0, STEPS // 2, ROWS).astype(int)
    end = MOTION.end_m[rows].copy()
    end[:, 1] += 0.02 * np.sin(np.linspace(0, 3, ROWS))
    t = np.linspace(0.0, STEP_S * (ROWS - 1), ROWS)
    motion = Motion(t, MOTION.start_m[rows], MOTION.start_q[rows], end, MOTION.end_q[rows])
    frames, s = np.arange(8, ROWS, 8), np.linspace(0, ROPE.length_m, 12)
    count = len(frames)
    points = Points(
        np.repeat(np.arange(count), 12),
        np.repeat(t[frames], 12),
        np.tile(s, count),
        np.zeros((12 * count, 3)),
    )
    return Recording("short", ROPE, GRAVITY, Ends(), motion, points, obstacles, quasi_static=quasi_static)


def _extrapolated(model: RecordingModel, rod: Rod, name: str, share: float) -> tuple[Floats, bool]:
    """Extrapolated central differences from a share of the value; and whether an event changed within."""
    value = rod.value(name)
    step = share * (abs(value) or 1.0)
    events = _events(model, rod)
    changed, columns = False, []
    for width in (step, step / 2, step / 4):
        sides = [rod.with_values({name: value + sign * width}) for sign in (1, -1)]
        changed = changed or any(not np.array_equal(events, _events(model, one)) for one in sides)
        ahead, behind = (model.predict(one).xyz_m for one in sides)
        columns.append((ahead - behind) / (2 * width))
    first = [(4 * fine - coarse) / 3 for coarse, fine in pairwise(columns)]
    return (16 * first[1] - first[0]) / 15, changed


def _events(model: RecordingModel, rod: Rod) -> Floats:
    """Branches of the laws and of friction, over the whole motion."""
    moved = model.roll_out(rod)
    return np.concatenate([moved.past[0, :, :, 2::3].ravel(), moved.sliding[0].ravel()])


def _adjoint_error(model: RecordingModel, rod: Rod, parameters: list[str]) -> float:
    """The adjoint's derivatives of a random linear loss against the sensitivities', of one roll-out."""
    from dlolib.sim.differentiate import Case, Variation
    from dlolib.sim.rod import scene_of
    from dlolib.sim.sides import sides_of

    # one that friction holds is followed in shorter steps than the model's own
    moved, times_s = model.timed(rod)
    ways = []
    for name in parameters:
        *sides, width = sides_of(model, rod, name)
        cases = []
        for made in sides:
            cases.append(Case(scene_of([made]), model.path(made, times_s)))
        ways.append(Variation(cases[0], cases[1], width))
    weights = np.random.default_rng(0).normal(size=moved.x.shape)
    weights[:, 0] = 0.0
    back = gradient(moved, weights, variations=ways).parameter[0]
    out, _ = sensitivities(moved, ways, np.arange(1, moved.x.shape[1]))
    forward_ = np.einsum("tcnk,tnk->c", out[0], weights[0, 1:])
    scale = np.linalg.norm(forward_)
    return float(np.linalg.norm(back - forward_) / scale) if scale else 0.0
