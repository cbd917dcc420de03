"""The paper's solver as published (Section IV): XPBD, constraint after constraint, a number of times a step.

It is the reference that the report compares the direct solver with. Its shape depends on the number of
iterations, and so does a stiffness identified with it. What is the paper's, and what it leaves open:

- Bend-twist has alpha = l / (4 EI), GJ on the tangent's axis, because |C_b| is about curvature x l / 2.
- The end constraints join the frames of wall and grasp to the rope over a full length l, as the paper
  does, while the first and last particles are held. The rope is thus half a segment longer at each end
  than it should be: the direct solver has half a segment there.
- Stretch-shear has alpha = 0 and `Scene.segments` has only the length: this rope does not stretch.
- A contact has alpha = 1 m/N, a spring of 1 N/m on each particle; `Scene.contacts` has only the radius.
- M in (2): the particles' masses; a frame has four times the moment of inertia m l^2 / 12 of its segment,
  as kinetic energy in quaternions has it. Frames start each step where they were: they have no momentum.
- An iteration takes the constraints in the paper's order, each from the rope's start to its end.

Iterated without end, a step of a rope bent in a plane is the direct solver's; a clamped rope that is
twisted keeps an error of the order of the time step, because XPBD adds up corrections along Jacobians of
shapes that it has left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlolib.errors import ParameterError, SimulationError
from dlolib.sim import iterative_kernels
from dlolib.sim.joints import HISTORY
from dlolib.sim.scene import LAWS, Scene, contact_points
from dlolib.sim.simulate import Clock, Path, Rollout, State
from dlolib.types import Floats, Rope

CONTACT_ALPHA_M_N = 1.0
UNIT_MASS_KG = 1.0


@dataclass(frozen=True)
class IterativeRollout(Rollout):
    """A `Rollout` of this solver: the reverse pass runs every step once more."""


@dataclass(frozen=True)
class IterativeGradient:
    """Derivatives of a scalar loss: by the initial state, held poses, and parameters.

    x, before (B, n, 3); q (B, n + 1, 3) by turns of the initial frames in their own axes [rad]; end_x, end_q
    (B, T, 2, 3), the latter by turns likewise; joint_d, joint_rest, force (B, n, 3) as in `Scene`.
    """

    x: Floats
    before: Floats
    q: Floats
    end_x: Floats
    end_q: Floats
    joint_d: Floats
    joint_rest: Floats
    force: Floats


@dataclass(frozen=True)
class Discrete:
    """A scene at one time step, as the kernels take it.

    A particle is predicted at onward x_t - backward x_(t-1) + fall, each (B, n); drag is in all three.
    stiffness (B, n, 3) is 1 / alpha~ of bend-twist [kg m^2], rest (B, n, 4) the quaternions Omega0,
    weight_x (B, n) [1/kg] and weight_q (B, n + 1) [1/(kg m^2)] the diagonal of M^-1, 0 where held;
    contact is alpha~ of constraint 5 [1/kg].
    """

    onward: Floats
    backward: Floats
    fall: Floats
    clamped: np.ndarray[tuple[int, ...], np.dtype[np.int32]]
    stiffness: Floats
    rest: Floats
    segment_l: Floats
    weight_x: Floats
    weight_q: Floats
    obstacles: Floats
    radius: Floats
    contact: float


def stiffness_from_alpha_b(alpha_b: float, rope: Rope, particles: int) -> float:
    """EI [N m^2] of the paper's inverse bending stiffness alpha_b.

    The convention is that of position-based dynamics, under which the paper's 0.0089 is a rope's
    stiffness: every particle has the mass 1 kg instead of its true rho l, l = length / (particles - 1).
    Then EI = l (rho l) / (4 alpha_b 1 kg). In true masses alpha = l / (4 EI), and 0.0089 would be 0.43 N m^2.
    A rope of unknown density counts as 1 kg/m, as in `Rod`: EI is then over density.

    Raises:
        ParameterError: alpha_b is not a positive number, or there are fewer than 3 particles.
    """
    if not (np.isfinite(alpha_b) and alpha_b > 0):
        raise ParameterError(f"alpha_b = {alpha_b:g} is not a positive number", mend="give one above 0")
    return _stiffness_times_alpha_b(rope, particles) / alpha_b


def alpha_b_from_stiffness(bending_stiffness: float, rope: Rope, particles: int) -> float:
    """The paper's alpha_b of EI [N m^2]: inverse of `stiffness_from_alpha_b`, same convention and errors."""
    if not (np.isfinite(bending_stiffness) and bending_stiffness > 0):
        raise ParameterError(
            f"bending_stiffness = {bending_stiffness:g} is not a positive number", mend="give one above 0"
        )
    return _stiffness_times_alpha_b(rope, particles) / bending_stiffness


def _stiffness_times_alpha_b(rope: Rope, particles: int) -> float:
    if particles < 3:
        raise ParameterError(f"particles = {particles}", mend="a rod needs 3 or more")
    segment = rope.length_m / (particles - 1)
    density = 1.0 if rope.linear_density_kg_m is None else rope.linear_density_kg_m
    return segment * density * segment / (4 * UNIT_MASS_KG)


def roll_out(scene: Scene, state: State, path: Path, clock: Clock, iterations: int) -> Rollout:
    """Move the held ends along the path, with a fixed number of Gauss-Seidel iterations a step.

    Args:
        scene: B ropes; read as the module says.
        state: where they are; the frames must be unit quaternions.
        path: held poses at T steps.
        clock: its step_s is the paper's time step (0.01 s).
        iterations: sweeps over all constraints in a step, 1 or more.

    Raises:
        ParameterError: a quasi-static clock (XPBD's compliance needs a time step), or iterations < 1.
        SimulationError: a rope has left for infinity; names rope and step.
    """
    if iterations < 1:
        raise ParameterError(f"iterations = {iterations}", mend="the iterative solver needs 1 or more")
    ropes, n = state.x.shape[:2]
    steps = path.x.shape[1]
    parts = _discretise(scene, clock)
    x, q = np.empty((ropes, steps + 1, n, 3)), np.empty((ropes, steps + 1, n + 1, 4))
    x[:, 0], q[:, 0] = state.x, state.q
    end_x, end_q = _finite_where_free(scene, path)
    status = np.zeros((ropes, steps), np.int32)
    iterative_kernels.roll_out(
        x, q, np.ascontiguousarray(state.before), end_x, end_q, *_arguments(parts, iterations),
        *_tape(scene, 1), status,
    )  # fmt: skip
    if status.any():
        rope, step = np.argwhere(status)[0]
        raise SimulationError(
            f"rope {rope}, step {step + 1}: the iterations diverge",
            mend="take more iterations or smaller steps, or the direct solver",
        )
    past, slip = np.zeros((ropes, steps + 1, n, HISTORY)), np.zeros((ropes, steps + 1, contact_points(n), 3))
    taken = np.full((ropes, steps), iterations, np.int32)
    sliding = np.zeros(slip.shape[:3], np.int32)
    return IterativeRollout(scene, clock, path, state.before, x, q, past, slip, sliding, taken)


def gradient(rollout: Rollout, d_x: Floats, d_before: Floats | None = None) -> IterativeGradient:
    """Reverse pass of the whole roll-out: exact derivatives of the iterations taken, converged or not.

    Args:
        rollout: what `roll_out` of this module returned.
        d_x: derivative of the loss by the positions, shape of rollout.x.
        d_before: further derivative by the positions at the last index but one, (B, n, 3).

    Returns:
        Unlike the direct solver's, an unconverged step depends on the frames that it starts from.

    Raises:
        ParameterError: the roll-out is another solver's.
    """
    if not isinstance(rollout, IterativeRollout):
        raise ParameterError(
            "this roll-out is not the iterative solver's", mend="take the gradient of the solver that made it"
        )
    scene, iterations = rollout.scene, int(rollout.iterations.flat[0])
    ropes, indices, n = rollout.x.shape[:3]
    parts = _discretise(scene, rollout.clock)
    end_x, end_q = _finite_where_free(scene, rollout.path)
    d_x = np.array(d_x, float, order="C")
    if d_before is not None:
        if indices < 2:
            raise ParameterError("d_before of a roll-out without steps", mend="give d_x alone")
        d_x[:, -2] += d_before
    bar_q, before, fall, stiffness, rest = (
        np.zeros((ropes, *shape)) for shape in ((n + 1, 4), (n, 3), (n, 3), (n, 3), (n, 3))
    )
    d_end_x, d_end_q = np.zeros((ropes, indices - 1, 2, 3)), np.zeros((ropes, indices - 1, 2, 4))
    iterative_kernels.adjoint(
        rollout.x, rollout.q, np.ascontiguousarray(rollout.before), end_x, end_q,
        *_arguments(parts, iterations), *_tape(scene, iterations), np.empty((ropes, 1, n, 3)),
        np.empty((ropes, 1, n + 1, 4)), np.empty((ropes, n, 3)), bar_q, np.empty((ropes, n, 3)), d_x, before,
        d_end_x, d_end_q, fall, stiffness, rest,
    )  # fmt: skip
    lengths, step_s = _joint_lengths(scene)[..., None], _step_s(rollout.clock)
    return IterativeGradient(
        x=d_x[:, 0].copy(),
        before=before,
        end_x=d_end_x,
        end_q=_by_turns(end_q, d_end_q),
        joint_d=stiffness * 4 * step_s**2 / lengths,
        joint_rest=_by_rest_curvature(scene.joint_rest, lengths, rest),
        force=fall * step_s**2 / (scene.mass + scene.drag * step_s)[..., None],
        q=_by_turns(rollout.q[:, 0], bar_q),
    )


def _step_s(clock: Clock) -> float:
    if clock.step_s is None:
        raise ParameterError(
            "the iterative solver cannot be quasi-static: its compliance is over the time step squared",
            mend="give a time step (the paper's is 0.01 s), or take the direct solver",
        )
    if not clock.step_s > 0:
        raise ParameterError(f"time step = {clock.step_s:g} s", mend="give one above 0")
    return clock.step_s


def _discretise(scene: Scene, clock: Clock) -> Discrete:
    step_s = _step_s(clock)
    if scene.joints[..., LAWS:].any() or not scene.symmetric or scene.grips.any():
        raise ParameterError(
            "the iterative solver knows no law of bending, no friction, no clamp that gives way and none of "
            "unmeasured roll",
            mend="take the direct solver",
        )
    clamped = scene.clamped.astype(bool)
    # the paper's steps are implicit Euler's
    momentum = float(clock.euler >= 0)
    # implicit drag makes a particle heavier and holds it where it was
    heavy = scene.mass + scene.drag * step_s
    weight_x = 1 / heavy
    weight_x[:, [0, -1]] *= ~clamped
    weight_q = np.zeros((scene.mass.shape[0], scene.mass.shape[1] + 1))
    weight_q[:, 1:-1] = 3 / (np.median(scene.mass, axis=1, keepdims=True) * scene.segment_l**2)
    lengths = _joint_lengths(scene)[..., None]
    angle = np.linalg.norm(scene.joint_rest, axis=-1, keepdims=True) * lengths / 2
    rest = np.concatenate([np.cos(angle), np.sinc(angle / np.pi) * lengths / 2 * scene.joint_rest], axis=-1)
    return Discrete(
        onward=((1 + momentum) * scene.mass + scene.drag * step_s) / heavy,
        backward=momentum * scene.mass / heavy,
        fall=step_s**2 * scene.force / heavy[..., None],
        clamped=scene.clamped,
        stiffness=4 * step_s**2 * scene.joint_d / lengths,
        rest=rest,
        segment_l=np.ascontiguousarray(scene.segment_l),
        weight_x=weight_x,
        weight_q=weight_q,
        obstacles=scene.obstacles,
        radius=np.ascontiguousarray(scene.contacts[:, :1, 1]),
        contact=CONTACT_ALPHA_M_N / step_s**2,
    )


def _joint_lengths(scene: Scene) -> Floats:
    """The length between neighbouring frames [m], (B, n): the end constraints' is a whole segment here."""
    lengths = scene.joint_l.copy()
    lengths[:, 0], lengths[:, -1] = scene.segment_l[:, 0], scene.segment_l[:, -1]
    return lengths


def _by_rest_curvature(rest: Floats, lengths: Floats, d_imaginary: Floats) -> Floats:
    """Derivative by the rest curvature [1/m] from that by Im(Omega0) = sin(|k| l / 2) k / |k|."""
    size = np.linalg.norm(rest, axis=-1, keepdims=True)
    angle = size * lengths / 2
    sinc = np.sinc(angle / np.pi) * lengths / 2
    along = rest / np.where(size > 0, size, 1.0)
    onto = np.sum(along * d_imaginary, axis=-1, keepdims=True)
    return np.asarray(sinc * d_imaginary + (np.cos(angle) * lengths / 2 - sinc) * onto * along)


def _by_turns(q: Floats, d_q: Floats) -> Floats:
    """Derivative by turns of q in its own axes, q <- q exp(turn / 2), from that by its components."""
    w, v = q[..., :1], q[..., 1:]
    return np.asarray((w * d_q[..., 1:] - d_q[..., :1] * v - np.cross(v, d_q[..., 1:])) / 2)


def _finite_where_free(scene: Scene, path: Path) -> tuple[Floats, Floats]:
    free = ~scene.clamped.astype(bool)[:, None, :, None]
    x, q = np.where(free, 0.0, path.x), np.where(free, 0.0, path.q)
    return np.ascontiguousarray(x), np.ascontiguousarray(q)


def _arguments(parts: Discrete, iterations: int) -> tuple[object, ...]:
    return (
        parts.onward, parts.backward, np.ascontiguousarray(parts.fall), parts.clamped, iterations,
        parts.stiffness, np.ascontiguousarray(parts.rest), parts.segment_l, parts.weight_x, parts.weight_q,
        parts.obstacles, parts.radius, parts.contact,
    )  # fmt: skip


def _tape(scene: Scene, slots: int) -> list[Floats]:
    """Multipliers of bend-twist and contact, the tape, and room for the tridiagonal solve."""
    ropes, n = scene.mass.shape
    contacts = (n, scene.obstacles.shape[1])
    tape = ((n - 1, 4), (n - 1, 3), (n, 4), (n, 4), (n, 3), (n, 3), (n - 1,), (*contacts, 3), contacts)
    shapes: list[tuple[int, ...]] = [(ropes, n, 3), (ropes, *contacts)]
    shapes += [(ropes, slots, *shape) for shape in tape]
    return [np.zeros(shape) for shape in (*shapes, (ropes, 2, n))]


__all__ = [
    "CONTACT_ALPHA_M_N",
    "IterativeGradient",
    "IterativeRollout",
    "alpha_b_from_stiffness",
    "gradient",
    "roll_out",
    "stiffness_from_alpha_b",
]
