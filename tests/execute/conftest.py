"""A stand-in robot for each test, and trajectories for it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dlolib.types import Motion

STAND_IN = Path(__file__).with_name("ur_stand_in.py")
TURN = (0.5, 0.5, 0.5, 0.5)
FIRST_M = (0.40, 0.0, 0.30)
MOTIONS = {"moveL", "servoL"}
ADDRESSES = (f"127.{1 + os.getpid() % 250}.{1 + number // 250}.{1 + number % 250}" for number in count())


@dataclass(frozen=True)
class StandIn:
    """A running stand-in: its address, its process, and what it noted."""

    host: str
    process: subprocess.Popen[str]
    journal_file: Path

    def journal(self) -> list[dict[str, Any]]:
        """Every command so far, in order; a line that is being written is left out."""
        lines = self.journal_file.read_text(encoding="utf-8").split("\n")[:-1]
        return [json.loads(line) for line in lines]

    def commands(self) -> list[str]:
        """The names of the commands so far."""
        return [entry["command"] for entry in self.journal()]

    def moved(self) -> bool:
        """Whether it has seen any motion command."""
        return bool(MOTIONS & set(self.commands()))


@contextmanager
def stand_ins(folder: Path) -> Iterator[Callable[..., StandIn]]:
    """Starts stand-ins with their journals in `folder`, each at an address of its own; ends them."""
    running: list[subprocess.Popen[str]] = []

    def start(*options: str) -> StandIn:
        host, journal = next(ADDRESSES), folder / f"journal_{len(running)}.jsonl"
        process = subprocess.Popen(
            [sys.executable, str(STAND_IN), host, "--journal", str(journal), *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        running.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        return StandIn(host, process, journal)

    try:
        yield start
    finally:
        for process in running:
            process.kill()
            process.wait()


@pytest.fixture
def robots(tmp_path: Path) -> Iterator[Callable[..., StandIn]]:
    """Starts stand-ins, which end with the test."""
    with stand_ins(tmp_path) as start:
        yield start


def arc(duration_s: float = 0.8, radius_m: float = 0.03) -> Motion:
    """A half circle in the x-z plane at constant speed from FIRST_M, every 20 ms, without a turn."""
    t_s = np.linspace(0, duration_s, round(duration_s / 0.02) + 1)
    angle = np.pi * t_s / duration_s
    sides = (1 - np.cos(angle), 0 * angle, np.sin(angle))
    end_m = np.array(FIRST_M) + radius_m * np.stack(sides, axis=1)
    turn = np.tile(TURN, (len(t_s), 1))
    return Motion(t_s, np.zeros_like(end_m), turn, end_m, turn)
