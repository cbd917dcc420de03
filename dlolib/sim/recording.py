"""The rod under a recording's own motion, at the recording's own points, with derivatives."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.errors import ParameterError, SimulationError
from dlolib.formats import interpolate_motion
from dlolib.sim import iterative
from dlolib.sim.differentiate import Case, Tangent, Variation, sensitivities, zero_tangent
from dlolib.sim.effects import LAWS, parameter
from dlolib.sim.effects.base import Camera, Setup, sizes
from dlolib.sim.observe import Sampling, point_weights, sampling_of, seen, turned, viewing_axis
from dlolib.sim.rod import STIFFNESSES, Rod, scene_of, setup
from dlolib.sim.simulate import Clock, Path, Rollout, State, roll_out
from dlolib.sim.start import first_shape, released, settle
from dlolib.types import Floats, Motion, Points, Pose, Recording

# Between two quasi-static steps an end moves and turns at most this much, so that the rope follows its
# branch where several equilibria exist; a rope that remembers its way takes shorter ones.
LARGEST_MOVE_M, LARGEST_TURN_RAD = 0.01, 0.1
REMEMBERED = 0.4
# Frames so close to each other in way, in units of that step, and in time, as a share of the recording, are
# not each solved for: between them the rope goes in a straight line but for some 0.01 % of its length, 0.2 %
# where it swings far for what its ends do.
CLOSE, BRIEF = 0.25, 0.01
# A difference for a derivative is no smaller a share of the value than this; a law's trace, in differences.
LEAST_DIFFERENCE, TRACE = 1e-9, 10.0
# A step of the dynamic clock follows an end by this share of the rope's length and by this turn.
FOLLOWED, FOLLOWED_RAD = 0.25, 1.0
# A roll-out of so many steps takes all of a machine's memory.
MOST_STEPS = 1_000_000
# Frames that tell where a rope was when it was seen first, and how fast.
FIRST = 3
# Dynamic steps between two rows of the motion: what is recorded so often moves that fast.
STEPS_A_ROW = 4


Made = TypeVar("Made")
Sides = tuple[Setup, Setup, float]


@dataclass(frozen=True)
class Prediction:
    """Simulated points (P, 3) [m] and their derivatives (P, 3, N) by the N parameters asked for."""

    xyz_m: Floats
    by_parameter: Floats


@dataclass(frozen=True)
class RecordingModel:
    """A recording made ready to be simulated again and again with different rods.

    Args:
        recording: ends, motion and points.
        particles: n.
        step_s: time step of the dynamic clock; a quasi-static recording needs none.
        sweeps: None for the direct solver; the paper's iterative one with so many iterations a step, which
            knows no quasi-static clock and has no forward sensitivities.
        near: a rod much like those that are simulated, if one is known: from its shape at the first pose
            theirs are sought.
        first: where the rope was seen first, if the recording's own points begin later: one that nobody holds
            falls from there.
    """

    recording: Recording
    particles: int
    step_s: float | None
    sweeps: int | None = None
    near: Rod | None = None
    first: Points | None = None

    def setup(self, rod: Rod) -> Setup:
        """The rod in the recording's surroundings.

        Raises:
            ParameterError: it has another number of particles than the model.
        """
        rec = self.recording
        check_mesh(rod, self.particles)
        moving = not rec.quasi_static or self.sweeps is not None
        return setup(rod, rec.gravity_m_s2, rec.ends, rec.obstacles, moving)

    def roll_out(self, rod: Rod) -> Rollout:
        """The whole motion, from the equilibrium at its first pose; step k is at index k + 1."""
        made = self.setup(rod)
        return self._moved(made, self._at_rest(made))

    def at_rest(self, rod: Rod) -> Rollout:
        """The equilibrium at the first pose: a roll-out of one step."""
        return self._at_rest(self.setup(rod))

    def times(self, made: Setup) -> Floats:
        """When the rope is solved for [s]."""
        return self._sampling(made).times_s

    def _sampling(self, made: Setup) -> Sampling:
        """When the rope is solved for, and how the points lie among that."""
        if made.moving and self.step_s is None:
            raise ParameterError("a dynamic recording needs a time step", mend="give rod.time_step_s")
        key = made.path_dependent, made.moving
        return self._samplings.get(key, lambda: self._sampled(*key))

    @cached_property
    def _samplings(self) -> Kept:
        return Kept()

    def _sampled(self, remembers: bool, moving: bool) -> Sampling:
        points, length = self.recording.points, self.recording.rope.length_m
        times = self._step_times(self.step_s if moving else None, REMEMBERED if remembers else 1.0)
        return sampling_of(points.t_s, times, point_weights(points, length, self.particles))

    @cached_property
    def _hastiest(self) -> tuple[float, float, float, float]:
        """The dynamic step that is hardest to follow: how hard, when [s], an end's way [m] and turn [rad]."""
        times = self._step_times(self.step_s, 1.0)
        poses = interpolate_motion(self.recording.motion, times)
        ways = [np.linalg.norm(np.diff(m, axis=0), axis=1) for m in (poses.start_m, poses.end_m)]
        cosines = [np.sum(q[1:] * q[:-1], axis=1) for q in (poses.start_q, poses.end_q)]
        way = np.nan_to_num(ways).max(axis=0)
        turn = 2 * np.arccos(np.clip(np.nan_to_num(cosines, nan=1.0), -1, 1)).max(axis=0)
        hard = np.maximum(way / (FOLLOWED * self.recording.rope.length_m), turn / FOLLOWED_RAD)
        worst = int(np.argmax(hard))
        return float(hard[worst]), float(times[worst]), float(way[worst]), float(turn[worst])

    def _check_speed(self) -> None:
        hard, time_s, way, turn = self._hastiest
        if hard > 1:
            slow_enough_s = 0.9 * (self.step_s or 0.0) / hard
            raise SimulationError(
                f"from t_s = {time_s:g} on an end moves {way:.3g} m and turns {turn:.2g} rad in a step of "
                f"{self.step_s:g} s, which follows {FOLLOWED * self.recording.rope.length_m:.3g} m "
                f"and {FOLLOWED_RAD:g} rad at most",
                mend=f"give rod.time_step_s of {slow_enough_s:.2g} or less, or correct motion.csv",
            )

    def _at_rest(self, made: Setup) -> Rollout:
        if made.moving:
            self._check_speed()
        path = self.path(made, self.times(made)[:1])
        if not self._held:
            nowhere = Path(path.x[:, :0], path.q[:, :0])
            return roll_out(scene_of([made]), self._released(made), nowhere, self._clock(made))
        if self._shape_near is not None:
            with contextlib.suppress(SimulationError):
                return roll_out(scene_of([made]), self._shape_near, path.still(1), Clock(None, fresh=True))
        return settle(scene_of([made]), self._first_shape(path), path)

    @cached_property
    def _shape_near(self) -> State | None:
        """The equilibrium of a rod much like those that are simulated, at the first pose."""
        if self.near is None or not self._held:
            return None
        alone = replace(self, near=None)
        return alone.at_rest(self.near.with_particles(self.particles)).final.at_rest()

    def _first_shape(self, path: Path) -> State:
        """Where the search for the equilibrium at the first pose begins."""
        rec = self.recording
        poses = [Pose(path.x[0, 0, k], path.q[0, 0, k]) for k in range(2)]
        start = poses[0] if rec.ends.start == "clamped" else None
        end = poses[1] if rec.ends.end == "clamped" else None

        def made() -> State:
            return first_shape(rec.rope.length_m, self.particles, start, end, rec.gravity_m_s2)

        return self._kept.get(("shape", *path.x[0, 0].ravel(), *path.q[0, 0].ravel()), made)

    @cached_property
    def _kept(self) -> Kept:
        """What most rods share: paths and first shapes depend on how the rope is held alone."""
        return Kept()

    @property
    def _held(self) -> bool:
        """Whether anybody holds the rope; else it falls from where it was seen first."""
        return "clamped" in (self.recording.ends.start, self.recording.ends.end)

    def _step_times(self, step_s: float | None, share: float) -> Floats:
        begin_s = None if step_s is None else self._begin_s(step_s)
        return _step_times(self.recording, step_s, share, begin_s)

    def _begin_s(self, step_s: float) -> float:
        """When the first step of the dynamic clock ends [s]."""
        return float(self.recording.motion.t_s[0] if self._held else self._first_points.t_s.min() + step_s)

    @cached_property
    def _first_points(self) -> Points:
        return self.first or first_points(self.recording)

    def _released(self, made: Setup) -> State:
        first, points = self._first_points.t_s == self._first_points.t_s.min(), self._first_points
        return released(points.s_m[first], points.xyz_m[first], made.segments[:, 0])

    def _moved(self, made: Setup, rest: Rollout) -> Rollout:
        path, state = self.path(made, self.times(made)), self._state(made, rest)
        if self.sweeps is not None:
            return iterative.roll_out(rest.scene, state, path, self._clock(made), self.sweeps)
        return roll_out(rest.scene, state, path, self._clock(made))

    def _state(self, made: Setup, rest: Rollout) -> State:
        """Where the motion begins, and how fast."""
        return rest.final.at_rest()

    def _clock(self, made: Setup) -> Clock:
        return Clock(self.step_s if made.moving else None)

    def path(self, made: Setup, times: Floats) -> Path:
        """The held poses at these of the set-up's own times."""
        held = (made.delay_s, made.turns, made.rolls, made.slip, made.length_m)
        way = (*held, made.moving, made.path_dependent, len(times))
        return self._kept.get(way, lambda: self._path(made, times))

    def _path(self, made: Setup, times: Floats) -> Path:
        motion = interpolate_motion(self.recording.motion, times - made.delay_s)
        dt = np.diff(times, prepend=times[:1] - (self.step_s or 0.0 if made.moving else 0.0))
        gone = made.slip.gone(times) / made.length_m
        span = 1.0 - np.concatenate([gone[:1], gone])
        return replace(held_path(motion, made), dt_s=dt[None], span=span[None])

    def predict(self, rod: Rod, parameters: Sequence[str] = ()) -> Prediction:
        """Simulate the recording's points and, by forward sensitivities, their derivatives."""
        rod = traced(rod, parameters)
        return self.respond(rod, [sides_of(self, rod, name) for name in parameters])

    def respond(self, rod: Rod, sides: Sequence[Sides]) -> Prediction:
        """The same with derivatives by whatever tells each two set-ups from the rod's own."""
        made = self.setup(rod)
        rest = self._at_rest(made)
        rollout = self._moved(made, rest)
        sampling, axis = self._sampling(made), viewing_axis(self.recording)
        xyz = sampling(rollout.x[0, 1 + sampling.steps][:, None])[:, 0]

        def moved(some: Sequence[Sides]) -> Floats:
            tangent = self._tangent(made, rest, some, sampling.times_s)
            ways = [self._variation(*side, sampling.times_s) for side in some]
            return sampling(sensitivities(rollout, ways, sampling.steps + 1, tangent.at_rest())[0][0])

        return as_seen(xyz, made.camera, axis, sides, moved)

    def _tangent(self, made: Setup, rest: Rollout, sides: Sequence[Sides], times: Floats) -> Tangent:
        """Derivatives of the first state by the parameters."""
        if self._held:
            first = [self._variation(*side, times[:1]) for side in sides]
            return sensitivities(rest, first, np.array([1]))[1]
        moved = [(self._released(a).x - self._released(b).x) / width for a, b, width in sides]
        return replace(zero_tangent(rest.scene, len(sides)), x=np.stack(moved, axis=1))

    def _variation(self, ahead: Setup, behind: Setup, width: float, times: Floats) -> Variation:
        one, other = (Case(scene_of([s]), self.path(s, times)) for s in (ahead, behind))
        if len(times) == 1:
            # the equilibrium's one step is from itself
            one, other = (Case(c.scene, replace(c.path, dt_s=None)) for c in (one, other))
        return Variation(one, other, width)


class Kept:
    """The last few results of something slow, by what they depend on; they are not to be written to."""

    MOST = 64

    def __init__(self) -> None:
        self._results: dict[Hashable, Any] = {}

    def get(self, key: Hashable, made: Callable[[], Made]) -> Made:
        """The result kept under the key, or made now."""
        if key not in self._results:
            if len(self._results) == self.MOST:
                self._results.pop(next(iter(self._results)))
            self._results[key] = made()
        return self._results[key]  # type: ignore[no-any-return]


def as_seen(
    xyz_m: Floats,
    camera: Camera,
    axis: Floats,
    sides: Sequence[Sides],
    moved: Callable[[Sequence[Sides]], Floats],
) -> Prediction:
    """True points (P, 3) [m] as the camera shows them, and their derivatives by what tells each two sides.

    `moved` gives the true points' derivatives (P, C, 3) by those that move the rope; what moves the camera
    alone needs no simulation.
    """
    moving = [k for k, (one, other, _) in enumerate(sides) if not one.moves_as(other)]
    by = np.zeros((*xyz_m.shape, len(sides)))
    if moving:
        by[:, :, moving] = np.moveaxis(turned(moved([sides[k] for k in moving]), camera), 1, 2)
    for k, (one, other, width) in enumerate(sides):
        by[:, :, k] += (seen(xyz_m, one.camera, axis) - seen(xyz_m, other.camera, axis)) / width
    return Prediction(seen(xyz_m, camera, axis), by)


def traced(rod: Rod, parameters: Sequence[str]) -> Rod:
    """The rod with a trace of every law whose size is one of the parameters and neutral.

    A law that is not there remembers nothing, and what a little of it would remember is most of its
    derivative.
    """
    traces = {}
    for law in LAWS:
        for part in sizes(law):
            name = f"{law.NAME}.{part}"
            known = parameter(name)
            if name in parameters and rod.value(name) == known.neutral and np.isfinite(known.neutral):
                traces[name] = known.neutral + TRACE * known.difference * known.scale
    return rod.with_values(traces) if traces else rod


def check_mesh(rod: Rod, particles: int) -> None:
    """Refuse a rod of another mesh than a model's: the kernels trust that arrays fit.

    Raises:
        ParameterError: it has another number of particles.
    """
    if rod.particles != particles:
        problem = f"a rod of {rod.particles} particles where the recording's model has {particles}"
        raise ParameterError(problem, mend=f"give rod.with_particles({particles})")


class Settable(Protocol):
    """What puts a rod into its surroundings."""

    def setup(self, rod: Rod) -> Setup: ...


def sides_of(model: Settable, rod: Rod, name: str) -> Sides:
    """The set-ups with a parameter a little more and a little less, and how much lies between."""
    value = rod.value(name)
    step = 1e-4 * value
    if name not in STIFFNESSES:
        known = parameter(name)
        step = max(known.difference * known.scale, LEAST_DIFFERENCE * abs(value))
    ahead, behind = value + step, value - step
    made = (model.setup(rod.with_values({name: side})) for side in (ahead, behind))
    return (*made, ahead - behind)  # type: ignore[return-value]


def held_path(motion: Motion, made: Setup) -> Path:
    """The poses of the held ends as a path (1, T, 2, ...), each frame turned and rolled as said."""
    positions = np.nan_to_num(np.stack([motion.start_m, motion.end_m], axis=1))
    frames = np.stack([motion.start_q, motion.end_q], axis=1)
    frames[np.isnan(frames).any(axis=2)] = (1.0, 0.0, 0.0, 0.0)
    changed = frames.copy()
    for end in range(2):
        if made.turns[end] != (0.0, 0.0) or made.rolls[end] != 0.0:
            turn = Rotation.from_rotvec([*made.turns[end], 0.0])
            turn = turn * Rotation.from_rotvec([0.0, 0.0, made.rolls[end]])
            own = Rotation.from_quat(frames[:, end], scalar_first=True) * turn
            changed[:, end] = own.as_quat(scalar_first=True)
    return Path(positions[None], changed[None])


def first_points(recording: Recording) -> Points:
    """The points of the first frames: where the rope was when it was seen first, and how fast."""
    points = recording.points
    first = np.isin(points.frame, np.unique(points.frame)[:FIRST])
    return Points(points.frame[first], points.t_s[first], points.s_m[first], points.xyz_m[first])


def _step_times(recording: Recording, step_s: float | None, share: float, begin_s: float | None) -> Floats:
    """When to solve: every dt, or without one at the frames, the rows and as many between.

    `share`: of the largest step that the ends may take; begin_s: when the first dt ends.
    """
    rows, frames = recording.motion.t_s, np.unique(recording.points.t_s)
    if step_s is not None and begin_s is not None:
        begin = begin_s
        last = max(frames[-1], begin + step_s)
        if last - begin > MOST_STEPS * step_s:
            problem = f"{last - begin:g} s in steps of {step_s:g} s are more than {MOST_STEPS:,} steps"
            raise SimulationError(problem, mend="look for a jump of the clock in t_s")
        return np.asarray(begin + step_s * np.arange(np.ceil((last - begin) / step_s - 1e-9) + 1))
    frames = np.unique(np.concatenate([rows[:1], frames]))
    fine = np.unique(np.concatenate([frames, rows[rows <= frames[-1]]]))
    gone = np.concatenate([[0.0], np.cumsum(_ways(interpolate_motion(recording.motion, fine)))])
    return _evenly(_marks(frames, np.interp(frames, fine, gone)), fine, gone, share)


def _marks(frames: Floats, gone: Floats) -> Floats:
    """Frames at which to solve for the rope, the last one too; at others, close between two of these, it is
    where it goes past in a straight line.

    gone: the ends' way to each frame, in units of the largest step.
    """
    brief_s = BRIEF * (frames[-1] - frames[0])
    kept = [0]
    for k in range(1, len(frames) - 1):
        if gone[k + 1] - gone[kept[-1]] > CLOSE or frames[k + 1] - frames[kept[-1]] > brief_s:
            kept.append(k)
    return frames[[*kept, len(frames) - 1]] if len(frames) > 1 else frames


def _evenly(marks: Floats, fine: Floats, gone: Floats, share: float) -> Floats:
    """Times from mark to mark, each way in as many equal parts as the largest step asks for; `gone` is the
    ends' way at the times `fine`.

    Equal steps are what the solver foretells best: its first guess goes on as the last steps went.
    """
    at = np.interp(marks, fine, gone)
    times = [marks[:1]]
    for first, last, begin, end in zip(marks, marks[1:], at, at[1:], strict=False):
        parts = max(int(np.ceil((end - begin) / share - 1e-9)), 1)
        inner = np.interp(begin + (end - begin) * np.arange(1, parts) / parts, gone, fine)
        times.append(np.append(np.clip(inner, first, last), last))
    return np.unique(np.concatenate(times))


def _ways(poses: Motion) -> Floats:
    """From each row to the next, in units of the largest step: (T - 1,)."""
    ways = [np.zeros(len(poses.t_s) - 1)]
    for x, q in ((poses.start_m, poses.start_q), (poses.end_m, poses.end_q)):
        along = np.sum(q[1:] * q[:-1], axis=1)
        half = np.arccos(np.clip(np.abs(along), 0, 1))
        turned = 2 * np.where(along < 0, np.pi - half, half)
        ways += [np.linalg.norm(np.diff(x, axis=0), axis=1) / LARGEST_MOVE_M, turned / LARGEST_TURN_RAD]
    return np.asarray(np.nanmax(ways, axis=0))


def largest_step(motion: Motion) -> float:
    """The largest way between two rows of the motion, in units of the largest quasi-static step."""
    return float(_ways(motion).max(initial=0.0))


def dynamic_step(motion: Motion, longest_s: float) -> float:
    """A step [s] that follows what the motion's rows tell: a share of the time between two of them."""
    between_s = float(np.median(np.diff(motion.t_s))) if len(motion.t_s) > 1 else np.inf
    return min(longest_s, between_s / STEPS_A_ROW)
