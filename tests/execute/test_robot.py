"""Trajectories on a robot: ur_rtde's own clients against a process that speaks the controller's protocols."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from dlolib.errors import MotionRefused
from dlolib.execute import ExecutionResult, Limits, RobotConfig, execute_from_log, execute_on_robot, read_log
from dlolib.execute.recorded import columns
from dlolib.execute.robots import Robot
from dlolib.execute.robots.ur import end_program
from dlolib.execute.stream import check_robot
from dlolib.formats import LEARNED_FOR, write_layout, write_motion
from dlolib.types import Ends, Floats, Layout, Motion, Obstacle, Pose, Rope

from .conftest import FIRST_M, TURN, StandIn, arc, stand_ins

Start = Callable[..., StandIn]
CALL = """
import sys
from pathlib import Path
from dlolib.execute import RobotConfig, execute_on_robot
result = execute_on_robot(Path(sys.argv[1]), sys.argv[2], RobotConfig(), Path(sys.argv[3]))
print(result.exit_status, flush=True)
"""


def test_all_four_clients_of_ur_rtde_connect(robots: Start) -> None:
    from dashboard_client import DashboardClient
    from rtde_control import RTDEControlInterface
    from rtde_io import RTDEIOInterface
    from rtde_receive import RTDEReceiveInterface

    host = robots().host
    dashboard = DashboardClient(host)
    dashboard.connect()
    assert dashboard.polyscopeVersion() == "5.12.0.1101319"
    receive, control, digital = RTDEReceiveInterface(host), RTDEControlInterface(host), RTDEIOInterface(host)
    assert receive.getActualTCPPose()[:3] == pytest.approx(FIRST_M)
    assert control.isProgramRunning()
    assert digital.setStandardDigitalOut(0, True)
    for client in (control, receive, digital, dashboard):
        client.disconnect()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[StandIn, Path, ExecutionResult]:
    """One completed run: the stand-in, the folder, the result."""
    folder = tmp_path_factory.mktemp("run")
    with stand_ins(folder) as start:
        robot = start("--pose", "0.40", "0.005", "0.30", "1.2", "1.2", "1.2")
        return robot, folder / "out", execute_on_robot(arc(), robot.host, RobotConfig(), folder / "out")


def test_the_recorded_path_is_the_trajectory(run: tuple[StandIn, Path, ExecutionResult]) -> None:
    _, out, result = run
    assert result.completed
    assert result.exit_status == 0
    log = read_log(out)
    assert result.samples == len(log.t_s) > 100
    # The stand-in follows with a delay of 20 ms at 0.12 m/s; it cuts the circle by less than 0.3 mm.
    assert result.path_error_m is not None
    assert result.path_error_m < 6e-4
    assert result.tracking_error_m is not None
    assert result.tracking_error_m > result.path_error_m / 10
    assert log.actual[-1, :3] == pytest.approx(arc().end_m[-1], abs=6e-4)


def test_the_robot_approaches_slowly_then_streams_then_is_stopped(
    run: tuple[StandIn, Path, ExecutionResult],
) -> None:
    robot, _, _ = run
    commands = robot.commands()
    once = [name for name, before in zip(commands, ["", *commands], strict=False) if name != before]
    assert once == ["script", "moveL", "stopL", "servoL", "servoStop", "stopScript"]
    approach = next(entry for entry in robot.journal() if entry["command"] == "moveL")
    assert approach["speed"] == Limits().approach_speed_m_s
    assert approach["pose"][:3] == pytest.approx(FIRST_M)
    streamed = np.array([entry["pose"] for entry in robot.journal() if entry["command"] == "servoL"])
    assert len(streamed) >= 401
    step_m = np.linalg.norm(np.diff(streamed[:, :3], axis=0), axis=1)
    assert step_m.max() < 1.01 * 0.03 * np.pi / 0.8 * 0.002
    assert np.abs(streamed[:, 3:] - 2 * np.pi / 3 / np.sqrt(3)).max() < 1e-9


def test_the_log_has_the_columns_of_ur_rtdes_recorder_and_no_repeats(
    run: tuple[StandIn, Path, ExecutionResult],
) -> None:
    _, out, result = run
    table = pd.read_csv(out / "log.csv")
    assert list(table) == columns()
    assert {"timestamp", "actual_TCP_pose_0", "actual_TCP_pose_5", "target_TCP_pose_5"} <= set(table)
    assert table["timestamp"].is_monotonic_increasing
    assert table["timestamp"].is_unique
    said = json.loads((out / "result.json").read_text())
    assert said["completed"] is True
    assert said["samples"] == len(table)
    assert said["tracking_error_m"] == result.tracking_error_m
    assert sorted(path.name for path in out.iterdir()) == ["log.csv", "result.json", "robot.json"]


def test_a_folder_of_logs_gives_the_runs_own_figures(
    run: tuple[StandIn, Path, ExecutionResult], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    _, out, result = run
    assert execute_from_log(arc(), out, tmp_path / "again") == result
    assert not caplog.records
    assert (tmp_path / "again" / "log.csv").read_bytes() == (out / "log.csv").read_bytes()
    elsewhere = Motion(*(value + (0.01 if name == "end_m" else 0) for name, value in vars(arc()).items()))
    other = execute_from_log(elsewhere, out, tmp_path / "other")
    assert other.path_error_m is not None
    assert other.path_error_m > 0.005
    assert other.of_another and not result.of_another
    (line,) = (record.getMessage() for record in caplog.records)
    assert "mm from this trajectory; give the one that was run" in line


def test_a_log_without_a_result_is_aligned_by_itself(
    run: tuple[StandIn, Path, ExecutionResult], tmp_path: Path
) -> None:
    _, out, result = run
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "log.csv").write_bytes((out / "log.csv").read_bytes())
    bare = execute_from_log(arc(), tmp_path / "bare", tmp_path / "out")
    assert bare.streamed_from_s is not None
    assert result.streamed_from_s is not None
    assert bare.streamed_from_s == pytest.approx(result.streamed_from_s, abs=0.4)
    assert bare.tracking_error_m is not None
    assert result.tracking_error_m is not None
    assert bare.tracking_error_m <= result.tracking_error_m + 1e-5


FAST = arc(duration_s=0.2)
REFUSED = {
    "workspace": (arc(), replace(Limits(), workspace_m=((0, -1, 0.3), (1, 1, 0.32))), "leaves the workspace"),
    "reach": (arc(), replace(Limits(), reach_m=0.52), "beyond the reach"),
    "speed": (FAST, replace(Limits(), acceleration_m_s2=100.0), "the limit is 0.25 m/s"),
    "acceleration": (FAST, replace(Limits(), speed_m_s=1.0), "accelerates"),
    "sampling": (arc(), replace(Limits(), step_m=0.001), "step to this row"),
}


def test_a_path_outside_the_limits_is_refused_and_the_robot_hears_nothing(
    robots: Start, tmp_path: Path
) -> None:
    robot = robots()
    for name, (motion, limits, message) in REFUSED.items():
        file = tmp_path / "trajectory.csv"
        write_motion(motion, file)
        with pytest.raises(MotionRefused, match=message) as refused:
            execute_on_robot(file, robot.host, RobotConfig(limits=limits), tmp_path / "out")
        assert "trajectory.csv: row" in str(refused.value), name
        assert refused.value.mend, name
    assert robot.commands() == []
    assert not (tmp_path / "out").exists()


def test_what_would_be_streamed_too_fast_is_refused_and_the_robot_stands_still(
    robots: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dlolib.execute.robot_run.check_path", lambda *_: None)
    robot = robots()
    with pytest.raises(MotionRefused, match="would move at 0.469 m/s"):
        execute_on_robot(FAST, robot.host, RobotConfig(), tmp_path / "out")
    assert not robot.moved()
    assert not (tmp_path / "out").exists()


ROBOTS_OWN = {
    "its own safety limits": (("--floor", "0.31"), Limits(), "outside the robot's own safety limits"),
    "its joints": ((), replace(Limits(), joints_rad=((-1,) * 6, (0.41, 1, 1, 2, 2, 2))), "joint 1 at"),
    "powered off": (("--off",), Limits(), "power off"),
    "not in remote control": (("--local",), Limits(), "takes no commands"),
    "too far away": (("--pose", "0.9", "0", "0", "0", "0", "0"), Limits(), "leaves the workspace"),
}


@pytest.mark.parametrize("case", ROBOTS_OWN)
def test_what_the_robot_itself_forbids_is_refused_before_any_motion(
    robots: Start, tmp_path: Path, case: str
) -> None:
    options, limits, message = ROBOTS_OWN[case]
    if case == "its own safety limits":
        options = (*options, "--pose", "0.40", "0.0", "0.32", "1.2", "1.2", "1.2")
    robot = robots(*options)
    with pytest.raises(MotionRefused, match=message):
        execute_on_robot(arc(), robot.host, RobotConfig(limits=limits), tmp_path / "out")
    assert not robot.moved()
    assert not (tmp_path / "out").exists()


def test_a_robot_that_denies_where_it_stands_is_not_asked_and_that_is_said(
    robots: Start, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    result = execute_on_robot(arc(), robots("--floor", "0.9").host, RobotConfig(), tmp_path / "out")
    assert result.completed
    assert any("denies even the pose in which it stands" in record.getMessage() for record in caplog.records)


def test_a_refusal_leaves_no_program_on_the_controller(robots: Start, tmp_path: Path) -> None:
    robot = robots("--floor", "0.31", "--pose", "0.40", "0.0", "0.32", "1.2", "1.2", "1.2")
    with pytest.raises(MotionRefused, match="safety limits"):
        execute_on_robot(arc(), robot.host, RobotConfig(), tmp_path / "out")
    wait_until(lambda: robot.commands() == ["script", "stopScript"])


def learned(folder: Path, free: bool, centre_m: tuple[float, float, float]) -> Path:
    """The half circle as `dlo learn` leaves it, among one sphere of 10 mm."""
    folder.mkdir()
    write_motion(arc(), folder / "trajectory.csv")
    (folder / "result.json").write_text(json.dumps({"free_of_contact": free}))
    still = Pose(np.array([0.1, 0.0, 0.3]), np.array(TURN))
    sphere = Obstacle("sphere", {"center_m": centre_m, "radius_m": (0.01,)})
    goal_m = np.linspace([0.1, 0.0, 0.3], [0.46, 0.0, 0.3], 20)
    rope, gravity = Rope("made up", 0.5, diameter_m=0.008), np.array([0.0, 0.0, -9.81])
    grasp = Pose(np.array(FIRST_M), np.array(TURN))
    at_m = np.linspace(0.0, 0.36, 20)
    layout = Layout("bench", rope, gravity, Ends(), (sphere,), still, grasp, at_m, goal_m)
    write_layout(layout, folder / LEARNED_FOR)
    return folder / "trajectory.csv"


def test_the_way_to_the_first_pose_is_held_against_the_obstacles_learned_among(
    robots: Start, tmp_path: Path
) -> None:
    """It stands where the path ends: the half circle goes round the sphere, the straight way goes by it, and
    through it where the rope is held 10 mm off the tool."""
    turn = [str(value) for value in Rotation.from_quat(TURN, scalar_first=True).as_rotvec()]
    robot = robots("--pose", "0.46", "0.0", "0.30", *turn)
    trajectory = learned(tmp_path / "bench", True, (0.43, 0.0, 0.315))
    moved = ((1, 0, 0, 0), (0, 1, 0, 0.01), (0, 0, 1, 0), (0, 0, 0, 1))
    with pytest.raises(MotionRefused, match=r"4\.\d mm into obstacle 0 \(sphere\)") as refused:
        execute_on_robot(trajectory, robot.host, RobotConfig(tool_from_grasp=moved), tmp_path / "out")
    assert refused.value.place == "on the way to the first pose" and "jog it" in str(refused.value.mend)
    assert not robot.commands()
    assert execute_on_robot(trajectory, robot.host, RobotConfig(), tmp_path / "out").completed


@pytest.mark.parametrize("beside", [True, False])
def test_what_was_learned_and_touches_is_refused(robots: Start, tmp_path: Path, beside: bool) -> None:
    """Whether or not its layout is beside it."""
    robot = robots()
    trajectory = learned(tmp_path / "bench", False, (0.43, 0.1, 0.3))
    if not beside:
        (tmp_path / "bench" / LEARNED_FOR).rename(tmp_path / "elsewhere")
    with pytest.raises(MotionRefused, match="comes too near to an obstacle"):
        execute_on_robot(trajectory, robot.host, RobotConfig(), tmp_path / "out")
    assert not robot.commands()


def test_nobody_at_the_address_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(MotionRefused, match=r"no robot answers at 127\.255\.255\.1") as refused:
        execute_on_robot(arc(), "127.255.255.1", RobotConfig(), tmp_path / "out")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("host", ["192.168..10", f"{'a' * 64}.local"])
def test_an_address_that_none_can_have_is_refused_in_one_line(tmp_path: Path, host: str) -> None:
    end_program(host)
    with pytest.raises(MotionRefused, match=rf"no robot answers at {host}") as refused:
        execute_on_robot(arc(), host, RobotConfig(), tmp_path / "out")
    assert "\n" not in str(refused.value)


STOPS = {
    "protective stop": ("--protect-after", "protective stop"),
    "connection closed for good": ("--die-after", "connection lost"),
    "connection closed, robot still there": ("--drop-after", "connection lost"),
    "no data any more": ("--freeze-after", "connection lost: no new sample"),
}


@pytest.mark.parametrize("case", STOPS)
def test_a_fault_ends_the_motion_and_keeps_the_log(robots: Start, tmp_path: Path, case: str) -> None:
    option, reason = STOPS[case]
    robot, out = robots(option, "150"), tmp_path / "out"
    result = execute_on_robot(arc(), robot.host, RobotConfig(), out)
    assert not result.completed
    assert result.exit_status == 1
    assert result.reason.startswith(reason)
    assert json.loads((out / "result.json").read_text())["reason"] == result.reason
    assert robot.commands().count("servoL") <= 152
    log = read_log(out)
    assert result.samples == len(log.t_s) > 30
    # The log goes on until the fault: about 150 of 400 periods, a good third of the half circle.
    angle = np.arctan2(log.actual[-1, 2] - 0.30, 0.43 - log.actual[-1, 0])
    assert 0.7 < angle < 1.6
    assert result.path_error_m is not None
    assert result.path_error_m < 6e-4
    assert not list(out.glob(".*"))


def caller(robot: StandIn, tmp_path: Path) -> subprocess.Popen[str]:
    """A program that runs a trajectory of four seconds, once it moves."""
    file = tmp_path / "trajectory.csv"
    write_motion(arc(duration_s=4.0), file)
    process = subprocess.Popen(
        [sys.executable, "-c", CALL, str(file), robot.host, str(tmp_path / "out")],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
    )
    wait_until(lambda: robot.commands().count("servoL") > 50)
    return process


def wait_until(true: Callable[[], bool], timeout_s: float = 45.0) -> None:
    """Wait for something that another process does."""
    until = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < until, "it did not happen"
        time.sleep(0.02)


INTERRUPTED = "interrupted (Ctrl-C, SIGTERM or a closed terminal)"


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGHUP])
def test_ctrl_c_or_a_closed_terminal_stops_the_robot_and_keeps_the_log(
    robots: Start, tmp_path: Path, how: signal.Signals
) -> None:
    robot = robots()
    process = caller(robot, tmp_path)
    process.send_signal(how)
    output, _ = process.communicate(timeout=45)
    assert process.returncode == 0
    assert output == "1\n"
    assert robot.commands()[-2:] == ["servoStop", "stopScript"]
    said = json.loads((tmp_path / "out" / "result.json").read_text())
    assert (said["completed"], said["reason"]) == (False, INTERRUPTED)
    assert said["samples"] == len(read_log(tmp_path / "out").t_s) > 20


def test_the_robot_is_stopped_when_the_caller_is_killed(robots: Start, tmp_path: Path) -> None:
    robot, out = robots(), tmp_path / "out"
    out.mkdir()
    for name in ("log.csv", "result.json", "robot.json"):
        (out / name).write_text("of an earlier run")
    process = caller(robot, tmp_path)
    process.kill()
    process.wait()
    wait_until(lambda: robot.commands()[-2:] == ["servoStop", "stopScript"])
    # nothing of an earlier run passes for this one
    assert [path.name for path in out.iterdir()] == [".recording.csv"]


def test_what_cannot_be_recorded_is_not_run(robots: Start, tmp_path: Path) -> None:
    robot, out = robots(), tmp_path / "out"
    (out / ".recording.csv").mkdir(parents=True)
    with pytest.raises(MotionRefused, match=r"\.recording\.csv"):
        execute_on_robot(arc(), robot.host, RobotConfig(), out)
    assert not robot.moved()


class Elbow:
    """A robot whose first joint bends far at one place only, and which forbids a place, both narrow."""

    def __init__(self, here_m: float, bent_m: float, forbidden_m: float = np.inf) -> None:
        self.here_m, self.bent_m, self.forbidden_m = here_m, bent_m, forbidden_m

    def pose(self) -> Floats:
        return np.array([self.here_m, 0.0, 0.3, 0.0, 0.0, 0.0])

    def trouble(self) -> None:
        return None

    def arm(self) -> None:
        pass

    def answers(self) -> bool:
        return True

    def forbids(self, poses: Floats) -> tuple[int, str] | None:
        bad = np.flatnonzero(np.abs(poses[:, 0] - self.forbidden_m) < 3e-3)
        return (int(bad[0]), "its limits") if bad.size else None

    def joints(self, pose: Floats, near: Floats | None) -> Floats:
        return np.array([3.0 * (abs(pose[0] - self.bent_m) < 1e-4), 0, 0, 0, 0, 0])


ELBOWS = {
    "a joint in one row": (Elbow(0.3, 0.4), "joint 1 .* row 151"),
    "a joint where it stands": (Elbow(0.25, 0.25), "joint 1 .* on the way to the first pose"),
    "a place on the path": (Elbow(0.3, 0.0, 0.403), "outside its limits.* row 15"),
    "a place on the way there": (Elbow(0.2, 0.0, 0.253), "outside its limits.* on the way to the first pose"),
}


@pytest.mark.parametrize("case", ELBOWS)
def test_no_pose_between_those_that_are_asked_about_is_overlooked(case: str) -> None:
    robot, message = ELBOWS[case]
    poses = np.zeros((301, 6))
    poses[:, 0], poses[:, 2] = np.linspace(0.3, 0.5, 301), 0.3
    with pytest.raises(MotionRefused) as refused:
        check_robot(cast(Robot, robot), poses, Limits(joints_rad=((-1,) * 6, (1,) * 6)))
    assert re.search(message, f"{refused.value.problem} {refused.value.place}")


@pytest.mark.parametrize("rows", [11, 41, 68])
@pytest.mark.parametrize("forbidden_m", [0.411, 0.4934])
def test_rows_far_apart_are_asked_about_between_them(rows: int, forbidden_m: float) -> None:
    poses = np.zeros((rows, 6))
    poses[:, 0], poses[:, 2] = np.linspace(0.3, 0.5, rows), 0.3
    poses = np.repeat(poses, 2, axis=0)  # it may stand still
    with pytest.raises(MotionRefused) as refused:
        check_robot(cast(Robot, Elbow(0.3, 0.0, forbidden_m)), poses, Limits())
    row = int(re.search(r"row (\d+)", refused.value.place or "")[1])  # type: ignore[index]
    assert poses[row - 3, 0] <= forbidden_m + 3e-3
    assert poses[row - 1, 0] >= forbidden_m - 3e-3


def test_the_robot_is_stopped_when_its_client_crashes(robots: Start, tmp_path: Path) -> None:
    robot = robots()
    process = caller(robot, tmp_path)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    os.kill(int(children[0]), signal.SIGSEGV)
    output, _ = process.communicate(timeout=45)
    assert output == "1\n"
    said = json.loads((tmp_path / "out" / "result.json").read_text())
    assert "SIGSEGV" in said["reason"]
    assert said["samples"] == len(read_log(tmp_path / "out").t_s) > 20
    wait_until(lambda: robot.commands()[-1] == "dashboard stop")
