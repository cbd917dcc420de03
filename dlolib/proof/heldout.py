"""What the truth itself gains in the held-out frames: the laboratory's own answer, of no diagnosis.

Held-out frames are drawn independently of what is concealed. In some it hardly acts, and whether the true
rope then is nearer to the points seen than an elastic one is chance. No name can do better on the whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from dlolib.proof.draw import Case
from dlolib.proof.gain import GAIN_BODIES, gain
from dlolib.proof.motions import HELDOUT_FRAMES
from dlolib.proof.noise import decay
from dlolib.proof.play import play
from dlolib.types import Floats, Noise


@dataclass(frozen=True)
class Foretold:
    """The true rope against the elastic one that comes nearest to it in all other frames.

    shows: chi-squared between the two in the held-out frames, without noise.
    change: chi-squared that the true rope leaves of the points seen, less the elastic one's: -shows, give or
        take 2 sqrt(shows).
    """

    shows: float
    change: float


def foretold(case: Case) -> Foretold:
    """The held-out frames of a case by its own rope and by an elastic one.

    Raises:
        SimulationError: the elastic rope cannot be played.
    """
    whole = case.experiment
    fitted = replace(whole, frame_t_s=whole.frame_t_s[:-HELDOUT_FRAMES])
    best = gain(fitted, play(fitted, case.effects, GAIN_BODIES), {}, case.noise, doubtless=0.0)
    elastic = replace(
        whole, bending_stiffness=best.bending_stiffness, torsional_stiffness=best.torsional_stiffness
    )
    apart = (play(elastic, {}, case.bodies) - case.points_m)[-HELDOUT_FRAMES:]
    noise, seen = case.noise_m[-HELDOUT_FRAMES:], case.seen[-HELDOUT_FRAMES:]
    shows = chi2(apart, seen, case.noise)
    return Foretold(shows, chi2(noise, seen, case.noise) - chi2(noise - apart, seen, case.noise))


def chi2(error_m: Floats, seen: np.ndarray, noise: Noise) -> float:
    """Of errors (F, P, 3) [m] at the points seen (F, P), under noise of this deviation and correlation."""
    frames, points = seen.shape
    over_frames = linalg.toeplitz(decay(noise.correlation_frames) ** np.arange(frames))
    over_points = linalg.toeplitz(decay(noise.correlation_points) ** np.arange(points))
    there = np.flatnonzero(seen)
    covariance = noise.sigma_m**2 * np.kron(over_frames, over_points)[np.ix_(there, there)]
    white = linalg.solve_triangular(linalg.cholesky(covariance, lower=True), error_m[seen], lower=True)
    return float(np.sum(white**2))


__all__ = ["Foretold", "chi2", "foretold"]
