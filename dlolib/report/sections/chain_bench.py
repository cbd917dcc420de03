"""The table of `make chain-bench`: the chain on rendered ropes whose axis is known (chain_bench.json)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dlolib.report.model import Block, Column, Missing, Paragraph, Table
from dlolib.report.results import Results
from dlolib.report.text import MINUS, fixed

# What stands in the table: key, heading, factor, unit, decimals.
SHOWN = (
    ("axis_rms_mm", "Off the axis", 1.0, "mm", 2),
    ("arc_rms_mm", "Arc length", 1.0, "mm", 2),
    ("spacing_percent", "Spacing, largest", 1.0, "%", 1),
    ("order", "In order", 100.0, "%", 0),
    ("completeness", "Complete", 100.0, "%", 1),
    ("in_ellipsoid", "In its ellipsoid", 100.0, "%", 1),
    ("frames_a_second", "Alone", 1.0, "1/s", 1),
    ("frames_together", "Shared out", 1.0, "1/s", 1),
)
NAMES = {
    "point_lag": "correlation along the rope",
    "frame_lag": "correlation over frames",
    **{key: heading.lower() for key, heading, *_ in SHOWN},
    "frames_a_second": "frames a second",
    "frames_together": "frames a second of a long capture",
}


def blocks(results: Results) -> list[Block]:
    """A sentence and the table of cases; what misses its goal is named beside its case."""
    found = results.json("chain_bench.json")
    if found is None:
        return [Missing("The chain was not held against rendered ropes: `make chain-bench` does it.")]
    cases: Mapping[str, Any] = found["cases"]
    figures = [one for case in cases.values() for one in case["figures"].values()]
    met = sum(1 for one in figures if one["met"])
    words = Paragraph(
        f"Other ropes, tables, light, distances, pillars, a gripper and a crossing were rendered with their "
        f"true axis (`make chain-bench`); {met} of {len(figures)} figures meet their goals. The covariances "
        "were set on such renderings."
    )
    columns = [Column("Case", align="left"), *(Column(heading, unit) for _, heading, _, unit, _ in SHOWN)]
    rows = tuple((name.replace("_", " "), *_cells(case["figures"])) for name, case in cases.items())
    misses = [told for key in found["how"] for told in _missed(key, cases)]
    caption = (
        "The chain on rendered ropes, root mean squares by case; frames a second, one after the other and "
        "those of a long capture shared out among the cores."
    )
    missed = [Paragraph(f"Missed: {'; '.join(misses)}.")] if misses else []
    return [words, Table(caption, tuple(columns), rows), *missed]


def _missed(key: str, cases: Mapping[str, Any]) -> list[str]:
    """The cases whose figure misses its goal, those with one goal together."""
    shown = {name: (factor, unit, digits) for name, _, factor, unit, digits in SHOWN}
    factor, unit, digits = shown.get(key, (1.0, "", 1))
    missed: dict[str, list[str]] = {}
    for name, case in cases.items():
        one = case["figures"].get(key)
        if one is None or one["met"]:
            continue
        bounds = one["goal"] if isinstance(one["goal"], list) else [one["goal"]]
        goal = " to ".join(f"{factor * bound:g}".replace("-", MINUS) for bound in bounds)
        # a digit more than in the table tells a near miss from the goal
        value = fixed(factor * one["value"], digits + 1)
        missed.setdefault(goal, []).append(f"{name.replace('_', ' ')} {value}")
    label = NAMES.get(key, key) + (f" [{unit}]" if unit else "")
    return [f"{label} (goal {goal}): {', '.join(told)}" for goal, told in missed.items()]


def _cells(figures: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(
        fixed(factor * figures[key]["value"], digits) if key in figures else "–"
        for key, _, factor, _, digits in SHOWN
    )
