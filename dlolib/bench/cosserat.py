"""Our rod as a solver of `cosseratbench` (entry point `cosseratbench.solvers`), by that package's own rules.

What the rod lacks is not declared: contact between rods, so that crossing and pile are unsupported. A
scenario that asks for an equilibrium and drives no end gets it at once; all others are stepped by implicit
Euler, with the mass-proportional damping that the other adapters take where the scenario allows it: by steps
of second order the ends of its twist run apart.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from cosseratbench.scenario import Cylinder, End, EndCondition, Scenario
from cosseratbench.scenario import Rod as Spec
from cosseratbench.solver import Capability, Diverged
from cosseratbench.trajectory import Trajectory
from scipy.spatial.transform import Rotation

from dlolib import __version__
from dlolib.errors import SimulationError
from dlolib.sim.rod import Rod, scene_of, setup
from dlolib.sim.scene import REST, STIFFNESS, Scene
from dlolib.sim.simulate import ALL, Clock, Path, State, roll_out
from dlolib.sim.start import settle
from dlolib.types import Ends, Floats, Obstacle, Rope

# Timoshenko's coefficient of a round section in shear; the same as in cosseratbench's PyElastica adapter.
SHEAR = 27.0 / 28.0
# The longest steps [s]: where the motion itself is the result, and where it only leads to one.
MOVING_STEP_S, LEADING_STEP_S = 1e-3, 0.05


class RodSolver:
    """The solver. `time_step_scale` multiplies the longest step."""

    name = "dlolib"
    backend_version = __version__
    capabilities: ClassVar[frozenset[Capability]] = frozenset(
        {
            Capability.STRETCH,
            Capability.SHEAR,
            Capability.CYLINDER_CONTACT,
            Capability.PLANE_CONTACT,
        }
    )

    def __init__(self, time_step_scale: float = 1.0) -> None:
        self.scale = time_step_scale

    def settings(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> dict[str, Any]:
        """The numerical choices made for a scenario."""
        if _at_once(scenario):
            return {"integrator": "equilibrium by Newton's method"}
        dt, _ = self._steps(scenario, n_frames)
        damping = 2.0 * scenario.slowest_frequency() if scenario.quasi_static else 0.0
        return {"integrator": "implicit Euler", "time_step": dt, "damping_rate": damping}

    def run(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> Trajectory:
        """All rods as one batch: they do not touch each other."""
        if n_elements < 2:
            raise NotImplementedError("a rod of fewer than three particles")
        made = Scene.stack([_scene(scenario, spec, n_elements) for spec in scenario.rods])
        states = [_state(spec, n_elements) for spec in scenario.rods]
        x, q = np.array([one[0] for one in states]), np.array([one[1] for one in states])
        try:
            if _at_once(scenario):
                moved_x, moved_q = _equilibrium(made, State(x, x.copy(), q), n_frames)
            else:
                moved_x, moved_q = self._stepped(scenario, made, State(x, x.copy(), q), n_frames)
        except SimulationError as error:
            raise Diverged(str(error)) from None
        directors = _axes(moved_q[:, :, 1:-1])[..., 0]
        times = np.linspace(0.0, scenario.duration, n_frames)
        return Trajectory(times, tuple(moved_x), tuple(directors))

    def _steps(self, scenario: Scenario, n_frames: int) -> tuple[float, int]:
        frame = scenario.duration / (n_frames - 1)
        longest = self.scale * (LEADING_STEP_S if scenario.quasi_static else MOVING_STEP_S)
        parts = math.ceil(frame / longest - 1e-9)
        return frame / parts, parts

    def _stepped(self, scenario: Scenario, made: Scene, state: State, n_frames: int) -> tuple[Floats, Floats]:
        dt, parts = self._steps(scenario, n_frames)
        clock = Clock(dt, ALL)
        begin = state
        shapes, frames = [state.x], [state.q]
        slid: Floats = np.zeros(len(scenario.rods))
        slides = any(
            motion is not None and motion.slides_along is not None
            for spec in scenario.rods
            for motion in (spec.start_motion, spec.end_motion)
        )
        # a sliding end's place follows from the rope's tension, so it is known for one step ahead only
        chunk = 1 if slides else parts
        for frame in range(n_frames - 1):
            for first in range(0, parts, chunk):
                t = (frame * parts + first + 1 + np.arange(chunk)) * dt
                moved = roll_out(made, state, _path(scenario, begin, t, slid), clock)
                state = moved.final
                if slides:
                    slid = slid + _slide(scenario, made, state)
            shapes.append(state.x)
            frames.append(state.q)
        return np.stack(shapes, axis=1), np.stack(frames, axis=1)


def _at_once(scenario: Scenario) -> bool:
    """Whether an equilibrium is asked for, and no history leads to it."""
    driven = any(spec.start_motion or spec.end_motion for spec in scenario.rods)
    held = all(
        EndCondition.FREE not in (spec.start,) or spec.end is not EndCondition.FREE for spec in scenario.rods
    )
    return scenario.quasi_static and not driven and held and not scenario.obstacles


def _equilibrium(made: Scene, state: State, n_frames: int) -> tuple[Floats, Floats]:
    ends = Path(state.x[:, None, [0, -1]], state.q[:, None, [0, -1]])
    still = settle(made, state, ends).final
    shapes = np.stack([state.x, *[still.x] * (n_frames - 1)], axis=1)
    return shapes, np.stack([state.q, *[still.q] * (n_frames - 1)], axis=1)


def _scene(scenario: Scenario, spec: Spec, n_elements: int) -> Scene:
    """One rod of a scenario; an end that is pinned is held without a moment."""
    material, inertia = spec.material, spec.second_moment_of_area
    rope = Rope("rod", spec.length, 2 * spec.radius, material.density * spec.area)
    effects = {"inertia_drag.inertia": 1.0}
    if scenario.quasi_static:
        effects["inertia_drag.drag"] = 2.0 * scenario.slowest_frequency() * material.density * spec.area
    frictions = {max(one.friction, spec.friction) for one in scenario.obstacles}
    if len(frictions) > 1:
        raise NotImplementedError("obstacles of different friction")
    if frictions and max(frictions) > 0.0:
        effects["contact_friction.coefficient"] = max(frictions)
    rod = Rod(
        rope, material.youngs_modulus * inertia, 2 * material.shear_modulus * inertia, effects, n_elements + 1
    )
    held = [spec.condition(end) is not EndCondition.FREE for end in End]
    # the library wants one end held; a rope that lies on something needs none
    ends = Ends("clamped" if held[0] or not any(held) else "free", "clamped" if held[1] else "free")
    made = setup(
        rod, np.asarray(scenario.gravity, dtype=float), ends, [_obstacle(o) for o in scenario.obstacles]
    )
    segments, joints = made.segments.copy(), made.joints.copy()
    segments[:, 1:3] = SHEAR * material.shear_modulus * spec.area
    segments[:, 3] = material.youngs_modulus * spec.area
    for joint, end in ((0, End.START), (-1, End.END)):
        if spec.condition(end) is not EndCondition.CLAMPED:
            joints[joint, STIFFNESS:REST] = 0.0
    load = np.zeros((n_elements + 1, 3))
    for one in spec.loads:
        load[0 if one.at is End.START else -1] += one.force
    made = replace(made, segments=segments, joints=joints).with_load(load)
    return replace(scene_of([made]), clamped=np.array([held], np.int32))


def _obstacle(one: Any) -> Obstacle:
    if isinstance(one, Cylinder):
        values = {
            "center_m": one.center,
            "axis": tuple(one.unit_axis),
            "radius_m": (one.radius,),
            "height_m": (one.length,),
        }
        return Obstacle("cylinder", values)
    return Obstacle("plane", {"point_m": one.point, "normal": tuple(one.unit_normal)})


def _state(spec: Spec, n_elements: int) -> tuple[Floats, Floats]:
    """Where a rod begins: its nodes (n, 3), and frames (n + 1, 4) whose first axis is its director."""
    nodes, first = spec.nodes(n_elements), spec.directors(n_elements)
    tangent = np.diff(nodes, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    axes = np.stack([first, np.cross(tangent, first), tangent], axis=2)
    frames = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    return nodes, np.concatenate([frames[:1], frames, frames[-1:]])


def _path(scenario: Scenario, begin: State, t: Any, slid: Floats) -> Path:
    """Poses of all rods' ends at the times t; `slid` [m] is how far each sliding end went along its axis."""
    ropes = len(scenario.rods)
    x = np.repeat(begin.x[:, None, [0, -1]], len(t), axis=1)
    q = np.repeat(begin.q[:, None, [0, -1]], len(t), axis=1)
    for rope in range(ropes):
        for k, end in enumerate(End):
            motion = scenario.rods[rope].motion(end)
            if motion is None:
                continue
            for step, time in enumerate(t):
                displacement, turn = motion.pose(float(time))
                x[rope, step, k] += displacement
                if motion.slides_along is not None:
                    x[rope, step, k] += slid[rope] * motion.axis
                own = Rotation.from_quat(q[rope, step, k], scalar_first=True)
                q[rope, step, k] = (Rotation.from_matrix(turn) * own).as_quat(scalar_first=True)
    return Path(x, q)


def _slide(scenario: Scenario, made: Scene, state: State) -> Floats:
    """How far each sliding end goes on [m]: what its load is ahead of the tension, over the rod's EA / L.

    No rod that is bent is stiffer along its axis than a straight one, so that this comes to rest.
    """
    moves = np.zeros(len(scenario.rods))
    for rope, spec in enumerate(scenario.rods):
        motion = spec.end_motion
        if spec.start_motion is not None and spec.start_motion.slides_along is not None:
            raise NotImplementedError("a start that slides")
        if motion is None or motion.slides_along is None:
            continue
        across = state.x[rope, -1] - state.x[rope, -2]
        length = float(np.linalg.norm(across))
        stiffness = float(made.segments[rope, -1, 3])
        pull = stiffness * (length / made.segment_l[rope, -1] - 1.0) * float(across @ motion.axis) / length
        load = sum(float(np.dot(one.force, motion.axis)) for one in spec.loads if one.at is End.END)
        moves[rope] = (load - pull) * spec.length / stiffness
    return moves


def _axes(q: Floats) -> Floats:
    """Frames (..., 4) as matrices (..., 3, 3) whose columns are their axes."""
    matrices = Rotation.from_quat(q.reshape(-1, 4), scalar_first=True).as_matrix()
    return np.asarray(matrices.reshape(*q.shape[:-1], 3, 3))
