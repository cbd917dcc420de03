"""Real cables (cables, sweeps and deform.json) and the elastic laboratory (elastic.json), beside all that."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dlolib.report.model import Block, Column, Figure, Missing, Paragraph, Section, Table
from dlolib.report.results import Results
from dlolib.report.style import PLASTIC, ROD, canvas, save
from dlolib.report.text import ABSENT, fixed, millimetres, scientific, span, title

TITLE = "Real cables, and the laboratory without plasticity"
# What is diagnosed together, and how far the tip may be off in the root mean square [mm].
SWEPT = {
    "whole": ("both sweeps", 10.0),
    "foretold": ("the first and half of the second", 10.0),
    "settled": ("both sweeps and two sets of settled poses", 14.0),
}
FORETOLD_MM = 12.0


def section(results: Results, figures: Path) -> Section:
    """Apparent stiffness by recording beside the common one; what is missing in its sweeps; the elastic
    laboratory against its truth."""
    blocks: list[Block] = []
    cables, elastic = results.json("cables.json"), results.json("elastic.json")
    sweeps, swung = results.json("sweeps.json"), results.json("deform.json")
    if not cables:
        blocks.append(Missing("The real cables were not run: `make cables DATA=DIR` writes their figures."))
    else:
        blocks += _cables(cables, figures)
    if not sweeps:
        blocks.append(Missing("The real cable's sweeps were not diagnosed: `make sweeps DATA=DIR` does it."))
    else:
        blocks += _sweeps(sweeps["cases"])
    if not swung:
        blocks.append(Missing("The swung cables were not foretold: `make deform DATA=DIR` does it."))
    else:
        blocks.append(_swung(swung))
    if not elastic:
        blocks.append(Missing("The elastic laboratory was not run, so that its figures are missing here."))
    else:
        blocks += _elastic(elastic)
    return Section("cables", TITLE, tuple(blocks))


def _cables(cables: Mapping[str, Any], figures: Path) -> list[Block]:
    recordings: list[Mapping[str, Any]] = cables["recordings"]
    words = (
        f"A thick cable, clamped in a robot's flange that turns it, with a free end. {len(recordings)} "
        "recordings of settled poses were identified each for itself, then together with one stiffness."
    )
    everything = [*recordings, cables["joint"]]
    return [
        Paragraph(words),
        _stiffness_figure(everything, figures),
        _cable_table(everything),
        Paragraph(cables["test"]["says"]),
        Paragraph(cables["contradiction"]),
    ]


def _stiffness_figure(everything: list[Mapping[str, Any]], figures: Path) -> Figure:
    """One row a recording, the last for all together."""
    figure = canvas(14 + 8 * len(everything))
    axes = figure.subplots()
    for place, found in enumerate(everything):
        ei = found["parameters"]["bending_stiffness"]
        color = ROD if found is not everything[-1] else PLASTIC
        interval = [ei["low"], ei["high"]]
        axes.plot(interval, [place, place], color=color, linewidth=2.2, solid_capstyle="butt")
        axes.plot(
            ei["value"], place, "o", color=color, markersize=5, markeredgecolor="white", markeredgewidth=0.6
        )
    axes.set_yticks(np.arange(len(everything)), [title(found["name"]) for found in everything])
    axes.set(xlabel="EI [N m²]", ylim=(len(everything) - 0.4, -0.6))
    axes.set_xlim(0, None)
    return Figure(
        save(figure, figures, "cables"),
        "Apparent stiffness of the cable from each recording with its 95 % interval, and one stiffness "
        "for all. See whether the intervals overlap: where they do not, one elastic cable with the "
        "stated mass does not explain all.",
        "Bending stiffness identified from each recording of one cable",
    )


def _cable_table(everything: list[Mapping[str, Any]]) -> Table:
    rows = []
    for found in everything:
        ei = found["parameters"]["bending_stiffness"]
        residuals = (millimetres(found[key], 1) for key in ("rmse_m", "heldout_rmse_m"))
        rows.append((title(found["name"]), scientific(ei["value"]), span(ei["low"], ei["high"]), *residuals))
    columns = (
        Column("Recording", align="wide"),
        Column("EI", "N m²"),
        Column("95 % interval", "N m²"),
        Column("Residual, RMS", "mm"),
        Column("On poses left out, RMS", "mm"),
    )
    return Table("The recordings of the cable.", columns, tuple(rows))


def _sweeps(cases: Mapping[str, Any]) -> list[Block]:
    """Recordings diagnosed together, with one material: the tip's distance before and after."""
    rows, said = [], ""
    for case, (label, goal_mm) in SWEPT.items():
        if case not in cases:
            continue
        found = cases[case]
        label = f"{label} (at {found['commit'][:7]})"
        named = " + ".join(found["named"]) or "nothing"
        said = f"Of {label} the verdict says: {found['summary']}"
        for name, tip in found["tip_rmse_m"].items():
            both = (millimetres(tip[key], 1) for key in ("elastic", "model"))
            rows.append((label, named, title(name), *both, f"≤ {goal_mm:g}"))
        foretold = found["foretold_tip_rmse_m"]
        if foretold is not None:
            half = "its other half, foretold"
            rows.append((label, named, half, ABSENT, millimetres(foretold, 1), f"≤ {FORETOLD_MM:g}"))
    columns = (
        Column("Diagnosed together", align="wide"), Column("Named", align="wide"),
        Column("Recording", align="left"), Column("Elastic", "mm"), Column("With what is named", "mm"),
        Column("Goal", "mm"),
    )  # fmt: skip
    caption = (
        "A weighted cable that a robot sweeps, diagnosed with one material (`make sweeps DATA=DIR`): root "
        "mean square distance at the tip."
    )
    return [Table(caption, columns, tuple(rows)), Paragraph(said)]


def _swung(swung: Mapping[str, Any]) -> Table:
    """Cables that two arms swing: what each kind of material foretells of recordings left out of its fit."""
    rows = []
    for name, cable in swung["cables"].items():
        for kind, found in cable["kinds"].items():
            means = (found["left_out_mean_mm"], found["eval_mean_mm"])
            errors = [fixed(mean[part], 1) for mean in means for part in ("all", "free")]
            chosen = "chosen" if kind == cable["chosen"] else ""
            rows.append((name.upper(), kind, chosen, *errors))
    columns = (
        Column("Cable", align="left"), Column("Material", align="wide"), Column("", align="left"),
        Column("Left out, all", "mm"), Column("free", "mm"),
        Column("Foretold, all", "mm"), Column("free", "mm"),
    )  # fmt: skip
    caption = (
        "Two cables that two arms swing fast, open loop over all 5 s (`make deform DATA=DIR`): mean absolute "
        "error per coordinate, of all markers and of the free ones. Left out: of each training recording by "
        "the others' material, which chooses; foretold: of recordings that nothing was fitted to, goal "
        f"{swung['goal_mm']:g} mm."
    )
    return Table(caption, columns, tuple(rows))


def _elastic(elastic: Mapping[str, Any]) -> list[Block]:
    ei = elastic["bending_stiffness"]
    rows = (
        ("EI identified", scientific(ei["value"]), "N m²"),
        ("its 95 % interval", span(ei["low"], ei["high"]), "N m²"),
        ("EI of the laboratory's rope", scientific(elastic["true_ei_n_m2"]), "N m²"),
        ("Error of EI", fixed(100 * elastic["ei_error"], 1), "%"),
        ("Residual a point, RMS", millimetres(elastic["rmse_m"], 2), "mm"),
    )
    words = (
        "With the laboratory's law switched to elastic the rod has all the physics of the recorded rope: "
        "what is left then is camera, chain and discretisation alone."
    )
    columns = (Column("Measure", align="wide"), Column("Value"), Column("Unit", align="left"))
    return [Paragraph(words), Table("The laboratory with an elastic rope.", columns, rows)]
