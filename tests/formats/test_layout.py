"""Layouts that no rope can reach, and those that one can."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from formats import samples

from dlolib.errors import DloError, FormatError, LayoutError
from dlolib.formats import read_layout


def test_round_trip(tmp_path: Path) -> None:
    written, again = samples.layout(), read_layout(samples.layout_folder(tmp_path / "l"))
    assert (again.name, again.rope, again.ends) == (written.name, written.rope, written.ends)
    assert again.obstacles == written.obstacles
    np.testing.assert_allclose(again.goal_m, written.goal_m, atol=1e-9)
    np.testing.assert_allclose(again.grasp.position_m, written.grasp.position_m)
    np.testing.assert_allclose(again.start.quaternion, written.start.quaternion)


def refused(folder: Path, name: str, kind: type[DloError] = LayoutError) -> str:
    with pytest.raises(kind) as caught:
        read_layout(folder)
    line = str(caught.value)
    assert line.startswith(str(folder / name)) and "; " in line
    return line


def test_goal_longer_than_the_rope(tmp_path: Path) -> None:
    folder = samples.layout_folder(tmp_path / "l")
    samples.set_key(folder / "layout.json", "object.length_m", 0.42)
    assert "the goal is longer than the rope: its last s_m is 0.445 m of 0.42 m" in refused(
        folder, "goal.csv"
    )


def test_the_way_along_the_goal_counts_too(tmp_path: Path) -> None:
    folder = samples.layout_folder(tmp_path / "l")
    samples.scale_columns(folder / "goal.csv", "z_m", 3.0)
    assert "the way along its points is" in refused(folder, "goal.csv")


def test_goal_in_millimetres(tmp_path: Path) -> None:
    folder = samples.layout_folder(tmp_path / "l")
    samples.scale_columns(folder / "goal.csv", "_m", 1000.0)
    assert "looks like millimetres; divide by 1000" in refused(folder, "goal.csv")


@pytest.mark.parametrize(
    ("height", "inside"), [(-0.075, True), (-0.042, True), (-0.039, False), (-0.111, False)]
)
def test_goal_inside_an_obstacle_radius_included(tmp_path: Path, height: float, inside: bool) -> None:
    # The goal's lowest point is at z = -0.075; the cylinder's radius is 30 mm, the rope's 4 mm.
    folder = samples.layout_folder(tmp_path / "l")
    samples.set_key(folder / "layout.json", "obstacles.0.center_m", [0.2, 0, height])
    if inside:
        assert "s_m = 0.222: the goal is" in refused(folder, "goal.csv")
    else:
        read_layout(folder)


def test_a_thin_obstacle_between_two_goal_points_is_found(tmp_path: Path) -> None:
    folder = samples.layout_folder(tmp_path / "l")
    goal = samples.layout().goal_m
    middle = goal[5:7].mean(axis=0).tolist()
    samples.set_key(
        folder / "layout.json", "obstacles", [{"shape": "sphere", "center_m": middle, "radius_m": 1e-3}]
    )
    assert "inside obstacle 0 (sphere)" in refused(folder, "goal.csv")


def test_grasp_inside_an_obstacle(tmp_path: Path) -> None:
    folder = samples.layout_folder(tmp_path / "l")
    samples.set_key(folder / "layout.json", "grasp.position_m", [0.2, 0, 0.15])
    assert "grasp.position_m: is 34.0 mm inside obstacle 0" in refused(folder, "layout.json")


def test_goal_out_of_reach(tmp_path: Path) -> None:
    folder = samples.layout_folder(tmp_path / "l")
    samples.set_key(folder / "layout.json", "start.position_m", [-0.1, 0, 0])
    samples.set_key(folder / "layout.json", "grasp.position_m", [0.2, 0, 0.05])
    assert "out of reach" in refused(folder, "goal.csv")


@pytest.mark.parametrize(
    ("key", "value", "says", "kind"),
    [
        ("grasp.position_m", [420, 0, 50], "looks like millimetres", LayoutError),
        ("grasp.position_m", [0.6, 0, 0], "grasp.position_m: is 0.6 m from the start", LayoutError),
        ("grasp.quaternion", [0, 0, 0, 0], "grasp.quaternion: is a zero quaternion; give", FormatError),
        ("start.quaternion", [1, 1, 0, 0], "start.quaternion: has length 1.414, not 1", FormatError),
        ("start", None, "start: ", FormatError),
    ],
)
def test_a_bad_key_is_named(tmp_path: Path, key: str, value: Any, says: str, kind: type[DloError]) -> None:
    folder = samples.layout_folder(tmp_path / "l")
    samples.set_key(folder / "layout.json", key, value)
    assert says in refused(folder, "layout.json", kind)


def test_a_goal_of_one_point_is_no_shape(tmp_path: Path) -> None:
    folder = samples.layout_folder(tmp_path / "l")
    header, first, *_ = (folder / "goal.csv").read_text().splitlines()
    (folder / "goal.csv").write_text(f"{header}\n{first}\n")
    assert "has one point" in refused(folder, "goal.csv")
    (folder / "goal.csv").write_text(f"{header}\n")
    assert "has no rows" in refused(folder, "goal.csv", FormatError)


def test_a_goal_before_the_ropes_start(tmp_path: Path) -> None:
    folder = samples.layout_folder(tmp_path / "l")
    samples.set_cell(folder / "goal.csv", 2, "s_m", "-0.001")
    assert "s_m = -0.001: is negative" in refused(folder, "goal.csv")


def test_a_goal_whose_arc_length_falls(tmp_path: Path) -> None:
    folder = samples.layout_folder(tmp_path / "l")
    samples.set_cell(folder / "goal.csv", 5, "s_m", "0.001")
    assert "line 5, column s_m: s_m falls" in refused(folder, "goal.csv", FormatError)
