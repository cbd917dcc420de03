"""Starts the process that moves the robot, hears how it goes, and keeps it on a handle."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

from dlolib.errors import MotionRefused
from dlolib.execute.limits import Limits, RobotConfig
from dlolib.execute.path import check_samples, sampled, tool_vectors
from dlolib.execute.robots import ROBOTS
from dlolib.execute.stream import STOPPING, Outcome
from dlolib.execute.surroundings import Surroundings
from dlolib.formats import say
from dlolib.types import Motion

POLL_S = 0.05
STOPPING_S = 10.0
LEAVING_S = 1.5


@contextmanager
def interruptions() -> Iterator[threading.Event]:
    """An event that Ctrl-C, SIGTERM and SIGHUP set instead of ending the program: the robot is stopped first.

    Elsewhere than in the main thread signals do not arrive; the event is then never set.
    """
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return
    before = {number: signal.getsignal(number) for number in STOPPING}
    for number in before:
        signal.signal(number, lambda *_: event.set())
    try:
        yield event
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def move(
    config: RobotConfig, host: str, path: Motion, around: Surroundings, raw: Path, begins: Callable[[], None]
) -> Outcome:
    """Run `dlolib.execute.driver` on a checked path (base frame) and return how it ended.

    Args:
        config: which robot, and its limits.
        host: name or address of its controller.
        path: the tool's poses over time in the base frame.
        around: what the held end must not enter.
        raw: file for the recorder.
        begins: called when the first motion begins.

    Raises:
        MotionRefused: before the first motion, by the robot or for what would be streamed to it.
    """
    job = {
        "robot": config.robot,
        "host": host,
        "limits": asdict(config.limits),
        "around": around.content(),
        "raw": str(raw.absolute()),
        "rows": tool_vectors(path).tolist(),
    }
    with interruptions() as interrupted:
        driver = _Driver(job, path, config.limits, begins)
        try:
            return driver.listen(interrupted) or driver.after_crash(config, host)
        finally:
            driver.let_go()


class _Driver:
    """The running process. `handle` is its standard input: closing it ends the motion."""

    def __init__(self, job: dict[str, Any], path: Motion, limits: Limits, begins: Callable[[], None]) -> None:
        self.path, self.limits, self.begins = path, limits, begins
        self.hear, tell = Pipe(duplex=False)
        package = str(Path(__file__).parents[2])
        search = os.pathsep.join([package, *filter(None, [os.environ.get("PYTHONPATH")])])
        # A session of its own: Ctrl-C reaches it through us. What ur_rtde prints goes to standard error.
        self.process = subprocess.Popen(
            [sys.executable, "-m", "dlolib.execute.driver", str(tell.fileno())],
            stdin=subprocess.PIPE,
            stdout=2,
            pass_fds=(tell.fileno(),),
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": search},
        )
        tell.close()
        self.moving = False
        self.streamed_from_s: float | None = None
        self._tell(job)

    def _tell(self, content: Any) -> None:
        """One line of JSON; a driver that has ended is noticed by `listen`."""
        with suppress(BrokenPipeError, ValueError):
            self._handle().write(json.dumps(content).encode() + b"\n")
            self._handle().flush()

    def _handle(self) -> Any:
        return self.process.stdin

    def listen(self, interrupted: threading.Event) -> Outcome | None:
        """What it says until it ends; None where it ended without a last word."""
        until: float | None = None
        while True:
            if interrupted.is_set() and until is None:
                until = time.monotonic() + STOPPING_S
                self._close_handle()
            if until is not None and time.monotonic() > until:
                self.process.kill()
            if not self.hear.poll(POLL_S):
                continue
            try:
                event = json.loads(self.hear.recv_bytes())
            except EOFError:
                return None
            if (outcome := self._heard(event)) is not None:
                return outcome

    def _heard(self, event: dict[str, Any]) -> Outcome | None:
        if event["event"] == "refused":
            raise MotionRefused(event["problem"], place=event["place"], mend=event["mend"])
        if event["event"] == "ended":
            return Outcome(event["completed"], event["reason"], self.streamed_from_s)
        if event["event"] == "connected":
            poses = sampled(self.path, event["period_s"])
            check_samples(poses, event["period_s"], self.limits)
            self._tell(poses.tolist())
            return None
        if event["event"] == "said":
            say(event["lines"])
            return None
        if not self.moving:
            self.begins()
        self.moving = True
        self.streamed_from_s = event.get("streamed_from_s", self.streamed_from_s)
        return None

    def after_crash(self, config: RobotConfig, host: str) -> Outcome:
        """End the robot's program in the driver's place."""
        ROBOTS[config.robot].end_program(host)
        code = self.process.wait()
        how = signal.Signals(-code).name if code < 0 else f"status {code}"
        if not self.moving:
            mend = "see the messages above, check the robot and try again"
            raise MotionRefused(f"the robot's client ended with {how} before any motion", mend=mend)
        reason = f"connection lost: the robot's client ended with {how}; the controller was told to stop"
        return Outcome(False, reason, self.streamed_from_s)

    def _close_handle(self) -> None:
        with suppress(BrokenPipeError):
            self._handle().close()

    def let_go(self) -> None:
        """Give it a moment to disconnect; after a lost connection that takes ur_rtde long."""
        self._close_handle()
        try:
            self.process.wait(LEAVING_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.hear.close()
