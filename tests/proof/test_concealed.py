"""Concealed recordings: scored beside their truth, or sealed once by a tree without changes."""

import json
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from dlolib.errors import ParameterError
from stages import concealed

SAYS = """
import json, sys
from pathlib import Path
recording, out = Path(sys.argv[1]), Path(sys.argv[2])
assert {path.name for path in recording.iterdir()} == {"recording.json", "motion.csv", "points.csv"}
out.mkdir()
(out / "verdict.json").write_text(json.dumps(VERDICT))
"""
TRUTH: dict[str, Any] = {
    "effects": ["clock_offset"],
    "parameters": {"clock_offset": {"time": 0.2}},
    "bending_stiffness": 3e-4,
}


def estimate(value: float, half: float) -> dict[str, Any]:
    return {"value": value, "low": value - half, "high": value + half, "unit": ""}


def verdict(time_s: float = 0.21, status: str = "explained") -> dict[str, Any]:
    parameters = {"bending_stiffness": estimate(3.2e-4, 1e-6), "clock_offset.time": estimate(time_s, 0.02)}
    effects = [{"name": "clock_offset"}] if status == "explained" else []
    part = {"parameters": parameters}
    return {"status": status, "effects": effects, "equivalent": [], "baseline": part, "augmented": part}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording with its truth, and a fresh repository with a diagnosis that says what VERDICT is."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dlolib/diagnose").mkdir(parents=True)
    (tmp_path / "dlolib/diagnose/diagnose.py").touch()
    who = ["-c", "user.name=x", "-c", "user.email=x@x"]
    for words in (["init", "-q"], ["add", "dlolib"], ["commit", "-q", "-m", "x"]):
        subprocess.run(["git", *who, *words], check=True)
    (tmp_path / "says.py").write_text(SAYS.replace("VERDICT", repr(verdict())))
    command = shlex.join([sys.executable, str(tmp_path / "says.py"), "{recording}", "{out}"])
    monkeypatch.setattr(concealed, "COMMAND", command)
    made = tmp_path / "given/one"
    made.mkdir(parents=True)
    for name in ("recording.json", "motion.csv", "points.csv"):
        (made / name).touch()
    (made / "truth.json").write_text(json.dumps(TRUTH))
    return made.parent


def test_practice_is_scored(folder: Path) -> None:
    concealed.main("practice", str(folder))
    found = json.loads(Path("reports/practice.json").read_text())
    counts = [found[key] for key in ("names_right", "of", "inside", "planted")]
    assert counts == [1, 1, 2, 2] and found["recordings"]["one"]["seconds"] >= 0


@pytest.mark.parametrize(
    ("said", "right", "inside"),
    [
        (verdict(), True, True),
        (verdict(time_s=0.25), True, False),
        (verdict(status="ambiguous"), False, True),
        (verdict(status="no_mismatch"), False, True),
    ],
)
def test_what_is_held_against_a_truth(said: dict[str, Any], right: bool, inside: bool) -> None:
    row = concealed.held(said, TRUTH)
    assert row["names_right"] == right
    assert row["parameters"]["clock_offset.time"]["inside"] == inside
    assert row["parameters"]["bending_stiffness"]["inside"], "within a tenth"


def test_a_sealed_verdict_is_made_once(folder: Path) -> None:
    concealed.main("sealed", str(folder))
    made = Path("reports/sealed/one")
    head = subprocess.run(["git", "rev-parse", "HEAD"], capture_output=True, text=True, check=True).stdout
    assert json.loads((made / "made.json").read_text())["commit"] == head.strip()
    first = (made / "verdict.json").stat().st_mtime_ns
    concealed.main("sealed", str(folder))
    assert (made / "verdict.json").stat().st_mtime_ns == first


def test_a_changed_tree_seals_nothing(folder: Path) -> None:
    Path("dlolib/diagnose/diagnose.py").write_text("changed = True\n")
    with pytest.raises(ParameterError, match="commit them first"):
        concealed.main("sealed", str(folder))
    assert not Path("reports/sealed").exists()


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="no recordings"):
        concealed.main("practice", str(tmp_path))
