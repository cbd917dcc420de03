"""The table of `make bench`: how fast and how right the rod is, beside its peers (bench.json)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dlolib.report.model import Column, Figure, Missing, Paragraph, Section, Table
from dlolib.report.results import Results
from dlolib.report.style import OBSERVED, PLASTIC, ROD, canvas, save
from dlolib.report.text import scientific

TITLE = "The rod and its peers"
NAMES = {
    "forward_vs_mujoco": "MuJoCo 4's flex over the rod, time a step",
    "forward_vs_pyelastica": "PyElastica over the rod, time a step",
    "backward_over_forward": "Adjoint over the forward pass",
    "batch64_over_single": "A rope in a batch of 64 over one alone",
    "per_segment_growth": "Time a segment, n = 480 over n = 30",
    "contact_over_free": "Step with contacts over a free one",
    "elastica_error_percent": "Distance to the exact elastica",
    "stretch_percent": "Change of a segment's length",
    "ei_spread_percent": "EI over discretisations, spread",
    "gradient_error": "Worst error of a derivative",
    "identify_vs_mujoco": "MuJoCo's identification over ours, time",
    "learn_seconds": "Learning one layout",
    "memory_mb": "Memory of a roll-out with gradient",
    "cosseratbench_error_time": "cosseratbench: error x time over the best other's",
}
# A table of all would be longer than a page.
EXACT = (
    "elastica_error_percent",
    "stretch_percent",
    "ei_spread_percent",
    "gradient_error",
    "cosseratbench_error_time",
)


def section(results: Results, figures: Path) -> Section:
    """Every figure over its goal, and a table with how each was measured."""
    found = results.json("bench.json")
    if found is None:
        missing = Missing("Nothing was measured beside the peers: `make bench` does it, in some minutes.")
        return Section("bench", TITLE, (missing,))
    absent = [name for key, name in NAMES.items() if key not in found]
    words = Paragraph(
        "The rod beside MuJoCo's one-dimensional flex, PyElastica and others, each on the same rope and arc "
        "and only after it came as near to the exact elastica as it must; timed in turn, the best of several "
        f"runs, on the machine that ran `make bench`. {_met(found)} of {len(NAMES)} goals are met; "
        "a miss stays in the table." + (f" Not measured yet: {'; '.join(absent)}." if absent else "")
    )
    quick = [key for key in found if key not in EXACT]
    tables = (
        _table("How fast the rod is, figure by figure (`make bench`).", found, quick),
        _table("How right it is, likewise.", found, [key for key in found if key in EXACT]),
    )
    return Section("bench", TITLE, (words, _figure(found, figures), *tables))


def _reached(row: Mapping[str, Any]) -> float | None:
    """How far the goal is reached: 1 and more is met."""
    if row["value"] is None:
        return None
    ratio = row["value"] / row["goal"]
    return float(ratio if row["at_least"] else 1.0 / max(ratio, 1e-9))


def _met(found: Mapping[str, Any]) -> int:
    return sum(1 for row in found.values() if (_reached(row) or 0.0) >= 1.0)


def _figure(found: Mapping[str, Any], figures: Path) -> Figure:
    canvas_ = canvas(8.0 + 5.0 * len(found))
    _draw(canvas_.subplots(), found)
    return Figure(
        save(canvas_, figures, "bench"),
        "How far each goal is reached: the figure over its goal, or the goal over the figure where less is "
        "better. Right of the line a goal is met (blue), left of it missed (vermilion); without a bar it "
        "was not measured.",
        "Figures of the bench over their goals",
    )


def _draw(axes: Axes, found: Mapping[str, Any]) -> None:
    keys = list(found)[::-1]
    for at, key in enumerate(keys):
        reached = _reached(found[key])
        if reached is not None:
            axes.barh(at, np.log10(reached), color=ROD if reached >= 1.0 else PLASTIC, height=0.6)
    axes.axvline(0.0, color=OBSERVED, linewidth=0.9)
    axes.set_yticks(range(len(keys)), [NAMES.get(key, key) for key in keys])
    low, high = (int(round_(edge)) for round_, edge in zip((np.floor, np.ceil), axes.get_xlim(), strict=True))
    axes.set_xticks(range(low, high + 1), [f"{10.0**power:g}" for power in range(low, high + 1)])
    axes.set_xlabel("goal reached, times")
    axes.grid(visible=False, axis="y")


def _table(caption: str, found: Mapping[str, Any], keys: Sequence[str]) -> Table:
    rows = []
    for key in keys:
        row = found[key]
        sign = "≥" if row["at_least"] else "≤"
        value = scientific(row["value"], 3)
        rows.append(
            (
                NAMES.get(key, key),
                value,
                f"{sign} {scientific(row['goal'], 2)}",
                row["unit"],
                row["how"],
            )
        )
    columns = (
        Column("Figure", align="wide"),
        Column("Reached"),
        Column("Goal"),
        Column("Unit", align="left"),
        Column("How", align="wide"),
    )
    return Table(caption, columns, tuple(rows))
