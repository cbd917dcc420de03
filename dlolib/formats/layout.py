"""Layouts: layout.json and goal.csv (format "dlo-layout/1")."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from dlolib.errors import LayoutError
from dlolib.files import whole_folder, write_csv, write_json
from dlolib.formats._json import checked, read_json
from dlolib.formats._plausible import MUCH
from dlolib.formats._schema import MILLIMETRES, PoseModel, Scene, scene_json
from dlolib.formats._table import check_rising, read_table
from dlolib.formats.geometry import signed_distance
from dlolib.types import Floats, Layout, Pose

FORM = "dlo-layout/1"
# In a folder beside a learned trajectory: the layout that it was learned for.
LEARNED_FOR = "layout"
SLACK = 1.02
STEP_M = 0.002


class LayoutModel(Scene):
    """layout.json."""

    start: PoseModel
    grasp: PoseModel


def read_layout(folder: Path) -> Layout:
    """Read a layout and check that a rope could reach its goal.

    Raises:
        FormatError: for a file without the form.
        LayoutError: for a goal longer than the rope, out of reach, or inside an obstacle.
    """
    folder = Path(folder)
    path, goal = folder / "layout.json", folder / "goal.csv"
    model = checked(LayoutModel, read_json(path, FORM), path)
    table = read_table(goal, ["s_m", "x_m", "y_m", "z_m"])
    layout = Layout(
        name=model.name or folder.resolve().name,
        rope=model.object.rope(),
        gravity_m_s2=model.gravity(),
        ends=model.parsed_ends(),
        obstacles=model.parsed_obstacles(),
        start=model.start.pose(),
        grasp=model.grasp.pose(),
        goal_s_m=check_rising(table, "s_m"),
        goal_m=table.stack(["x_m", "y_m", "z_m"]),
    )
    _check_length(layout, goal)
    _check_reach(layout, path, goal)
    _check_free(layout, goal, path)
    return layout


def write_layout(layout: Layout, folder: Path) -> None:
    """Write layout.json and goal.csv, whole or not at all."""
    content: dict[str, Any] = {
        "format": FORM,
        "name": layout.name,
        **scene_json(layout.rope, layout.gravity_m_s2, layout.ends, layout.obstacles),
        "start": _pose_json(layout.start),
        "grasp": _pose_json(layout.grasp),
    }
    columns = {"s_m": layout.goal_s_m} | dict(zip(("x_m", "y_m", "z_m"), layout.goal_m.T, strict=True))
    with whole_folder(Path(folder)) as temporary:
        write_json(temporary / "layout.json", content)
        write_csv(temporary / "goal.csv", pd.DataFrame(columns))


def _pose_json(pose: Pose) -> dict[str, list[float]]:
    return {"position_m": pose.position_m.tolist(), "quaternion": pose.quaternion.tolist()}


def _check_length(layout: Layout, goal: Path) -> None:
    """The goal is a shape of this rope: at least two points, no longer than it."""
    length, last = layout.rope.length_m, len(layout.goal_s_m) - 1
    if last == 0:
        raise LayoutError("has one point", file=goal, mend="give the shape as a row of points")
    if layout.goal_s_m[0] < 0:
        raise LayoutError(
            "is negative", file=goal, place=_at(layout, 0), mend="count from the start of the rope"
        )
    chord = float(np.linalg.norm(np.diff(layout.goal_m, axis=0), axis=1).sum())
    longest, word = max((chord, "the way along its points"), (float(layout.goal_s_m[-1]), "its last s_m"))
    if longest > SLACK * length:
        mend = MILLIMETRES if longest > MUCH * length else "shorten the goal or correct object.length_m"
        problem = f"the goal is longer than the rope: {word} is {longest:.4g} m of {length:g} m"
        raise LayoutError(problem, file=goal, place=_at(layout, last), mend=mend)


def _check_reach(layout: Layout, path: Path, goal: Path) -> None:
    """Grasp and goal are no further from the start than the rope is long."""
    length, start = layout.rope.length_m, layout.start.position_m
    reach = float(np.linalg.norm(layout.grasp.position_m - start))
    if reach > SLACK * length:
        mend = MILLIMETRES if reach > MUCH * length else "bring it nearer to start"
        problem = f"is {reach:.4g} m from the start, on a rope of {length:g} m"
        raise LayoutError(problem, file=path, place="grasp.position_m", mend=mend)
    away = np.linalg.norm(layout.goal_m - start, axis=1)
    bad = np.flatnonzero(away > SLACK * layout.goal_s_m + (SLACK - 1) * length)
    if bad.size:
        row = int(bad[-1])
        problem = f"the point is {away[row]:.4g} m from the start: out of reach"
        mend = "move the goal nearer or correct start.position_m"
        raise LayoutError(problem, file=goal, place=_at(layout, row), mend=mend)


def _check_free(layout: Layout, goal: Path, path: Path) -> None:
    """Neither goal nor grasp is inside an obstacle, the rope's radius included."""
    s_m, goal_m = _dense(layout.goal_s_m, layout.goal_m)
    for number, obstacle in enumerate(layout.obstacles):
        name = f"obstacle {number} ({obstacle.shape})"
        clearance = signed_distance(obstacle, goal_m) - layout.rope.radius_m
        worst = int(np.argmin(clearance))
        if clearance[worst] < 0:
            problem = f"the goal is {-1e3 * clearance[worst]:.1f} mm inside {name}"
            place, mend = f"s_m = {s_m[worst]:.3f}", "move the goal or the obstacle"
            raise LayoutError(problem, file=goal, place=place, mend=mend)
        grasp = float(signed_distance(obstacle, layout.grasp.position_m)) - layout.rope.radius_m
        if grasp < 0:
            problem = f"is {-1e3 * grasp:.1f} mm inside {name}"
            mend = "move the grasp or the obstacle"
            raise LayoutError(problem, file=path, place="grasp.position_m", mend=mend)


def _at(layout: Layout, row: int) -> str:
    """The place of a point in goal.csv by its arc length; its line is not known, tables may have gaps."""
    return f"s_m = {layout.goal_s_m[row]:g}"


def _dense(s_m: Floats, xyz_m: Floats) -> tuple[Floats, Floats]:
    """The polyline at steps of at most `STEP_M`, so that no obstacle slips between two points."""
    count = max(2, int(np.ceil((s_m[-1] - s_m[0]) / STEP_M)) + 1)
    fine = np.union1d(s_m, np.linspace(s_m[0], s_m[-1], count))
    return fine, np.stack([np.interp(fine, s_m, column) for column in xyz_m.T], axis=-1)
