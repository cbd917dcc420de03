"""The cases of `make validation` and of tests/sim/test_validation.py: the rod against theory, one by one.

Each is settled by a formula or by a boundary-value problem that knows nothing of the rod. Quantities are SI;
ropes lie in the x-z plane with z up, bending about the second material axis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq, curve_fit
from scipy.spatial.transform import Rotation

from dlolib.lab.elastica import planar_elastica
from dlolib.sim.effects import LAWS
from dlolib.sim.rod import Rod, scene
from dlolib.sim.scene import Scene
from dlolib.sim.simulate import Clock, Path, Rollout, State, roll_out
from dlolib.sim.start import first_shape, settle
from dlolib.types import Ends, Floats, Obstacle, Pose, Rope

GRAVITY = np.array([0.0, 0.0, -9.81])
NONE = np.zeros(3)
# A frame whose third axis is +x and whose second is +y: the paper's clamps.
LEVEL = Rotation.from_matrix(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))
CANTILEVER = Ends(end="free")
LENGTH, EI, GJ, DENSITY = 0.445, 3e-4, 2e-4, 0.04
ROPE = Rope("rope", LENGTH, 0.008, DENSITY)


@dataclass(frozen=True)
class Shapes:
    """A simulated and an exact shape, each (., 2) [m] in the x-z plane, at several discretisations.

    particles and error: largest distance of a particle to the exact place of its arc length, over the length.
    """

    particles: tuple[int, ...]
    error: Floats
    simulated: Floats
    exact: Floats

    @property
    def order(self) -> Floats:
        """Order of convergence between one discretisation and the next."""
        segments = np.array(self.particles) - 1
        return np.asarray(-np.diff(np.log(self.error)) / np.diff(np.log(segments)))


def pose(x: float, z: float, angle: float = 0.0) -> Pose:
    """A frame in the x-z plane whose tangent rises by `angle` [rad] from +x."""
    turned = Rotation.from_rotvec([0.0, -angle, 0.0]) * LEVEL
    return Pose(np.array([x, 0.0, z]), turned.as_quat(scalar_first=True))


def held(start: list[Pose], end: list[Pose] | None = None) -> Path:
    """A path of both ends, the end's entries unread where it is free."""
    pairs = list(zip(start, end or start, strict=True))
    x = np.array([[p.position_m for p in pair] for pair in pairs])
    q = np.array([[p.quaternion for p in pair] for pair in pairs])
    return Path(x[None], q[None])


def rest(rod: Rod, start: Pose, end: Pose | None, gravity: Floats = GRAVITY) -> tuple[Scene, Rollout]:
    """The rod's equilibrium between two clamps, or from one."""
    ends = Ends() if end is not None else CANTILEVER
    made = scene([rod], gravity, ends)
    state = first_shape(rod.rope.length_m, rod.particles, start, end, gravity)
    return made, settle(made, state, held([start], [end or start]))


def _shapes(found: list[Floats], s: Floats, exact: Floats) -> Shapes:
    """Compare particles (n, 3) of several discretisations with an exact shape (., 2) at arc lengths s."""
    errors = []
    for x in found:
        nodes = np.linspace(0, s[-1], len(x))
        off = [x[:, axis] - np.interp(nodes, s, exact[:, k]) for k, axis in enumerate((0, 2))]
        errors.append(np.hypot(*off).max() / s[-1])
    return Shapes(tuple(map(len, found)), np.array(errors), found[-1][:, [0, 2]], exact)


def elastica(particles: tuple[int, ...] = (15, 30, 60, 120)) -> Shapes:
    """Clamped at both ends under its weight: Euler's elastica by `solve_bvp` (dlolib.lab.elastica)."""
    end = (0.3, -0.05)
    s, x, z, _ = planar_elastica(LENGTH, EI, DENSITY * 9.81, (0, 0), 0.0, end, 0.0, points=4001)
    found = [rest(Rod(ROPE, EI, GJ, particles=n), pose(0, 0), pose(*end))[1].final.x[0] for n in particles]
    return _shapes(found, s, np.stack([x, z], axis=1))


def catenary(particles: tuple[int, ...] = (15, 30, 60, 120), ei: float = 1e-9) -> Shapes:
    """Next to no bending stiffness, clamped along the catenary's own tangents: z = a cosh(x / a)."""
    span = 0.7 * LENGTH
    a = brentq(lambda a: 2 * a * np.sinh(span / 2 / a) - LENGTH, 0.02, 10.0)
    s = np.linspace(0, LENGTH, 4001)
    x = a * np.arcsinh((s - LENGTH / 2) / a)
    z = a * (np.cosh(x / a) - np.cosh(span / 2 / a))
    steep = float(np.arctan(np.sinh(span / 2 / a)))
    found = []
    for n in particles:
        clamps = pose(0, 0, -steep), pose(span, 0, steep)
        found.append(rest(Rod(ROPE, ei, ei, particles=n), *clamps)[1].final.x[0])
    return _shapes(found, s, np.stack([x + span / 2, z], axis=1))


def cantilever(particles: tuple[int, ...] = (15, 30, 60, 120), tip_kg: float = 5e-4) -> Shapes:
    """One end level, the other free with a mass: EI θ'' = (m + ρ (L - s)) g cos θ, θ(0) = 0, θ'(L) = 0.

    Antman, Nonlinear Problems of Elasticity, chapter 4; with the rope's own weight.
    """
    light = replace(ROPE, linear_density_kg_m=DENSITY / 20, tip_mass_kg=tip_kg)
    tip, weight = tip_kg * 9.81 * LENGTH**2 / EI, DENSITY / 20 * 9.81 * LENGTH**3 / EI

    def slope(u: Floats, y: Floats) -> Floats:
        return np.array([y[1], (tip + weight * (1 - u)) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def ends(a: Floats, b: Floats) -> Floats:
        return np.array([a[0], b[1], a[2], a[3]])

    u = np.linspace(0, 1, 401)
    guess = np.array([-1.4 * np.tanh(4 * u), -5.6 / np.cosh(4 * u) ** 2, 0.3 * u, -0.8 * u])
    solved = solve_bvp(slope, ends, u, guess, tol=1e-9, max_nodes=50_000)
    if not solved.success:
        raise RuntimeError(f"the cantilever's boundary-value problem: {solved.message}")
    s = np.linspace(0, 1, 4001)
    exact = LENGTH * solved.sol(s)[2:].T
    found = [rest(Rod(light, EI, GJ, particles=n), pose(0, 0), None)[1].final.x[0] for n in particles]
    return _shapes(found, LENGTH * s, exact)


@dataclass(frozen=True)
class Buckling:
    """Growth a step of a ring's second mode over the twist [rad]; the critical twist, found and in theory."""

    twist: Floats
    growth: Floats
    found: float
    theory: float


# The step over √(ρ R⁴ / EI): short enough that the unstable mode grows by little, and its step can be solved.
CREEP = 0.3


def michell(particles: int = 60, steps: int = 40) -> Buckling:
    """A ring cut open, one end rolled: it leaves its plane at a twist of 2π √3 EI / GJ.

    Michell 1889; Goriely, Twisted elastic rings and the rediscoveries of Michell's instability, J. Elasticity
    84 (2006). Both ends are held at one point with one tangent, which takes a ring's rigid motions and
    nothing else; what it leaves is to turn about that tangent at no cost. So no single equilibrium is asked
    for: rings of several twists are put a little out of their plane and creep (implicit Euler without
    momentum, x <- x / (1 + λ dt²) for a mode of stiffness λ), and the twist where the second harmonic of the
    deflection neither grows nor falls is the critical one.
    """
    theory = 2 * np.pi * np.sqrt(3) * EI / GJ
    radius = LENGTH / (2 * np.pi)
    around = np.linspace(0, 2 * np.pi, particles)
    seed = 1e-4 * radius * (np.sin(2 * around) - 2 * np.sin(around) + np.cos(2 * around) - 1)
    x = np.stack([radius * np.sin(around), seed, radius * (1 - np.cos(around))], axis=1)
    middles = np.concatenate([[0.0], (around[1:] + around[:-1]) / 2, [2 * np.pi]])
    flat = Rotation.concatenate(
        [Rotation.from_quat(pose(0, 0, a).quaternion, scalar_first=True) for a in middles]
    )
    twist = theory * np.linspace(0.7, 1.2, 6)
    roll = np.zeros((len(twist), len(middles), 3))
    roll[..., 2] = twist[:, None] * middles / (2 * np.pi)
    q = np.array([(flat * Rotation.from_rotvec(one)).as_quat(scalar_first=True) for one in roll])
    made = scene([Rod(ROPE, EI, GJ, particles=particles)] * len(twist), NONE, Ends())
    places = np.tile(x, (len(twist), 1, 1))
    ends = np.repeat(q[:, None, [0, -1]], steps, axis=1)
    path = Path(np.zeros((len(twist), steps, 2, 3)), ends)
    clock = Clock(CREEP * float(np.sqrt(DENSITY * radius**4 / EI)), momentum=0.0)
    moved = roll_out(made, State(places, places.copy(), q), path, clock)
    harmonics = np.stack([around**0, *(f(k * around) for k in (1, 2, 3) for f in (np.cos, np.sin))], axis=1)
    parts = np.einsum("hp,btp->bth", np.linalg.pinv(harmonics), moved.x[..., 1])
    size = np.hypot(parts[..., 3], parts[..., 4])
    growth = size[:, -1] / size[:, -2]
    # λ, from below and above, is smooth in the twist: its zero, not the growth's
    stiffness = 1 / growth - 1
    return Buckling(
        twist, growth, float(brentq(lambda a: _cubic(twist, stiffness, a), twist[0], twist[-1])), theory
    )


def _cubic(x: Floats, y: Floats, at: float) -> float:
    return float(np.polyval(np.polyfit(x, y, 3), at))


@dataclass(frozen=True)
class Standing:
    """How far the tip of a standing rope hangs beside its foot, found and in theory (., ) over the length, by
    its weight over EI / L²; and the weight at which it falls, found and in theory."""

    weight: Floats
    aside: Floats
    exact: Floats
    found: float
    theory: float


# 9/4 of the square of the first zero of the Bessel function of order -1/3.
GREENHILL = 7.8373


def standing(particles: int = 60) -> Standing:
    """A rope clamped at its foot, straight up: it falls where its weight is 7.8373 EI / L².

    Greenhill, Proc. Cambridge Phil. Soc. 4 (1881). No ropes but straight ones are begun with, and nothing
    pushes them. Beyond that the elastica EI α'' = -w (L - s) sin α says how far; the square of that grows
    evenly with the weight, and its zero is where the rope falls.
    """
    weight, up = GREENHILL * np.linspace(0.98, 1.06, 9), pose(0.0, 0.0, np.pi / 2)
    aside = []
    for w in weight:
        ei = DENSITY * 9.81 * LENGTH**3 / w
        tip = rest(Rod(ROPE, ei, ei, particles=particles), up, None)[1].final.x[0, -1]
        aside.append(float(np.hypot(tip[0], tip[1])) / LENGTH)
    found = np.array(aside)
    fallen = found > 0.01
    line = np.polyfit(weight[fallen], found[fallen] ** 2, 2)
    root = brentq(lambda w: float(np.polyval(line, w)), 0.9 * GREENHILL, weight[-1])
    return Standing(weight, found, np.array([_leans(w) for w in weight]), float(root), GREENHILL)


def _leans(weight: float) -> float:
    """How far the tip of a standing elastica hangs beside its foot, over the length."""
    if weight <= GREENHILL:
        return 0.0
    s = np.linspace(0.0, 1.0, 201)
    lean = 2.0 * np.sqrt(weight / GREENHILL - 1)
    guess = lean * np.array([np.sin(np.pi * s / 2), np.pi / 2 * np.cos(np.pi * s / 2)])
    solved = solve_bvp(
        lambda at, a: np.array([a[1], -weight * (1 - at) * np.sin(a[0])]),
        lambda a, b: np.array([a[0], b[1]]), s, guess, tol=1e-9,
    )  # fmt: skip
    if not solved.success:
        raise RuntimeError(f"the standing rope's boundary-value problem: {solved.message}")
    return float(abs(np.trapezoid(np.sin(solved.sol(s)[0]), s)))


@dataclass(frozen=True)
class Capstan:
    """Tension of every segment [N] over its angle on the cylinder [rad], and the ratio of both sides."""

    angle: Floats
    tension: Floats
    ratio: float
    theory: float


def capstan(coefficient: float = 0.3, particles: int = 80, steps: int = 60) -> Capstan:
    """Half round a rough cylinder, a mass on one side, drawn down on the other: T2 / T1 = e^(μ π).

    Euler and Eytelwein; the rope's weight is 1/500 of the mass a radius, its bending force T / 5000.
    """
    radius, hanging, drawn, moved_m = 0.05, 0.15, 0.1, 0.05
    thick, density, mass = 0.004, 0.02, 0.5
    axis = radius + thick / 2
    length = hanging + drawn + np.pi * axis
    rope = Rope("capstan", length, thick, density, mass)
    rod = Rod(rope, 5e-6, 5e-6, {"contact_friction.coefficient": coefficient}, particles)
    values = {
        "center_m": (0.0, 0.0, 0.0), "axis": (0.0, 1.0, 0.0), "radius_m": (radius,), "height_m": (0.2,)
    }  # fmt: skip
    made = scene([rod], GRAVITY, CANTILEVER, (Obstacle("cylinder", values),))

    def at(s: Floats) -> tuple[Floats, Floats]:
        turn = np.clip((s - drawn) / axis, 0, np.pi)
        x, z = -axis * np.cos(turn), axis * np.sin(turn)
        z += np.minimum(s - drawn, 0) - np.maximum(s - drawn - np.pi * axis, 0)
        return np.stack([x, 0 * x, z], axis=1), np.pi / 2 - turn

    nodes = np.linspace(0, length, particles)
    x, _ = at(nodes)
    _, angles = at(np.concatenate([[0.0], (nodes[1:] + nodes[:-1]) / 2, [length]]))
    q = np.array([pose(0, 0, angle).quaternion for angle in angles])
    start = [pose(-axis, -drawn - down, np.pi / 2) for down in np.linspace(0, moved_m, steps)]
    still = settle(made, State(x[None], x[None].copy(), q[None]), held(start[:1])).final
    last = roll_out(made, still, held(start), Clock(None)).final.x[0]
    across = np.diff(last, axis=0)
    strain = np.linalg.norm(across, axis=1) / made.segment_l[0] - 1
    tension = made.segments[0, :, 3] * strain
    middle = (last[1:] + last[:-1]) / 2
    angle = (np.arctan2(middle[:, 2], -middle[:, 0]) + 1.0) % (2 * np.pi) - 1.0
    free = (middle[:, 2] < -0.2 * axis) & (middle[:, 2] > -axis)
    one, other = (tension[free & side].mean() for side in (middle[:, 0] < 0, middle[:, 0] > 0))
    return Capstan(angle, tension, float(one / other), float(np.exp(coefficient * np.pi)))


def arc_end(curvature: float, length: float = LENGTH) -> Pose:
    """The end of a rope that starts level at the origin and is an arc of this curvature [1/m]."""
    if curvature == 0:
        return pose(length, 0)
    angle = curvature * length
    return pose(np.sin(angle) / curvature, (1 - np.cos(angle)) / curvature, angle)


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


@dataclass(frozen=True)
class Oscillation:
    """Frequency and decay rate found at several steps, those of implicit Euler, and the beam's frequency."""

    step_s: Floats
    frequency: Floats
    rate: Floats
    euler_rate: Floats
    theory: float
    t_s: Floats
    tip: Floats

    @property
    def continuous(self) -> float:
        """The frequency at a step of zero, implicit Euler's tan(ω dt) = Ω dt undone [rad/s]."""
        return float((np.tan(self.frequency * self.step_s) / self.step_s)[-1])


def oscillation(particles: int = 60, parts: tuple[int, ...] = (200, 400, 800)) -> Oscillation:
    """A cantilever without gravity, let go: ω = 1.8751² √(EI / ρ L⁴), decay ln(1 + ω² dt²) / (2 dt).

    Euler and Bernoulli's beam (Blevins, Formulas for Natural Frequency, 1979, table 8-1). The second is
    implicit Euler's own on a linear oscillator: half a step, half the decay.
    """
    theory = 1.8751040687**2 * np.sqrt(EI / (DENSITY * LENGTH**4))
    rod = Rod(ROPE, EI, GJ, particles=particles)
    _, bent = rest(rod, pose(0, 0), None, np.array([0.0, 0.0, -1e-3]))
    free = scene([rod], NONE, CANTILEVER)
    steps, frequencies, rates = [], [], []
    for part in parts:
        dt = 2 * np.pi / theory / part
        count = 2 * part
        moved = roll_out(free, bent.final.at_rest(), held([pose(0, 0)] * count), Clock(dt))
        # the beam's first mode alone: its shape is orthogonal to the others'
        tip = moved.x[0, :, :, 2] @ (free.mass[0] * _first_mode(particles))
        t = dt * np.arange(count + 1)
        wave = curve_fit(
            lambda t, a, b, rate, w: np.exp(-rate * t) * (a * np.cos(w * t) + b * np.sin(w * t)),
            t, tip / abs(tip[0]), (-1.0, 0.0, theory**2 * dt / 2, theory),
        )[0]  # fmt: skip
        steps.append(dt)
        rates.append(wave[2])
        frequencies.append(wave[3])
    step = np.array(steps)
    euler = np.log(1 + (theory * step) ** 2) / (2 * step)
    return Oscillation(
        step, np.array(frequencies), np.array(rates), euler, float(theory), t, tip / abs(tip[0])
    )


def _first_mode(particles: int) -> Floats:
    """The first mode of a clamped-free beam at even arc lengths."""
    u = 1.8751040687 * np.linspace(0, 1, particles)
    share = (np.cos(u[-1]) + np.cosh(u[-1])) / (np.sin(u[-1]) + np.sinh(u[-1]))
    return np.asarray(np.cosh(u) - np.cos(u) - share * (np.sinh(u) - np.sin(u)))
