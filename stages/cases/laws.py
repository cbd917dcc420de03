"""Laws with a history, on evenly bent ropes: plastic bending, relaxation, creep."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.sim.effects import LAWS
from dlolib.sim.rod import Rod, scene
from dlolib.sim.simulate import Clock, Rollout, State, roll_out
from dlolib.types import Ends, Floats, Rope
from stages.cases.rope import CANTILEVER, EI, GJ, LENGTH, NONE, ROPE, arc_end, held, pose, rest


@dataclass(frozen=True)
class Bending:
    """Curvature [1/m] and moment [N m] of an evenly bent rope, found and in theory; what is left of it."""

    curvature: Floats
    moment: Floats
    theory: Floats
    left: float
    left_theory: float


def _bent(rod: Rod, curvatures: Floats) -> Rollout:
    """Both clamps moved so that every shape on the way is an arc."""
    made, n = scene([rod], NONE, Ends()), rod.particles
    nodes = np.linspace(0, LENGTH, n)
    x = np.stack([nodes, 0 * nodes, 0 * nodes], axis=1)
    q = np.tile(pose(0, 0).quaternion, (n + 1, 1))
    start = State(x[None], x[None].copy(), q[None])
    path = held([pose(0, 0)] * len(curvatures), [arc_end(k) for k in curvatures])
    return roll_out(made, start, path, Clock(None))


def plastic(particles: int = 60, steps: int = 80) -> Bending:
    """Bent evenly past its yield curvature, let go: linear kinematic hardening keeps κp = (κ - κy) / (1 + H).

    Simo and Hughes, Computational Inelasticity (1998), chapter 1: M = EI κ up to κy, then with the slope
    EI H / (1 + H), and back with EI until -EI κy + H EI κp.
    """
    limit, hardening, most = 4.0, 0.3, 12.0
    effects = {"plastic_bending.yield_curvature": limit, "plastic_bending.hardening_ratio": hardening}
    rod = Rod(ROPE, EI, GJ, effects, particles)
    curvatures = np.linspace(0, most, steps + 1)[1:]
    moved = _bent(rod, curvatures)
    place = 3 * [law.NAME for law in LAWS].index("plastic_bending")
    joint = particles // 2
    turned = _bends(moved)[:, joint]
    moment = EI * (np.abs(turned) - np.hypot(*moved.past[0, 1:, joint, place : place + 2].T))
    theory = np.where(
        curvatures < limit, EI * curvatures, EI * (limit + hardening / (1 + hardening) * (curvatures - limit))
    )
    free = scene([rod], NONE, CANTILEVER)
    let_go = roll_out(free, moved.final.at_rest(), held([pose(0, 0)]), Clock(None))
    left = float(np.abs(_bends(let_go)[-1, 1:-1]).mean())
    return Bending(curvatures, moment, theory, left, (most - limit) / (1 + hardening))


def _bends(moved: Rollout) -> Floats:
    """Curvature [1/m] of every joint (T, n) of a rope bent in the x-z plane."""
    frames = Rotation.from_quat(moved.q[0, 1:].reshape(-1, 4), scalar_first=True).as_matrix()
    axes = frames[:, :, 2].reshape(moved.q.shape[1] - 1, moved.q.shape[2], 3)
    angles = np.unwrap(np.arctan2(axes[..., 2], axes[..., 0]), axis=1)
    return np.asarray(np.diff(angles, axis=1) / moved.scene.joint_l[0])


@dataclass(frozen=True)
class Decay:
    """Times [s], what was found and what theory says."""

    t_s: Floats
    found: Floats
    theory: Floats

    @property
    def error(self) -> float:
        """The largest difference over the largest value."""
        return float(np.abs(self.found - self.theory).max() / np.abs(self.theory).max())


VISCOUS = {"viscoelastic_bending.modulus_ratio": 0.5, "viscoelastic_bending.relaxation_time": 2.0}


def relaxation(particles: int = 30, steps: int = 40) -> Decay:
    """Bent evenly in a step of 0.1 s, then held: the moment over EI κ falls as 1 + r f e^(-t / τ).

    The Maxwell branch (Simo and Hughes 1998, section 10.3); f = (1 - e^(-a)) / a with a = 0.1 s / τ is what
    it has lost at the end of an even bend.
    """
    ratio, time = VISCOUS.values()
    rod, bend, ramp, dt = Rod(ROPE, EI, GJ, VISCOUS, particles), 5.0, 0.1, 0.2
    made = scene([rod], NONE, Ends())
    nodes = np.linspace(0, LENGTH, particles)
    x = np.stack([nodes, 0 * nodes, 0 * nodes], axis=1)
    q = np.tile(pose(0, 0).quaternion, (particles + 1, 1))
    path = held([pose(0, 0)] * (steps + 1), [arc_end(bend)] * (steps + 1))
    durations = np.r_[ramp, np.full(steps, dt)]
    path = replace(path, dt_s=durations[None])
    moved = roll_out(made, State(x[None], x[None].copy(), q[None]), path, Clock(None))
    place = 3 * [law.NAME for law in LAWS].index("viscoelastic_bending")
    joint = particles // 2
    branch = np.abs(moved.past[0, 1:, joint, place : place + 2]).sum(axis=1)
    found = 1 + branch / (EI * np.abs(_bends(moved)[:, joint]))
    t = np.cumsum(durations) - ramp
    lost = (1 - np.exp(-ramp / time)) / (ramp / time)
    return Decay(t, found, 1 + ratio * lost * np.exp(-t / time))


def creep(particles: int = 60, steps: int = 100, dt: float = 0.1) -> Decay:
    """The same branch seen from outside: a light tip load on a cantilever, deflection over the instant one.

    Under a constant small moment κ(t) = (M / EI) (1 - r / (1 + r) e^(-t / (τ (1 + r)))).
    """
    ratio, time = VISCOUS.values()
    rope = Rope("creep", LENGTH, 0.008, 1e-6, 1e-6)
    rod = Rod(rope, EI, GJ, VISCOUS, particles)
    made, first = rest(rod, pose(0, 0), None)
    moved = roll_out(
        made,
        first.final.at_rest(),
        replace(held([pose(0, 0)] * steps), dt_s=np.full((1, steps), dt)),
        Clock(None),
    )
    found = moved.x[0, :, -1, 2] / moved.x[0, 0, -1, 2]
    t = np.linspace(0.0, dt * steps, steps + 1)
    return Decay(t, found, (1 + ratio) * (1 - ratio / (1 + ratio) * np.exp(-t / (time * (1 + ratio)))))
