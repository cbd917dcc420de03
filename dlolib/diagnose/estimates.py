"""What was fitted, with 95 % intervals that know how much else is not known.

The curvature of χ² knows of noise alone. Which effects there are, and in which form, is not known for certain
either: other models explain the recordings nearly as well, each with its own EI. An interval is that of the
mixture of all of them, weighted by exp(-BIC / 2) (Bayesian model averaging: Hoeting, Madigan, Raftery and
Volinsky, Statistical Science 14, 1999), in which the size of an effect that a model lacks is neutral; and
never narrower than the winner's own. And a law of the library is never quite that of the rope: as much as its
form may leave of χ² it may also have taken up by moving a parameter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from dlolib.diagnose.decide import OFF
from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.residuals import slow_modes
from dlolib.diagnose.study import Study, ideal
from dlolib.identify.parameters import Unknown
from dlolib.sim.effects import parameter
from dlolib.sim.rod import unit_of
from dlolib.types import Estimate, Floats

LEVELS = (0.025, 0.975)
Z95 = float(stats.norm.ppf(LEVELS[1]))
# A normal distribution as so many values, as likely each.
VALUES = 2000
SPREAD = stats.norm.ppf((np.arange(VALUES) + 0.5) / VALUES)


@dataclass(frozen=True)
class Alternatives:
    """What may be right in the place of a model: every model fitted, the elastic rod among them, and the
    model itself with its effects in other forms or elsewhere."""

    baseline: Fitted
    models: tuple[Fitted, ...]


def estimates(
    study: Study, model: Fitted, recording: int | None, beside: Alternatives | None = None
) -> dict[str, Estimate]:
    """Parameters shared by all recordings, or those of one, with 95 % intervals; of this model alone, or
    with what may be right in its place."""
    found = {}
    for unknown, theta in zip(model.unknowns, model.theta, strict=True):
        if unknown.recording != recording:
            continue
        low, high = study.bounds(unknown)
        ends = [
            unknown.outward(end) if low < end < high and np.isfinite(end) else None
            for end in _interval(study, model, unknown, beside)
        ]
        weighed = study.seen[0].recording.rope.linear_density_kg_m is not None
        name = f"{unknown.name}_over_density" if unknown.stiffness and not weighed else unknown.name
        unit = unit_of(unknown.name, weighed)
        found[name] = Estimate(unknown.outward(float(theta)), ends[0], ends[1], unit)
    return found


def _interval(
    study: Study, model: Fitted, unknown: Unknown, beside: Alternatives | None
) -> tuple[float, float]:
    """Of the fit's own coordinate."""
    base = model if beside is None else beside.baseline
    center, deviation = _one(model, unknown, base)
    own = center - Z95 * deviation, center + Z95 * deviation
    if beside is None:
        return own
    models = [model, *(one for one in beside.models if one is not model)]
    known = [(one, *_one(one, unknown, base)) for one in models if unknown in one.unknowns or unknown.size]
    scores = np.array([one.bic(study.frames) for one, _, _ in known])
    weights = np.exp(-0.5 * (scores - scores.min()))
    low, high = _quantiles(weights, *np.array([part for _, *part in known]).T)
    return min(own[0], low), max(own[1], high)


def _one(model: Fitted, unknown: Unknown, base: Fitted) -> tuple[float, float]:
    """Where a model has the unknown, and its deviation; neutral for certain where the model lacks it."""
    if unknown not in model.unknowns:
        return unknown.inward(parameter(unknown.name).neutral), 0.0
    n = model.unknowns.index(unknown)
    form = OFF * max(base.chi2 - model.chi2, 0.0) if any(map(ideal, model.effects)) else 0.0
    variance = max(float(model.covariance[n, n]), 0.0) * (_scale(model) + form / Z95**2)
    return float(model.theta[n]), float(np.sqrt(variance))


def _quantiles(weights: Floats, centers: Floats, deviations: Floats) -> Floats:
    """The ends (2,) of the 95 % interval of a mixture of normal distributions, some of no width or at
    infinity."""
    values = centers[:, None] + deviations[:, None] * SPREAD
    shares = np.broadcast_to(weights[:, None], values.shape)
    return np.asarray(np.quantile(values, LEVELS, weights=shares, method="inverted_cdf"))


def _scale(model: Fitted) -> float:
    """Variance of the whitened residuals, of the slow ones too: more than 1 where the noise was taken for too
    small, or where the model is not quite right. Birge's ratio, Physical Review 40, 1932."""
    slow = slow_modes(model)
    return max(1.0, model.chi2 / max(model.coordinates - len(model.theta), 1), slow.energy)


__all__ = ["Alternatives", "estimates"]
