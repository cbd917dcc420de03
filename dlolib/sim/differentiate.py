"""Derivatives of roll-outs: gradients of a scalar backwards, sensitivities of the positions forwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlolib.sim import adjoint, linearise, sensitivity
from dlolib.sim.assembly import ENDS
from dlolib.sim.band import HALF
from dlolib.sim.effects import LAWS
from dlolib.sim.explicit import CONTACT, GRIP, JOINT, PARTICLE, SEGMENT
from dlolib.sim.joints import HISTORY
from dlolib.sim.runtime import LANES
from dlolib.sim.scene import Scene
from dlolib.sim.simulate import (
    Clock,
    Path,
    Rollout,
    State,
    banded,
    before_next,
    columns,
    refuse,
    steps_of,
)
from dlolib.types import Floats


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
    slip, first = np.zeros((ropes, rollout.scene.slips, 3)), np.zeros((ropes, n, 3))
    if final is not None:
        d_x[:, -1] += final.x
        weights = before_next(indices - 1, rollout.clock)
        for back, weight in enumerate(weights[::-1]):
            (d_x[:, -1 - back] if back < indices else first)[:] += weight * final.before
        turn, past, slip = (np.array(part, order="C") for part in (final.turn, final.past, final.slip))
    end_x, end_q = np.zeros((ropes, indices - 1, 2, 3)), np.zeros((ropes, indices - 1, 2, 3))
    groups = groups_of(len(variations))
    parameter = np.zeros((ropes, groups, LANES))
    scene = rollout.scene
    factors, memory = _linearised(rollout)
    adjoint.adjoint(
        *_states(rollout), np.ascontiguousarray(rollout.path.q), steps_of(rollout.path, rollout.clock),
        scene.joints, scene.particles, scene.grips, scene.clamped, *rollout.clock.flags,
        int(scene.symmetric), *factors, columns(ropes, 2, n), *memory, *_cases(rollout, variations),
        in_rows(ropes, groups, n), *_room(rollout, variations), d_x, first, turn, past, slip, end_x,
        end_q, parameter,
    )  # fmt: skip
    by_parameter = of_lanes(parameter, len(variations))
    return Gradient(Cotangent(d_x[:, 0], first, turn, past, slip), end_x, end_q, by_parameter)


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
    groups = groups_of(count)
    slot = np.full(indices - 1, -1, np.int32)
    slot[np.asarray(steps) - 1] = np.arange(len(steps))
    out = np.zeros((ropes, len(steps), groups, 3 * n, LANES))
    begin = initial or zero_tangent(rollout.scene, count)
    u, trail = in_rows(ropes, groups, n), np.stack([in_rows(ropes, groups, n)] * sensitivity.KEPT, axis=1)
    _positions(u)[:], _turns(u)[:] = map(in_lanes, (begin.x, begin.turn))
    _positions(trail[:, 0])[:], _positions(trail[:, 1])[:] = map(in_lanes, (begin.before, begin.x))
    past, slip = in_lanes(begin.past), in_lanes(begin.slip)
    scene = rollout.scene
    factors, memory = _linearised(rollout)
    sensitivity.sensitivities(
        *_states(rollout), steps_of(rollout.path, rollout.clock), scene.joints, scene.particles, scene.grips,
        scene.clamped, *rollout.clock.flags, int(scene.symmetric), *factors, *memory, slot,
        *_cases(rollout, variations), *_room(rollout, variations), u, trail,
        in_rows(ropes, groups, n), past, slip, np.zeros((ropes, groups, n, 2, LANES)), out,
    )  # fmt: skip
    moved = np.moveaxis(out.reshape(ropes, len(steps), groups, n, 3, LANES), -1, 3)
    moved = moved.reshape(ropes, len(steps), groups * LANES, n, 3)[:, :, :count]
    onward = sum(
        weight * _positions(trail[:, (indices - back) % sensitivity.KEPT])
        for back, weight in enumerate(before_next(indices - 1, rollout.clock)[::-1])
    )
    states = (_positions(u), onward, _turns(u), past, slip)
    return moved, Tangent(*(of_lanes(part, count) for part in states))


def groups_of(count: int) -> int:
    """Into how many groups of `LANES` so many columns go."""
    return -(-count // LANES)


def in_lanes(part: Floats) -> Floats:
    """Columns (B, C, ...) in groups: (B, G, ..., LANES)."""
    ropes, count = part.shape[:2]
    groups = groups_of(count)
    padded = np.zeros((ropes, groups * LANES, *part.shape[2:]))
    padded[:, :count] = part
    grouped = padded.reshape(ropes, groups, LANES, *part.shape[2:])
    return np.ascontiguousarray(np.moveaxis(grouped, 2, -1))


def of_lanes(part: Floats, count: int) -> Floats:
    """So many columns (B, C, ...) of groups (B, G, ..., LANES)."""
    columns_first = np.moveaxis(part, -1, 2)
    ropes, groups = part.shape[:2]
    return np.ascontiguousarray(columns_first.reshape(ropes, groups * LANES, *part.shape[2:-1])[:, :count])


def in_rows(ropes: int, groups: int, n: int) -> Floats:
    """Room for unknowns by parameters, in the rows of `band`."""
    return np.zeros((ropes, groups, 6 * (n + 1) + HALF, LANES))


def _positions(u: Floats) -> Floats:
    """Those among rows (B, G, rows, LANES), as a view (B, G, n, 3, LANES)."""
    blocks = u[:, :, :-HALF].reshape(*u.shape[:2], -1, 6, LANES)
    return blocks[:, :, 1:, :3]


def _turns(u: Floats) -> Floats:
    """Those of the frames, (B, G, n + 1, 3, LANES)."""
    return u[:, :, :-HALF].reshape(*u.shape[:2], -1, 6, LANES)[:, :, :, 3:]


def _states(rollout: Rollout) -> tuple[np.ndarray, ...]:
    """All states of a roll-out, as the kernels take them. A fresh rope's past is made anew for every case."""
    past = rollout.past.copy() if rollout.clock.fresh else rollout.past
    return rollout.x, rollout.q, rollout.before, past, rollout.slip, rollout.sliding


def zero_tangent(scene: Scene, count: int) -> Tangent:
    """Of a state that depends on none of so many parameters."""
    ropes, n = scene.particles.shape[:2]
    place = np.zeros((ropes, count, n, 3))
    turn, past = np.zeros((ropes, count, n + 1, 3)), np.zeros((ropes, count, n, HISTORY))
    return Tangent(place, place.copy(), turn, past, np.zeros((ropes, count, scene.slips, 3)))


def tangent_between(scene: Scene, sides: Sequence[tuple[State, State, float]]) -> Tangent:
    """Of a state at rest that each parameter puts at one of two places, a little to either side, so far apart
    in the parameter; what it remembers depends on none."""
    x = np.stack([(one.x - other.x) / width for one, other, width in sides], axis=1)
    turn = np.stack([_turn(other.q, one.q) / width for one, other, width in sides], axis=1)
    return replace(zero_tangent(scene, len(sides)), x=x, turn=turn).at_rest()


def _cases(rollout: Rollout, variations: Sequence[Variation]) -> tuple[np.ndarray, ...]:
    """The parameters' scenes as `explicit` takes them, and how they move what is held: (B, T, G, 12)."""
    ropes, indices, n = rollout.x.shape[:3]
    if any(case.path.x.shape[1] != indices - 1 for one in variations for case in (one.ahead, one.behind)):
        raise ValueError("a parameter's path has another number of steps than the roll-out")
    differs = [_differing(one, rollout.clock) for one in variations]
    # what holds the ends otherwise alone changes no force on a rope that is where it is
    slots = [c for c, differ in enumerate(differs) if differ.any()]
    cases = [case for c in slots for case in (variations[c].ahead, variations[c].behind)]
    cases = cases or [Case(rollout.scene, rollout.path)]
    held = np.zeros((ropes, indices - 1, groups_of(len(variations)), 2, 6, LANES))
    for c, variation in enumerate(variations):
        one, other = variation.ahead.path, variation.behind.path
        if one is not other:
            own = held[:, :, c // LANES, :, :, c % LANES]
            own[..., :3] = np.nan_to_num(one.x - other.x) / variation.width
            own[..., 3:] = np.nan_to_num(_turn(other.q, one.q)) / variation.width
    return (
        np.concatenate([case.path.q for case in cases]),
        np.concatenate([steps_of(case.path, rollout.clock) for case in cases]),
        *Scene.stack([case.scene for case in cases]).arrays()[:-1],
        np.array([differs[c] for c in slots], np.int32).reshape(len(slots), ropes, n + 1),
        np.array(slots, np.int32),
        np.array([variations[c].width for c in slots]),
        held.reshape(*held.shape[:3], 12, LANES),
    )


def _differing(variation: Variation, clock: Clock) -> np.ndarray:
    """What differs between a parameter's two cases, by the bits of `explicit`: (B, n + 1)."""
    one, other = variation.ahead, variation.behind
    ropes, n = one.scene.particles.shape[:2]
    found = np.zeros((ropes, n + 1), np.int32)
    a, b = one.scene, other.scene
    found[:, :n] |= np.where((a.joints != b.joints).any(axis=2), JOINT, 0)
    found[:, : n - 1] |= np.where((a.segments != b.segments).any(axis=2), SEGMENT, 0)
    found[:, :n] |= np.where((a.particles != b.particles).any(axis=2), PARTICLE, 0)
    if not np.array_equal(a.contacts, b.contacts) or not np.array_equal(a.obstacles, b.obstacles):
        found[:, :n] |= CONTACT
    grips = bool((a.grips != b.grips).any())
    if one.path is not other.path:
        if not np.array_equal(steps_of(one.path, clock), steps_of(other.path, clock)):
            found[:, :n] |= JOINT | PARTICLE
            found[:, : n - 1] |= SEGMENT
        grips = grips or (bool(a.grips.any()) and not np.array_equal(one.path.q, other.path.q))
    if grips:
        found[:, [0, n]] |= GRIP
    return found


def _room(rollout: Rollout, variations: Sequence[Variation]) -> tuple[Floats, Floats, Floats]:
    """For what parameters do to the histories that follow a step."""
    ropes, n = rollout.scene.particles.shape[:2]
    groups, slips = groups_of(len(variations)), rollout.scene.slips
    sides = [case.scene for one in variations for case in (one.ahead, one.behind)]
    laws = any(scene.has_laws for scene in (rollout.scene, *sides))
    by_past = np.zeros((ropes, groups, n if laws else 1, HISTORY, LANES))
    return by_past, np.zeros((ropes, groups, slips, 3, LANES)), np.zeros((ropes, 2, n, HISTORY))


def _turn(a: Floats, b: Floats) -> Floats:
    """Rotation vector from frames a to frames b (..., 4), a little apart, in a's own axes."""
    w, v = a[..., :1], a[..., 1:]
    along = w * b[..., 1:] - b[..., :1] * v - np.cross(v, b[..., 1:])
    over = np.sum(a * b, axis=-1, keepdims=True)
    return np.asarray(2 * np.sign(over) * along)


def _linearised(rollout: Rollout) -> tuple[list[Floats], list[Floats]]:
    """K of every step at its converged state, rope by rope: its factors (two parts) and the columns of what
    is prescribed; and how its laws and contacts depend on the step before."""
    ropes, indices, n = rollout.x.shape[:3]
    states = ropes * (indices - 1)
    lower = banded(1 if rollout.scene.symmetric else states, n)
    factors = [banded(states, n), lower, np.zeros((states, ENDS - 1, 3, 2 * HALF + 1))]
    # room for what acts alone: untouched memory costs as much as a step
    laws = rollout.scene.has_laws
    bends = np.zeros((states, n, len(LAWS), 20) if laws else (1, 1, 1, 1))
    slips = rollout.scene.slips
    rubs = np.zeros((states, slips, 19) if slips > 1 else (1, 1, 1))
    memory = [bends, rubs]
    status = np.zeros(states, np.int32)
    linearise.linearise(
        rollout.x, rollout.q, rollout.before, rollout.past, rollout.slip, rollout.sliding,
        np.ascontiguousarray(rollout.path.q), steps_of(rollout.path, rollout.clock), *rollout.scene.arrays(),
        *rollout.clock.flags, int(rollout.scene.symmetric), *factors, columns(states, 1, n), *memory, status,
    )  # fmt: skip
    refuse(status.reshape(ropes, indices - 1))
    return factors, memory
