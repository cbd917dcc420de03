"""Whether what a model leaves is noise: the energy of the slow modes of its whitened residuals.

A χ² over all points is too blunt. What is missing bends the rope slowly along its length and from frame to
frame, and shows in few modes of a cosine transform; the quick ones give the scale, so that a noise estimate
that is a little off does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.fft import dctn

from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.modes import SLOWER, slow_of
from dlolib.diagnose.study import ideal
from dlolib.diagnose.whitening import MODES, ModesOfNoise
from dlolib.types import Floats

# A model whose slow residuals are this unlikely does not explain the recording, if they also are more than
# a share of what it explains, larger for an ideal law: its form is never quite that of the rope.
UNLIKELY, NEGLIGIBLE, IDEALLY = 1e-3, 0.01, 0.05
# A deviation of the noise that is declared or seen may be off by this factor.
BADLY_KNOWN = 2.0
# A model that leaves less than this of what it explains brings the distance to about half or below.
LARGELY = 0.25
# Where any of `SLOWER` modes are less likely than this more may be missing: what gains 40 in χ² shows.
AMISS = 0.05


@dataclass(frozen=True)
class SlowModes:
    """Energy of the residuals' slow modes over its expectation, and how likely so much is by chance.

    excess: of χ², over what the quick modes tell of noise there.
    """

    energy: float
    p_value: float
    excess: float


def slow_modes(model: Fitted, modes: int = MODES) -> SlowModes:
    """The test of what a model leaves: slow modes against quick ones, each against what noise would leave."""
    return tested(model.residuals, model.noise, model.taken[modes], modes)


def tested(
    residuals: Sequence[Floats], noise: Sequence[ModesOfNoise], taken: float, modes: int = MODES
) -> SlowModes:
    """The same of the whitened residuals (F, columns, A) of each recording, of whose slow modes' degrees of
    freedom a fit took so many.

    Where places were not seen noise lies unevenly in the modes, and their energy goes as χ² of fewer degrees
    of freedom (Satterthwaite, Biometrics Bulletin 2, 1946).
    """
    slow = quick = expected = squared = places = 0.0
    for grid, own in zip(residuals, noise, strict=True):
        squares = dctn(grid, axes=(0, 1), norm="ortho") ** 2
        m, n = slow_of(grid.shape[0], grid.shape[1], modes)
        low = squares[:m, :n]
        slow += float(low.sum())
        quick += float(squares.sum() - low.sum())
        covariance = own.covariance[:m, :n, :m, :n].reshape(low[..., 0].size, -1)
        axes = grid.shape[2]
        expected += axes * float(np.trace(covariance))
        squared += axes * float(np.sum(covariance**2))
        places += axes * own.places
    slow_count, quick_count = expected - taken, max(places - expected, 1.0)
    scale = quick / quick_count
    energy = slow / max(slow_count, 1.0) / scale
    p = float(stats.f.sf(energy, max(slow_count, 1.0) * expected / squared, quick_count))
    return SlowModes(energy, p, slow - slow_count * scale)


def amiss(model: Fitted) -> bool:
    """Whether a model may leave more than noise: a test that sooner errs on that side than `explains`."""
    return min(slow_modes(model, modes).p_value for modes in SLOWER) < AMISS


def explains(model: Fitted, base: Fitted) -> bool:
    """Whether a model leaves but noise, or little of what it explains."""
    slow = slow_modes(model)
    share = IDEALLY if any(map(ideal, model.effects)) else NEGLIGIBLE
    return slow.p_value >= UNLIKELY or _left(model, slow) <= share * (base.chi2 - model.chi2)


def helps(model: Fitted, base: Fitted) -> bool:
    """Whether a model that does not explain all at least takes up most of it."""
    slow = slow_modes(model)
    return _left(model, slow) <= LARGELY * (base.chi2 - model.chi2)


def _left(model: Fitted, slow: SlowModes) -> float:
    """What is not noise of a model's χ²: the excess of the slow modes, or all that is more than noise of a
    deviation known that badly; what is missing in a quick motion shows in quick modes, too."""
    return max(slow.excess, model.chi2 - BADLY_KNOWN**2 * model.coordinates)


__all__ = ["SlowModes", "amiss", "explains", "helps", "slow_modes", "tested"]
