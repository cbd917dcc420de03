"""Shapes at rest: the elastica, the catenary, the cantilever."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

from dlolib.lab.elastica import planar_elastica
from dlolib.sim.rod import Rod
from dlolib.types import Floats
from stages.cases.rope import DENSITY, EI, GJ, LENGTH, ROPE, pose, rest


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
