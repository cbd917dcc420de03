"""The learned motions: four layouts in two views as in the paper's Fig. 10, errors, learning curves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D

from dlolib.report.drawing import VIEWS, draw_clamp, draw_obstacles, draw_rope, mark, silhouette, smooth
from dlolib.report.model import Block, Column, Figure, Missing, Paragraph, Section, Table
from dlolib.report.results import Results
from dlolib.report.style import GOAL, PATH, ROD, SERIES, WHITE, WIDTH_MM, canvas, label, save, thousandths
from dlolib.report.text import listed, millimetres, title
from dlolib.types import Floats, Layout

TITLE = "Motions learned"
BETWEEN = "#9DB4C6"
PATH_COLUMNS = ["end_x_m", "end_y_m", "end_z_m"]


def section(results: Results, figures: Path) -> Section:
    """Each layout seen from the front and from above, a table, the curves of learning."""
    learned = [name for name in results.layouts if results.learned(name)]
    if not learned:
        return Section("layouts", TITLE, (Missing("Nothing was learned yet: `dvc repro learn` does it."),))
    blocks: list[Block] = [Paragraph(_words(results))]
    drawn = [each for name in learned if (each := _read(results, name))]
    if drawn:
        blocks.append(_views(drawn, figures))
    absent = [title(name) for name in learned if name not in {each.name for each in drawn}]
    if absent:
        blocks.append(Missing(f"No layout or no shapes to draw for {listed(absent)}."))
    blocks.append(_table(results, learned))
    curves = {
        name: curve for name in learned if (curve := results.table("learn", name, "curve.csv")) is not None
    }
    if curves:
        blocks.append(_curves(curves, figures))
    return Section("layouts", TITLE, tuple(blocks))


def _words(results: Results) -> str:
    segments = (results.parameters or {}).get("learn", {}).get("segments")
    arcs = f"{segments} arcs" if segments else "a chain of arcs"
    return (
        f"For each layout a small network proposes the gripper's motion from A to B as {arcs}, and "
        "learns from the gradient through the simulated rod: toward the goal shape, and away from every "
        "contact on the way."
    )


@dataclass(frozen=True)
class Learned:
    """What is drawn of a layout: itself, the rod's nodes by step, the gripper's path (N, 3) [m]."""

    name: str
    layout: Layout
    shapes: pd.DataFrame
    path: Floats | None

    @property
    def reach_m(self) -> Floats:
        """Lowest and highest coordinates of what is to be seen, (2, 3)."""
        seen = [self.shapes[["x_m", "y_m", "z_m"]].to_numpy(), self.layout.goal_m]
        seen += [self.path] if self.path is not None else []
        for obstacle in self.layout.obstacles:
            for view, across in VIEWS.items():
                outline = silhouette(obstacle, view)
                if outline is not None:
                    # an outline tells nothing of how far away it is
                    seen.append(np.full((len(outline), 3), np.nan))
                    seen[-1][:, across] = outline
        points = np.vstack(seen)
        return np.array([np.nanmin(points, axis=0), np.nanmax(points, axis=0)])


def _read(results: Results, name: str) -> Learned | None:
    layout, shapes = results.layout(name), results.table("learn", name, "shapes.csv")
    if layout is None or shapes is None or shapes.empty:
        return None
    way = results.table("learn", name, "trajectory.csv")
    return Learned(name, layout, shapes, None if way is None else way[PATH_COLUMNS].to_numpy())


def _views(drawn: list[Learned], figures: Path) -> Figure:
    columns = min(2, len(drawn))
    rows = -(-len(drawn) // columns)
    low = np.min([each.reach_m[0] for each in drawn], axis=0) - 0.02
    high = np.max([each.reach_m[1] for each in drawn], axis=0) + 0.02
    front, above = _sides(drawn)
    (across, up), back = VIEWS[front], VIEWS[above][1]
    wide, deep, tall = (high - low)[[across, back, up]]
    scale = (WIDTH_MM / columns - 17.0) / wide
    figure = canvas(rows * (scale * (tall + deep) + 17.0) + 8.0)
    panels = figure.subplots(2 * rows, columns, squeeze=False, sharex=True, height_ratios=[tall, deep] * rows)
    for axes in panels.flat:
        axes.set_axis_off()
    for index, each in enumerate(drawn):
        row, column = divmod(index, columns)
        for axes, view in ((panels[2 * row, column], front), (panels[2 * row + 1, column], above)):
            axes.set_axis_on()
            other = VIEWS[view][1]
            _draw(axes, view, each)
            # who looks along -x at y-z and from above has x towards himself
            ends = (high[other], low[other]) if view == "y-x" else (low[other], high[other])
            axes.set(xlim=(low[across], high[across]), ylim=ends, aspect="equal")
            axes.set_ylabel(f"{view[-1]} [mm]" if column == 0 else "")
            thousandths(axes)
        panels[2 * row, column].set_title(label(each.name))
    for axes in panels[-1]:
        axes.set_xlabel(f"{front[0]} [mm]")
    _legend(figure)
    return Figure(
        save(figure, figures, "layouts"),
        f"The layouts, each from the front ({front}) and from above ({above}), ropes at their true "
        "thickness. See whether the reached shape (blue) lies on the goal (magenta rings), and whether "
        "any of the shapes on the way (pale blue, every thirtieth step) comes near an obstacle; the green "
        "line is the gripper's path from A to B.",
        "Learned motions in each layout in two views",
    )


def _sides(drawn: list[Learned]) -> tuple[str, str]:
    """The views from the front and from above, whose first axis is the one along which the goals extend."""
    goals_m = np.vstack([each.layout.goal_m for each in drawn])
    return ("x-z", "x-y") if np.ptp(goals_m[:, 0]) >= np.ptp(goals_m[:, 1]) else ("y-z", "y-x")


def _draw(axes: Axes, view: str, each: Learned) -> None:
    layout, path = each.layout, each.path
    radius = layout.rope.radius_m
    draw_obstacles(axes, layout.obstacles, view)
    steps = [rows[["x_m", "y_m", "z_m"]].to_numpy() for _, rows in each.shapes.groupby("step")]
    draw_rope(axes, steps[0], view, "#8A8F95", radius, fill=0.22)
    for nodes in steps[1:-1]:
        axes.plot(*smooth(nodes)[:, VIEWS[view]].T, color=BETWEEN, linewidth=0.6, zorder=2.5)
    draw_rope(axes, steps[-1], view, ROD, radius, fill=0.3)
    if path is not None:
        axes.plot(*path[:, VIEWS[view]].T, color=PATH, linewidth=1.4, zorder=5)
    goal = layout.goal_m[:: max(1, len(layout.goal_m) // 24)][:, VIEWS[view]]
    axes.plot(*goal.T, "o", color=GOAL, markersize=3.2, markerfacecolor="none", markeredgewidth=0.7, zorder=6)
    draw_clamp(axes, layout.start.position_m, view)
    if view.endswith("z"):
        mark(axes, layout.grasp.position_m, view, "A", (3, -10))
        mark(axes, layout.goal_m[-1], view, "B", (4, 5))


def _legend(figure: Canvas) -> None:
    handles = [
        Line2D([], [], color="#8A8F95", linewidth=3, alpha=0.6, label="start"),
        Line2D([], [], color=BETWEEN, linewidth=0.8, label="on the way"),
        Line2D([], [], color=ROD, linewidth=2, label="reached"),
        Line2D(
            [], [], color=GOAL, marker="o", markerfacecolor="none", linestyle="", markersize=4, label="goal"
        ),
        Line2D([], [], color=PATH, linewidth=1.4, label="gripper's path"),
        Line2D([], [], color="#333333", marker="s", linestyle="", markersize=4, label="clamp"),
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles))


def _table(results: Results, names: list[str]) -> Table:
    rows = []
    for name in names:
        result = results.learned(name)
        assert result is not None
        goal = result["goal_error_m"]
        rows.append(
            (
                title(name),
                millimetres(goal["mean"], 2),
                millimetres(goal["max"], 2),
                millimetres(goal["end"], 2),
                millimetres(result["min_clearance_m"], 2),
                str(result["contacts"]),
                str(result["iterations"]),
            )
        )
    columns = (
        Column("Layout", align="left"),
        Column("Mean error", "mm"),
        Column("Largest", "mm"),
        Column("At the end", "mm"),
        Column("Clearance", "mm"),
        Column("Contacts", "count"),
        Column("Iterations", "count"),
    )
    caption = (
        "The learned motions in the rod. The goal error is the distance between a point of the reached "
        "shape and its goal; the clearance is that of the rope's surface to the nearest obstacle over "
        "all steps, negative inside. Contacts: how often, over all particles and steps, one came nearer than "
        "the clearance that was asked for."
    )
    return Table(caption, columns, tuple(rows))


def _curves(curves: dict[str, pd.DataFrame], figures: Path) -> Figure:
    """Without an obstacle in any layout there is no clearance to be drawn."""
    columns = [("loss", "loss (19)"), ("goal_error_mean_m", "mean goal error [mm]")]
    clearance = any(np.isfinite(curve["min_clearance_m"]).any() for curve in curves.values())
    if clearance:
        columns.append(("min_clearance_m", "clearance [mm]"))
    figure = canvas(56)
    panels = figure.subplots(1, len(columns))
    for index, (name, curve) in enumerate(curves.items()):
        for axes, (column, _) in zip(panels, columns, strict=True):
            color = SERIES[index % len(SERIES)]
            axes.plot(curve["iteration"], curve[column], color=color, label=label(name), linewidth=1)
    for axes, (column, shown) in zip(panels, columns, strict=True):
        axes.set(xlabel="iteration", ylabel=shown)
        if column.endswith("_m"):
            thousandths(axes, "y")
    panels[0].set_yscale("log")
    panels[1].set_ylim(0, None)
    words = (
        "How the motions were learned: the loss and the mean goal error. See how far the error falls, and "
        "whether it still does at the end."
    )
    if clearance:
        margin = max(float(curve["contact_margin_m"].max()) for curve in curves.values())
        _mark_touching(panels[2], margin)
        words = (
            "How the motions were learned: the loss, the mean goal error, and the smallest clearance on the "
            "whole way. While learning the rope counts as thicker by a margin of "
            f"{millimetres(margin)} mm, and a motion at that line touches an obstacle: it has to come free "
            "before it can come to the goal. See where the clearance leaves the line, and what the goal "
            "error does there."
        )
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
    return Figure(
        save(figure, figures, "learning"),
        words,
        f"Loss{',' if clearance else ' and'} goal error{' and clearance' if clearance else ''} over the "
        "iterations of learning",
    )


def _mark_touching(axes: Axes, margin_m: float) -> None:
    """The clearance at which learning's thicker rope touches."""
    axes.set_ylim(min(0.0, axes.get_ylim()[0]), None)
    axes.axhline(margin_m, color="#333333", linewidth=0.8)
    axes.annotate(
        "touching", (0.98, margin_m), (0, 1), xycoords=("axes fraction", "data"), textcoords="offset points",
        ha="right", va="bottom", fontsize=6.5, color="#333333", bbox=WHITE,
    )  # fmt: skip
