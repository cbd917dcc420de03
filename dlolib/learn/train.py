"""Algorithm 2: learn a path by sending the loss's gradient back through the simulated rope."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import autograd.numpy as anp
import numpy as np
from autograd import make_vjp
from autograd.misc.flatten import flatten

from dlolib.learn.arcs import PARAMETERS, arc
from dlolib.learn.arm import REACH, outside, within_reach
from dlolib.learn.goal import GoalError, goal_error
from dlolib.learn.loss import path_loss
from dlolib.learn.policy import Policy
from dlolib.learn.rope import DifferentiableRope, Piece
from dlolib.learn.settings import LearnSettings
from dlolib.sim.clearance import clearance
from dlolib.types import Floats, Layout

TINY_M = 1e-6

Back = Callable[[Floats], tuple[Floats, Floats, Floats, Floats]]


@dataclass(frozen=True)
class Episode:
    """One pass over the whole path.

    positions_m (T + 1, N, 3); end_m (T, 3), the moved end as executed; parameters (k, 5), the T_i.
    """

    positions_m: Floats
    end_m: Floats
    parameters: Floats
    loss: float
    contacts: int
    goal: GoalError
    min_clearance_m: float
    gradient: Floats


@dataclass(frozen=True)
class Blocked:
    """A part of the loss, linear in how far each step (T,) is held back."""

    value: float
    weights: Floats


class Learner:
    """The controller, the arm and the rope of one layout, differentiated as a whole."""

    def __init__(
        self, layout: Layout, rope: DifferentiableRope, policy: Policy, settings: LearnSettings
    ) -> None:
        self.layout, self.rope, self.policy, self.settings = layout, rope, policy, settings
        self.a_m, self.b_m = layout.grasp.position_m, layout.goal_m[-1]
        gap_m = layout.rope.radius_m + settings.contact_margin_m
        self.push_out = outside(layout.obstacles, gap_m)
        self.initial, self.first_m = rope.start()
        self.flat, self.unflatten = flatten(policy.weights)

    def segment(self, weights: Floats, positions_m: Floats, previous: Floats, from_m: Floats) -> Floats:
        """Lines 4 and 5 of Algorithm 2 for one sub-trajectory, differentiable.

        Args:
            weights: all weights in one row.
            positions_m: the rope's state (N, 3).
            previous: T_{i-1}, shape (5,).
            from_m: where the commanded path has come to, shape (3,).

        Returns:
            In one row: the executed positions (M, 3), how far each is from the commanded one (M,), T_i (5,),
            the last commanded position (3,).
        """
        steps = self.settings.steps // self.settings.segments
        parameters = self.policy.parameters(self.unflatten(weights), positions_m, previous)
        commanded = arc(parameters, from_m, self.a_m, self.b_m, steps)
        reach_m = REACH * self.layout.rope.length_m
        executed = self.push_out(within_reach(commanded, self.layout.start.position_m, reach_m))
        held_back = anp.sqrt(anp.sum((commanded - executed) ** 2, axis=1) + TINY_M**2) - TINY_M
        row: Floats = anp.concatenate((anp.ravel(executed), held_back, parameters, commanded[-1]))
        return row

    def episode(self, weights: Floats, want_gradient: bool = True) -> Episode:
        """Lines 3 to 8 of Algorithm 2: forward through all sub-trajectories, the loss, and back."""
        state, now = self.initial, self.first_m
        previous, from_m = np.zeros(PARAMETERS), self.a_m
        pieces: list[Piece] = []
        backs: list[Back] = []
        executed: list[Floats] = []
        chosen: list[Floats] = []
        held_back: list[Floats] = []
        for _ in range(self.settings.segments):
            back, row = make_vjp(lambda v: self.segment(*v))((weights, now, previous, from_m))
            end_m, back_m, previous, from_m = self._split(row)
            held_back.append(back_m)
            piece = self.rope.forward(state, end_m)
            state, now = piece.state, piece.positions_m[-1]
            pieces.append(piece)
            backs.append(back)
            executed.append(end_m)
            chosen.append(previous)
        positions_m = np.concatenate([self.first_m[None], *(piece.positions_m[1:] for piece in pieces)])
        obstacles, radius_m = self.layout.obstacles, self.layout.rope.radius_m
        loss = path_loss(positions_m, self.policy.goal_m, obstacles, radius_m, self.settings)
        blocked = self._blocked(np.concatenate(held_back))
        return Episode(
            positions_m=positions_m,
            end_m=np.concatenate(executed),
            parameters=np.array(chosen),
            loss=loss.value + blocked.value,
            contacts=loss.contacts,
            goal=goal_error(positions_m[-1], self.policy.goal_m),
            min_clearance_m=float(clearance(positions_m, radius_m, obstacles).min()),
            gradient=self._backward(pieces, backs, loss.d_positions, blocked.weights)
            if want_gradient
            else np.zeros(0),
        )

    def _backward(
        self, pieces: list[Piece], backs: list[Back], d_positions: Floats, d_back: Floats
    ) -> Floats:
        """Line 8: the gradient by all weights, from the last sub-trajectory to the first.

        Three things cross from one sub-trajectory to the next: the rope's state, which the simulator
        takes back; its positions, which the controller saw; T_i and the commanded position.
        """
        total: Floats = np.zeros_like(self.flat)
        steps = self.settings.steps // self.settings.segments
        d_state = None
        d_seen, d_previous, d_from = np.zeros_like(self.first_m), np.zeros(PARAMETERS), np.zeros(3)
        for i in reversed(range(len(pieces))):
            d_piece = d_positions[i * steps : (i + 1) * steps + 1].copy()
            d_piece[0] = 0.0  # belongs to the piece before
            d_piece[-1] += d_seen
            d_end, d_state = self.rope.backward(pieces[i], d_piece, d_state)
            row = np.concatenate((d_end.ravel(), d_back[i * steps : (i + 1) * steps], d_previous, d_from))
            d_weights, d_seen, d_previous, d_from = backs[i](row)
            total += d_weights
        return total

    def _blocked(self, held_back: Floats) -> Blocked:
        """The held end's own term in (19): the mean of how far the arm is held back where it is."""
        where = held_back > TINY_M
        if self.settings.loss == "mse" or not where.any():
            return Blocked(0.0, np.zeros_like(held_back))
        weights = self.settings.contact_weight * where / self.settings.steps
        return Blocked(float(weights @ held_back), weights)

    def _split(self, row: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        steps = self.settings.steps // self.settings.segments
        end_m, back_m, parameters, from_m = np.split(row, np.cumsum((3 * steps, steps, PARAMETERS)))
        return end_m.reshape(-1, 3), back_m, parameters, from_m

    def replayed(self, episode: Episode, rope: DifferentiableRope) -> Episode:
        """The same path with another rope: what becomes of it without the margin that it was learned with."""
        state, first_m = rope.start()
        positions_m = np.concatenate([first_m[None], rope.forward(state, episode.end_m).positions_m[1:]])
        obstacles, radius_m = self.layout.obstacles, self.layout.rope.radius_m
        return replace(
            episode,
            positions_m=positions_m,
            contacts=path_loss(positions_m, self.policy.goal_m, obstacles, radius_m, self.settings).contacts,
            goal=goal_error(positions_m[-1], self.policy.goal_m),
            min_clearance_m=float(clearance(positions_m, radius_m, obstacles).min()),
        )

    def trained(self, weights: Floats) -> Policy:
        """The policy with other weights."""
        return replace(self.policy, weights=self.unflatten(weights))
