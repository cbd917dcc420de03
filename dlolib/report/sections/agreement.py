"""The rod with each law against another solver, by the same parameters (agreement.json)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from dlolib.report.model import Figure, Missing, Paragraph, Section
from dlolib.report.results import Results
from dlolib.report.style import OBSERVED, PLASTIC, ROD, canvas, save
from dlolib.report.text import fixed, title

TITLE = "Each law by another solver"


def section(results: Results, figures: Path) -> Section:
    """Largest distance of both solvers' ropes, effect by effect."""
    found = results.json("agreement.json")
    if found is None:
        missing = Missing(
            "The rod was not held against another solver: `make agreement` does it, in minutes."
        )
        return Section("agreement", TITLE, (missing,))
    rows: list[Mapping[str, Any]] = found["recordings"]
    refused = [row for row in rows if "refused" in row]
    words = (
        "The blind proof's laboratory shares no code with the rod: bodies and hinges in balance, laws of "
        f"other form. It plays a rope with one effect, {fixed(found['size'], 0)} times as large as one that "
        "is just found, and `dlo simulate` the same rope by the same parameters, "
        f"{found['each']} of each. Where a law's form is another the rod has the parameters by which it "
        f"comes nearest, and what is left of the form is part of the distance. {found['met']} of "
        f"{found['of']} are within the goal: half a percent of the length, a whole one where "
        "the way counts or the rope touches."
    )
    if refused:
        words += f" {len(refused)} could not be simulated and are left out of the figure."
    elsewhere = sum(bool(row.get("frames_elsewhere")) for row in rows)
    if elsewhere:
        words += f" In {elsewhere} the rope lies in another equilibrium in some frames."
    return Section("agreement", TITLE, (Paragraph(words), _figure(rows, figures)))


def _figure(rows: list[Mapping[str, Any]], figures: Path) -> Figure:
    names = list(dict.fromkeys(row["effect"] for row in rows))
    drawing = canvas(12.0 + 4.2 * len(names))
    _draw(drawing.subplots(), rows, names)
    return Figure(
        save(drawing, figures, "agreement"),
        "Largest distance of a point in any frame, in percent of the rope's length, one dot for each rope: "
        "within the goal (blue) or beyond it (vermilion). The strokes are the goals.",
        "Distance of the rod from another solver's by effect",
    )


def _draw(axes: Axes, rows: list[Mapping[str, Any]], names: list[str]) -> None:
    for at, name in enumerate(reversed(names)):
        for row in rows:
            if row["effect"] != name:
                continue
            axes.plot([row["goal_percent"]] * 2, [at - 0.4, at + 0.4], color=OBSERVED, linewidth=0.9)
            if "most_percent" in row:
                met = row["most_percent"] <= row["goal_percent"]
                axes.plot(row["most_percent"], at, "o", color=ROD if met else PLASTIC, markersize=4)
    axes.set_yticks(range(len(names)), [title(name) if name else "Elastic" for name in reversed(names)])
    axes.set_xscale("log")
    axes.set_xlabel("largest distance [% of the length]")
    axes.grid(visible=False, axis="y")
