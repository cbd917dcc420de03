"""Simulated on recorded shapes, and what is left between them along the rope."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from dlolib.report.drawing import widest
from dlolib.report.measures import by_arc_length, normal_residual
from dlolib.report.model import Figure
from dlolib.report.style import FAINT, OBSERVED, ROD, canvas, legend_above, save, thousandths
from dlolib.report.text import millimetres, title
from dlolib.types import Floats, Ints

SHOWN = 7
LINES = 60
"""Most lines of residuals that are drawn: more cannot be told apart, and each makes the page larger."""
SURE = 2.0
"""How many standard errors off zero the shared residual is before it is called the wire's own."""


def shapes_figure(name: str, shapes: pd.DataFrame, figures: Path) -> Figure:
    """Draw the shapes.csv of one recording in the plane in which the rope extends most: shapes to the left,
    residual across the rope to the right."""
    view = widest(shapes[["x_m", "y_m", "z_m"]].to_numpy())
    across, up = (f"{axis}_m" for axis in view.split("-"))
    frames = np.unique(shapes["frame"])
    repeated = _is_one_pose(shapes)
    spaced = np.linspace(0, len(frames) - 1, min(SHOWN, len(frames))).round().astype(int)
    chosen = frames if repeated else frames[spaced]
    # one point alone does not tell which way the rope runs there
    lines = shapes.groupby("frame").filter(lambda rows: len(rows) > 1)
    figure = canvas(58)
    aspect = float(np.ptp(shapes[across]) / max(np.ptp(shapes[up]), 1e-6))
    panels = [min(max(aspect, 0.5), 1.15), 1.0] if len(lines) else [1.0]
    left, *right = figure.subplots(1, len(panels), width_ratios=panels, squeeze=False)[0]
    _draw_shapes(left, shapes, chosen, view)
    shown = f"{title(name)}: {len(chosen)} of {len(frames)} frames; dots are observed, lines simulated."
    caption, beside = f"{shown} No frame has two points, between which a residual could be drawn.", ""
    if right:
        means, spread = _draw_residual(right[0], lines, view)
        caption, beside = f"{shown} {_residual_said(len(frames), view)}", ", and the residual along the rope"
        if repeated:
            caption = _shared_said(name, len(frames), means, spread)
    for axes in (left, *right):
        thousandths(axes)
        legend_above(axes)
    alt = f"Simulated and observed shapes of {title(name)}{beside}"
    return Figure(save(figure, figures, f"shapes_{name}"), caption, alt)


def _draw_shapes(axes: Axes, shapes: pd.DataFrame, chosen: Ints, view: str) -> None:
    across, up = view.split("-")
    for count, frame in enumerate(chosen):
        rows = shapes[shapes["frame"] == frame]
        seen, made = ("observed", "simulated") if count == 0 else (None, None)
        points, rod = (rows[[f"{part}{across}_m", f"{part}{up}_m"]].to_numpy().T for part in ("", "sim_"))
        axes.plot(*points, "o", color=OBSERVED, markersize=1.9, markeredgewidth=0, label=seen)
        axes.plot(*rod, color=ROD, linewidth=1.2, label=made, alpha=0.9)
    axes.set(xlabel=f"{across} [mm]", ylabel=f"{up} [mm]")
    axes.set_aspect("equal", adjustable="datalim")


def _draw_residual(axes: Axes, shapes: pd.DataFrame, view: str) -> tuple[Floats, Floats]:
    """Draw the residual of every frame; return the mean of the frames and their spread by arc length [m]."""
    arcs, offsets = _residual_lines(shapes, axes, view)
    bins = min(24, int(shapes.groupby("frame").size().max()))
    centres, means, rms = by_arc_length(arcs, offsets, bins=bins)
    spread = np.sqrt(np.maximum(rms**2 - means**2, 0.0))
    band = axes.fill_between(centres, means - spread, means + spread, color=ROD, alpha=0.16, linewidth=0)
    band.set_label("± standard deviation")
    axes.plot(centres, means, color=ROD, linewidth=1.6, label="mean of the frames")
    axes.axhline(0, color="#9AA0A6", linewidth=0.6)
    axes.set(xlabel="arc length from the start [mm]", ylabel="observed minus simulated, across [mm]")
    return means, spread


def _residual_lines(shapes: pd.DataFrame, axes: Axes, view: str) -> tuple[Floats, Floats]:
    arcs, offsets = [], []
    frames = np.unique(shapes["frame"])
    drawn = {*frames[np.linspace(0, len(frames) - 1, min(LINES, len(frames))).round().astype(int)].tolist()}
    for frame, rows in shapes.groupby("frame"):
        s_m, across = normal_residual(rows, view)
        if frame in drawn:
            axes.plot(s_m, across, color=FAINT, linewidth=0.45, alpha=0.7, zorder=1)
        arcs.append(s_m)
        offsets.append(across)
    return np.concatenate(arcs), np.concatenate(offsets)


def _is_one_pose(shapes: pd.DataFrame) -> bool:
    """Whether every frame shows the same pose, so that only the noise of picking differs."""
    spread = shapes.groupby("s_m")[["x_m", "y_m", "z_m"]].std().max().max()
    return bool(np.isfinite(spread) and spread < 0.02)


def _shared_said(name: str, frames: int, means: Floats, spread: Floats) -> str:
    """What the residuals of one pose say that was seen again and again."""
    shared, error = np.sqrt(np.mean(means**2)), np.sqrt(np.mean(spread**2) / frames)
    verdict = (
        "which is more than the points' scatter explains: the rod lacks something"
        if shared > SURE * error
        else "which the points' scatter alone can explain"
    )
    return (
        f"{title(name)}: one pose, seen {frames} times. Right, "
        "across the rope: grey one line a time, blue their mean and its spread. What all "
        f"share is {millimetres(float(shared))} mm (RMS) with a standard error of "
        f"{millimetres(float(error))} mm, {verdict}."
    )


def _residual_said(frames: int, view: str) -> str:
    grey = "one line a frame" if frames <= LINES else f"the lines of {LINES} frames"
    return (
        f"Right, across the rope in the {view} plane: grey {grey}, blue the mean of all frames and its "
        "spread. Smooth waves of the grey lines are what the model lacks; their jagged scatter is noise."
    )
