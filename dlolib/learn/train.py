"""Algorithm 2: learn a path by sending the loss's gradient back through the simulated rope."""

from __future__ import annotations

from dataclasses import dataclass, replace

import autograd.numpy as anp
import numpy as np
from autograd import make_jvp, make_vjp
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
class Choices:
    """What the controller was shown and what it chose, for each of k sub-trajectories.

    seen_m (k, N, 3), previous (k, 5), the T_{i-1}; from_m (k, 3), where the commanded path had come to;
    parameters (k, 5), the T_i.
    """

    seen_m: Floats
    previous: Floats
    from_m: Floats
    parameters: Floats


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
        self.each = settings.steps // settings.segments

    def way(self, parameters: Floats, from_m: Floats) -> Floats:
        """Line 5 of Algorithm 2: sub-trajectories and what the arm makes of them, differentiable.

        Args:
            parameters: T_i, shape (..., 5).
            from_m: where the commanded path has come to, shape (..., 3).

        Returns:
            In one row: the executed positions (M, 3), how far each is from the commanded one (M,), the last
            commanded position (3,).
        """
        commanded = arc(parameters, from_m, self.a_m, self.b_m, self.each)
        reach_m = REACH * self.layout.rope.length_m
        executed = self.push_out(within_reach(commanded, self.layout.start.position_m, reach_m))
        held_back = anp.sqrt(anp.sum((commanded - executed) ** 2, axis=-1) + TINY_M**2) - TINY_M
        flat = anp.reshape(executed, (*held_back.shape[:-1], -1))
        row: Floats = anp.concatenate((flat, held_back, commanded[..., -1, :]), axis=-1)
        return row

    def episode(self, weights: Floats, want_gradient: bool = True) -> Episode:
        """Lines 3 to 8 of Algorithm 2: forward through all sub-trajectories, the loss, and back."""
        layers = self.unflatten(weights)
        state, seen = self.initial, [self.first_m]
        chosen, come_to = [np.zeros(PARAMETERS)], [self.a_m]
        pieces: list[Piece] = []
        executed: list[Floats] = []
        held_back: list[Floats] = []
        for _ in range(self.settings.segments):
            chosen.append(self.policy.parameters(layers, seen[-1], chosen[-1]))
            row = self.way(chosen[-1], come_to[-1])
            end_m, back_m, reached_m = np.split(row, (3 * self.each, 4 * self.each))
            piece = self.rope.forward(state, end_m.reshape(-1, 3))
            state = piece.state
            pieces.append(piece)
            executed.append(end_m.reshape(-1, 3))
            held_back.append(back_m)
            come_to.append(reached_m)
            seen.append(piece.positions_m[-1])
        choices = Choices(
            seen_m=np.array(seen[:-1]),
            previous=np.array(chosen[:-1]),
            from_m=np.array(come_to[:-1]),
            parameters=np.array(chosen[1:]),
        )
        positions_m = np.concatenate([self.first_m[None], *(piece.positions_m[1:] for piece in pieces)])
        obstacles, radius_m = self.layout.obstacles, self.layout.rope.radius_m
        loss = path_loss(positions_m, self.policy.goal_m, obstacles, radius_m, self.settings)
        blocked = self._blocked(np.concatenate(held_back))
        return Episode(
            positions_m=positions_m,
            end_m=np.concatenate(executed),
            parameters=choices.parameters,
            loss=loss.value + blocked.value,
            contacts=loss.contacts,
            goal=goal_error(positions_m[-1], self.policy.goal_m),
            min_clearance_m=self._clearance(positions_m),
            gradient=self._backward(weights, pieces, choices, loss.d_positions, blocked.weights)
            if want_gradient
            else np.zeros(0),
        )

    def _backward(
        self, weights: Floats, pieces: list[Piece], choices: Choices, d_positions: Floats, d_back: Floats
    ) -> Floats:
        """Line 8: the gradient by all weights, from the last sub-trajectory to the first.

        Three things cross from one sub-trajectory to the next: the rope's state, which the simulator
        takes back; its positions, which the controller saw; T_i and the commanded position.
        """
        by_choice, by_seen, by_previous = self._jacobians(weights, choices)
        d_chosen = np.zeros_like(choices.parameters)
        d_state = None
        d_seen, d_previous, d_from = np.zeros_like(self.first_m), np.zeros(PARAMETERS), np.zeros(3)
        for i in reversed(range(len(pieces))):
            steps = slice(i * self.each, (i + 1) * self.each)
            d_piece = d_positions[steps.start : steps.stop + 1].copy()
            d_piece[0] = 0.0  # belongs to the piece before
            d_piece[-1] += d_seen
            d_end, d_state = self.rope.backward(pieces[i], d_piece, d_state)
            d_choice = by_choice[i] @ np.concatenate((d_end.ravel(), d_back[steps], d_from))
            d_chosen[i] = d_choice[:PARAMETERS] + d_previous
            d_from = d_choice[PARAMETERS:]
            d_seen, d_previous = (np.tensordot(d_chosen[i], by[i], 1) for by in (by_seen, by_previous))
        back, _ = make_vjp(lambda w: self._chosen(w, choices.seen_m, choices.previous))(weights)
        gradient: Floats = back(d_chosen)
        return gradient

    def _jacobians(self, weights: Floats, choices: Choices) -> tuple[Floats, Floats, Floats]:
        """Of each row of `way` by T_i and where it begins, (k, 8, 4 M + 3); of T_i by the nodes that the
        controller saw, (k, 5, N, 3), and by T_{i-1}, (k, 5, 5). All at once: each costs as much as one."""
        inputs = np.concatenate((choices.parameters, choices.from_m), axis=1)
        tiled, unit = _for_each(inputs, inputs.shape[1])
        _, by_choice = make_jvp(lambda v: self.way(v[..., :PARAMETERS], v[..., PARAMETERS:]))(tiled)(unit)
        seen_m, unit = _for_each(choices.seen_m, PARAMETERS)
        previous, _ = _for_each(choices.previous, PARAMETERS)
        back, _ = make_vjp(lambda v: self._chosen(weights, *v))((seen_m, previous))
        return by_choice, *back(unit)

    def _chosen(self, weights: Floats, seen_m: Floats, previous: Floats) -> Floats:
        return self.policy.parameters(self.unflatten(weights), seen_m, previous)

    def _blocked(self, held_back: Floats) -> Blocked:
        """The held end's own term in (19): the mean of how far the arm is held back where it is."""
        where = held_back > TINY_M
        if self.settings.loss == "mse" or not where.any():
            return Blocked(0.0, np.zeros_like(held_back))
        weights = self.settings.contact_weight * where / self.settings.steps
        return Blocked(float(weights @ held_back), weights)

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
            min_clearance_m=self._clearance(positions_m),
        )

    def _clearance(self, positions_m: Floats) -> float:
        """The smallest clearance [m] of a rope (T + 1, N, 3): of all of it at each step, and of its moved end
        on the straight way from one step to the next.

        The rope keeps to the side of an obstacle where it was. The arm need not: an obstacle that stands in
        its way leads it round, behind its middle from one side to the other in a step.
        """
        obstacles, radius_m = self.layout.obstacles, self.layout.rope.radius_m
        way = clearance(positions_m[None, :, -1], radius_m, obstacles)
        return float(min(clearance(positions_m, radius_m, obstacles).min(), way.min()))

    def trained(self, weights: Floats) -> Policy:
        """The policy with other weights."""
        return replace(self.policy, weights=self.unflatten(weights))


def _for_each(values: Floats, count: int) -> tuple[Floats, Floats]:
    """Values (k, ...) so many times, (k, count, ...), and a unit vector for each, (k, count, count)."""
    shape = (len(values), count)
    repeated = np.broadcast_to(values[:, None], (*shape, *values.shape[1:]))
    return repeated, np.broadcast_to(np.eye(count), (*shape, count))
