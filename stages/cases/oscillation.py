"""A free oscillation: its period, and what the step takes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, curve_fit

from dlolib.sim.inertia import ACCELERATION, BACK
from dlolib.sim.rod import Rod, scene
from dlolib.sim.simulate import Clock, roll_out
from dlolib.types import Floats
from stages.cases.rope import CANTILEVER, DENSITY, EI, GJ, LENGTH, NONE, ROPE, held, pose, rest

# The first steps look back to before they began, and end in another amplitude; from this one on it decays.
SETTLED = BACK + 2


@dataclass(frozen=True)
class Oscillation:
    """Frequency and decay rate found at several steps, the scheme's own rates, and the beam's frequency."""

    step_s: Floats
    frequency: Floats
    rate: Floats
    own_rate: Floats
    theory: float
    t_s: Floats
    tip: Floats

    @property
    def continuous(self) -> float:
        """The frequency at a step of zero, what the shortest step does to it undone [rad/s]."""
        found, step_s = float(self.frequency[-1]), float(self.step_s[-1])
        return float(brentq(lambda omega: park(omega, step_s)[0] - found, 0.5 * found, 2 * found))


def park(omega: float, step_s: float) -> tuple[float, float]:
    """Frequency [rad/s] and decay rate [1/s] that the scheme makes of a linear oscillator without damping, by
    the root of its characteristic equation that is nearest to e^(i ω dt)."""
    powers = ACCELERATION.copy()
    powers[0] += (omega * step_s) ** 2
    roots = np.roots(powers)
    growth = np.log(roots[np.argmin(np.abs(roots - np.exp(1j * omega * step_s)))]) / step_s
    return float(growth.imag), -float(growth.real)


def oscillation(particles: int = 60, parts: tuple[int, ...] = (16, 24, 32)) -> Oscillation:
    """A cantilever without gravity, let go: ω = 1.8751² √(EI / ρ L⁴), decay that of `park`.

    Euler and Bernoulli's beam (Blevins, Formulas for Natural Frequency, 1979, table 8-1). The decay is the
    scheme's own, and so little that only long steps show it.
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
            t[SETTLED:], tip[SETTLED:] / abs(tip[0]), (-1.0, 0.0, 0.0, theory),
        )[0]  # fmt: skip
        steps.append(dt)
        rates.append(wave[2])
        frequencies.append(wave[3])
    step = np.array(steps)
    own = np.array([park(theory, dt)[1] for dt in steps])
    return Oscillation(step, np.array(frequencies), np.array(rates), own, float(theory), t, tip / abs(tip[0]))


def _first_mode(particles: int) -> Floats:
    """The first mode of a clamped-free beam at even arc lengths."""
    u = 1.8751040687 * np.linspace(0, 1, particles)
    share = (np.cos(u[-1]) + np.cosh(u[-1])) / (np.sin(u[-1]) + np.sinh(u[-1]))
    return np.asarray(np.cosh(u) - np.cos(u) - share * (np.sinh(u) - np.sin(u)))
