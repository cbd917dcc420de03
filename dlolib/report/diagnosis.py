"""Figures of a diagnosis, drawn from the folder that `dlo diagnose` or the stage wrote."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure as Canvas

from dlolib.formats import read_verdict
from dlolib.report.style import (
    ELASTIC,
    FAINT,
    OBSERVED,
    PLASTIC,
    ROD,
    STYLE,
    canvas,
    legend_above,
    thousandths,
)
from dlolib.report.text import title
from dlolib.types import Candidate, Verdict

SHOWN_FRAMES, SHOWN_MODELS = 6, 10
# Letters of a model's name in a line, and what a line and the gap to the next model take [mm].
NAME_LETTERS, LINE_MM, GAP_MM = 44, 3.0, 2.0
DPI = 200
# A gain in χ² that is none.
LEAST_GAIN = 1e-3
# The best model, too, has a bar, though BIC has it no worse than itself.
SHORTEST_BAR = 0.1
BLACK_BOX = "a residual that names nothing"


def draw_diagnosis(folder: Path) -> None:
    """Draw rope.png, scan.png, models.png and, of a rope with a law, moments.png into the folder."""
    verdict = read_verdict(folder)
    # a recording may be called 007
    shapes, scan = (pd.read_csv(folder / n, dtype={"recording": str}) for n in ("shapes.csv", "scan.csv"))
    moments = pd.read_csv(folder / "moments.csv")
    with rc_context(STYLE):
        figures = {"rope": rope_figure(shapes, verdict.recordings[0])}
        figures["scan"] = scan_figure(scan, verdict.recordings[0])
        figures["models"] = models_figure(verdict)
        if bends(moments):
            figures["moments"] = moments_figure(moments)
        for name, figure in figures.items():
            figure.savefig(folder / f"{name}.png", dpi=DPI, metadata={"Software": None})


def rope_figure(shapes: pd.DataFrame, recording: str) -> Canvas:
    """The rope, coloured by how many deviations of the noise the elastic rod is off; beside it both rods."""
    mine = shapes[shapes["recording"] == recording]
    frames = np.unique(mine["frame"])
    chosen = frames[np.unique(np.linspace(0, len(frames) - 1, SHOWN_FRAMES).round().astype(int))]
    if mine.groupby("s_m")["elastic_x_m"].nunique().max() == 1:
        chosen = frames[:1]  # one pose, seen again and again
    figure = canvas(72)
    views = figure.subplots(1, 2)
    for axes, (across, up) in zip(views, (("x", "z"), ("x", "y")), strict=True):
        lines, values = [], []
        for frame in chosen:
            rows = mine[mine["frame"] == frame].sort_values("s_m")
            places = rows[[f"{across}_m", f"{up}_m"]].to_numpy()
            lines += list(np.stack([places[:-1], places[1:]], axis=1))
            values += list((rows["off"].to_numpy()[1:] + rows["off"].to_numpy()[:-1]) / 2)
            axes.plot(rows[f"elastic_{across}_m"], rows[f"elastic_{up}_m"], color=ELASTIC, linewidth=0.6)
            axes.plot(
                rows[f"model_{across}_m"],
                rows[f"model_{up}_m"],
                color=OBSERVED,
                linewidth=0.5,
                linestyle="--",
            )
        drawn = LineCollection(lines, cmap="inferno_r", linewidths=2.4, alpha=0.9)
        drawn.set_array(np.array(values))
        drawn.set_clim(0, max(4.0, float(np.quantile(mine["off"], 0.99))))
        axes.add_collection(drawn)
        axes.set(xlabel=f"{across} [mm]", ylabel=f"{up} [mm]")
        axes.set_aspect("equal", adjustable="datalim")
        thousandths(axes)
    views[0].plot([], [], color=ELASTIC, linewidth=0.8, label="elastic rod")
    views[0].plot([], [], color=OBSERVED, linewidth=0.8, linestyle="--", label="best model")
    legend_above(views[0])
    figure.colorbar(drawn, ax=views, label="observed, off the elastic rod [deviations of the noise]")
    return figure


def scan_figure(scan: pd.DataFrame, recording: str) -> Canvas:
    """Gain of the best local probe over place and frame; below what noise does it is left white."""
    mine = scan[scan["recording"] == recording]
    best = mine.groupby(["s_m", "frame"])["gain"].max().unstack()
    threshold = float(mine["threshold"].iloc[0])
    figure = canvas(62)
    axes = figure.subplots()
    axes.grid(False)
    # where nothing is free to move nothing gains, and no threshold was to be found
    least = max(threshold, LEAST_GAIN)
    top = max(float(best.to_numpy().max()), 10 * least)
    drawn = axes.pcolormesh(
        best.columns, 1e3 * best.index, np.where(best > least, best, np.nan), cmap="inferno_r",
        norm=LogNorm(least, top), shading="nearest", rasterized=True,
    )  # fmt: skip
    axes.set(xlabel="frame", ylabel="arc length [mm]")
    figure.colorbar(drawn, ax=axes, label="gain in χ² of the best local probe")
    return figure


def models_figure(verdict: Verdict) -> Canvas:
    """The best models: how much worse each is by BIC, and what each foretells of held-out motion, if any."""
    some = [one for one in verdict.candidates if one.kind != "wrong_same_size"][:SHOWN_MODELS]
    rest = [one for one in verdict.candidates if one.kind == "black_box" or not one.effects]
    models = some + [one for one in rest if one not in some]
    names = [textwrap.fill(_name(one), NAME_LETTERS) for one in models]
    lines = sum(1 + name.count("\n") for name in names)
    figure = canvas(20 + GAP_MM * len(models) + LINE_MM * lines)
    ahead = [(k, one) for k, one in enumerate(models) if one.heldout_delta_chi2 is not None]
    left, *others = figure.subplots(1, 2 if ahead else 1, sharey=True, squeeze=False)[0]
    places = np.arange(len(models))
    said = [set(names) for names in verdict.equivalent] or [{effect.name for effect in verdict.effects}]
    silent = verdict.status == "unexplained" and not verdict.effects
    won = [one.kind == "library" and set(one.effects) in said and not silent for one in models]
    colors = [ROD if one else FAINT for one in won]
    left.barh(places, [max(one.delta_bic, SHORTEST_BAR) for one in models], color=colors, height=0.6)
    left.set(xlabel="BIC over\nthe best model's", xscale="log", xlim=(SHORTEST_BAR / 2, None))
    left.set_yticks(places, names)
    left.invert_yaxis()
    for right in others:
        right.errorbar(
            [one.heldout_delta_chi2 for _, one in ahead], [k for k, _ in ahead],
            xerr=[2 * (one.heldout_delta_chi2_se or 0.0) for _, one in ahead], fmt="o", color=OBSERVED,
            markersize=3, linewidth=0.9,
        )  # fmt: skip
        right.axvline(0, color="#9AA0A6", linewidth=0.6)
        right.set(xlabel="held-out change in χ²\n(± 2 standard errors)")
        right.locator_params(axis="x", nbins=4)
    return figure


def _name(one: Candidate) -> str:
    if one.kind == "black_box":
        return BLACK_BOX
    return " + ".join(title(name).lower() for name in one.effects) or "elastic rod"


def bends(moments: pd.DataFrame) -> bool:
    """Whether there is a moment to be drawn."""
    return len(moments) > 2 and float(np.ptp(moments["curvature_1_m"])) > 0


def moments_figure(moments: pd.DataFrame) -> Canvas:
    """Moment against curvature where the best model bends most, in the order of time."""
    figure = canvas(58)
    axes: Axes = figure.subplots()
    axes.plot(moments["curvature_1_m"], 1e3 * moments["moment_n_m"], color=PLASTIC, linewidth=1.2)
    axes.plot(
        moments["curvature_1_m"].iloc[0],
        1e3 * moments["moment_n_m"].iloc[0],
        "o",
        color=OBSERVED,
        markersize=3,
    )
    place = 1e3 * float(moments["s_m"].iloc[0])
    axes.set(xlabel="curvature [1/m]", ylabel="moment [mN m]", title=f"at {place:.0f} mm")
    return figure


__all__ = ["bends", "draw_diagnosis", "models_figure", "moments_figure", "rope_figure", "scan_figure"]
