"""Calls of the direct solver's kernels: roll out, gradients backwards, sensitivities forwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlolib.errors import SimulationError
from dlolib.sim import direct
from dlolib.sim.band import HALF
from dlolib.sim.rod import Scene
from dlolib.types import Floats

TOLERANCE = 1e-8
MOST_ITERATIONS = 1000


@dataclass(frozen=True)
class State:
    """Where B ropes are: positions (B, n, 3) [m], those one step earlier, frames (B, n + 1, 4).

    Frames 0 and n are the wall's and the grasp's.
    """

    x: Floats
    before: Floats
    q: Floats


@dataclass(frozen=True)
class Path:
    """Held poses at T steps: positions (B, T, 2, 3) [m] and frames (B, T, 2, 4) of start and end.

    Entries of a free end are not read.
    """

    x: Floats
    q: Floats


@dataclass(frozen=True)
class Clock:
    """How time passes: `step_s` None is quasi-static; `momentum` 0 lets every step start at rest."""

    step_s: float | None = None
    momentum: float = 1.0

    @property
    def rate(self) -> float:
        """1 / dt, 0 for quasi-static [1/s]."""
        return 0.0 if self.step_s is None else 1.0 / self.step_s


@dataclass(frozen=True)
class Rollout:
    """States of B ropes at indices 0 (the initial one) ... T: x (B, T + 1, n, 3), q (B, T + 1, n + 1, 4)."""

    scene: Scene
    clock: Clock
    before: Floats
    x: Floats
    q: Floats
    iterations: np.ndarray[tuple[int, ...], np.dtype[np.int32]]

    @property
    def final(self) -> State:
        """The state to go on from."""
        before = self.x[:, -2] if self.x.shape[1] > 1 else self.before
        return State(self.x[:, -1].copy(), before.copy(), self.q[:, -1].copy())


@dataclass(frozen=True)
class Gradient:
    """Derivatives of a scalar loss: by initial positions and those before, held poses, and parameters.

    end_x (B, T, 2, 3); end_q (B, T, 2, 3) by turns of the held frames in their own axes [rad];
    joint_d, joint_rest, force as in `Scene`.
    """

    x: Floats
    before: Floats
    end_x: Floats
    end_q: Floats
    joint_d: Floats
    joint_rest: Floats
    force: Floats


@dataclass(frozen=True)
class Directions:
    """P parameters as directions in the scene: each (B, P, n, 3), frame (B, P, 2, 3)."""

    joint_d: Floats
    joint_rest: Floats
    force: Floats
    frame: Floats


def roll_out(scene: Scene, state: State, path: Path, clock: Clock) -> Rollout:
    """Move the held ends along the path.

    Raises:
        SimulationError: a step could not be solved; names the rope, the step and why.
    """
    ropes, n = state.x.shape[:2]
    steps = path.x.shape[1]
    x, q = np.empty((ropes, steps + 1, n, 3)), np.empty((ropes, steps + 1, n + 1, 4))
    x[:, 0], q[:, 0] = state.x, state.q
    status, iterations = np.zeros((ropes, steps), np.int32), np.zeros((ropes, steps), np.int32)
    direct.roll_out(
        x, q, np.ascontiguousarray(state.before), np.ascontiguousarray(path.x), np.ascontiguousarray(path.q),
        *scene.arrays(), clock.rate, clock.momentum, TOLERANCE, MOST_ITERATIONS, *_bands(ropes, n),
        _columns(ropes, 2, n),
        np.empty((ropes, n, 3)), np.empty((ropes, n + 1, 4)), np.empty((ropes, n, 3)), status, iterations,
    )  # fmt: skip
    _refuse(status)
    return Rollout(scene, clock, state.before, x, q, iterations)


def gradient(rollout: Rollout, d_x: Floats, d_before: Floats | None = None) -> Gradient:
    """Adjoint of the whole roll-out for a loss whose derivative by the positions x is d_x, same shape."""
    ropes, indices, n = rollout.x.shape[:3]
    d_x = np.array(d_x, order="C")
    before = np.zeros((ropes, n, 3)) if d_before is None else np.array(d_before, order="C")
    end_x, end_q = np.zeros((ropes, indices - 1, 2, 3)), np.zeros((ropes, indices - 1, 2, 3))
    joint_d, joint_rest, force = (np.zeros((ropes, n, 3)) for _ in range(3))
    if d_before is not None:
        # a loss by the state before the last one is a loss by the last position but one
        d_x[:, -2] += before
        before[:] = 0
    made, clock = rollout.scene, rollout.clock
    direct.adjoint(
        rollout.x, rollout.q, made.joint_d, made.joint_l, made.joint_rest, made.mass, made.drag, made.clamped,
        clock.rate, clock.momentum, *_linearised(rollout), _columns(ropes, 1, n), d_x, before, end_x, end_q,
        joint_d, joint_rest, force,
    )  # fmt: skip
    return Gradient(d_x[:, 0], before, end_x, end_q, joint_d, joint_rest, force)


def sensitivities(
    rollout: Rollout,
    directions: Directions,
    steps: np.ndarray,
    initial: Floats | None = None,
) -> Floats:
    """Derivatives of the positions at some steps (1 ... T) by P parameters: (B, len(steps), P, n, 3).

    `initial` (B, P, n, 3) are those of an initial state at rest, where it depends on the parameters.
    """
    ropes, indices, n = rollout.x.shape[:3]
    parameters = directions.frame.shape[1]
    slot = np.full(indices - 1, -1, np.int32)
    slot[np.asarray(steps) - 1] = np.arange(len(steps))
    out = np.zeros((ropes, len(steps), parameters, n, 3))
    begin = np.zeros((ropes, parameters, n, 3)) if initial is None else np.ascontiguousarray(initial)
    made, clock = rollout.scene, rollout.clock
    direct.sensitivities(
        rollout.x, rollout.q, made.joint_d, made.joint_l, made.joint_rest, made.mass, made.drag, made.clamped,
        clock.rate, clock.momentum, *_linearised(rollout), _columns(ropes, parameters, n), slot,
        *(np.ascontiguousarray(getattr(directions, name)) for name in directions.__dataclass_fields__),
        begin.copy(), begin.copy(), out,
    )  # fmt: skip
    return out


def _linearised(rollout: Rollout) -> tuple[Floats, Floats]:
    """The Hessian of every step at its converged state, rope by rope: factored, and whole."""
    ropes, indices, n = rollout.x.shape[:3]
    states = ropes * (indices - 1)
    band, saved = _bands(states, n)
    status = np.zeros(states, np.int32)
    x = np.ascontiguousarray(rollout.x[:, 1:]).reshape(states, 1, n, 3)
    q = np.ascontiguousarray(rollout.q[:, 1:]).reshape(states, 1, n + 1, 4)
    each = (np.repeat(array, indices - 1, axis=0) for array in rollout.scene.arrays())
    direct.linearise(
        x, q, *each, rollout.clock.rate, band, saved, _columns(states, 1, n), x[:, 0].copy(), status
    )  # fmt: skip
    _refuse(status.reshape(ropes, indices - 1))
    return band, saved


def _bands(ropes: int, n: int) -> tuple[Floats, Floats]:
    return np.zeros((ropes, 6 * (n + 1) + HALF, HALF + 1)), np.zeros((ropes, 6 * (n + 1) + HALF, HALF + 1))


def _columns(ropes: int, columns: int, n: int) -> Floats:
    return np.zeros((ropes, columns, 6 * (n + 1) + HALF))


def _refuse(status: np.ndarray) -> None:
    if not status.any():
        return
    rope, step = np.argwhere(status)[0]
    why = {
        direct.UNCONVERGED: f"no equilibrium within {MOST_ITERATIONS} iterations",
        direct.NOT_FINITE: "the rod's Hessian is singular or the state not finite",
    }[int(status[rope, step])]
    raise SimulationError(
        f"rope {rope}, step {step + 1}: {why}",
        mend="move the ends in smaller steps, or check stiffness and length",
    )
