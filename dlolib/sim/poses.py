"""Settled poses whose way from one to the next was not recorded: each is an equilibrium of its own.

Where several equilibria exist, the motion between two poses decides which one the rope settles in; here
that motion is unknown, so each pose is restarted near the shape that was observed. All poses are one
batch.

What a rope remembers the way decides, too. An end that turns while the other hangs free can hardly have gone
another way than the one between two rows: a rope that remembers follows it, and settles before it is seen.
Between two held ends the way stays unknown, and each pose is reached from straight at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeGuard

import numpy as np

from dlolib.formats import interpolate_motion
from dlolib.sim.begun import STANDARD_GRAVITY_M_S2, motion_model
from dlolib.sim.differentiate import Case, Variation, sensitivities
from dlolib.sim.effects.base import Setup
from dlolib.sim.observe import point_weights, viewing_axis
from dlolib.sim.recording import STRAIGHT, RecordingModel, check_mesh, held_path, held_poses
from dlolib.sim.rod import Rod, scene_of, setup
from dlolib.sim.sides import Prediction, Sides, as_seen, sides_of, traced
from dlolib.sim.simulate import Path, Rollout, State
from dlolib.sim.start import first_shape, settle, shape_seen
from dlolib.sim.steps import REMEMBERED, largest_step, quasi_static_times
from dlolib.sim.upright import upright
from dlolib.sim.winding import twists, wound
from dlolib.types import Floats, Ints, Motion, Pose, Recording

# Share of the time between two poses in which the ends go from one to the other.
UNDERWAY = 0.1
# How long before its first row a rope hung as it is held there; any time does [s].
BEFORE_S = 1.0


@dataclass(frozen=True)
class _Followed(RecordingModel):
    """A way along which the rope settles at every pose: its inertia and its drag have no part in it."""

    def setup(self, rod: Rod) -> Setup:
        """As `RecordingModel.setup`."""
        return replace(super().setup(rod), moving=False)

    def _quasi_static_times(self, remembers: bool, relaxes_s: float) -> Floats:
        # a pose is stopped at though nothing was seen there
        share = self.share * REMEMBERED if remembers else 1.0
        return quasi_static_times(self.recording, share, rows_too=True, relaxes_s=relaxes_s)


@dataclass(frozen=True)
class PosesModel:
    """The same calls as `RecordingModel`, every frame on its own; the points of a rope that remembers, with
    an end free, are those of the way in the order recorded."""

    recording: Recording
    particles: int

    @cached_property
    def _followed(self) -> _Followed:
        """The poses as one motion in the order recorded."""
        rows = self.recording.motion
        arrived_s = rows.t_s[:-1] + UNDERWAY * np.diff(rows.t_s)
        t_s = np.insert(rows.t_s, np.arange(1, len(rows.t_s)), arrived_s)
        # each row but the first when it is reached, and when the next way begins
        stands = np.repeat(np.arange(len(rows.t_s)), 2)[1:]
        motion = Motion(
            t_s, rows.start_m[stands], rows.start_q[stands], rows.end_m[stands], rows.end_q[stands]
        )
        return _Followed(replace(self.recording, motion=motion), self.particles, None)

    def _remembers(self, made: Setup) -> bool:
        ends = self.recording.ends
        return made.path_dependent and "free" in (ends.start, ends.end)

    @cached_property
    def _which(self) -> Ints:
        """The frame of each point, counted from 0."""
        return np.unique(self.recording.points.frame, return_inverse=True)[1].astype(np.int64)

    @cached_property
    def _times(self) -> Floats:
        """When each frame was seen [s]."""
        return self.recording.points.t_s[np.unique(self._which, return_index=True)[1]]

    @cached_property
    def _motion(self) -> Motion:
        return interpolate_motion(self.recording.motion, self._times)

    @cached_property
    def _weights(self) -> Floats:
        return point_weights(self.recording.points, self.recording.rope.length_m, self.particles)

    @cached_property
    def _start(self) -> State:
        return self._observed(len(self._motion.t_s))

    def setup(self, rod: Rod) -> Setup:
        """The rod in the recording's surroundings; as `RecordingModel.setup`, but what settles is at rest."""
        rec = self.recording
        check_mesh(rod, self.particles)
        return replace(setup(rod, rec.gravity_m_s2, rec.ends, rec.obstacles), moving=False)

    def roll_out(self, rod: Rod) -> Rollout:
        """Every pose's equilibrium by itself, of a rope that does not remember: one rope a frame, index 1 is
        the settled shape."""
        case = self._case(self.setup(rod))
        return settle(case.scene, self._start, case.path)

    def predict(self, rod: Rod, parameters: Sequence[str] = ()) -> Prediction:
        """Simulate the recording's points and, by forward sensitivities, their derivatives."""
        rod = traced(rod, parameters)
        return self.respond(rod, [sides_of(self, rod, name) for name in parameters])

    def respond(self, rod: Rod, sides: Sequence[Sides]) -> Prediction:
        """The same with derivatives by whatever tells each two set-ups from the rod's own."""
        made = self.setup(rod)
        if any(self._remembers(one) for one in (made, *(side for both in sides for side in both[:2]))):
            return self._followed.respond(rod, sides)
        rollout = self.roll_out(rod)
        weights, which, axis = self._weights, self._which, viewing_axis(self.recording)
        xyz = np.einsum("pn,pnk->pk", weights, rollout.x[which, 1])

        def moved(some: Sequence[Sides]) -> Floats:
            ways = [Variation(self._case(one), self._case(other), width) for one, other, width in some]
            out = sensitivities(rollout, ways, np.array([1]))[0][:, 0]
            return np.asarray(np.einsum("pn,pmnk->pmk", weights, out[which]))

        return as_seen(xyz, made.camera, axis, sides, moved)

    def _case(self, made: Setup) -> Case:
        """All frames as a batch of ropes that take one step each."""
        motion = self._motion
        if made.delay_s:
            motion = interpolate_motion(self.recording.motion, self._times - made.delay_s)
        path = held_path(motion, made)
        gone = made.slip.gone(self._times) / made.length_m
        span = np.repeat(1.0 - gone[:, None], 2, axis=1)
        x, q = (part.transpose(1, 0, 2, 3) for part in (path.x, path.q))
        return Case(scene_of([made] * len(self._times)), Path(x, q, span=span))

    def _observed(self, frames: int) -> State:
        """For each frame a smooth curve through the held ends and the observed points, as a first shape."""
        shapes = [self._shape(k) for k in range(frames)]
        places, q = (np.concatenate([getattr(one, part) for one in shapes]) for part in ("x", "q"))
        if self.recording.ends.start == self.recording.ends.end == "clamped":
            turned = self._twists(places)
            q = np.array(
                [wound(x, own[0], own[-1], twist) for x, own, twist in zip(places, q, turned, strict=True)]
            )
        return State(places, places.copy(), q)

    def _twists(self, places: Floats) -> Floats:
        """How far the rope is twisted from held end to held end at each frame, by the way there [rad]."""
        motion, length_m = self.recording.motion, self.recording.rope.length_m
        start, end = Pose(motion.start_m[0], motion.start_q[0]), Pose(motion.end_m[0], motion.end_q[0])
        length_m = max(length_m, STRAIGHT * float(np.linalg.norm(end.position_m - start.position_m)))
        # what hangs in a plane tells how it was gripped; what it bent to by the first frame may not
        hangs = first_shape(length_m, self.particles, start, end, self.recording.gravity_m_s2)
        times_s = np.append(motion.t_s[0] - BEFORE_S, self._times)
        return twists(motion, times_s, np.concatenate([hangs.x, places]))[1:]

    def _shape(self, k: int) -> State:
        """The curve of frame k, its frames twisted the least."""
        points, motion = self.recording.points, self._motion
        x = np.stack([motion.start_m[k], motion.end_m[k]])
        q = np.stack([motion.start_q[k], motion.end_q[k]])
        held, mine = held_poses(x, q, self.recording.ends), self._which == k
        seen = points.s_m[mine], points.xyz_m[mine]
        return shape_seen(*seen, self.recording.rope.length_m, self.particles, *held)


Model = RecordingModel | PosesModel


def model_of(recording: Recording, particles: int, step_s: float | None, sweeps: int | None = None) -> Model:
    """The recording ready to be fitted: as one motion, or pose by pose where the ways between are unknown."""
    if recording.quasi_static and sweeps is None and _poses(recording):
        return PosesModel(upright(recording), particles)
    return motion_model(recording, particles, step_s, sweeps)


def _poses(recording: Recording) -> bool:
    """Whether the motion's rows are where a rope settled, and not a way: far apart, and so long that a rope
    as long as that would have fallen meanwhile (its pendulum's √(L / g))."""
    frames, motion = np.unique(recording.points.t_s), recording.motion
    if len(frames) < 2 or len(motion.t_s) > len(frames) or largest_step(motion) <= 1.0:
        return False
    falls_s = np.sqrt(recording.rope.length_m / STANDARD_GRAVITY_M_S2)
    return bool(np.median(np.diff(motion.t_s)) > falls_s)


def follows(model: Model) -> TypeGuard[RecordingModel]:
    """Whether the rope follows its ends from frame to frame."""
    return isinstance(model, RecordingModel)


def near(model: Model, rod: Rod) -> Model:
    """The same for rods much like this one: their first shapes are sought from its own.

    Settled poses each begin where they were seen.
    """
    return replace(model, near=rod) if follows(model) else model
