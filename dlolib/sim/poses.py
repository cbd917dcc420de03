"""Settled poses whose way from one to the next was not recorded: each is an equilibrium of its own.

Where several equilibria exist, the motion between two poses decides which one the rope settles in; here
that motion is unknown, so each pose is restarted near the shape that was observed. All poses are one
batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from dlolib.formats import interpolate_motion
from dlolib.sim.recording import (
    Prediction,
    RecordingModel,
    directions,
    held_path,
    largest_step,
    point_weights,
    roll_share,
)
from dlolib.sim.rod import Rod, Scene, scene
from dlolib.sim.simulate import Directions, Path, Rollout, State, sensitivities
from dlolib.sim.start import frames_along, settle
from dlolib.types import Floats, Ints, Motion, Pose, Recording


@dataclass(frozen=True)
class PosesModel:
    """The same calls as `RecordingModel`, every frame on its own."""

    recording: Recording
    particles: int

    @cached_property
    def _which(self) -> Ints:
        """The frame of each point, counted from 0."""
        return np.unique(self.recording.points.frame, return_inverse=True)[1].astype(np.int64)

    @cached_property
    def _motion(self) -> Motion:
        first = np.unique(self._which, return_index=True)[1]
        return interpolate_motion(self.recording.motion, self.recording.points.t_s[first])

    @cached_property
    def _weights(self) -> Floats:
        return point_weights(self.recording.points, self.recording.rope.length_m, self.particles)

    @cached_property
    def _start(self) -> State:
        return self._observed(len(self._motion.t_s))

    def roll_out(self, rod: Rod) -> Rollout:
        """Every pose's equilibrium: one rope a frame, index 1 is the settled shape."""
        path = self._path(rod)
        start = self._start
        return settle(self._scene(rod), start, path)

    def predict(self, rod: Rod, parameters: Sequence[str] = ()) -> Prediction:
        """Simulate the recording's points and, by forward sensitivities, their derivatives."""
        rollout = self.roll_out(rod)
        weights = self._weights
        which = self._which
        xyz = np.einsum("pn,pnk->pk", weights, rollout.x[which, 1])
        if not parameters:
            return Prediction(xyz, np.zeros((*xyz.shape, 0)))
        one = directions(rod, rollout.scene, parameters)
        frames = len(rollout.x)
        every = Directions(
            *(np.repeat(getattr(one, name), frames, axis=0) for name in one.__dataclass_fields__)
        )
        out = sensitivities(rollout, every, np.array([1]))[:, 0]
        return Prediction(xyz, np.einsum("pn,pmnk->pkm", weights, out[which]))

    def _scene(self, rod: Rod) -> Scene:
        rec = self.recording
        frames = len(self._motion.t_s)
        made = scene([rod] * frames, rec.gravity_m_s2, rec.ends, rec.obstacles)
        return replace(made, joint_d=made.joint_d * roll_share(rec.ends, rod.particles))

    def _path(self, rod: Rod) -> Path:
        path = held_path(self._motion, rod.end_turns)
        return Path(path.x.transpose(1, 0, 2, 3), path.q.transpose(1, 0, 2, 3))

    def _observed(self, frames: int) -> State:
        """For each frame a smooth curve through the held ends and the observed points, as a first shape."""
        rec, motion = self.recording, self._motion
        shapes, turns = [], []
        nodes = np.linspace(0, rec.rope.length_m, self.particles)
        for k in range(frames):
            mine = self._which == k
            held = {0.0: motion.start_m[k], rec.rope.length_m: motion.end_m[k]}
            seen = dict(zip(rec.points.s_m[mine].tolist(), rec.points.xyz_m[mine], strict=True))
            known = {s: p for s, p in {**seen, **held}.items() if np.isfinite(p).all()} | {
                s: p for s, p in seen.items() if s not in held or not np.isfinite(held[s]).all()
            }
            s = np.array(sorted(known))
            curve = CubicSpline(s, np.array([known[a] for a in s]), bc_type="natural")(nodes)
            start = Pose(motion.start_m[k], motion.start_q[k]) if rec.ends.start == "clamped" else None
            end = Pose(motion.end_m[k], motion.end_q[k]) if rec.ends.end == "clamped" else None
            shapes.append(curve)
            turns.append(frames_along(curve, start, end))
        x = np.array(shapes)
        return State(x, x.copy(), np.array(turns))


Model = RecordingModel | PosesModel


def model_of(recording: Recording, particles: int, step_s: float | None, sweeps: int | None = None) -> Model:
    """The recording ready to be fitted: as one motion, or pose by pose where the ways between are unknown."""
    frames = np.unique(recording.points.t_s)
    motion = recording.motion
    settled = recording.quasi_static and len(frames) > 1 and len(motion.t_s) <= len(frames)
    if settled and sweeps is None and largest_step(motion) > 1.0:
        return PosesModel(recording, particles)
    return RecordingModel(recording, particles, step_s, sweeps)
