"""Calls of the direct solver's kernels: roll out, gradients backwards, sensitivities forwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dlolib.errors import SimulationError
from dlolib.sim import derivatives, direct
from dlolib.sim.band import HALF
from dlolib.sim.effects import LAWS
from dlolib.sim.joints import HISTORY
from dlolib.sim.scene import Scene, contact_points
from dlolib.types import Floats

TOLERANCE = 1e-8
MOST_ITERATIONS = 1000
# Parameters whose sides are looked at in one launch: a launch costs as much as the forces of some 100 steps.
TOGETHER = 8
# Damped motion to an equilibrium: steps of one length, the first and last length [s], how often at most, and
# how much longer each time.
RELAXING, RELAXING_S, MOST_RELAXING, LONGER = 5, (0.01, 10.0), 16, 3.0
# A rope that snaps more often than this is on the edge of two shapes all the way.
MOST_SNAPS = 4
# A rope that is held this share longer than it is would tear; one that may stretch, this many times further
# than under its own weight.
TORN, TORN_OVER_WEIGHT = 0.05, 30.0


@dataclass(frozen=True)
class State:
    """Where B ropes are, and what they remember.

    Args:
        x: positions (B, n, 3) [m].
        before: those one step earlier.
        q: frames (B, n + 1, 4); frames 0 and n are the wall's and the grasp's.
        past: histories of the laws (B, n, HISTORY); None: none yet.
        slip: stretch of the contacts' tangential springs (B, K, 3) [m]; None: none yet.
    """

    x: Floats
    before: Floats
    q: Floats
    past: Floats | None = None
    slip: Floats | None = None

    def at_rest(self) -> State:
        """The same without velocity."""
        return replace(self, before=self.x.copy())


@dataclass(frozen=True)
class Path:
    """Held poses at T steps: positions (B, T, 2, 3) [m] and frames (B, T, 2, 4) of start and end.

    Entries of a free end are not read. dt_s (B, T): the steps' durations, where they are not the clock's.
    span (B, T + 1): rest lengths over the scene's, from the initial state on; None: 1.
    """

    x: Floats
    q: Floats
    dt_s: Floats | None = None
    span: Floats | None = None

    def still(self, steps: int) -> Path:
        """So many steps at the first pose."""
        x, q = (np.repeat(part[:, :1], steps, axis=1) for part in (self.x, self.q))
        return Path(x, q, span=None if self.span is None else np.repeat(self.span[:, :1], steps + 1, axis=1))

    def of(self, rope: int, begin: int) -> Path:
        """One rope's, from a step on."""
        x, q, dt_s, span = (
            None if part is None else part[rope : rope + 1, begin:]
            for part in (self.x, self.q, self.dt_s, self.span)
        )
        assert x is not None and q is not None
        return Path(x, q, dt_s, span)


@dataclass(frozen=True)
class Clock:
    """How time passes: `step_s` None is quasi-static; `momentum` 0 lets every step start at rest.

    `fresh`: the laws see every step's rope come from being straight, or from what it once was, at once: so a
    first shape is found.
    """

    step_s: float | None = None
    momentum: float = 1.0
    fresh: bool = False

    @property
    def flags(self) -> tuple[int, float, int]:
        """As the kernels take it: whether time passes, momentum, fresh."""
        return int(self.step_s is not None), self.momentum, int(self.fresh)


@dataclass(frozen=True)
class Rollout:
    """States of B ropes at indices 0 (the initial one) ... T: x (B, T + 1, n, 3), q (B, T + 1, n + 1, 4),
    past (B, T + 1, n, HISTORY), slip (B, T + 1, K, 3), sliding (B, T + 1, K)."""

    scene: Scene
    clock: Clock
    path: Path
    before: Floats
    x: Floats
    q: Floats
    past: Floats
    slip: Floats
    sliding: np.ndarray[tuple[int, ...], np.dtype[np.int32]]
    iterations: np.ndarray[tuple[int, ...], np.dtype[np.int32]]

    @property
    def final(self) -> State:
        """The state to go on from."""
        before = self.x[:, -2] if self.x.shape[1] > 1 else self.before
        last = (self.x[:, -1], before, self.q[:, -1], self.past[:, -1], self.slip[:, -1])
        return State(*(part.copy() for part in last))


@dataclass(frozen=True)
class Case:
    """A scene and the way it is held: what a parameter may change."""

    scene: Scene
    path: Path


@dataclass(frozen=True)
class Variation:
    """A parameter as two cases a little to either side, `width` apart in the parameter."""

    ahead: Case
    behind: Case
    width: float


@dataclass(frozen=True)
class Tangent:
    """Derivatives of a state by C parameters: x and before (B, C, n, 3), turn (B, C, n + 1, 3) of the frames
    in their own axes, past (B, C, n, HISTORY), slip (B, C, K, 3)."""

    x: Floats
    before: Floats
    turn: Floats
    past: Floats
    slip: Floats

    def at_rest(self) -> Tangent:
        """The same without velocity."""
        return replace(self, before=self.x.copy())


@dataclass(frozen=True)
class Cotangent:
    """Derivatives of a scalar by a state: x and before (B, n, 3), turn (B, n + 1, 3), past, slip likewise."""

    x: Floats
    before: Floats
    turn: Floats
    past: Floats
    slip: Floats


@dataclass(frozen=True)
class Gradient:
    """Derivatives of a scalar loss.

    initial: by the initial state. end_x (B, T, 2, 3): by held positions; end_q (B, T, 2, 3): by turns of the
    held frames in their own axes [rad]. parameter (B, C): by the variations asked for.
    """

    initial: Cotangent
    end_x: Floats
    end_q: Floats
    parameter: Floats


def roll_out(scene: Scene, state: State, path: Path, clock: Clock) -> Rollout:
    """Move the held ends along the path.

    Where Newton's method does not follow a quasi-static rope without history, because it snaps to another
    shape, the rope goes there by damped motion.

    Raises:
        SimulationError: a step could not be solved; names the rope, the step and why. Or no end is held, and
            no time passes. Or the ends are held so that the rope would tear.
    """
    if clock.step_s is None and not scene.clamped.any(axis=1).all():
        raise SimulationError(
            "no end is held, and a quasi-static rope would fall for ever",
            mend="hold an end, or simulate it dynamically",
        )
    rollout, status = _launch(scene, state, path, clock)
    forgets = scene.symmetric and not scene.has_laws
    if status.any() and clock == Clock(None) and forgets:
        for rope in np.flatnonzero(status.any(axis=1)):
            _snap(rollout, status, int(rope))
    _refuse(status)
    _refuse_torn(rollout)
    return rollout


def relax(scene: Scene, state: State, path: Path, fresh: bool = False) -> Rollout:
    """Equilibrium of B ropes at the path's first pose: damped motion in steps that grow while they can be
    solved, and the quasi-static step that ends it.

    Raises:
        SimulationError: they do not come to rest.
    """
    step_s = RELAXING_S[0]
    for _ in range(MOST_RELAXING):
        clock = Clock(step_s, momentum=0.0, fresh=fresh)
        moved, status = _launch(scene, state, path.still(RELAXING), clock)
        if status.any():
            step_s /= 4
            continue
        state = moved.final
        step_s *= LONGER
        if step_s > RELAXING_S[1]:
            rest, status = _launch(scene, state, path.still(1), Clock(None, fresh=fresh))
            if not status.any():
                return rest
            step_s = 0.1 * RELAXING_S[1]
    raise SimulationError(
        f"rope {int(np.argmax(status.any(axis=1)))} does not come to rest",
        mend="check its stiffness and how it is held",
    )


def _launch(scene: Scene, state: State, path: Path, clock: Clock) -> tuple[Rollout, np.ndarray]:
    """The kernel's roll-out, and what became of every step (B, T)."""
    ropes, n = state.x.shape[:2]
    count = path.x.shape[1]
    x, q = np.empty((ropes, count + 1, n, 3)), np.empty((ropes, count + 1, n + 1, 4))
    past, slip = np.zeros((ropes, count + 1, n, HISTORY)), np.zeros((ropes, count + 1, contact_points(n), 3))
    sliding = np.zeros((ropes, count + 1, contact_points(n)), np.int32)
    x[:, 0], q[:, 0] = state.x, state.q
    if state.past is not None:
        past[:, 0] = state.past
    if state.slip is not None:
        slip[:, 0] = state.slip
    status, iterations = np.zeros((ropes, count), np.int32), np.zeros((ropes, count), np.int32)
    before = np.ascontiguousarray(state.before)
    direct.roll_out(
        _plain(scene), x, q, before, past, slip, sliding, np.ascontiguousarray(path.x),
        np.ascontiguousarray(path.q), steps_of(path, clock), *scene.arrays(), *clock.flags,
        int(scene.symmetric), TOLERANCE, MOST_ITERATIONS, *(_band(ropes, n) for _ in range(2)),
        _columns(ropes, 2, n), np.zeros((ropes, 7, contact_points(n))), np.empty((ropes, n, 3)),
        np.empty((ropes, n + 1, 4)), status, iterations,
    )  # fmt: skip
    return Rollout(scene, clock, path, before, x, q, past, slip, sliding, iterations), status


def _snap(rollout: Rollout, status: np.ndarray, rope: int) -> None:
    """Mend in place the steps of one rope that were not solved: each by damped motion, then on from there."""
    alone = rollout.scene.of(rope)
    for _ in range(MOST_SNAPS):
        if not status[rope].any():
            return
        step = int(np.argmax(status[rope] != 0))
        held = rollout.path.of(rope, step)
        x, q = rollout.x[[rope], step], rollout.q[[rope], step]
        # the span's first entry is that of the state before the step
        there = held if held.span is None else replace(held, span=held.span[:, 1:])
        try:
            rest = relax(alone, State(x, x.copy(), q), there)
        except SimulationError:
            return
        rollout.x[rope, step + 1], rollout.q[rope, step + 1] = rest.x[0, 1], rest.q[0, 1]
        after, status[rope, step + 1 :] = _launch(
            alone, rest.final.at_rest(), rollout.path.of(rope, step + 1), rollout.clock
        )
        status[rope, step] = 0
        rollout.x[rope, step + 2 :], rollout.q[rope, step + 2 :] = after.x[0, 1:], after.q[0, 1:]
        rollout.iterations[rope, step + 1 :] = after.iterations[0]


def gradient(
    rollout: Rollout,
    d_x: Floats,
    final: Cotangent | None = None,
    variations: Sequence[Variation] = (),
) -> Gradient:
    """Adjoint of the whole roll-out for a loss whose derivative by the positions x is d_x, same shape.

    Args:
        rollout: what `roll_out` returned.
        d_x: (B, T + 1, n, 3).
        final: further derivatives by the final state (`Rollout.final`), its positions and those before too.
        variations: parameters whose derivative is wanted, too.
    """
    ropes, indices, n = rollout.x.shape[:3]
    d_x = np.array(d_x, dtype=float, order="C")
    turn, past = np.zeros((ropes, n + 1, 3)), np.zeros((ropes, n, HISTORY))
    slip, first = np.zeros((ropes, contact_points(n), 3)), np.zeros((ropes, n, 3))
    if final is not None:
        d_x[:, -1] += final.x
        # the state before the last one is the last position but one
        d_x[:, -2] += final.before
        turn, past, slip = (np.array(part, order="C") for part in (final.turn, final.past, final.slip))
    end_x, end_q = np.zeros((ropes, indices - 1, 2, 3)), np.zeros((ropes, indices - 1, 2, 3))
    parameter = np.zeros((ropes, len(variations), 1))
    scene = rollout.scene
    factors, memory = _linearised(rollout)
    derivatives.adjoint(
        rollout.x, rollout.q, np.ascontiguousarray(rollout.path.q), steps_of(rollout.path, rollout.clock),
        scene.joints, scene.particles, scene.grips, scene.clamped, *rollout.clock.flags,
        int(scene.symmetric), *factors, _columns(ropes, 2, n), *memory, *_explicit(rollout, variations), d_x,
        first, turn, past, slip, end_x, end_q, parameter,
    )  # fmt: skip
    return Gradient(Cotangent(d_x[:, 0], first, turn, past, slip), end_x, end_q, parameter[..., 0])


def sensitivities(
    rollout: Rollout,
    variations: Sequence[Variation],
    steps: np.ndarray,
    initial: Tangent | None = None,
) -> tuple[Floats, Tangent]:
    """Derivatives of the positions at some steps (1 ... T) by C parameters: (B, len(steps), C, n, 3).

    `initial` are those of the initial state, where it depends on the parameters. Returned with those of the
    final state.
    """
    ropes, indices, n = rollout.x.shape[:3]
    count = len(variations)
    slot = np.full(indices - 1, -1, np.int32)
    slot[np.asarray(steps) - 1] = np.arange(len(steps))
    out = np.zeros((ropes, len(steps), count, n, 3))
    begin = initial or zero_tangent(ropes, count, n)
    x, before, turn, past, slip = (
        np.array(part, order="C") for part in (begin.x, begin.before, begin.turn, begin.past, begin.slip)
    )
    scene = rollout.scene
    factors, memory = _linearised(rollout)
    derivatives.sensitivities(
        rollout.x, rollout.q, steps_of(rollout.path, rollout.clock), scene.joints,
        scene.particles, scene.grips, scene.clamped, *rollout.clock.flags, int(scene.symmetric), *factors,
        _columns(ropes, count, n), *memory, slot, *_explicit(rollout, variations), x, before, turn,
        np.zeros((ropes, count, n + 1, 3)), past, slip, out,
    )  # fmt: skip
    return out, Tangent(x, before, turn, past, slip)


def zero_tangent(ropes: int, count: int, n: int) -> Tangent:
    """Of a state that depends on none of the parameters."""
    place = np.zeros((ropes, count, n, 3))
    turn, past = np.zeros((ropes, count, n + 1, 3)), np.zeros((ropes, count, n, HISTORY))
    return Tangent(place, place.copy(), turn, past, np.zeros((ropes, count, contact_points(n), 3)))


def _explicit(rollout: Rollout, variations: Sequence[Variation]) -> tuple[Floats, Floats, Floats, Floats]:
    """What each parameter does to every step at fixed states: to forces, histories, contacts, held poses."""
    ropes, indices, n = rollout.x.shape[:3]
    states = ropes * (indices - 1)
    count = len(variations)
    force, held = np.zeros((states, count, 6 * (n + 1))), np.zeros((ropes, indices - 1, count, 2, 6))
    past, slip = np.zeros((states, count, n, HISTORY)), np.zeros((states, count, contact_points(n), 3))
    for first in range(0, count, TOGETHER):
        some = variations[first : first + TOGETHER]
        sides = _forces(rollout, [case for one in some for case in (one.ahead, one.behind)])
        for c, variation in enumerate(some, first):
            for target, side in zip((force, past, slip), sides, strict=True):
                target[:, c] = (side[2 * (c - first)] - side[2 * (c - first) + 1]) / variation.width
    for c, variation in enumerate(variations):
        one, other = variation.ahead.path, variation.behind.path
        if one is not other:
            held[:, :, c, :, :3] = (one.x - other.x) / variation.width
            held[:, :, c, :, 3:] = _turn(other.q, one.q) / variation.width
    return force, past, slip, np.nan_to_num(held)


def _forces(rollout: Rollout, cases: Sequence[Case]) -> tuple[Floats, Floats, Floats]:
    """Minus the forces of every step in C other cases, and the histories that follow: (C, states, ...)."""
    ropes, indices, n = rollout.x.shape[:3]
    states = ropes * (indices - 1)
    count = len(cases)
    y = np.zeros((count * states, 1, 6 * (n + 1)))
    past = np.zeros((count * states, 1, n, HISTORY))
    slip = np.zeros((count * states, 1, contact_points(n), 3))

    def each(values: Any) -> Any:
        return np.tile(values, (count,) + (1,) * (values.ndim - 1))

    derivatives.residuals(
        *(each(part) for part in (rollout.x, rollout.q, rollout.before, rollout.past, rollout.slip)),
        each(rollout.sliding), np.concatenate([case.path.q for case in cases]),
        np.concatenate([steps_of(case.path, rollout.clock) for case in cases]),
        *Scene.stack([case.scene for case in cases]).arrays(), *rollout.clock.flags,
        int(rollout.scene.symmetric), np.zeros((1, 1, HALF + 1)), y, past, slip,
    )  # fmt: skip
    return tuple(part[:, 0].reshape(count, states, *part.shape[2:]) for part in (y, past, slip))  # type: ignore[return-value]


def _turn(a: Floats, b: Floats) -> Floats:
    """Rotation vector from frames a to frames b (..., 4), a little apart, in a's own axes."""
    w, v = a[..., :1], a[..., 1:]
    along = w * b[..., 1:] - b[..., :1] * v - np.cross(v, b[..., 1:])
    over = np.sum(a * b, axis=-1, keepdims=True)
    return np.asarray(2 * np.sign(over) * along)


def _linearised(rollout: Rollout) -> tuple[list[Floats], list[Floats]]:
    """K of every step at its converged state, rope by rope: factored (two parts) and whole (two parts); and
    how its laws and contacts depend on the step before."""
    ropes, indices, n = rollout.x.shape[:3]
    states = ropes * (indices - 1)
    factors = [_band(states, n) for _ in range(4)]
    # room for what acts alone: untouched memory costs as much as a step
    laws = rollout.scene.has_laws
    bends = np.zeros((states, n, len(LAWS), 20) if laws else (1, 1, 1, 1))
    rubs = np.zeros((1, 1, 1) if rollout.scene.symmetric else (states, contact_points(n), 19))
    memory = [bends, rubs]
    status = np.zeros(states, np.int32)
    derivatives.linearise(
        rollout.x, rollout.q, rollout.before, rollout.past, rollout.slip, rollout.sliding,
        np.ascontiguousarray(rollout.path.q), steps_of(rollout.path, rollout.clock), *rollout.scene.arrays(),
        *rollout.clock.flags, int(rollout.scene.symmetric), *factors, _columns(states, 1, n), *memory, status,
    )  # fmt: skip
    _refuse(status.reshape(ropes, indices - 1))
    return factors, memory


def steps_of(path: Path, clock: Clock) -> Floats:
    """Duration of the step to each index and span at it, (B, T + 1, 2)."""
    ropes, count = path.x.shape[:2]
    steps = np.ones((ropes, count + 1, 2))
    steps[:, :, 0] = clock.step_s or 1.0
    if path.dt_s is not None:
        steps[:, 1:, 0] = path.dt_s
    if path.span is not None:
        steps[:, :, 1] = path.span
    return steps


def _plain(scene: Scene) -> bool:
    """Whether nothing acts on the ropes but what is elastic, loads and inertia."""
    return scene.symmetric and not scene.obstacles.shape[1] and not scene.has_laws


def _band(slots: int, n: int) -> Floats:
    band = np.empty((slots, 6 * (n + 1) + HALF, HALF + 1))
    band[:, -HALF:] = 0.0
    return band


def _columns(slots: int, columns: int, n: int) -> Floats:
    return np.zeros((slots, columns, 6 * (n + 1) + HALF))


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


def _refuse_torn(rollout: Rollout) -> None:
    """Refuse a rope that is held longer than it can be, by its ends or round an obstacle."""
    scene, path = rollout.scene, rollout.path
    if not scene.clamped.all() or path.x.shape[1] == 0:
        return
    weight = np.linalg.norm(scene.force, axis=2).sum(axis=1)
    most = TORN + TORN_OVER_WEIGHT * weight / scene.segments[..., 3].min(axis=1)
    span = 1.0 if path.span is None else path.span[:, 1:]
    over = (
        np.linalg.norm(path.x[:, :, 1] - path.x[:, :, 0], axis=2)
        / scene.segment_l.sum(axis=1)[:, None]
        / span
    )
    if scene.obstacles.shape[1]:
        pieces = np.linalg.norm(np.diff(rollout.x[:, 1:], axis=2), axis=3) / scene.segment_l[:, None]
        over = np.maximum(over, pieces.max(axis=2) / span)
    torn = over - 1 > most[:, None]
    if torn.any():
        rope, step = np.argwhere(torn)[0]
        raise SimulationError(
            f"rope {rope}, step {step + 1}: held {100 * (over[rope, step] - 1):.0f} % longer than it is, "
            "it would tear",
            mend="bring the ends nearer to each other, check the length, or give axial_stretch",
        )
