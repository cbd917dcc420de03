"""Damaged recordings before `dlo ingest` and `dlo chain`, and whether what came of it is as it must be.

Exit status 2, one line with file, place and mend, nothing written; or 0, and then the result is as without
the damage, or a warning says what is doubtful. Never a traceback. The same seed damages the same things.
"""

from __future__ import annotations

import io
import json
import logging
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from captures.harm import Damage
from captures.harmed import KINDS

from dlolib.cli import run


@dataclass
class Outcome:
    """What came of one damaged recording; `fault` says what should not have happened."""

    kind: str
    damage: str
    status: int
    said: str
    fault: str | None = None


@dataclass
class Heard:
    """What was said on standard error, by Python or by a library below it, and as warnings."""

    text: str = ""
    warnings: list[str] = field(default_factory=list)


@contextmanager
def listening() -> Iterator[Heard]:
    heard, real, saved = Heard(), sys.stderr, os.dup(2)
    handler = logging.Handler()
    handler.emit = lambda record: heard.warnings.append(record.getMessage())  # type: ignore[method-assign]
    with tempfile.TemporaryFile("w+") as file:
        os.dup2(file.fileno(), 2)
        sys.stderr = os.fdopen(os.dup(file.fileno()), "w", buffering=1)
        logging.getLogger("dlolib").addHandler(handler)
        logging.getLogger("dlolib").propagate = False
        try:
            yield heard
        finally:
            logging.getLogger("dlolib").removeHandler(handler)
            logging.getLogger("dlolib").propagate = True
            sys.stderr.close()
            os.dup2(saved, 2)
            os.close(saved)
            sys.stderr = real
            file.seek(0)
            heard.text = file.read()


class Bench:
    """Pristine recordings of every kind, made once, and copies of them to damage."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.expected: dict[tuple[str, str], dict[str, Any]] = {}
        self.pristine = {kind: self._pristine(kind) for kind in KINDS}

    def _pristine(self, kind: str) -> Path:
        place = self.folder / "pristine" / kind
        place.mkdir(parents=True)
        KINDS[kind].write(place)
        return place

    def outcome(self, kind: str, damage: Damage, command: str, seed: int) -> Outcome:
        """Damage a copy, run the command on it and judge what came of it."""
        if (kind, command) not in self.expected:
            whole = self._run(kind, lambda place, rng: "nothing", command, 0)
            assert whole[0] == 0, whole[1].text
            self.expected[kind, command] = whole[3]
        status, heard, said, written = self._run(kind, damage, command, seed)
        outcome = Outcome(f"{command} {kind}", said, status, heard.text.strip())
        if status == 0:
            outcome.said = "; ".join(heard.warnings)
            if heard.text:
                outcome.fault = f"it was taken, but said: {heard.text}"
            elif "outside" in said:
                outcome.fault = "what lies outside was taken"
            elif written != self.expected[kind, command] and not heard.warnings:
                outcome.fault = "another result without a warning"
        else:
            outcome.fault = refusal_fault(status, heard.text, written)
        return outcome

    def _run(
        self, kind: str, damage: Damage, command: str, seed: int
    ) -> tuple[int, Heard, str, dict[str, Any]]:
        place = self.folder / "work"
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(self.pristine[kind], place / "given", symlinks=True)
        (place / "written").mkdir()
        told = damage(place / "given", np.random.default_rng(seed))
        said, options = told if isinstance(told, tuple) else (told, [])
        about = place / "given" / "object.json"
        if command == "ingest" and about.exists():
            options = ["--object", str(about), *options]
        source = str(place / "given" / KINDS[kind].source)
        with listening() as heard, redirect_stdout(io.StringIO()):
            try:
                status = run([command, source, "--out", str(place / "written" / "out"), *options])
            except BaseException as error:  # a traceback is what is looked for
                status, heard.text = -1, repr(error)
        return status, heard, said, content(place / "written")


def refusal_fault(status: int, text: str, written: dict[str, Any]) -> str | None:
    """What is wrong with a refusal, or None."""
    if status != 2:
        return f"exit status {status}: {text}"
    if not text.startswith("dlo: ") or text.count("\n") != 1:
        return f"not one line: {text!r}"
    if not re.match(r"dlo: ([^;]*/given/[^;]*|--[^;]*): .*; .", text):
        return f"names no file or no mend: {text!r}"
    return f"half written: {sorted(written)}" if written else None


def content(folder: Path) -> dict[str, Any]:
    """Files by name, JSON and tables without what means nothing: a last line break, 0.0 for 0."""
    found: dict[str, Any] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            data = path.read_bytes()
            name = path.relative_to(folder).as_posix()
            found[name] = json.loads(data) if path.suffix == ".json" else data
            found[name] = _cells(data) if path.suffix == ".csv" else found[name]
        else:
            found[path.relative_to(folder).as_posix()] = "folder"
    return found


def _cells(data: bytes) -> list[list[str | float]]:
    """The cells of a table, numbers as such."""
    found: list[list[str | float]] = []
    for line in data.decode().splitlines():
        found.append([])
        for cell in line.split(","):
            try:
                found[-1].append(float(cell))
            except ValueError:
                found[-1].append(cell)
    return found
