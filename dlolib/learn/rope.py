"""The differentiable rope that learning drives: a held rope of `dlolib.sim`, one sub-trajectory at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from dlolib.errors import SimulationError
from dlolib.learn.settings import LearnSettings
from dlolib.sim.differentiate import Cotangent, gradient
from dlolib.sim.rod import Rod, scene
from dlolib.sim.simulate import AT_REST, Clock, Path, Rollout, State, roll_out
from dlolib.sim.start import first_shape, settle
from dlolib.types import Floats, Layout


@dataclass(frozen=True)
class Piece:
    """One sub-trajectory simulated: positions [m] (M + 1, N, 3), the first before its first step.

    `tape` is what the simulator needs for the way back.
    """

    positions_m: Floats
    state: Any
    tape: Any


class DifferentiableRope(Protocol):
    """A rope with its start clamped and its end moved without turning."""

    def start(self) -> tuple[Any, Floats]:
        """The state at rest with the end at the grasp, and its positions [m], (N, 3)."""
        ...

    def forward(self, state: Any, end_m: Floats) -> Piece:
        """Move the end through the positions end_m [m], (M, 3)."""
        ...

    def backward(self, piece: Piece, d_positions: Floats, d_state: Any | None) -> tuple[Floats, Any]:
        """Derivatives of a scalar by the end's positions (M, 3) and by the state before, from those by
        the piece's positions (M + 1, N, 3) and by the state after it (None: none)."""
        ...


class HeldRope:
    """`dlolib.sim`'s direct rod under a layout's gravity, among its obstacles.

    Every step starts at rest (no momentum): an arm that takes seconds for a hand's breadth moves the
    rope from one rest to the next, and what is learned then holds at any slow speed.

    Args:
        layout: ends, gravity, obstacles.
        rod: the rope's physics; its number of particles comes from the settings.
        settings: particles, duration of a step.
        margin_m: the rope touches obstacles this much before its surface does.
    """

    def __init__(self, layout: Layout, rod: Rod, settings: LearnSettings, margin_m: float) -> None:
        # a thicker rope keeps the clearance; mass and stiffness are given per length and stay
        rope = replace(layout.rope, diameter_m=2 * (layout.rope.radius_m + margin_m))
        self.rod = replace(rod, rope=rope, particles=settings.particles)
        self.layout = layout
        self.clock = Clock(settings.step_s, AT_REST)
        self.scene = scene([self.rod], layout.gravity_m_s2, layout.ends, layout.obstacles)

    def start(self) -> tuple[State, Floats]:
        """See `DifferentiableRope`."""
        return self._rest, self._rest.x[0]

    @cached_property
    def _rest(self) -> State:
        layout = self.layout
        guess = first_shape(
            layout.rope.length_m,
            self.rod.particles,
            layout.start,
            layout.grasp,
            layout.gravity_m_s2,
        )
        return settle(self.scene, guess, self._path(layout.grasp.position_m[None])).final.at_rest()

    def forward(self, state: State, end_m: Floats) -> Piece:
        """See `DifferentiableRope`."""
        rollout = roll_out(self.scene, state, self._path(end_m), self.clock)
        return Piece(rollout.x[0], rollout.final, rollout)

    def backward(
        self, piece: Piece, d_positions: Floats, d_state: Cotangent | None
    ) -> tuple[Floats, Cotangent]:
        """See `DifferentiableRope`."""
        rollout: Rollout = piece.tape
        found = gradient(rollout, d_positions[None], d_state)
        if not np.isfinite(found.end_x).all():
            raise SimulationError("the gradient is not finite", mend="lower learn.rate")
        return found.end_x[0, :, 1], found.initial

    def _path(self, end_m: Floats) -> Path:
        start, grasp = self.layout.start, self.layout.grasp
        x = np.stack([np.broadcast_to(start.position_m, end_m.shape), end_m], axis=1)
        q = np.broadcast_to(np.stack([start.quaternion, grasp.quaternion]), (len(end_m), 2, 4))
        return Path(np.ascontiguousarray(x)[None], np.ascontiguousarray(q)[None])
