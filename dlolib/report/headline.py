"""The five figures that a run ends with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dlolib.report.results import CAPTURED, Results
from dlolib.types import Estimate

STIFFNESS = ("bending_stiffness", "bending_stiffness_over_density")


def stiffness(results: Results, name: str = CAPTURED) -> Estimate | None:
    """The bending stiffness that was identified for a recording; N m², or m⁴/s² without a density."""
    fit = results.fit(name)
    found = [fit.parameters[key] for key in STIFFNESS if key in fit.parameters] if fit else []
    return found[0] if found else None


def clear(result: Mapping[str, Any]) -> bool:
    """Whether a learned motion kept out of every obstacle, and its margin, at every step."""
    return bool(result["free_of_contact"])


def headline(results: Results) -> dict[str, Any]:
    """The headline figures in SI units, null where a stage has not run.

    Keys: ei_n_m2 {value, low, high}; residual_m, RMS distance of an observed point to the simulated one;
    chain_rms_m, of the chain to the true axis; worst_goal_error_m, the largest mean goal error of the
    layouts, in the rod; smallest_clearance_m, the smallest of all steps of all layouts, in the rod.
    """
    ei, fit = stiffness(results), results.fit(CAPTURED)
    in_newton = ei is not None and "N" in ei.unit
    learned = [result for name in results.layouts if (result := results.learned(name))]
    clearances = [value for result in learned if (value := result["min_clearance_m"]) is not None]
    error = results.chain_error
    return {
        "ei_n_m2": {"value": ei.value, "low": ei.low, "high": ei.high} if ei and in_newton else None,
        "residual_m": fit.rmse_m if fit else None,
        "chain_rms_m": error.rms_m if error else None,
        "worst_goal_error_m": max(result["goal_error_m"]["mean"] for result in learned) if learned else None,
        "smallest_clearance_m": min(clearances, default=None),
    }
