"""Where a straight or a round rope does not stay: the twisted ring, the standing rope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from dlolib.sim.rod import Rod, scene
from dlolib.sim.simulate import AT_REST, Clock, Path, State, roll_out
from dlolib.types import Ends, Floats
from stages.cases.rope import DENSITY, EI, GJ, LENGTH, NONE, ROPE, pose, rest


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
    clock = Clock(CREEP * float(np.sqrt(DENSITY * radius**4 / EI)), AT_REST)
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
