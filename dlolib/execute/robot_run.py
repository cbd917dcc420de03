"""A trajectory on a robot: read, check, move, record, compare."""

from __future__ import annotations

import shutil
from pathlib import Path

from dlolib.errors import FormatError, MotionRefused
from dlolib.execute.config import read_robot
from dlolib.execute.limits import RobotConfig
from dlolib.execute.log import (
    ExecutionResult,
    RobotLog,
    evaluate,
    read_log,
    read_result,
    without_repeats,
    write_log,
    write_result,
)
from dlolib.execute.path import check_path, path_in_base
from dlolib.execute.stream import Outcome
from dlolib.execute.supervise import move
from dlolib.execute.surroundings import Surroundings
from dlolib.files import whole_file, write_json
from dlolib.formats import LEARNED_FOR, read_layout, read_motion, say
from dlolib.types import Motion

RAW = ".recording.csv"


def execute_on_robot(trajectory: Motion | Path, host: str, config: RobotConfig, out: Path) -> ExecutionResult:
    """Run a trajectory on the robot at `host`; the paper's Section V-C experiment.

    The whole path is checked first: workspace, reach, speed, sampling, acceleration, then what the robot
    itself says, and that the held end enters no obstacle of the layout beside the trajectory, on the way to
    its first pose either; what was learned and touches is refused. It is approached slowly in a straight line
    and streamed at the controller's rate. A lost connection, a protective stop, Ctrl-C and a closed terminal
    end the motion; the log up to there is kept.

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
    around = Surroundings() if file is None else _learned_among(file, config)
    raw = out / RAW
    outcome = move(config, host, path, around, raw, lambda: _without_earlier(out))
    write_log(without_repeats(raw), out)
    raw.unlink()
    return _conclude(out, path, outcome, config)


def _learned_among(file: Path, config: RobotConfig) -> Surroundings:
    """The obstacles of the layout that `dlo learn` left beside a trajectory; without it that is said.

    Raises:
        MotionRefused: the path was learned, and touches.
    """
    result, layout = file.with_name("result.json"), file.with_name(LEARNED_FOR)
    if read_result(result).get("free_of_contact") is False:
        raise MotionRefused(
            "no path with the clearance asked for was found: this one comes too near to an obstacle",
            file=result,
            place="free_of_contact",
            mend="learn it anew, with more iterations or another layout",
        )
    if not layout.is_dir():
        says = (
            "what stands around is not known, and the straight way to the first pose is held against nothing"
        )
        say([f"{file}: no {LEARNED_FOR}/ beside it as `dlo learn` leaves it: {says}"])
        return Surroundings()
    return Surroundings.of(read_layout(layout), config)


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
    say(_of_another(result, folder / "log.csv"))
    out.mkdir(parents=True, exist_ok=True)
    with whole_file(out / "log.csv") as copy:
        shutil.copyfile(folder / "log.csv", copy)
    write_result(result, out)
    write_json(out / "robot.json", config.content())
    return result


def _of_another(result: ExecutionResult, file: Path) -> list[str]:
    """That the poses which were demanded of the robot are not those of the trajectory."""
    if result.demanded_error_m is None or not result.of_another:
        return []
    problem = f"what was demanded is up to {1e3 * result.demanded_error_m:.3g} mm from this trajectory"
    mend = "give the one that was run"
    return [str(FormatError(problem, file=file, place="column target_TCP_pose_0", mend=mend))]


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
