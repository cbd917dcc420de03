"""A rod in a layout, moved step by step by a controller: what learning drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dlolib.sim import iterative, simulate
from dlolib.sim.clearance import Nearest, clearance, nearest
from dlolib.sim.rod import Rod, Scene, scene
from dlolib.sim.simulate import Clock, Gradient, Path, Rollout, State
from dlolib.sim.start import first_shape, settle
from dlolib.types import Ends, Floats, Obstacle, Pose


@dataclass(frozen=True)
class RodSimulator:
    """One rod between a fixed clamp and a gripper that only translates.

    Args:
        rod: its physics.
        start: pose of the fixed end.
        grasp: pose of the gripper at the beginning; its orientation stays.
        gravity_m_s2: shape (3,).
        obstacles: what it may touch.
        step_s: time step dt [s].
        sweeps: None for the direct solver; the paper's iterative one with so many iterations a step.
    """

    rod: Rod
    start: Pose
    grasp: Pose
    gravity_m_s2: Floats
    obstacles: Sequence[Obstacle]
    step_s: float = 0.01
    sweeps: int | None = None

    @cached_property
    def _scene(self) -> Scene:
        return scene([self.rod], self.gravity_m_s2, Ends(), self.obstacles)

    def settle(self) -> State:
        """Equilibrium at the beginning, at rest."""
        first = first_shape(
            self.rod.rope.length_m, self.rod.particles, Ends(), self.start, self.grasp, self.gravity_m_s2
        )
        rest = settle(self._scene, first, self._path(self.grasp.position_m[None])).final
        return State(rest.x, rest.x.copy(), rest.q)

    def forward(self, state: State, end_positions_m: Floats) -> Rollout:
        """Move the gripper through T positions (T, 3), one a step; x of the result is (1, T + 1, n, 3)."""
        path, clock = self._path(end_positions_m), Clock(self.step_s)
        if self.sweeps is not None:
            return iterative.roll_out(self._scene, state, path, clock, self.sweeps)
        return simulate.roll_out(self._scene, state, path, clock)

    def backward(self, rollout: Rollout, d_x: Floats, d_before: Floats | None = None) -> Gradient:
        """Reverse pass for a loss whose derivative by the positions is d_x (1, T + 1, n, 3).

        `d_before` is a further derivative by `rollout.final.before`; the result's x and before are those by
        the state that the roll-out began with, its end_x[0, :, 1] those by the gripper's positions.
        """
        if self.sweeps is not None:
            return iterative.gradient(rollout, d_x, d_before)
        return simulate.gradient(rollout, d_x, d_before)

    def clearance(self, positions_m: Floats) -> Floats:
        """Smallest distance [m] from the rope's surface to an obstacle, per step of (..., n, 3)."""
        return clearance(positions_m, self.rod.rope.radius_m, self.obstacles)

    def nearest(self, points_m: Floats) -> Nearest:
        """The nearest obstacle of each point (..., 3) of the rope's axis."""
        return nearest(points_m, self.obstacles)

    def _path(self, end_positions_m: Floats) -> Path:
        steps = len(end_positions_m)
        fixed = np.broadcast_to(self.start.position_m, (steps, 3))
        frames = np.stack([self.start.quaternion, self.grasp.quaternion])
        return Path(np.stack([fixed, end_positions_m], axis=1)[None], np.tile(frames, (1, steps, 1, 1)))
