"""A trajectory on a robot: read, check, move, record, compare."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from dlolib.errors import FormatError
from dlolib.execute.config import read_robot
from dlolib.execute.limits import RobotConfig
from dlolib.execute.log import (
    ExecutionResult,
    RobotLog,
    evaluate,
    path_error,
    read_log,
    without_repeats,
    write_log,
    write_result,
)
from dlolib.execute.path import check_path, path_in_base
from dlolib.execute.stream import Outcome
from dlolib.execute.supervise import move
from dlolib.files import whole_file, write_json
from dlolib.formats import read_motion, say
from dlolib.types import Motion

RAW = ".recording.csv"
# A controller's demand is smoothed, and still nearer than this to the trajectory that it was given.
ANOTHER_M = 5e-3


def execute_on_robot(trajectory: Motion | Path, host: str, config: RobotConfig, out: Path) -> ExecutionResult:
    """Run a trajectory on the robot at `host`; the paper's Section V-C experiment.

    The whole path is checked first: workspace, reach, speed, sampling, acceleration, then what the robot
    itself says. It is approached slowly in a straight line and streamed at the controller's rate. A lost
    connection, a protective stop, Ctrl-C and a closed terminal end the motion; the log up to there is kept.

    Args:
        trajectory: poses of the moved end in the world, or the trajectory.csv that holds them.
        host: name or address of the controller.
        config: from `read_robot`.
        out: folder for log.csv, result.json and robot.json; not touched where the motion is refused.

    Returns:
        What came of it; `exit_status` is 1 where the motion was stopped.

    Raises:
        MotionRefused: before any motion, with the row and the mend.
        FormatError: the trajectory cannot be read.
    """
    file = trajectory if isinstance(trajectory, Path) else None
    motion = read_motion(trajectory) if isinstance(trajectory, Path) else trajectory
    path = path_in_base(motion, config)
    check_path(path, config.limits, file)
    raw = out / RAW
    outcome = move(config, host, path, raw, lambda: _without_earlier(out))
    write_log(without_repeats(raw), out)
    raw.unlink()
    return _conclude(out, path, outcome, config)


def execute_from_log(trajectory: Motion, folder: Path, out: Path) -> ExecutionResult:
    """What a run with --host recorded, compared with the trajectory: the same files as the run's own.

    Args:
        trajectory: that the run should have followed.
        folder: holds log.csv and, as the run wrote them, result.json and robot.json.
        out: folder for log.csv, result.json and robot.json.

    Raises:
        FormatError: the log cannot be read.
    """
    log = read_log(folder)
    robot = folder / "robot.json"
    config = read_robot(robot if robot.is_file() else None)
    path = path_in_base(trajectory, config)
    result = evaluate(log, path)
    say(_of_another(log, path, result, folder / "log.csv"))
    out.mkdir(parents=True, exist_ok=True)
    with whole_file(out / "log.csv") as copy:
        shutil.copyfile(folder / "log.csv", copy)
    write_result(result, out)
    write_json(out / "robot.json", config.content())
    return result


def _of_another(log: RobotLog, path: Motion, result: ExecutionResult, file: Path) -> list[str]:
    """That the poses which were demanded of the robot are not those of the trajectory."""
    if result.streamed_from_s is None or not np.isfinite(log.target).all():
        return []
    away_m = path_error(replace(log, actual=log.target), path, result.streamed_from_s)
    problem = f"what was demanded is up to {1e3 * away_m:.3g} mm from this trajectory"
    mend = "give the one that was run"
    place = "column target_TCP_pose_0"
    return [str(FormatError(problem, file=file, place=place, mend=mend))] if away_m > ANOTHER_M else []


def _without_earlier(out: Path) -> None:
    """What an earlier run left must not pass for this one's, however it ends."""
    for name in ("log.csv", "result.json", "robot.json"):
        (out / name).unlink(missing_ok=True)


def _conclude(out: Path, path: Motion, outcome: Outcome, config: RobotConfig) -> ExecutionResult:
    said = {
        "completed": outcome.completed,
        "reason": outcome.reason,
        "streamed_from_s": outcome.streamed_from_s,
    }
    log = read_log(out)
    result = evaluate(RobotLog(log.t_s, log.actual, log.target, said), path)
    write_result(result, out)
    write_json(out / "robot.json", config.content())
    return result
