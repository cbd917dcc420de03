"""The end of `make repro`: where the report lies, and the five figures that it begins with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stages import REPORTS, run
from stages.report import read_headline

MM = 1e3


def main() -> None:
    figures = read_headline()
    print(f"\nThe report: {REPORTS / 'report.html'} and {REPORTS / 'report.pdf'}")
    for name, value in lines(figures):
        print(f"  {name:<29}{value}")


def lines(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Name and value with unit of each of the five figures; a dash where a stage has nothing to say."""
    stiffness = figures["ei_n_m2"]
    return [
        ("bending stiffness EI", _interval(stiffness) if stiffness else "–"),
        ("residual a point", _millimetres(figures["residual_m"])),
        ("chain to the true axis, RMS", _millimetres(figures["chain_rms_m"])),
        ("worst goal error", _millimetres(figures["worst_goal_error_m"])),
        ("smallest clearance", _millimetres(figures["smallest_clearance_m"])),
    ]


def _interval(stiffness: Mapping[str, float | None]) -> str:
    value, low, high = (_scientific(stiffness[key]) for key in ("value", "low", "high"))
    return f"{value} N m² (95 %: {low} to {high})"


def _scientific(value: float | None) -> str:
    return "unbounded" if value is None else f"{value:.2e}".replace("e-0", "e-")


def _millimetres(value_m: float | None) -> str:
    return "–" if value_m is None else f"{value_m * MM:.2f} mm"


if __name__ == "__main__":
    run(main)
