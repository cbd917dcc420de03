"""Derivatives of roll-outs: gradients of a scalar backwards, sensitivities of the positions forwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlolib.sim import adjoint, linearise, sensitivity
from dlolib.sim.assembly import ENDS
from dlolib.sim.band import HALF
from dlolib.sim.effects import LAWS
from dlolib.sim.joints import HISTORY
from dlolib.sim.scene import Scene
from dlolib.sim.simulate import Clock, Path, Rollout, banded, columns, refuse, steps_of
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
        # the state before the last one is the last position but one
        d_x[:, -2] += final.before
        turn, past, slip = (np.array(part, order="C") for part in (final.turn, final.past, final.slip))
    end_x, end_q = np.zeros((ropes, indices - 1, 2, 3)), np.zeros((ropes, indices - 1, 2, 3))
    parameter = np.zeros((ropes, len(variations), 1))
    scene = rollout.scene
    factors, memory = _linearised(rollout)
    adjoint.adjoint(
        rollout.x, rollout.q, np.ascontiguousarray(rollout.path.q), steps_of(rollout.path, rollout.clock),
        scene.joints, scene.particles, scene.grips, scene.clamped, *rollout.clock.flags,
        int(scene.symmetric), *factors, columns(ropes, 2, n), *memory, *_explicit(rollout, variations), d_x,
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
    begin = initial or zero_tangent(rollout.scene, count)
    x, before, turn, past, slip = (
        np.array(part, order="C") for part in (begin.x, begin.before, begin.turn, begin.past, begin.slip)
    )
    scene = rollout.scene
    factors, memory = _linearised(rollout)
    sensitivity.sensitivities(
        rollout.x, rollout.q, steps_of(rollout.path, rollout.clock), scene.joints,
        scene.particles, scene.grips, scene.clamped, *rollout.clock.flags, int(scene.symmetric), *factors,
        columns(ropes, count, n), *memory, slot, *_explicit(rollout, variations), x, before, turn,
        np.zeros((ropes, count, n + 1, 3)), past, slip, np.zeros((ropes, count, n, 2)), out,
    )  # fmt: skip
    return out, Tangent(x, before, turn, past, slip)


def zero_tangent(scene: Scene, count: int) -> Tangent:
    """Of a state that depends on none of so many parameters."""
    ropes, n = scene.particles.shape[:2]
    place = np.zeros((ropes, count, n, 3))
    turn, past = np.zeros((ropes, count, n + 1, 3)), np.zeros((ropes, count, n, HISTORY))
    return Tangent(place, place.copy(), turn, past, np.zeros((ropes, count, scene.slips, 3)))


def _explicit(rollout: Rollout, variations: Sequence[Variation]) -> tuple[Floats, Floats, Floats, Floats]:
    """What each parameter does to every step at fixed states: to forces, histories, contacts, held poses."""
    ropes, indices, n = rollout.x.shape[:3]
    states = ropes * (indices - 1)
    count = len(variations)
    # what holds the ends otherwise alone changes no force on a rope that is where it is
    slots = [c for c, one in enumerate(variations) if _pushes(one, rollout.clock)]
    cases = [case for c in slots for case in (variations[c].ahead, variations[c].behind)]
    laws, slips = any(case.scene.has_laws for case in cases), rollout.scene.slips
    # room for what acts alone: untouched memory costs as much as a step
    force, held = np.zeros((states, count, 6 * (n + 1))), np.zeros((ropes, indices - 1, count, 2, 6))
    past = np.zeros((states, count, n, HISTORY) if laws or rollout.scene.has_laws else (1, 1, 1, 1))
    slip = np.zeros((states, count, slips, 3))
    if slots:
        # a fresh rope's past is made anew for every case
        before = rollout.past.copy() if rollout.clock.fresh else rollout.past
        linearise.differences(
            rollout.x, rollout.q, rollout.before, before, rollout.slip, rollout.sliding,
            np.concatenate([case.path.q for case in cases]),
            np.concatenate([steps_of(case.path, rollout.clock) for case in cases]),
            *Scene.stack([case.scene for case in cases]).arrays(), *rollout.clock.flags,
            int(rollout.scene.symmetric), np.array(slots, np.int32),
            np.array([variations[c].width for c in slots]), np.zeros((1, 1, HALF + 1)),
            columns(states, 1, n), np.zeros((states, 1, n, HISTORY) if laws else (1, 1, 1, 1)),
            np.zeros((states, 1, slips, 3)), force, past, slip,
        )  # fmt: skip
    for c, variation in enumerate(variations):
        one, other = variation.ahead.path, variation.behind.path
        if one is not other:
            held[:, :, c, :, :3] = (one.x - other.x) / variation.width
            held[:, :, c, :, 3:] = _turn(other.q, one.q) / variation.width
    return force, past, slip, np.nan_to_num(held)


def _pushes(variation: Variation, clock: Clock) -> bool:
    """Whether the parameter changes any force on the rope at fixed states."""
    one, other = variation.ahead, variation.behind
    pairs = [*zip(one.scene.arrays(), other.scene.arrays(), strict=True)]
    if one.path is not other.path:
        pairs.append((steps_of(one.path, clock), steps_of(other.path, clock)))
        if one.scene.grips.any():
            pairs.append((one.path.q, other.path.q))
    return not all(np.array_equal(a, b) for a, b in pairs)


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
