"""The rod under a recording's own motion, at the recording's own points, with derivatives."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.errors import ParameterError, SimulationError
from dlolib.formats import interpolate_motion
from dlolib.sim import iterative
from dlolib.sim.branches import roll_out_as_seen
from dlolib.sim.differentiate import Case, Tangent, Variation, sensitivities, tangent_between
from dlolib.sim.effects.base import Setup
from dlolib.sim.observe import Sampling, point_weights, sampling_of, unseen, viewing_axis
from dlolib.sim.rod import Rod, scene_of, setup
from dlolib.sim.scene import FRICTION
from dlolib.sim.sides import Prediction, Sides, as_seen, sides_of, traced
from dlolib.sim.simulate import Clock, Path, Rollout, State, roll_out, stretches
from dlolib.sim.start import first_shape, released, settle, shape_seen
from dlolib.sim.steps import CLOSE, REMEMBERED, check_speed, dynamic_times, largest_step, quasi_static_times
from dlolib.types import Ends, Floats, Motion, Points, Pose, Recording

# Frames that tell where a rope was when it was seen first, and how fast.
FIRST = 3
# Steps that do not follow a rope that rubs are made shorter by so much, down to this share of their length.
SHORTER, SHORTEST = 0.25, 0.05
# A rope is seen where so many of its points, no fewer, are as far apart as along it, but for this share.
FEWEST, ABOUT = 8, 0.2
# A stretched rope begins a little longer than its ends are apart.
STRAIGHT = 1.0001

Made = TypeVar("Made")


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
        share: of the steps' usual length, of the quasi-static clock of a rope that remembers.
        sought: frames at which a quasi-static rope is sought near where it was seen, which may be on another
            side than the one that it would go on to.
    """

    recording: Recording
    particles: int
    step_s: float | None
    sweeps: int | None = None
    near: Rod | None = None
    first: Points | None = None
    share: float = 1.0
    sought: tuple[Points, ...] = ()

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
        return self.timed(rod)[0]

    def timed(self, rod: Rod) -> tuple[Rollout, Floats]:
        """The same, and when each of its steps ends [s]."""
        made = self.setup(rod)
        return self._following(
            made, lambda model: (model._moved(made, model._at_rest(made)), model.times(made))
        )

    def _following(self, made: Setup, asked: Callable[[RecordingModel], Made]) -> Made:
        """What is asked of the model, or of one in shorter steps: a rope that friction holds until it slides
        far and at once is not followed by long ones."""
        try:
            return asked(self)
        except SimulationError:
            rubs = bool((made.obstacles[:, FRICTION] > 0.0).any())
            if made.moving or not rubs or self.share * SHORTER < SHORTEST:
                raise
        return self._in_shorter_steps._following(made, asked)

    @cached_property
    def _in_shorter_steps(self) -> RecordingModel:
        return replace(self, share=SHORTER * self.share)

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
        # to powers of two, or each step of a fit would have its own
        relaxes_s = float(2.0 ** np.floor(np.log2(made.relaxes_s)))
        key = made.path_dependent, made.moving, relaxes_s, self._late_s(made)
        return self._samplings.get(key, lambda: self._sampled(*key))

    def _late_s(self, made: Setup) -> float:
        """By how much the steps go with the log [s]: those of the dynamic clock by whole ones, if earlier."""
        if not made.moving:
            return made.delay_s
        step_s = self.step_s or np.inf
        return float(step_s * np.floor(min(made.delay_s, 0.0) / step_s))

    @cached_property
    def _samplings(self) -> Kept:
        """Of the last few set-ups: a fit of the clocks has one at every step, as large as the recording."""
        return Kept(4)

    def _sampled(self, remembers: bool, moving: bool, relaxes_s: float, late_s: float) -> Sampling:
        if moving:
            times = self._dynamic_times(late_s)
        else:
            times = self._delayed(late_s)._quasi_static_times(remembers, relaxes_s)
        return sampling_of(self.recording.points.t_s, times, self._weights)

    @cached_property
    def _weights(self) -> Floats:
        return point_weights(self.recording.points, self.recording.rope.length_m, self.particles)

    def _at_rest(self, made: Setup) -> Rollout:
        path = self.path(made, self.times(made)[:1])
        if not self._held:
            nowhere = Path(path.x[:, :0], path.q[:, :0])
            return roll_out(scene_of([made]), self._released(made), nowhere, self._clock(made))
        with contextlib.suppress(SimulationError):
            # a rope may be possible with what is new in it alone
            near = self._shape_near
            if near is not None:
                return roll_out(scene_of([made]), near, path.still(1), Clock(None, fresh=True))
        return settle(scene_of([made]), self._first_shape(path, made), path)

    @cached_property
    def _shape_near(self) -> State | None:
        """The equilibrium of a rod much like those that are simulated, at the first pose."""
        if self.near is None or not self._held:
            return None
        alone = replace(self, near=None)
        return alone.at_rest(self.near.with_particles(self.particles)).final.at_rest()

    def _first_shape(self, path: Path, made: Setup) -> State:
        """Where the search for the equilibrium at the first pose begins: a rope as long as recorded, or as
        this one is where that is too short, stretched if it may be."""
        rec = self.recording
        start, end = held_poses(path.x[0, 0], path.q[0, 0], rec.ends)
        lies = self._lies(start, end)
        if lies is not None:
            return lies
        length_m, both = rec.rope.length_m, start is not None and end is not None
        apart_m = float(np.linalg.norm(path.x[0, 0, 1] - path.x[0, 0, 0])) if both else 0.0
        if apart_m > length_m:
            length_m = made.length_m * (1.0 if path.span is None else float(path.span[0, 0]))
            if length_m < apart_m <= (1 + stretches(scene_of([made]))[0]) * length_m:
                length_m = apart_m * STRAIGHT

        def shape() -> State:
            return first_shape(length_m, self.particles, start, end, rec.gravity_m_s2)

        return self._kept.get(("shape", length_m, *path.x[0, 0].ravel(), *path.q[0, 0].ravel()), shape)

    def _lies(self, start: Pose | None, end: Pose | None) -> State | None:
        """Where the rope was seen at the first pose among obstacles: on which side of them nothing else says.

        None where it was not seen as long as it is.
        """
        rec, points = self.recording, self._first_points
        first = np.flatnonzero(points.t_s == points.t_s.min())
        then = interpolate_motion(rec.motion, np.array([rec.motion.t_s[0], points.t_s.min()]))
        if not rec.obstacles or len(first) < FEWEST or largest_step(then) > CLOSE:
            return None
        first = first[np.argsort(points.s_m[first])]
        few = first[np.linspace(0, len(first) - 1, FEWEST).astype(int)]
        apart_m = np.linalg.norm(np.diff(points.xyz_m[few], axis=0), axis=1).sum()
        if abs(apart_m / np.ptp(points.s_m[few]) - 1) > ABOUT:
            return None
        seen = points.s_m[first], points.xyz_m[first]
        return shape_seen(*seen, rec.rope.length_m, self.particles, start, end)

    @cached_property
    def _kept(self) -> Kept:
        """What most rods share: paths and first shapes depend on how the rope is held alone."""
        return Kept()

    @property
    def _held(self) -> bool:
        """Whether anybody holds the rope; else it falls from where it was seen first."""
        return "clamped" in (self.recording.ends.start, self.recording.ends.end)

    def _dynamic_times(self, late_s: float) -> Floats:
        """Of the dynamic clock, whose steps follow the motion."""
        step_s = self.step_s or 0.0
        times_s = dynamic_times(self.recording, step_s, self._begin_s(step_s, late_s))
        check_speed(self.recording, times_s - late_s, step_s)
        return times_s

    def _delayed(self, late_s: float) -> RecordingModel:
        """The same with a log that is so much later."""
        if late_s == 0.0:
            return self
        motion = self.recording.motion
        later = replace(motion, t_s=motion.t_s + late_s)
        return replace(self, recording=replace(self.recording, motion=later))

    def _later(self, times: Floats, by_s: float) -> Floats:
        """The quasi-static times of a log that is so much later: what lies between frames goes with it, for a
        rope may remember how long ago it moved."""
        if by_s == 0.0:
            return times
        seen = np.isin(times, self.recording.points.t_s)
        return np.maximum.accumulate(np.where(seen, times, times + by_s))

    def _quasi_static_times(self, remembers: bool, relaxes_s: float) -> Floats:
        share = self.share * REMEMBERED if remembers else 1.0
        return quasi_static_times(self.recording, share, relaxes_s=relaxes_s)

    def _begin_s(self, step_s: float, late_s: float) -> float:
        """When the first step of the dynamic clock ends [s]."""
        if not self._held:
            return float(self._first_points.t_s.min() + step_s)
        return float(self.recording.motion.t_s[0] + late_s)

    @cached_property
    def _first_points(self) -> Points:
        return self.first or first_points(self.recording)

    def _released(self, made: Setup) -> State:
        first, points = self._first_points.t_s == self._first_points.t_s.min(), self._first_points
        # the points' arc lengths are shares of the recorded length
        s_m = points.s_m[first] * (made.length_m / self.recording.rope.length_m)
        return released(s_m, self._true_m(points.xyz_m[first], made), made.segments[:, 0])

    def _true_m(self, xyz_m: Floats, made: Setup) -> Floats:
        """Where points (..., 3) [m] are that the camera showed."""
        return unseen(xyz_m, made.camera, viewing_axis(self.recording))

    def _begins_as_seen(self, made: Setup) -> bool:
        """Whether the rope begins where the camera showed it."""
        return not self._held

    def _moves(self, made: Setup) -> tuple[Hashable, ...]:
        """All that tells apart how set-ups move."""
        return made.mechanics, made.camera if self._begins_as_seen(made) else None

    def _moved(self, made: Setup, rest: Rollout) -> Rollout:
        path, state = self.path(made, self.times(made)), self._state(made, rest)
        if self.sweeps is not None:
            return iterative.roll_out(rest.scene, state, path, self._clock(made), self.sweeps)
        if self.sought and not made.moving:
            return roll_out_as_seen(rest.scene, state, path, self._sought(made, path))
        return roll_out(rest.scene, state, path, self._clock(made))

    def _sought(self, made: Setup, path: Path) -> dict[int, State]:
        """Near what the rope is sought, by the step."""
        way = ("sought", *self._way(made, self.times(made)))
        return self._kept.get(way, lambda: dict(self._seen_at(frame, made, path) for frame in self.sought))

    def _seen_at(self, points: Points, made: Setup, path: Path) -> tuple[int, State]:
        """The step at which a frame was seen, and the rope there."""
        times = self.times(made)
        step = min(int(np.searchsorted(times, points.t_s[0] - 1e-9)), len(times) - 1)
        held = held_poses(path.x[0, step], path.q[0, step], self.recording.ends)
        s_m = points.s_m * (made.length_m / self.recording.rope.length_m)
        # near enough whatever the camera's pose: cameras do not move the rope
        return step, shape_seen(s_m, points.xyz_m, made.length_m, self.particles, *held)

    def _state(self, made: Setup, rest: Rollout) -> State:
        """Where the motion begins, and how fast."""
        return rest.final.at_rest()

    def _clock(self, made: Setup) -> Clock:
        return Clock(self.step_s if made.moving else None)

    def path(self, made: Setup, times: Floats) -> Path:
        """The held poses at these of the set-up's own times."""
        return self._kept.get(self._way(made, times), lambda: self._path(made, times))

    def _way(self, made: Setup, times: Floats) -> tuple[Hashable, ...]:
        """All that tells apart how the ends are held at these times."""
        held = (made.delay_s, made.turns, made.rolls, made.slip, made.length_m)
        return *held, made.moving, made.path_dependent, times.tobytes()

    def _path(self, made: Setup, times: Floats) -> Path:
        motion = self._logged(times - made.delay_s)
        dt = np.diff(times, prepend=times[:1] - (self.step_s or 0.0 if made.moving else 0.0))
        gone = made.slip.gone(times) / made.length_m
        span = 1.0 - np.concatenate([gone[:1], gone])
        return replace(held_path(motion, made), dt_s=dt[None], span=span[None])

    def _logged(self, times: Floats) -> Motion:
        """The motion as the robot logged it, at these of its own times."""
        way = ("logged", times.tobytes())
        return self._kept.get(way, lambda: interpolate_motion(self._log, times))

    @cached_property
    def _log(self) -> Motion:
        return self.recording.motion

    def predict(self, rod: Rod, parameters: Sequence[str] = ()) -> Prediction:
        """Simulate the recording's points and, by forward sensitivities, their derivatives."""
        rod = traced(rod, parameters)
        return self.respond(rod, [sides_of(self, rod, name) for name in parameters])

    def respond(self, rod: Rod, sides: Sequence[Sides]) -> Prediction:
        """The same with derivatives by whatever tells each two set-ups from the rod's own.

        Raises:
            SimulationError: names the recording.
        """
        made = self.setup(rod)
        try:
            return self._following(made, lambda model: model._responding(made, sides))
        except SimulationError as error:
            place = error.place or self.recording.name
            raise SimulationError(error.problem, file=error.file, place=place, mend=error.mend) from error

    def _responding(self, made: Setup, sides: Sequence[Sides]) -> Prediction:
        rest, rollout = self._solved.get(self._moves(made), lambda: self._both(made))
        sampling, axis = self._sampling(made), viewing_axis(self.recording)
        xyz = sampling(rollout.x[0, 1 + sampling.steps][:, None])[:, 0]

        def moved(some: Sequence[Sides]) -> Floats:
            tangent = self._tangent(made, rest, some, sampling.times_s)
            ways = [self._variation(*side, sampling.times_s) for side in some]
            return sampling(sensitivities(rollout, ways, sampling.steps + 1, tangent)[0][0])

        return as_seen(xyz, made.camera, axis, sides, moved, self._moves)

    def _both(self, made: Setup) -> tuple[Rollout, Rollout]:
        """The first shape and the whole motion."""
        rest = self._at_rest(made)
        return rest, self._moved(made, rest)

    @cached_property
    def _solved(self) -> Kept:
        """Both of the last few set-ups: a fit is begun at many places of what is not there yet."""
        return Kept(4)

    def _tangent(self, made: Setup, rest: Rollout, sides: Sequence[Sides], times: Floats) -> Tangent:
        """Derivatives of the first state, and of how fast it is, by the parameters."""
        if self._held:
            first = [self._variation(*side, times[:1]) for side in sides]
            return sensitivities(rest, first, np.array([1]))[1].at_rest()
        placed = [(self._released(a), self._released(b), width) for a, b, width in sides]
        return tangent_between(rest.scene, placed)

    def _variation(self, ahead: Setup, behind: Setup, width: float, times: Floats) -> Variation:
        by_s = 0.0 if ahead.moving else (ahead.delay_s - behind.delay_s) / 2
        own = self._later(times, by_s), self._later(times, -by_s)
        cases = zip((ahead, behind), own, strict=True)
        one, other = (Case(scene_of([made]), self.path(made, at)) for made, at in cases)
        if len(times) == 1:
            # the equilibrium's one step is from itself
            one, other = (Case(c.scene, replace(c.path, dt_s=None)) for c in (one, other))
        return Variation(one, other, width)


class Kept:
    """Results of something slow, by what they depend on: those used last. They are not to be written to."""

    def __init__(self, most: int = 64) -> None:
        self._most = most
        self._results: dict[Hashable, Any] = {}

    def __reduce__(self) -> tuple[type[Kept], tuple[int]]:
        """Another process makes its own."""
        return Kept, (self._most,)

    def get(self, key: Hashable, made: Callable[[], Made]) -> Made:
        """The result kept under the key, or made now."""
        found = self._results.pop(key) if key in self._results else made()
        if len(self._results) == self._most:
            self._results.pop(next(iter(self._results)))
        self._results[key] = found
        return found


def check_mesh(rod: Rod, particles: int) -> None:
    """Refuse a rod of another mesh than a model's: the kernels trust that arrays fit.

    Raises:
        ParameterError: it has another number of particles.
    """
    if rod.particles != particles:
        problem = f"a rod of {rod.particles} particles where the recording's model has {particles}"
        raise ParameterError(problem, mend=f"give rod.with_particles({particles})")


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


def held_poses(x: Floats, q: Floats, ends: Ends) -> tuple[Pose | None, Pose | None]:
    """Of the start and the end at x (2, 3) [m] with frames q (2, 4): None of a free one."""
    start, end = (Pose(place, frame) for place, frame in zip(x, q, strict=True))
    return start if ends.start == "clamped" else None, end if ends.end == "clamped" else None


def first_points(recording: Recording) -> Points:
    """The points of the first frames: where the rope was when it was seen first, and how fast."""
    points = recording.points
    return _some(points, np.isin(points.frame, np.unique(points.frame)[:FIRST]))


def frame_of(points: Points, frame: int) -> Points:
    """The points of one frame."""
    return _some(points, points.frame == frame)


def _some(points: Points, which: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> Points:
    return Points(points.frame[which], points.t_s[which], points.s_m[which], points.xyz_m[which])
