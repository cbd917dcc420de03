"""The ablation of the paper's Fig. 11: plain squared error against the loss with the contact term."""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd

from dlolib.report import paper
from dlolib.report.model import Block, Column, Figure, Missing, Paragraph, Section, Table
from dlolib.report.results import Results
from dlolib.report.style import PAPER, PLASTIC, ROD, WHITE, canvas, save, thousandths
from dlolib.report.text import millimetres, scientific, title

TITLE = "With and without the contact term"
LOSSES = {"mse": ("plain MSE", PLASTIC), "contact": ("with contact term", ROD)}
LAST = ("goal_error_mean_m", "min_clearance_m", "value")
# A rope that lies on an obstacle stays nearer to it than the margin and this; from one iteration to the next
# a path at an obstacle comes off by a millimetre and back.
TOUCHING_M, LATEST = 1e-4, 20


def section(results: Results, figures: Path) -> Section:
    """Curve beside curve for every initial weight, and where each run ended."""
    tables = {name: read_ablation(results, name) for name in results.layouts}
    found = {name: table for name, table in tables.items() if table is not None}
    if not found:
        text = (
            "The ablation has not run: `dvc repro learn` writes it for the layout that `params.yaml` names."
        )
        return Section("ablation", TITLE, (Missing(text),))
    blocks: list[Block] = []
    for name, table in found.items():
        blocks += [Paragraph(_words(name, table)), _curves(name, table, figures), _table(name, table)]
    return Section("ablation", TITLE, tuple(blocks))


def read_ablation(results: Results, name: str) -> pd.DataFrame | None:
    """A layout's ablation, None where it has none."""
    return results.table("learn", name, "ablation.csv")


def last_of_runs(table: pd.DataFrame, loss: str) -> pd.DataFrame:
    """The last iteration of each run with a loss, by seed."""
    runs = table[table["loss"] == loss].sort_values("iteration")
    return runs.groupby("seed").last()


def at_obstacle(table: pd.DataFrame, loss: str) -> int:
    """How many runs with a loss end at an obstacle: one of their latest paths touches it.

    Learning's rope is thicker by the margin, and not inside.
    """
    runs = table[table["loss"] == loss].sort_values("iteration")
    latest = runs.groupby("seed").tail(LATEST)
    touches = latest["min_clearance_m"] <= latest["contact_margin_m"] + TOUCHING_M
    return int(touches.groupby(latest["seed"]).any().sum())


def _words(name: str, table: pd.DataFrame) -> str:
    texts = []
    for loss, (word, _) in LOSSES.items():
        runs = last_of_runs(table, loss)
        if len(runs):
            texts.append(
                f"{word}, {at_obstacle(table, loss)} of {len(runs)} runs end at an obstacle, with a median "
                f"goal error of {millimetres(float(runs['goal_error_mean_m'].median()))} mm"
            )
    return (
        f"The same network learned {title(name)} again from other initial weights, with the plain squared "
        f"error of the paper's Fig. 11 and with the contact term. By loss: {'; '.join(texts)}. A run ends at "
        f"an obstacle where a path of its last {LATEST} iterations touches one. These weights are bare; the "
        "motions above were learned from a first arc beside AB (learn.first_arc)."
    )


def _curves(name: str, table: pd.DataFrame, figures: Path) -> Figure:
    figure = canvas(60)
    error, clearance = figure.subplots(1, 2, sharex=True)
    for loss, (word, color) in LOSSES.items():
        for count, (_, run) in enumerate(table[table["loss"] == loss].groupby("seed")):
            look = {"color": color, "linewidth": 0.9, "alpha": 0.85}
            error.plot(run["iteration"], run["goal_error_mean_m"], label=word if count == 0 else None, **look)
            clearance.plot(run["iteration"], run["min_clearance_m"], **look)
    error.axhline(paper.FINAL_CONTACT_LOSS_M, color=PAPER, linewidth=0.9, linestyle=(0, (4, 3)))
    error.annotate(
        "the paper: a loss below 0.01 m", (0.02, paper.FINAL_CONTACT_LOSS_M), (0, -3),
        xycoords=("axes fraction", "data"), textcoords="offset points", ha="left", va="top",
        fontsize=6.5, color=PAPER, bbox=WHITE,
    )  # fmt: skip
    error.set(xlabel="iteration", ylabel="mean goal error [mm]", yscale="log")
    lowest = min(float(table["min_clearance_m"].min()) * 1.08, 0.0)
    margin = float(table["contact_margin_m"].max())
    clearance.axhspan(lowest, margin, color="#F3E3DA", alpha=0.6, zorder=0, linewidth=0)
    clearance.axhline(margin, color="#333333", linewidth=0.8)
    clearance.annotate(
        "touching", (0.98, margin), (0, -3), xycoords=("axes fraction", "data"), textcoords="offset points",
        ha="right", va="top", fontsize=6.5, color="#555555",
    )  # fmt: skip
    clearance.set(xlabel="iteration", ylabel="smallest clearance [mm]", ylim=(lowest, None))
    for axes in (error, clearance):
        thousandths(axes, "y")
    figure.legend(*error.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return Figure(
        save(figure, figures, f"ablation_{name}"),
        f"{title(name)} from {table['seed'].nunique()} initial weights, one curve a run. Left the mean "
        "goal error, right the smallest clearance; while learning the rope counts as thicker by a margin of "
        f"{millimetres(margin)} mm and touches an obstacle at that line. See whether plain squared error "
        "(orange) stays at an obstacle, where no step toward the goal lowers the loss any more, while the "
        "contact term (blue) may lead around it; how far each comes says how much that is worth from these "
        "weights.",
        "Goal error and clearance over the iterations for both losses",
    )


def _table(name: str, table: pd.DataFrame) -> Table:
    columns = [Column("Initial weights", "seed", "left")]
    rows = {int(seed): [str(int(seed))] for seed in sorted(table["seed"].unique())}
    for loss, (word, _) in LOSSES.items():
        columns += [
            Column(f"{word}: goal error", "mm"),
            Column("clearance", "mm"),
            Column("loss", "m"),
        ]
        runs = last_of_runs(table, loss)
        for seed, row in rows.items():
            error, clearance, value = (float(runs[key].get(seed, math.nan)) for key in LAST)
            row += [millimetres(error, 2), millimetres(clearance, 2), scientific(value, 2)]
    margin = millimetres(float(table["contact_margin_m"].max()))
    caption = (
        f"Where each run on {title(name)} ended: mean goal error, smallest clearance (the margin of "
        f"{margin} mm, or less, where the path touches an obstacle), value of its own loss."
    )
    return Table(caption, tuple(columns), tuple(tuple(row) for row in rows.values()))
