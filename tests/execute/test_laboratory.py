"""A trajectory in the laboratory: the shape reached beside the goal and the rod's."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from dlolib.errors import ParameterError
from dlolib.execute.laboratory import LabExecution, compare, execute_in_lab, rope_of
from dlolib.execute.recorded import columns
from dlolib.lab.play import LabRun
from dlolib.lab.rope import LabRope
from dlolib.types import Ends, Layout, Motion, Obstacle, Pose, Rope

from .conftest import TURN

LENGTH_M = 0.445
A, B = np.array([0.34, 0.0, 0.02]), np.array([0.33, 0.0, 0.05])
ROPE = LabRope(bodies=16)


def layout() -> Layout:
    s_m = np.linspace(0, LENGTH_M, 30)
    values = {"center_m": (0.2, 0.0, 0.2), "axis": (0.0, 1.0, 0.0), "radius_m": (0.03,), "height_m": (0.06,)}
    return Layout(
        name="layout_x",
        rope=Rope("rope", LENGTH_M, 0.008, 0.04),
        gravity_m_s2=np.array([0.0, 0.0, -9.81]),
        ends=Ends(),
        obstacles=(Obstacle("cylinder", values),),
        start=Pose(np.zeros(3), np.array(TURN)),
        grasp=Pose(A, np.array(TURN)),
        goal_s_m=s_m,
        goal_m=np.outer(s_m / LENGTH_M, B),
    )


def motion() -> Motion:
    t_s = np.linspace(0, 0.6, 61)
    share = (1 - np.cos(np.pi * t_s / 0.6))[:, None] / 2
    turn = np.tile(TURN, (61, 1))
    return Motion(t_s, np.zeros((61, 3)), turn, A + share * (B - A), turn)


@pytest.fixture(scope="module")
def both() -> LabExecution:
    return execute_in_lab(motion(), layout(), ROPE)


def test_what_no_run_can_be_is_refused() -> None:
    way = motion()
    one = Motion(way.t_s[:1], way.start_m[:1], way.start_q[:1], way.end_m[:1], way.end_q[:1])
    with pytest.raises(ParameterError, match="fewer than two rows"):
        execute_in_lab(one, layout(), ROPE)
    late = np.where(np.arange(len(way.t_s)) > 30, 1e8, 0.0)
    with pytest.raises(ParameterError, match="lasts 1e.08 s; look for a jump of the clock"):
        execute_in_lab(replace(way, t_s=way.t_s + late), layout(), ROPE)
    with pytest.raises(ParameterError, match="laws: no law to run; give elastic, plastic, or both"):
        execute_in_lab(way, layout(), ROPE, laws=())


def test_both_laws_reach_the_end_and_differ(both: LabExecution) -> None:
    assert list(both.laws) == ["elastic", "plastic"]
    elastic, plastic = both.laws["elastic"], both.laws["plastic"]
    assert elastic.goal_error_m["end"] < 1e-4
    assert abs(elastic.goal_error_m["mean"] - plastic.goal_error_m["mean"]) > 1e-4
    assert elastic.rod_error_m is None
    assert elastic.min_clearance_m is not None
    assert 0.05 < elastic.min_clearance_m < 0.2


def test_the_grippers_log_follows_the_trajectory(both: LabExecution) -> None:
    assert list(both.log) == columns()
    assert both.result.completed
    assert both.result.tracking_error_m is not None
    assert both.result.tracking_error_m < 1e-4
    assert both.log["actual_q_0"].isna().all()
    last = both.log[columns({"actual_TCP_pose": 6})].to_numpy()[-1]
    assert last == pytest.approx([*B, *np.full(3, 2 * np.pi / 3 / np.sqrt(3))], abs=1e-4)


def test_the_files_hold_the_same(both: LabExecution, tmp_path: Path) -> None:
    both.write(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.csv", "result.json", "shapes.csv"]
    said = json.loads((tmp_path / "result.json").read_text())
    assert said["samples"] == len(pd.read_csv(tmp_path / "log.csv"))
    assert said["laws"]["plastic"]["goal_error_m"] == dict(both.laws["plastic"].goal_error_m)
    shapes = pd.read_csv(tmp_path / "shapes.csv")
    assert list(shapes) == ["law", "step", "t_s", "node", "x_m", "y_m", "z_m"]
    assert sorted(set(shapes["step"])) == [0, 30, 60]
    assert len(shapes) == 2 * 3 * 17


def test_a_run_is_the_same_to_the_byte(both: LabExecution) -> None:
    again = execute_in_lab(motion(), layout(), ROPE, laws=("elastic",))
    assert again.laws["elastic"] == both.laws["elastic"]
    first = both.shapes[both.shapes["law"] == "elastic"]
    assert again.shapes.to_numpy().tolist() == first.to_numpy().tolist()


def test_distances_are_at_equal_arc_length() -> None:
    s_m = np.linspace(0, LENGTH_M, 61)
    straight = np.outer(s_m / LENGTH_M, B)
    run = LabRun(
        t_s=np.zeros(1),
        s_m=s_m,
        xyz_m=straight[None] + [0.0, 0.003, 0.0],
        plastic_1_m=np.zeros((1, 61, 2)),
        min_clearance_m=np.inf,
        clearance_m=np.zeros(1),
        log_t_s=np.zeros(1),
        log_m=np.zeros((1, 3)),
        log_q=np.zeros((1, 4)),
    )
    rod = np.outer(np.linspace(0, 1, 31), B) + np.array([0.0, 0.001, 0.0])
    found = compare(run, layout(), rod)
    assert found.goal_error_m == pytest.approx({"mean": 0.003, "max": 0.003, "end": 0.003})
    assert found.rod_error_m == pytest.approx({"mean": 0.002, "max": 0.002})
    assert found.min_clearance_m is None
    # of a goal that covers a part of the rope nothing is said beyond it
    there = layout()
    part = there.goal_s_m < 0.4 * LENGTH_M
    goal_m = there.goal_m[part].copy()
    goal_m[-1, 2] += 1e-4
    found = compare(run, replace(there, goal_s_m=there.goal_s_m[part], goal_m=goal_m), rod)
    assert found.goal_error_m == pytest.approx({"mean": 0.003, "max": 0.003, "end": 0.003}, rel=0.01)
    # nor where it lies between two nodes
    two = LENGTH_M * np.array([0.501, 0.505])
    found = compare(run, replace(there, goal_s_m=two, goal_m=np.outer(two / LENGTH_M, B)), rod)
    assert found.goal_error_m == pytest.approx({"mean": 0.003, "max": 0.003, "end": 0.003})


def test_a_trajectory_of_another_layout_is_refused() -> None:
    moved = replace(layout(), grasp=Pose(A + 0.02, np.array(TURN)))
    with pytest.raises(ParameterError, match="away from the grasp of layout_x"):
        execute_in_lab(motion(), moved, ROPE)


@pytest.mark.parametrize("end", ["start", "grasp"])
def test_a_layout_that_holds_an_end_otherwise_is_refused(end: str) -> None:
    held = getattr(layout(), end)
    tilted = Rotation.from_euler("y", 10, degrees=True) * Rotation.from_quat(TURN, scalar_first=True)
    for pose, message in (
        (
            replace(held, position_m=held.position_m + np.array([0.0, 0.02, 0.0])),
            f"0.020 m away from the {end}",
        ),
        (
            replace(held, quaternion=tilted.as_quat(scalar_first=True)),
            f"turned by 0.17 rad against the {end}",
        ),
    ):
        with pytest.raises(ParameterError, match=message):
            execute_in_lab(motion(), replace(layout(), **{end: pose}), ROPE)
    with pytest.raises(ParameterError, match="layout_x, ends: an end is free"):
        execute_in_lab(motion(), replace(layout(), ends=Ends(end="free")), ROPE)


def test_the_layouts_rope_counts() -> None:
    rope = rope_of(replace(layout(), rope=Rope("thin", 0.3, 0.002, None)), LabRope(linear_density_kg_m=0.02))
    assert (rope.length_m, rope.diameter_m, rope.linear_density_kg_m) == (0.3, 0.002, 0.02)


def test_the_robots_side_loads_no_mujoco() -> None:
    code = (
        "import sys, dlolib.execute as e; [getattr(e, n) for n in e.__all__]; print('mujoco' in sys.modules)"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
