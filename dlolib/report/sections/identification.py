"""Identification: the loss beside the paper's, parameters with intervals, simulated and recorded shapes."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes

from dlolib.report import paper
from dlolib.report.headline import STIFFNESS
from dlolib.report.model import Block, Column, Figure, Missing, Paragraph, Section, Table
from dlolib.report.results import CAPTURED, Results
from dlolib.report.shapes import shapes_figure
from dlolib.report.style import (
    PAPER,
    SERIES,
    WHITE,
    canvas,
    legend_above,
    save,
)
from dlolib.report.text import listed, millimetres, nice_unit, scientific, span, title
from dlolib.types import Estimate

TITLE = "Stiffness identified"
NAMES = {
    "bending_stiffness": "Bending stiffness EI",
    "torsional_stiffness": "Torsional stiffness GJ",
    "bending_stiffness_over_density": "Bending stiffness over density",
    "torsional_stiffness_over_density": "Torsional stiffness over density",
}

# Marked iterations, as far as there are so many.
TICKS = (0, 5, 10, 100, 300, 1000, 3000, 10_000, 100_000)


def section(results: Results, figures: Path) -> Section:
    """The loss curve, a table of parameters, then for each recording its shapes and residual."""
    if not results.recordings:
        missing = Missing("Nothing was identified yet: `dvc repro identify` does it for every recording.")
        return Section("identification", TITLE, (missing,))
    blocks: list[Block] = [Paragraph(_words(results))]
    loss = results.table("identify", CAPTURED, "loss.csv")
    if loss is None or loss.empty:
        blocks.append(Missing(f"There is no loss curve of the recording `{CAPTURED}`."))
    else:
        blocks.append(_loss(loss, figures))
    blocks += [_parameters(results), _residuals(results)]
    for name in results.recordings:
        together = (results.json("identify", name, "summary.json") or {}).get("recordings", [])
        if len(together) > 1:
            text = (
                f"{title(name)}: {listed(together)} were identified together; shapes and mean distance are "
            )
            blocks.append(Paragraph(f"{text}of the first."))
        shapes = results.table("identify", name, "shapes.csv")
        if shapes is None or shapes.empty:
            blocks.append(Missing(f"There are no simulated shapes of the recording `{name}`."))
        else:
            blocks.append(shapes_figure(name, shapes, figures))
    return Section("identification", TITLE, tuple(blocks))


def _words(results: Results) -> str:
    text = (
        "The rod's parameters are those with which its simulation, moved by the recorded poses, comes "
        "closest to the observed points; the gradient goes through the simulator. Intervals hold 95 % "
        "and are scaled to the residual that is left, by a jackknife over blocks of frames."
    )
    others = [name for name in results.recordings if name != CAPTURED]
    if others:
        text += (
            " Beside the captured rope stand recordings made elsewhere "
            f"({', '.join(title(name) for name in others)})."
        )
    if results.truth is not None and results.truth.laws["law"] == "plastic":
        text += (
            " The laboratory's rope yields plastically and this rod does not: its stiffness is then the "
            "one of an elastic rope that looks most alike, below the true one, and what it cannot follow "
            "stays in the residual."
        )
    return text


def _loss(loss: pd.DataFrame, figures: Path) -> Figure:
    figure = canvas(62)
    stiffness = next((name for name in STIFFNESS if name in loss), None)
    panels = figure.subplots(1, 2 if stiffness else 1, squeeze=False)[0]
    for index, (method, rows) in enumerate(loss.groupby("method", sort=False)):
        color = SERIES[index % len(SERIES)]
        marker = "o" if len(rows) < 40 else ""
        label = str(method).replace("_", " ")
        for axes, column in zip(panels, ["loss_m", stiffness], strict=False):
            axes.plot(
                rows["iteration"], rows[column], marker=marker, markersize=2.4, color=color, label=label
            )
    room = float(loss["loss_m"].max()) > 1.5 * paper.FINAL_LOSS_M
    panels[0].axhline(paper.FINAL_LOSS_M, color=PAPER, linewidth=0.9, linestyle=(0, (4, 3)))
    panels[0].annotate(
        "the paper's final loss, about 0.2 m\n(40 frames: 5 mm a point)", (0.16, paper.FINAL_LOSS_M),
        (0, -3 if room else 3), va="top" if room else "bottom", ha="left",
        xycoords=("axes fraction", "data"), textcoords="offset points", color=PAPER,
        fontsize=6.5, bbox=WHITE,
    )  # fmt: skip
    panels[0].set(xlabel="iteration", ylabel="loss (12) [m]", yscale="log")
    legend_above(panels[0], 3)
    if stiffness == STIFFNESS[0]:
        _stiffness_axes(panels[1])
    elif stiffness:
        panels[1].set(xlabel="iteration", ylabel="EI over density [m⁴/s²]", yscale="log")
    for axes in panels:
        axes.set_xscale("symlog", linthresh=10)
        axes.set_xlim(-0.4, None)
        ticks = [tick for tick in TICKS if tick <= loss["iteration"].max()]
        axes.set_xticks(ticks, [f"{tick:,}".replace(",", " ") for tick in ticks])
    return Figure(
        save(figure, figures, "loss"),
        "Left: the loss (12) over the iterations, the sum over the frames of the mean distance a point; "
        "right: the stiffness that belongs to it. Dashed are the paper's own figures: its loss settles "
        f"at about 0.2 m after {paper.IDENTIFY_ITERATIONS} iterations, while its α~b~ goes from "
        f"{paper.START_ALPHA_B} to {paper.FINAL_ALPHA_B}. See how many iterations each "
        "method needs, and where it ends. The iterations are drawn evenly up to 10, logarithmically beyond.",
        "Loss and stiffness over the iterations of identification",
    )


def _stiffness_axes(axes: Axes) -> None:
    axes.set(xlabel="iteration", ylabel="EI [N m²]", yscale="log")
    for alpha, word in ((paper.START_ALPHA_B, "start"), (paper.FINAL_ALPHA_B, "end")):
        value = paper.stiffness_n_m2(alpha)
        axes.axhline(value, color=PAPER, linewidth=0.9, linestyle=(0, (4, 3)))
        axes.annotate(
            f"paper's {word}: $\\alpha_b$ = {alpha:g}", (1.0, value), (-2, -3), ha="right", va="top",
            xycoords=("axes fraction", "data"), textcoords=(
                "offset points"
            ), color=PAPER, fontsize=6.5, bbox=WHITE,
        )  # fmt: skip


def _parameters(results: Results) -> Table:
    rows = []
    for name in results.recordings:
        fit = results.fit(name)
        if fit is None:
            continue
        # what several recordings share, and what each of them has for itself
        several = len(fit.nuisances) > 1
        own = [(of if several else name, values) for of, values in fit.nuisances.items()]
        for whose, values in ((name, fit.parameters), *own):
            rows += [(title(whose), _parameter(key), *_estimate(one)) for key, one in values.items()]
    columns = (
        Column("Recording", align="left"),
        Column("Parameter", align="wide"),
        Column("Value"),
        Column("95 % interval"),
        Column("Unit", align="left"),
    )
    return Table("What was identified, with 95 % intervals.", columns, tuple(rows))


def _parameter(key: str) -> str:
    if key in NAMES:
        return NAMES[key]
    effect, _, parameter = key.partition(".")
    return f"{title(effect)}, {parameter.replace('_', ' ')}"


def _estimate(estimate: Estimate) -> tuple[str, str, str]:
    return scientific(estimate.value), span(estimate.low, estimate.high), nice_unit(estimate.unit)


def _residuals(results: Results) -> Table:
    rows = []
    for name in results.recordings:
        summary = results.json("identify", name, "summary.json")
        if summary is None:
            continue
        held = summary["heldout_rmse_m"]
        rows.append(
            (
                title(name),
                str(summary["frames"]),
                str(summary["points"]),
                millimetres(summary["rmse_m"], 2),
                millimetres(held, 2) if held is not None else "no frames left out",
                millimetres(summary["mean_distance_m"], 2),
            )
        )
    columns = (
        Column("Recording", align="left"),
        Column("Frames", "count"),
        Column("Points", "count"),
        Column("Residual, RMS", "mm"),
        Column("On frames left out, RMS", "mm"),
        Column("Mean distance", "mm"),
    )
    caption = (
        "What is left between the simulated and the observed points. Where a recording repeats one pose, "
        "the frame left out is another look at the same pose and no new one."
    )
    return Table(caption, columns, tuple(rows))
