"""The laboratory's laws of bending, each in another form than formats.md gives for the fitter.

A law answers with moments [N m] per axis of every joint, shape (J, 2), for the joints' curvatures [1/m],
and with their slopes [N m²], shape (J, 2, 2). It keeps its history until `keep` is called.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from dlolib.errors import SimulationError
from dlolib.types import Floats

TINY = 1e-12
EYE = np.eye(2)


class Law(Protocol):
    """What the equilibrium asks of a law of bending."""

    def moments(self, curvature: Floats, step_s: float) -> tuple[Floats, Floats]:
        """Moments (J, 2) and slopes (J, 2, 2) at the end of a step from the history that is kept."""

    def keep(self, curvature: Floats, step_s: float) -> None:
        """Make this curvature history."""


class Elastic:
    """EI (κ - κ0), or a hyperbolic sine where it stiffens and its inverse where it softens.

    EI sinh(b k) / b with b² = 6 c, and EI arsinh(b k) / b with b² = 6 |c|, agree with the cubic law
    EI κ (1 + c k²) to third order and with nothing beyond.

    Args:
        stiffness: EI about both axes [N m²], shape (J, 2).
        rest: κ0 [1/m], shape (2,) or (J, 2).
        cubic: c [m²].
        linear: 0 leaves out the part EI (κ - κ0), which yields elsewhere.
    """

    def __init__(self, stiffness: Floats, rest: Floats, cubic: float = 0.0, linear: float = 1.0) -> None:
        self.stiffness, self.rest, self.cubic, self.linear = stiffness, rest, cubic, linear

    def moments(self, curvature: Floats, step_s: float) -> tuple[Floats, Floats]:
        bend = curvature - self.rest
        slopes = self.stiffness[:, :, None] * EYE
        if not self.cubic:
            return self.linear * self.stiffness * bend, self.linear * slopes
        size = np.maximum(np.linalg.norm(bend, axis=1), 1e-6)[:, None]
        scale = np.sqrt(6 * abs(self.cubic))
        x = scale * size
        ratio = (np.sinh(x) if self.cubic > 0 else np.arcsinh(x)) / x - 1 + self.linear
        rate = (np.cosh(x) if self.cubic > 0 else 1 / np.sqrt(1 + x**2)) - 1 + self.linear
        unit = bend / size
        along = unit[:, :, None] * unit[:, None, :]
        form = ratio[:, :, None] * EYE + (rate - ratio)[:, :, None] * along
        return self.stiffness * ratio * bend, self.stiffness[:, :, None] * form

    def keep(self, curvature: Floats, step_s: float) -> None:
        """Nothing to keep."""


class JenkinStack:
    """Springs in series with sliders, side by side: Prandtl's, Jenkin's and Iwan's body.

    (Iwan, J. Appl. Mech. 34 (1967), 612.) Element e carries its stiffness times the curvature until the
    norm of its moment over both axes reaches its limit, then slides: the radial return.

    Args:
        stiffness: of the elements [N m²], shape (E, J, 2).
        limit: of the norm of their moments [N m], shape (E, 1) or (E, J).
        rest: the curvature without moment at the beginning [1/m], shape (2,).
        width: what an axis may carry over the first one, shape (J, 2): it divides the moment in that norm.
    """

    def __init__(
        self, stiffness: Floats, limit: Floats, rest: Floats | float = 0.0, width: Floats | float = 1.0
    ) -> None:
        self.stiffness, self.limit, self.width = stiffness, limit[:, :, None], width
        self.carried = np.zeros_like(stiffness)
        self.before = np.zeros(stiffness.shape[1:]) + rest

    def _slide(self, curvature: Floats) -> tuple[Floats, Floats, Floats]:
        trial = self.carried + self.stiffness * (curvature - self.before)
        size = np.linalg.norm(trial / self.width, axis=2, keepdims=True)
        return trial, size, np.minimum(1.0, self.limit / np.maximum(size, TINY))

    def moments(self, curvature: Floats, step_s: float) -> tuple[Floats, Floats]:
        trial, size, share = self._slide(curvature)
        unit = np.where(share < 1, trial / np.maximum(size, TINY), 0.0)
        form = share[..., None] * (EYE - unit[..., :, None] * (unit / self.width**2)[..., None, :])
        slopes = form * self.stiffness[:, :, None, :]
        return (trial * share).sum(axis=0), slopes.sum(axis=0)

    def keep(self, curvature: Floats, step_s: float) -> None:
        trial, _, share = self._slide(curvature)
        self.carried, self.before = trial * share, curvature.copy()


class Spectrum:
    """Two relaxing branches in place of one, integrated exactly for curvatures linear within a step.

    (Taylor, Pister, Goudreau, Int. J. Num. Meth. Eng. 2 (1970), 45.)

    Args:
        stiffness: of the branches [N m²], shape (B, J, 2).
        time_s: their relaxation times [s], shape (B,).
    """

    def __init__(self, stiffness: Floats, time_s: Floats) -> None:
        self.stiffness, self.time_s = stiffness, time_s[:, None, None]
        self.carried = np.zeros_like(stiffness)
        self.before = np.zeros(stiffness.shape[1:])

    def _relax(self, curvature: Floats, step_s: float) -> tuple[Floats, Floats]:
        share = step_s / self.time_s
        fresh = -np.expm1(-share) / share if step_s else np.ones_like(share)
        slope = self.stiffness * fresh
        return self.carried * np.exp(-share) + slope * (curvature - self.before), slope

    def moments(self, curvature: Floats, step_s: float) -> tuple[Floats, Floats]:
        carried, slope = self._relax(curvature, step_s)
        return carried.sum(axis=0), slope.sum(axis=0)[:, :, None] * EYE

    def keep(self, curvature: Floats, step_s: float) -> None:
        self.carried, self.before = self._relax(curvature, step_s)[0], curvature.copy()


# The stack's yield curvatures around the named one, and the share that each element carries: the corner
# of the bilinear law is rounded over a third of the yield curvature to either side.
YIELD_SPREAD, YIELD_SHARE = np.array([0.7, 0.85, 1.0, 1.15, 1.3]), np.array([0.1, 0.2, 0.4, 0.2, 0.1])
# Where the sliders of friction let go, in units of the transition curvature: exp(-κ / trans) is followed
# by straight pieces. Their slopes fall by what each slider held.
RELEASES = np.array([0.15, 0.4, 0.75, 1.2, 1.8, 2.7, 4.0])
# The two relaxation times over the named one, of half the modulus each.
TIMES = np.array([0.65, 1.5])


def yielding(
    stiffness: Floats, uniform: float, yield_1_m: float, hardening: float, rest: Floats | float = 0.0
) -> JenkinStack:
    """What replaces the elastic part EI κ past a smooth yield, hardening kinematically by the ratio H.

    All sliders gone, what is left is the joint's spring in series with that of the hardening, which counts
    with the rope's uniform EI: EI H / (1 + H) where the joint is as stiff, here a slider that never lets go.

    Args:
        stiffness: EI of the joints [N m²], shape (J, 2).
        uniform: the EI that the yield moment and the hardening count with [N m²].
        yield_1_m: κy [1/m].
        hardening: H.
        rest: κ0 [1/m], shape (2,).
    """
    local, moments = stiffness / uniform, YIELD_SHARE * YIELD_SPREAD * uniform * yield_1_m
    slides, never = local / (local + hardening), hardening / (local + hardening)
    shares = np.concatenate([YIELD_SHARE[:, None, None] * local / (local + hardening), never[None]])
    limits = moments[:, None] * local[:, 0] / (local[:, 0] + hardening)
    limits = np.concatenate([limits, np.full((1, len(local)), np.inf)])
    return JenkinStack(shares * stiffness, limits, rest, slides / slides[:, :1])


def rubbing(uniform: float, saturation_1_m: float, transition_1_m: float, joints: int) -> JenkinStack:
    """Strands that rub: a Prandtl stack whose first loading is Dahl's 1 - exp(-κ / trans), piecewise.

    Args:
        uniform: EI [N m²]; the moment saturates at EI times `saturation_1_m`.
        saturation_1_m, transition_1_m: as in formats.md [1/m].
        joints: how many.

    Raises:
        SimulationError: no curvature to rub in over, which a search for the best other rope may come to.
    """
    if not transition_1_m > 0:
        raise SimulationError("internal friction rubs in over a curvature above zero")
    corner = np.concatenate([[0.0], RELEASES])
    held = 1 - np.exp(-corner)
    slopes = np.append(np.diff(held) / np.diff(corner), 0.0) / held[-1]
    weight = -np.diff(slopes)
    stiffness = uniform * saturation_1_m / transition_1_m * weight
    limits = stiffness * RELEASES * transition_1_m
    everywhere = np.broadcast_to(stiffness[:, None, None], (len(weight), joints, 2)).copy()
    return JenkinStack(everywhere, limits[:, None])


def creeping(stiffness: Floats, ratio: float, time_s: float) -> Spectrum:
    """A modulus of `ratio` over EI that relaxes in about `time_s` [s], beside EI."""
    return Spectrum(np.broadcast_to(0.5 * ratio * stiffness, (2, *stiffness.shape)).copy(), time_s * TIMES)
