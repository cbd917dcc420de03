"""Recordings that begin while the ends move: the rope starts where it was seen first, and as fast.

Such a rope is nowhere near an equilibrium. Started from one it would swing otherwise for as long as the air
lets it, and a rod that leaves out inertia would fit the better. Where it was seen and how fast is a smooth
curve through its first points, no smoother than their noise allows, and through the ends as they were held.
What its laws remember by then is what they remember of that way of the ends, gone slowly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np
from scipy.interpolate import make_splprep

from dlolib.errors import SimulationError
from dlolib.formats import interpolate_motion
from dlolib.sim.differentiate import Case, Tangent, Variation, sensitivities, tangent_between
from dlolib.sim.effects.base import Setup
from dlolib.sim.recording import RecordingModel, held_poses
from dlolib.sim.rod import Rod, scene_of
from dlolib.sim.sides import Sides
from dlolib.sim.simulate import AT_REST, Clock, Path, Rollout, State, roll_out
from dlolib.sim.start import frames_along, off_clamps
from dlolib.sim.upright import upright
from dlolib.types import Floats, Motion, Points, Recording

STANDARD_GRAVITY_M_S2 = 9.81
# An end that is faster than this share of √(gL) begins in motion: started at rest the rope would be off by
# about as large a share of its length.
FAST = 0.02
# The shape seen is drawn to the rope's own length in steps so short that nothing else moves [s].
DRAWN, DRAWN_S = 10, 1e-4
# How it is bent between the points, and how fast, nobody saw: of that implicit Euler damps what rings in
# fewer than 40 steps a period, in so many.
DAMPED = 80
# The weight of a held end in a curve through noisy points, over theirs.
HELD = 1e3
CUBIC = 3


@dataclass(frozen=True)
class BegunModel(RecordingModel):
    """A recording whose rope does not start at rest, on the dynamic clock; without it there is no start."""

    def _begin_s(self, step_s: float, late_s: float) -> float:
        return float(self._first_points.t_s.min())

    def _begins_as_seen(self, made: Setup) -> bool:
        return made.moving

    def _at_rest(self, made: Setup) -> Rollout:
        """One step before the first frame, drawn to the rope's length; how fast it is `_state` says."""
        if not made.moving:
            return super()._at_rest(made)
        seen, held = self._drawing(made, self.times(made))
        if made.path_dependent:
            there = self._remembered(made)
            seen = replace(seen, past=there.past, slip=there.slip)
        return roll_out(held.scene, seen, held.path, Clock(DRAWN_S, AT_REST))

    def _clock(self, made: Setup) -> Clock:
        return Clock(self.step_s if made.moving else None, DAMPED)

    def _drawing(self, made: Setup, times: Floats) -> tuple[State, Case]:
        """The rope as it was seen, and how it is held while it is drawn to its length."""
        path = self.path(made, times[:1])
        place, speed = self._seen(made)
        x = place - (self.step_s or 0.0) * speed
        poses = held_poses(x[[0, -1]], path.q[0, 0], self.recording.ends)
        seen = State(x[None], x[None].copy(), frames_along(x, *poses)[None])
        return seen, Case(scene_of([made]), Path(x[None, None, [0, -1]], path.q[:, :1]).still(DRAWN))

    def _state(self, made: Setup, rest: Rollout) -> State:
        if not made.moving:
            return super()._state(made, rest)
        return replace(rest.final, before=rest.final.x - (self.step_s or 0.0) * self._seen(made)[1][None])

    def _tangent(self, made: Setup, rest: Rollout, sides: Sequence[Sides], times: Floats) -> Tangent:
        """Parameters move what was seen, how the ends are turned, what is remembered and what is drawn."""
        if not made.moving:
            return super()._tangent(made, rest, sides, times)
        drawings = [(self._drawing(a, times), self._drawing(b, times), width) for a, b, width in sides]
        begun = tangent_between(rest.scene, [(a[0], b[0], width) for a, b, width in drawings])
        if any(one.path_dependent for one in (made, *(side for both in sides for side in both[:2]))):
            there = self._remembered_by(made, sides)
            begun = replace(begun, past=there.past, slip=there.slip)
        ways = [Variation(a[1], b[1], width) for a, b, width in drawings]
        drawn = sensitivities(rest, ways, np.array([DRAWN]), begun)[1]
        faster = [(self._seen(a)[1] - self._seen(b)[1]) / width for a, b, width in sides]
        return replace(drawn, before=drawn.x - (self.step_s or 0.0) * np.stack(faster)[None])

    def _remembered(self, made: Setup) -> State:
        """The rope that went the ends' way to the first frame slowly."""
        slow = replace(made, moving=False)
        return self._way_there._following(slow, lambda model: model._moved(slow, model._at_rest(slow)).final)

    def _remembered_by(self, made: Setup, sides: Sequence[Sides]) -> Tangent:
        """Its derivatives."""
        slow = replace(made, moving=False)
        slowly = [(replace(a, moving=False), replace(b, moving=False), width) for a, b, width in sides]

        def gone(model: RecordingModel) -> Tangent:
            rest, times = model._at_rest(slow), model.times(slow)
            begun = model._tangent(slow, rest, slowly, times)
            ways = [model._variation(*side, times) for side in slowly]
            return sensitivities(model._moved(slow, rest), ways, np.array([len(times)]), begun)[1]

        return self._way_there._following(slow, gone)

    @cached_property
    def _way_there(self) -> RecordingModel:
        """The ends' way up to the first frame."""
        points = self._first_points
        first = points.t_s == points.t_s.min()
        frame = Points(points.frame[first], points.t_s[first], points.s_m[first], points.xyz_m[first])
        return RecordingModel(replace(self.recording, points=frame), self.particles, self.step_s)

    @cached_property
    def _log(self) -> Motion:
        """With a row before the first, for a late clock: ends that move by then had moved as fast."""
        motion, lasts_s = self.recording.motion, float(np.ptp(self._first_points.t_s))
        now_s = motion.t_s[0]
        after = interpolate_motion(motion, np.array([now_s + lasts_s]))
        x = [2 * getattr(motion, end)[:1] - getattr(after, end) for end in ("start_m", "end_m")]
        q = [_turned_back(getattr(motion, end)[:1], getattr(after, end)) for end in ("start_q", "end_q")]
        before = (np.array([now_s - lasts_s]), x[0], q[0], x[1], q[1])
        rows = (motion.t_s, motion.start_m, motion.start_q, motion.end_m, motion.end_q)
        return Motion(*(np.concatenate(both) for both in zip(before, rows, strict=True)))

    def _seen(self, made: Setup) -> tuple[Floats, Floats]:
        """Where the rope's particles are at the first frame (n, 3) [m], and how fast (n, 3) [m/s]."""
        return self._kept.get(("seen", made.camera, made.delay_s), lambda: self._curves(made))

    def _curves(self, made: Setup) -> tuple[Floats, Floats]:
        """The smooth curves through the first points and the ends as they are held."""
        recording, points = self.recording, self._first_points
        t_s, s_m, xyz_m = _in_all_frames(points)
        xyz_m = self._true_m(xyz_m, made)
        motion, length_m = self._logged(t_s - made.delay_s), recording.rope.length_m
        held = {0.0: motion.start_m, length_m: motion.end_m}
        held = {s: x for s, x in held.items() if np.isfinite(x).all()}
        inside = off_clamps(s_m, length_m, held)
        if len(inside) + len(held) <= CUBIC:
            raise SimulationError(
                f"the ends move at first, when {len(inside)} points of the rope are seen: that is no shape",
                mend="begin with frames of four points or more, or while the rope is at rest",
            )
        xyz_m = np.concatenate([xyz_m[:, inside], *(x[:, None] for x in held.values())], axis=1)
        at, weights = [*s_m[inside], *held], [1.0] * len(inside) + [HELD] * len(held)
        since = t_s - t_s.mean()
        noise_m = recording.noise.sigma_m if recording.noise else recording.position_noise_m or 0.0
        line = since / (since @ since)
        nodes_m = np.linspace(0.0, length_m, self.particles)

        def curve(values: Floats, noise: float) -> Floats:
            """The smoothest that leaves no more than noise (Reinsch, Numerische Mathematik 10, 1967)."""
            order = np.argsort(at)
            u, through, w = (np.asarray(part)[order] for part in (at, values, weights))
            left = values.size * noise**2
            spline, _ = make_splprep(through.T, w=w if noise else None, u=u, s=left)
            return np.asarray(spline(nodes_m)).T

        speeds = np.tensordot(line, xyz_m, 1)
        return curve(xyz_m[0], noise_m), curve(speeds, noise_m * float(np.linalg.norm(line)))


def _turned_back(q: Floats, after: Floats) -> Floats:
    """Frames (T, 4) as far before q as `after` is after it."""
    return np.asarray(2 * np.sum(q * after, axis=1, keepdims=True) * q - after)


def _in_all_frames(points: Points) -> tuple[Floats, Floats, Floats]:
    """Times (F,) of the frames, arc lengths (M,) of what all of them show, and where it is (F, M, 3)."""
    frames = [points.frame == frame for frame in np.unique(points.frame)]
    t_s = np.array([points.t_s[mine][0] for mine in frames])
    s_m = reduce(np.intersect1d, [points.s_m[mine] for mine in frames])
    return t_s, s_m, np.array([points.xyz_m[mine & np.isin(points.s_m, s_m)] for mine in frames])


def motion_model(
    recording: Recording,
    particles: int,
    step_s: float | None,
    sweeps: int | None = None,
    near: Rod | None = None,
) -> RecordingModel:
    """The recording as one motion, which begins at rest, or as it was seen where the ends move by then."""
    kind = BegunModel if sweeps is None and in_motion(recording) else RecordingModel
    return kind(upright(recording), particles, step_s, sweeps, near)


def in_motion(recording: Recording) -> bool:
    """Whether a held end moves fast in the motion's first two rows, and frames show the rope."""
    motion = recording.motion
    if recording.planar or len(motion.t_s) < 2 or len(np.unique(recording.points.frame)) < 2:
        return False
    took_s = motion.t_s[1] - motion.t_s[0]
    speeds = [np.linalg.norm(x[1] - x[0]) / took_s for x in (motion.start_m, motion.end_m)]
    fast = FAST * np.sqrt(STANDARD_GRAVITY_M_S2 * recording.rope.length_m)
    return bool(np.nan_to_num(speeds).max() > fast)


__all__ = ["BegunModel", "in_motion", "motion_model"]
