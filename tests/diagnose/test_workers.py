"""The processes of a diagnosis."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from dlolib.diagnose.workers import Workers

STARTED = """
import time
from dlolib.diagnose.workers import Workers

def slow(study):
    print(__import__("os").getpid(), flush=True)
    time.sleep(60)

if __name__ == "__main__":
    with Workers(2) as run:
        run.begin(None, slow)
        time.sleep(60)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals are POSIX's")
def test_no_process_outlives_a_killed_diagnosis(tmp_path: Path) -> None:
    script = tmp_path / "started.py"
    script.write_text(STARTED)
    first = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert first.stdout is not None
    other = int(first.stdout.readline())
    first.kill()
    first.wait()
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline and _lives(other):
        time.sleep(0.1)
    lives = _lives(other)
    if lives:
        os.kill(other, signal.SIGKILL)
    assert not lives


@pytest.mark.skipif(sys.platform == "win32", reason="signals are POSIX's")
@pytest.mark.parametrize("after_s", [0.0, 0.5, 2.0])
def test_ctrl_c_is_answered_by_the_first_process_alone(tmp_path: Path, after_s: float) -> None:
    script = tmp_path / "started.py"
    # it waits in short turns: a signal between two instructions, just before a long sleep, is heard after it
    wait = "        print(1, flush=True)\n        for _ in range(600):\n            time.sleep(0.1)\n"
    script.write_text(STARTED.replace("        time.sleep(60)\n", wait))
    first = subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # what runs in the background ignores Ctrl-C, and so would what it starts
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert first.stdout is not None
    first.stdout.readline()
    time.sleep(after_s)
    os.killpg(first.pid, signal.SIGINT)
    said = first.communicate(timeout=40)[1]
    assert said.count("Traceback") == 1


class Changing:
    """A study that this process goes on working with while it is sent to another."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.kept = {key: np.zeros(2000) for key in range(2000)}


def number_of(study: Changing, job: float) -> tuple[int, int]:
    time.sleep(job)
    return os.getpid(), study.number


def test_every_process_works_on_the_study_that_began_last() -> None:
    with Workers(2) as run:
        for number in range(4):
            study = Changing(number)
            run.begin(study)
            for key in range(2000):
                study.kept[-key] = np.zeros(1)
            study.number = -1 - number
            done = run(number_of, [0.05] * 40, "numbers")
            others = {found for process, found in done if process != os.getpid()}
            assert others <= {number} and (others or number == 0)


class Unsendable:
    """A study that cannot be read where it arrives."""

    def __reduce__(self) -> tuple[type, tuple[str]]:
        return int, ("no number",)


def test_a_study_that_does_not_arrive_is_an_error() -> None:
    with Workers(2) as run, pytest.raises(ValueError, match="no number"):
        run.begin(Unsendable())
        for _ in range(100):
            run(number_of_none, [0.05] * 40, "numbers")


def number_of_none(_study: object, job: float) -> None:
    time.sleep(job)


def _lives(process: int) -> bool:
    """A process that ended and that nobody waited for counts as ended."""
    state = Path(f"/proc/{process}/stat")
    return state.exists() and state.read_text().rsplit(")", 1)[1].split()[0] != "Z"
