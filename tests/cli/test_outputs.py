"""Where a command may write: nothing that is read, and nothing else of the user's, is ever replaced."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import pytest
from formats import samples

from dlolib.cli import run
from dlolib.errors import FormatError
from dlolib.files import whole_folder
from dlolib.outputs import check_out

VALUES = ["--set", "bending_stiffness=3e-4"]


def _files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_a_tilde_that_no_shell_expanded_is_a_letter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    samples.recording_folder(tmp_path / "rec")
    monkeypatch.chdir(tmp_path)
    assert run(["simulate", "rec", *VALUES, "--out", "~/made"]) == 0
    assert (tmp_path / "~/made/points.csv").is_file()


@pytest.mark.parametrize(
    "out", ["", ".", "..", "../work", "rec", "data", "link", "file", "file/below", "mine"]
)
def test_what_is_there_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], out: str
) -> None:
    work = tmp_path / "work"
    rec = samples.recording_folder(work / "data" / "rec")
    shutil.copytree(rec, work / "rec")
    (work / "mine").mkdir()
    (work / "mine" / "notes.txt").write_text("mine")
    (work / "file").write_text("mine")
    (work / "link").symlink_to(work / "mine")
    monkeypatch.chdir(work)
    before = _files(tmp_path)
    source = "rec" if out == "rec" else "data/rec"
    assert run(["simulate", source, *VALUES, "--out", out]) == 2
    assert _files(tmp_path) == before
    said = capfd.readouterr().err
    assert said.count("\n") == 1 and "; " in said


def test_a_mount_is_no_folder_to_write_to() -> None:
    with pytest.raises(FormatError, match="is a mount"):
        check_out(Path("/proc"), "recording.json")


@pytest.mark.parametrize("locked", ["", "out"])
def test_a_folder_that_cannot_be_written_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, locked: str
) -> None:
    (tmp_path / "out").mkdir()
    make = tempfile.TemporaryDirectory

    def denied(dir: Path) -> tempfile.TemporaryDirectory[str]:
        if dir == tmp_path / locked:
            raise PermissionError(13, "Permission denied")
        return make(dir=dir)

    monkeypatch.setattr(tempfile, "TemporaryDirectory", denied)
    with pytest.raises(FormatError, match="cannot be written to") as refused:
        check_out(tmp_path / "out", "recording.json")
    assert refused.value.file == tmp_path / locked


def test_an_earlier_result_is_replaced(tmp_path: Path) -> None:
    rec = samples.recording_folder(tmp_path / "rec")
    out = tmp_path / "out"
    for _ in range(2):
        assert run(["simulate", str(rec), *VALUES, "--out", str(out)]) == 0
        (out / "left.txt").write_text("of the first run")
    assert run(["simulate", str(rec), *VALUES, "--out", str(out)]) == 0
    assert not (out / "left.txt").exists()


def test_what_was_measured_is_no_result_of_simulation(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    rec, measured = (samples.recording_folder(tmp_path / name) for name in ("rec", "measured"))
    before = {path: path.read_bytes() for path in measured.iterdir()}
    assert run(["simulate", str(rec), *VALUES, "--out", str(measured)]) == 2
    assert {path: path.read_bytes() for path in measured.iterdir()} == before
    assert "no recording.json of an earlier run" in capfd.readouterr().err


@pytest.mark.parametrize("kind", ["recording", "capture"])
def test_only_a_result_of_the_same_command_is_replaced(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], kind: str
) -> None:
    rec = samples.recording_folder(tmp_path / "rec")
    other = tmp_path / "other"
    shutil.copytree(rec, other)
    (other / "recording.json").rename(other / f"{kind}.json")
    before = _files(other)
    assert run(["identify", str(rec), "--out", str(other)]) == 2
    assert _files(other) == before
    assert "no fit.json" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("command", "there", "lacks"),
    [
        (["learn", "layout"], ("log.csv", "result.json", "shapes.csv"), "no policy.npz"),
        (
            ["execute", "layout/trajectory.csv", "--layout", "layout"],
            ("log.csv", "result.json"),
            "no shapes.csv",
        ),
        (
            ["execute", "layout/trajectory.csv", "--layout", "layout"],
            ("policy.npz", "result.json", "shapes.csv", "trajectory.csv"),
            "no log.csv",
        ),
        (["execute", "layout/trajectory.csv", "--host", "::1"], ("policy.npz", "result.json"), "no log.csv"),
        (
            ["execute", "layout/trajectory.csv", "--host", "::1"],
            ("log.csv", "shapes.csv"),
            "holds shapes.csv",
        ),
        (
            ["execute", "layout/trajectory.csv", "--layout", "layout"],
            ("log.csv", "robot.json", "shapes.csv"),
            "holds robot.json",
        ),
    ],
)
def test_what_was_learned_and_what_was_run_do_not_replace_each_other(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    command: list[str],
    there: tuple[str, ...],
    lacks: str,
) -> None:
    """A log of the robot, without shapes, is no result of the laboratory either."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    for name in there:
        (tmp_path / "out" / name).write_text("of a run")
    assert run([*command, "--out", "out"]) == 2
    assert _files(tmp_path / "out") == sorted(there)
    assert lacks in capfd.readouterr().err


def test_what_cannot_be_replaced_is_not_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OSError), whole_folder(Path(".")):
        pass
    assert (tmp_path / "mine.txt").read_text() == "mine"


def test_folders_made_for_what_was_refused_go_again(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(ValueError), whole_folder(tmp_path / "there" / "new" / "newer" / "out"):
        raise ValueError
    assert (tmp_path / "there").is_dir() and not list((tmp_path / "there").iterdir())
    with whole_folder(tmp_path / "there" / "new" / "newer" / "out"):
        pass
    assert (tmp_path / "there" / "new" / "newer" / "out").is_dir()


def test_a_report_leaves_foreign_figures(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "results").mkdir()
    (tmp_path / "out" / "figures").mkdir(parents=True)
    (tmp_path / "out" / "figures" / "mine.png").write_bytes(b"mine")
    assert run(["report", str(tmp_path / "results"), "--out", str(tmp_path / "out")]) == 2
    assert (tmp_path / "out" / "figures" / "mine.png").exists()
    assert "figures" in capfd.readouterr().err
