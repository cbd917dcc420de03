"""What `dlo ingest` says and leaves where it refuses a recording made elsewhere."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from captures import foreign_samples as foreign

from dlolib.cli import run


class Refusals:
    """Runs `dlo ingest` and looks at what it said and wrote."""

    def __init__(self, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
        self.folder, self.capfd = tmp_path, capfd
        self.about = foreign.given(tmp_path / "object.json", camera=foreign.camera_of())

    def status(self, source: Path, *options: str) -> tuple[int, str]:
        """Exit status and what was said on standard error; a refusal leaves nothing behind."""
        before = sorted(self.folder.iterdir())
        out = self.folder / "out"
        status = run(["ingest", str(source), "--out", str(out), "--object", str(self.about), *options])
        captured = self.capfd.readouterr()
        if status == 0:
            shutil.rmtree(out)
            return status, captured.err
        assert status == 2, captured
        assert captured.out == ""
        line = captured.err
        assert line.startswith("dlo: ") and line.endswith("\n") and line.count("\n") == 1, line
        assert "; " in line, "says no mend"
        assert sorted(self.folder.iterdir()) == before, "something half written"
        return status, line

    def __call__(self, source: Path, says: str, *options: str) -> None:
        """It is refused, and the line says so."""
        status, line = self.status(source, *options)
        assert status == 2, "was taken"
        assert says in line, line


def told(value: object) -> str:
    """The id of a case: what the line must say."""
    return value if isinstance(value, str) else ""
