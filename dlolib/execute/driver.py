"""The process that holds the connection to a robot, started by `dlolib.execute.supervise`.

A process of its own, because ur_rtde reconnects behind our back when a connection breaks, in two threads at
once, and may crash in it; the caller then still has the log and says why. Standard input is the dead man's
handle: its first line is the job, its second the path once the robot's period is known, and when it closes
(Ctrl-C, or the caller is gone) the motion ends. The argument is the file descriptor to report to. It imports
little, so that it starts fast.
"""

from __future__ import annotations

import json
import signal
import sys
import threading
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from dlolib.errors import MotionRefused
from dlolib.execute.limits import Limits
from dlolib.execute.robots import ROBOTS, Robot
from dlolib.execute.stream import STOPPING, check_robot, drive
from dlolib.execute.surroundings import Surroundings


class Report:
    """Tells the caller what happens, one JSON object an event."""

    def __init__(self, descriptor: int) -> None:
        self.connection = Connection(descriptor, readable=False)

    def say(self, event: str, **values: Any) -> None:
        """Send one event."""
        self.connection.send_bytes(json.dumps({"event": event, **values}).encode())


def main() -> None:
    """Read the job, connect, check, move; what happens goes to the report."""
    report = Report(int(sys.argv[1]))
    interrupted = threading.Event()
    for number in STOPPING:
        signal.signal(number, lambda *_: interrupted.set())
    job = json.loads(sys.stdin.readline())
    try:
        with ROBOTS[job["robot"]].connect(job["host"]) as robot:
            report.say("connected", period_s=robot.period_s)
            line = sys.stdin.readline()
            if not line:
                raise MotionRefused("interrupted before the first motion", mend="run it again")
            threading.Thread(target=_watch_handle, args=(interrupted,), daemon=True).start()
            run(robot, job, np.array(json.loads(line)), interrupted, report)
    except MotionRefused as error:
        report.say("refused", problem=error.problem, place=error.place, mend=error.mend)


def run(robot: Robot, job: dict[str, Any], path: Any, interrupted: threading.Event, report: Report) -> None:
    """Check what only the robot can tell, then move and record.

    Args:
        robot: connected.
        job: `limits`; `around`, what the held end must not enter; `rows`, the trajectory's poses (T, 6);
            `raw`, the recorder's file.
        path: poses one controller period apart (N, 6).
        interrupted: ends the motion.
        report: of what happens.

    Raises:
        MotionRefused: before the first motion.
    """
    limits, rows, raw = Limits(**job["limits"]), np.array(job["rows"]), Path(job["raw"])
    report.say("said", lines=check_robot(robot, rows, limits, Surroundings.read(job["around"])))
    if interrupted.is_set():
        raise MotionRefused("interrupted before the first motion", mend="run it again")
    _check_recorder(raw)
    robot.record(raw)
    report.say("moving")
    try:
        outcome = drive(
            robot, path, limits, interrupted, lambda at: report.say("streaming", streamed_from_s=at)
        )
    finally:
        robot.stop_recording()
    # where nobody listens any more the motion was ended for that
    with suppress(BrokenPipeError):
        report.say("ended", completed=outcome.completed, reason=outcome.reason)


def _check_recorder(raw: Path) -> None:
    """Refuse a file that cannot be recorded into: the robot's own recorder would not say so."""
    try:
        raw.parent.mkdir(parents=True, exist_ok=True)
        raw.touch()
    except OSError as error:
        problem = f"{raw} cannot be written: {error.strerror}"
        raise MotionRefused(problem, mend="remove it, or give another folder") from error
    if not raw.is_file():
        raise MotionRefused(f"{raw} is no file", mend="remove it, or give another folder")


def _watch_handle(interrupted: threading.Event) -> None:
    sys.stdin.read()
    interrupted.set()


if __name__ == "__main__":
    main()
