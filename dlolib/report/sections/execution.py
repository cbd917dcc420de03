"""Execution against plan: the shape that the laboratory's ropes reach, or the logs of a robot."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from dlolib.report.drawing import VIEWS, draw_clamp, draw_obstacles, draw_rope, silhouette, widest
from dlolib.report.model import Block, Column, Figure, Missing, Paragraph, Section, Table
from dlolib.report.results import Results
from dlolib.report.style import (
    ELASTIC,
    GOAL,
    PLASTIC,
    ROD,
    SERIES,
    WIDTH_MM,
    canvas,
    label,
    save,
    thousandths,
)
from dlolib.report.text import ABSENT, millimetres, title
from dlolib.types import Floats, Layout

TITLE = "Execution against plan"
LAWS = {"elastic": ("laboratory, elastic rope", ELASTIC), "plastic": ("laboratory, plastic rope", PLASTIC)}
POSE = [f"actual_TCP_pose_{axis}" for axis in range(3)]
TARGET = [f"target_TCP_pose_{axis}" for axis in range(3)]
# What came of one layout's motion, by rope.
Played = Mapping[str, Mapping[str, Any]]


def section(results: Results, figures: Path) -> Section:
    """Shapes reached beside plan and goal, a table, and the tracking of a robot where one moved."""
    executed = {
        name: found for name in results.layouts if (found := results.json("execute", name, "result.json"))
    }
    if not executed:
        missing = Missing("Nothing was executed: `dvc repro execute` runs the motions in the laboratory.")
        return Section("execution", TITLE, (missing,))
    in_lab = {name: played for name in executed if (played := results.played(name))}
    blocks: list[Block] = []
    if in_lab:
        blocks.append(Paragraph(_words(own_rope=results.truth is not None)))
        drawn = [
            name
            for name in in_lab
            if results.layout(name) and results.table("execute", name, "shapes.csv") is not None
        ]
        if drawn:
            blocks.append(_shapes(results, drawn, figures))
        blocks.append(_table(results, in_lab))
        without = {name: played for name in in_lab if (played := results.played(name, "without"))}
        if without:
            blocks.append(_without(in_lab, without))
    by_robot = [name for name in executed if name not in in_lab]
    if by_robot:
        blocks += _robot(results, executed, by_robot, figures)
    else:
        blocks.append(Missing("No robot took part: there are no logs of one among the results."))
    return Section("execution", TITLE, tuple(blocks))


def _words(own_rope: bool) -> str:
    """own_rope: whether the laboratory's rope is the one that was recorded."""
    text = (
        "Each learned motion was run in the virtual laboratory, whose rope is another model than the rod "
        "that learned: once elastic, once yielding plastically as the paper suspects of its own rope in "
        "layout 2. "
    )
    if not own_rope:
        return text + (
            "Its stiffness and its law are those of `lab.rope` in params.yaml, and not those of the rope "
            "that was recorded here: how far it ends from the goal says what the motions do to another rope."
        )
    return text + (
        "The motions were learned with the diagnosed rod: what a rope with the same law misses of "
        "the goal is the error of the model, what the other one misses is the difference in physics."
    )


def _shapes(results: Results, names: list[str], figures: Path) -> Figure:
    columns = min(2, len(names))
    rows = -(-len(names) // columns)
    view = widest(np.vstack([layout.goal_m for name in names if (layout := results.layout(name))]))
    across, up = view.split("-")
    low, high = _reach(results, names, view)
    figure = canvas(
        rows * ((WIDTH_MM / columns - 17.0) * (high[1] - low[1]) / (high[0] - low[0]) + 8.0) + 14.0
    )
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes in panels.flat:
        axes.set_axis_off()
    for axes, name in zip(panels.flat, names, strict=False):
        axes.set_axis_on()
        layout, shapes = results.layout(name), results.table("execute", name, "shapes.csv")
        assert layout is not None and shapes is not None
        _final(axes, view, layout, shapes, results.table("learn", name, "shapes.csv"))
        axes.set_title(label(name))
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        thousandths(axes)
    for axes in panels[-1]:
        axes.set_xlabel(f"{across} [mm]")
    for axes in panels[:, 0]:
        axes.set_ylabel(f"{up} [mm]")
    _legend(figure.get_axes()[0])
    handles, labels = figure.get_axes()[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
    return Figure(
        save(figure, figures, "execution"),
        f"The shape at the end of the motion in the {view} plane: goal (magenta rings), the rod that learned "
        "(dashed blue), and the laboratory's elastic (light blue) and plastic (orange) ropes. See how "
        "near the elastic rope comes to the plan, and where along it the plastic one departs.",
        "Shapes at the end of the executed motions",
    )


def _reach(results: Results, names: list[str], view: str) -> tuple[Floats, Floats]:
    """Lowest and highest coordinates in a view [m] of goals, obstacles and reached shapes, with a margin."""
    seen = []
    for name in names:
        layout, shapes = results.layout(name), results.table("execute", name, "shapes.csv")
        assert layout is not None and shapes is not None
        seen.append(layout.goal_m[:, VIEWS[view]])
        seen += [line for obstacle in layout.obstacles if (line := silhouette(obstacle, view)) is not None]
        last = [_last_shape(rows) for _, rows in shapes.groupby("law")]
        seen += [nodes[:, VIEWS[view]] for nodes in last if nodes is not None]
    points = np.vstack(seen)
    return points.min(axis=0) - 0.015, points.max(axis=0) + 0.015


def _final(axes: Axes, view: str, layout: Layout, shapes: pd.DataFrame, plan: pd.DataFrame | None) -> None:
    draw_obstacles(axes, layout.obstacles, view)
    for law, (_, color) in LAWS.items():
        nodes = _last_shape(shapes[shapes["law"] == law])
        if nodes is not None:
            draw_rope(axes, nodes, view, color, layout.rope.radius_m, fill=0.2)
    nodes = _last_shape(plan) if plan is not None else None
    if nodes is not None:
        axes.plot(*nodes[:, VIEWS[view]].T, color=ROD, linewidth=1.0, linestyle=(0, (5, 2)), zorder=5)
    goal = layout.goal_m[:: max(1, len(layout.goal_m) // 24), VIEWS[view]]
    axes.plot(*goal.T, "o", color=GOAL, markersize=3.2, markerfacecolor="none", markeredgewidth=0.7, zorder=6)
    draw_clamp(axes, layout.start.position_m, view)


def _legend(axes: Axes) -> None:
    axes.plot([], [], "o", color=GOAL, markerfacecolor="none", markersize=4, label="goal")
    axes.plot([], [], color=ROD, linestyle=(0, (5, 2)), label="plan: the rod")
    for word, color in LAWS.values():
        axes.plot([], [], color=color, linewidth=2, label=word)


def _last_shape(shapes: pd.DataFrame) -> Floats | None:
    if shapes.empty:
        return None
    last = shapes[shapes["step"] == shapes["step"].max()]
    return np.asarray(last[["x_m", "y_m", "z_m"]])


def _table(results: Results, played: Mapping[str, Played]) -> Table:
    rows = []
    for name, ropes in played.items():
        plan = results.learned(name)
        if plan is not None:
            rows.append((title(name), "plan (rod)", *_figures(plan), ABSENT))
        for law, found in ropes.items():
            rod = found["rod_error_m"]
            departure = ABSENT if rod is None else millimetres(rod["mean"], 2)
            rows.append(("" if plan else title(name), LAWS[law][0], *_figures(found), departure))
    columns = (
        Column("Layout", align="left"),
        Column("Rope", align="wide"),
        Column("Mean error", "mm"),
        Column("Largest", "mm"),
        Column("At the end", "mm"),
        Column("Clearance", "mm"),
        Column("To the plan", "mm"),
    )
    return Table(
        (
            "Execution in the laboratory beside the plan: distance of the reached shape to the goal, "
            "smallest clearance of all steps, and mean distance to the shape that the rod foresaw."
        ),
        columns,
        tuple(rows),
    )


def _without(played: Mapping[str, Played], without: Mapping[str, Played]) -> Table:
    """The error at the goal of paths learned with the verdict's rod and with the best elastic one."""
    rows = []
    for name, bare in without.items():
        for law, found in bare.items():
            named = played[name].get(law)
            if named is None:
                continue
            pair = (named["goal_error_m"], found["goal_error_m"])
            figures = (millimetres(error[key], 2) for key in ("mean", "max") for error in pair)
            rows.append((title(name), LAWS[law][0], *figures))
    columns = (
        Column("Layout", align="left"),
        Column("Rope", align="wide"),
        Column("Mean, verdict", "mm"),
        Column("Mean, elastic", "mm"),
        Column("Largest, verdict", "mm"),
        Column("Largest, elastic", "mm"),
    )
    caption = (
        "What the verdict is worth: error at the goal of motions learned with the diagnosed rod and with the "
        "best elastic one, both played in the laboratory."
    )
    return Table(caption, columns, tuple(rows))


def _figures(found: Mapping[str, Any]) -> tuple[str, str, str, str]:
    errors = [millimetres(found["goal_error_m"][key], 2) for key in ("mean", "max", "end")]
    return errors[0], errors[1], errors[2], millimetres(found["min_clearance_m"], 2)


def _robot(
    results: Results, executed: dict[str, dict[str, Any]], names: list[str], figures: Path
) -> list[Block]:
    blocks: list[Block] = [
        Paragraph("A robot ran these motions; its controller's own log tells how well it kept to them.")
    ]
    errors = {
        name: error
        for name in names
        if (error := _tracking(results.table("execute", name, "log.csv"))) is not None
    }
    if errors:
        blocks.append(_tracking_figure(errors, figures))
    else:
        blocks.append(
            Missing("The logs hold no target poses beside the actual ones, so that tracking cannot be drawn.")
        )
    others = [name for name in names if executed[name].get("of_another")]
    blocks += [
        Missing(
            f"{title(name)}: the log is of another trajectory, which goes up to "
            f"{1e3 * executed[name]['demanded_error_m']:.0f} mm off the one here; it tells nothing of that."
        )
        for name in others
    ]
    rows = [
        (
            title(name),
            "yes" if executed[name]["completed"] else "no",
            executed[name]["reason"],
            str(executed[name]["samples"]),
            ABSENT if name in others else millimetres(executed[name]["tracking_error_m"], 2),
        )
        for name in names
    ]
    columns = (
        Column("Layout", align="left"),
        Column("Completed", align="left"),
        Column("Why it ended", align="wide"),
        Column("Samples", "count"),
        Column("Tracking error", "mm"),
    )
    blocks.append(Table("Motions run by the robot.", columns, tuple(rows)))
    return blocks


def _tracking(log: pd.DataFrame | None) -> tuple[Floats, Floats] | None:
    """Time (N,) [s] and distance (N,) [m] of the tool from its target; None where the log lacks them."""
    if log is None or log.empty or not set(TARGET) <= set(log.columns):
        return None
    distance = np.linalg.norm(log[POSE].to_numpy() - log[TARGET].to_numpy(), axis=1)
    time = log["timestamp"].to_numpy()
    return time - time[0], distance


def _tracking_figure(errors: dict[str, tuple[Floats, Floats]], figures: Path) -> Figure:
    figure = canvas(50)
    axes = figure.subplots()
    for index, (name, (time, distance)) in enumerate(errors.items()):
        axes.plot(time, distance, color=SERIES[index % len(SERIES)], linewidth=0.9, label=label(name))
    axes.set(xlabel="time [s]", ylabel="distance to target [mm]", ylim=(0, None))
    thousandths(axes, "y")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return Figure(
        save(figure, figures, "tracking"),
        "Distance of the tool from its target during the motion, as the robot's controller logged both. "
        "Peaks show where the motion asks for more speed or acceleration than the controller follows.",
        "Tracking error of the robot over time",
    )
