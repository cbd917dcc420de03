"""Unusable input through `dlo`: status 2, one line with file, place and mend, nothing half written."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from formats import samples

from dlolib.cli import run
from dlolib.formats import write_fit, write_motion
from dlolib.types import Estimate, Fit

Spoil = Callable[[Path], object]
ROOT = Path(__file__).resolve().parents[2]
EI = ("--set", "bending_stiffness=3e-4")
# Stands for a recording that is in order.
GOOD = "<a recording>"


def told(value: object) -> str:
    """The id of a case: what the line must say."""
    return value if isinstance(value, str) else ""


def cell(name: str, line: int, column: str, value: str) -> Spoil:
    return lambda folder: samples.set_cell(folder / name, line, column, value)


def key(name: str, dotted: str, value: object) -> Spoil:
    return lambda folder: samples.set_key(folder / name, dotted, value)


def missing(name: str) -> Spoil:
    return lambda folder: (folder / name).unlink()


def millimetres(name: str) -> Spoil:
    return lambda folder: samples.scale_columns(folder / name, "_m", 1000.0)


def zero_quaternion(name: str) -> Spoil:
    return lambda folder: [samples.set_cell(folder / name, 3, f"end_q{turn}", "0") for turn in "wxyz"]


def truncated(name: str) -> Spoil:
    def cut(folder: Path) -> None:
        path = folder / name
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    return cut


def nested(name: str) -> Spoil:
    """Lists in lists, deeper than any program reads."""

    def spoil(folder: Path) -> None:
        (folder / name).write_text("[" * 100_000)

    return spoil


def blank(folder: Path) -> None:
    for path in (folder / "color").iterdir():
        cv2.imwrite(str(path), np.zeros((160, 360, 3), np.uint8))


MOTION: list[tuple[Spoil, str]] = [
    (missing("motion.csv"), "motion.csv: no such file"),
    (cell("motion.csv", 4, "end_x_m", "nan"), "motion.csv: line 4, column end_x_m: nan is not a finite"),
    (
        cell("motion.csv", 4, "end_x_m", "far"),
        "motion.csv: line 4, column end_x_m: 'far' in a number's place",
    ),
    (cell("motion.csv", 4, "t_s", "0.5"), "motion.csv: line 4, column t_s: t_s falls"),
    (cell("motion.csv", 4, "t_s", "1"), "motion.csv: line 4, column t_s: two rows with the same t_s"),
    (zero_quaternion("motion.csv"), "motion.csv: line 3, column end_qw: zero quaternion"),
]
CAPTURE: list[tuple[Spoil, str]] = [
    *MOTION,
    (shutil.rmtree, "bad: no such folder"),
    (missing("capture.json"), "capture.json: no such file"),
    (missing("frames.csv"), "frames.csv: no such file"),
    (missing("color/000001.png"), "frames.csv: line 3, column color: no such file: color/000001.png"),
    (truncated("color/000001.png"), "000001.png"),
    (truncated("depth/000001.png"), "000001.png"),
    (truncated("capture.json"), "capture.json: line"),
    (millimetres("motion.csv"), "divide by 1000"),
    (
        key("capture.json", "object.length_m", 445),
        "capture.json: object.length_m: a rope of 445 m looks like mill",
    ),
    (key("capture.json", "camera.fx", 0), "capture.json: camera.fx: Input should be greater than 0, got 0"),
    (cell("frames.csv", 3, "t_s", "soon"), "frames.csv: line 3, column t_s: 'soon' in a number's place"),
    (cell("frames.csv", 3, "t_s", "-1"), "frames.csv: line 3, column t_s: t_s falls"),
    (cell("frames.csv", 3, "t_s", "0"), "frames.csv: line 3, column t_s: two rows with the same t_s"),
]
RECORDING: list[tuple[Spoil, str]] = [
    *MOTION,
    (shutil.rmtree, "bad: no such folder"),
    (missing("points.csv"), "points.csv: no such file"),
    (millimetres("points.csv"), "divide by 1000"),
    (millimetres("motion.csv"), "divide by 1000"),
    (cell("points.csv", 5, "z_m", "NaN"), "points.csv: line 5, column z_m: NaN is not a finite"),
    (cell("points.csv", 5, "z_m", "low"), "points.csv: line 5, column z_m: 'low' in a number's place"),
    (cell("points.csv", 12, "t_s", "-1"), "points.csv: line 12, column t_s: t_s falls"),
    (key("recording.json", "object.length_m", "long"), "recording.json: object.length_m: Input should be"),
    (
        key("recording.json", "obstacles.0.center_m", [0.01, 0, 0]),
        "motion.csv: t_s = 0: the clamped start is 20.0 mm inside obstacle 0 (cylinder); move",
    ),
    (key("recording.json", "object.length_m", 0), "object.length_m: Input should be greater than 0"),
    (key("recording.json", "obstacles.0.shape", "torus"), "valid are cylinder, sphere, plane, box, capsule"),
    (key("recording.json", "obstacles.0.shape", ["box"]), "unknown shape ['box']; valid are"),
    (key("recording.json", "obstacles.0.radius_m", 10**400), "obstacles: number 0: cylinder: radius_m"),
    (key("recording.json", "obstacles.0.axis", [1e200, 1e200, 0]), "obstacles: number 0: cylinder: axis"),
    (nested("recording.json"), "recording.json: cannot be read"),
]
LAYOUT: list[tuple[Spoil, str]] = [
    (shutil.rmtree, "bad: no such folder"),
    (missing("goal.csv"), "goal.csv: no such file"),
    (missing("layout.json"), "layout.json: no such file"),
    (millimetres("goal.csv"), "divide by 1000"),
    (key("layout.json", "object.length_m", 0.42), "goal.csv: s_m = 0.445: the goal is longer than the rope"),
    (key("layout.json", "obstacles.0.center_m", [0.2, 0, -0.07]), "inside obstacle 0 (cylinder)"),
    (key("layout.json", "obstacles.0.center_m", [0.01, 0, 0]), "inside obstacle 0 (cylinder)"),
    (
        key("layout.json", "grasp.quaternion", [0, 0, 0, 0]),
        "layout.json: grasp.quaternion: is a zero quaternion",
    ),
    (cell("goal.csv", 5, "x_m", "nan"), "goal.csv: line 5, column x_m: nan is not a finite"),
    (cell("goal.csv", 5, "x_m", "left"), "goal.csv: line 5, column x_m: 'left' in a number's place"),
    (cell("goal.csv", 5, "s_m", "0"), "goal.csv: line 5, column s_m: s_m falls"),
]


def refusal(capfd: pytest.CaptureFixture[str], tmp_path: Path, *arguments: object) -> str:
    """Run `dlo` with `--out`; the one line on standard error of a refusal that wrote nothing."""
    before = sorted(tmp_path.iterdir())
    status = run([str(argument) for argument in (*arguments, "--out", tmp_path / "out")])
    captured = capfd.readouterr()
    assert status == 2, captured
    assert captured.out == ""
    line = captured.err
    assert line.startswith("dlo: ") and line.endswith("\n") and line.count("\n") == 1, line
    assert "; " in line, "says no mend"
    assert sorted(tmp_path.iterdir()) == before, "something half written"
    return line


@pytest.mark.parametrize("command", ["ingest", "chain"])
@pytest.mark.parametrize(("spoil", "says"), CAPTURE, ids=told)
def test_captures(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], command: str, spoil: Spoil, says: str
) -> None:
    spoil(samples.capture_folder(tmp_path / "bad"))
    assert says in refusal(capfd, tmp_path, command, tmp_path / "bad")


def test_a_capture_without_rope(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    blank(samples.capture_folder(tmp_path / "bad"))
    assert "000000.png" in refusal(capfd, tmp_path, "chain", tmp_path / "bad")


@pytest.mark.parametrize("command", [("simulate", *EI), ("identify",)])
@pytest.mark.parametrize(("spoil", "says"), RECORDING, ids=told)
def test_recordings(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], command: tuple[str, ...], spoil: Spoil, says: str
) -> None:
    spoil(samples.recording_folder(tmp_path / "bad"))
    assert says in refusal(capfd, tmp_path, command[0], tmp_path / "bad", *command[1:])


@pytest.mark.parametrize("command", ["learn", "execute"])
@pytest.mark.parametrize(("spoil", "says"), LAYOUT, ids=told)
def test_layouts(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], command: str, spoil: Spoil, says: str
) -> None:
    spoil(samples.layout_folder(tmp_path / "bad"))
    if command == "learn":
        line = refusal(capfd, tmp_path, "learn", tmp_path / "bad", *EI)
    else:
        write_motion(samples.motion(), tmp_path / "trajectory.csv")
        line = refusal(capfd, tmp_path, "execute", tmp_path / "trajectory.csv", "--layout", tmp_path / "bad")
    assert says in line


@pytest.mark.parametrize("where", ["layout", "host"])
@pytest.mark.parametrize(("spoil", "says"), [*MOTION, (millimetres("motion.csv"), "motion.csv")], ids=told)
def test_trajectories(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], where: str, spoil: Spoil, says: str
) -> None:
    (tmp_path / "bad").mkdir()
    write_motion(samples.motion(), tmp_path / "bad" / "motion.csv")
    spoil(tmp_path / "bad")
    there = samples.layout_folder(tmp_path / "layout") if where == "layout" else "127.0.0.9"
    assert says in refusal(capfd, tmp_path, "execute", tmp_path / "bad" / "motion.csv", f"--{where}", there)


def fit_file(tmp_path: Path) -> Path:
    fit = Fit({"bending_stiffness": Estimate(3e-4, None, None, "N m^2")}, 0.001, 3, 30)
    write_fit(fit, tmp_path / "fit.json")
    return tmp_path / "fit.json"


def found(name: str, value: float) -> Spoil:
    """A fit that says that a further effect was found."""

    def spoil(folder: Path) -> None:
        content = json.loads((folder / "fit.json").read_text())
        content["parameters"][name] = {"value": value, "low": None, "high": None, "unit": ""}
        (folder / "fit.json").write_text(json.dumps(content))

    return spoil


@pytest.mark.parametrize("command", ["simulate", "learn"])
@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (missing("fit.json"), "fit.json: no such file"),
        (truncated("fit.json"), "fit.json: line"),
        (
            key("fit.json", "parameters.bending_stiffness.value", "soft"),
            "fit.json: parameters.bending_stiffness",
        ),
        (key("fit.json", "parameters.bending_stiffness.value", -3e-4), "bending_stiffness"),
        (found("end_angle.start_1", 50.0), "--fit or --verdict: end_angle.start_1: end_angle.start_1 = 50"),
        (found("mass_profile.s", 9.0), "mass_profile.s = 9 m is beyond the end of a rope of 0.445 m"),
        (key("fit.json", "parameters", {}), "bending_stiffness"),
    ],
    ids=told,
)
def test_fits(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], command: str, spoil: Spoil, says: str
) -> None:
    make = samples.recording_folder if command == "simulate" else samples.layout_folder
    fit = fit_file(tmp_path)
    spoil(tmp_path)
    assert says in refusal(capfd, tmp_path, command, make(tmp_path / "good"), "--fit", fit)


@pytest.mark.parametrize("command", ["simulate", "learn"])
@pytest.mark.parametrize(
    ("values", "says"),
    [
        ((), "bending_stiffness"),
        (
            ("stiffness=1",),
            "unknown name 'stiffness'; valid are bending_stiffness, torsional_stiffness, linear_density",
        ),
        (("bending_stiffness",), "--set bending_stiffness"),
        (("bending_stiffness=soft",), "'soft' in a number's place"),
        (("bending_stiffness=-1",), "is not a positive number"),
        (("bending_stiffness=nan",), "is not a positive number"),
        (("bending_stiffness=3_0",), "'3_0' in a number's place"),
        (("bending_stiffness=1", "bending_stiffness=2"), "bending_stiffness is given twice; give it once"),
    ],
)
def test_values(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], command: str, values: tuple[str, ...], says: str
) -> None:
    make = samples.recording_folder if command == "simulate" else samples.layout_folder
    options = [part for value in values for part in ("--set", value)]
    assert says in refusal(capfd, tmp_path, command, make(tmp_path / "good"), *options)


@pytest.mark.parametrize("command", ["chain", "simulate", "identify", "learn"])
def test_an_unknown_key_in_params_yaml(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    make = {"chain": samples.capture_folder, "learn": samples.layout_folder}.get(
        command, samples.recording_folder
    )
    options = EI if command in ("simulate", "learn") else ()
    text = (ROOT / "params.yaml").read_text(encoding="utf-8")
    spoiled = text.replace("  particles: 30", "  particels: 30", 1)
    (tmp_path / "params.yaml").write_text(spoiled, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    number = spoiled[: spoiled.index("particels")].count("\n") + 1
    line = refusal(capfd, tmp_path, command, make(tmp_path / "good"), *options)
    assert f"params.yaml: line {number}, rod.particels: unknown key; did you mean `particles`?" in line


def test_another_projects_params_yaml_sets_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "params.yaml").write_text("train:\n  rate: 0.1\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    recording = samples.recording_folder(tmp_path / "good")
    assert run(["simulate", str(recording), *EI, "--out", "out"]) == 0


def test_a_report_of_other_results_takes_nothing_from_this_folders_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr("dlolib.report.build_report", lambda *_, **given: asked.append(given["parameters"]))
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text(encoding="utf-8"), "utf-8")
    monkeypatch.chdir(tmp_path)
    for results in ("reports", "elsewhere"):
        assert run(["report", results, "--out", "out"]) == 0
    assert asked[0] is not None and asked[1] is None


def test_a_report_of_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert "nowhere" in refusal(capfd, tmp_path, "report", tmp_path / "nowhere")


def test_a_report_of_a_spoiled_fit(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "results" / "identify" / "captured"
    folder.mkdir(parents=True)
    truncated("fit.json")(fit_file(folder).parent)
    assert "fit.json: line" in refusal(capfd, tmp_path, "report", tmp_path / "results")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("inges", "a"), "No such command 'inges'"),
        (("ingest",), "Missing argument"),
        (("ingest", "a", "--speed", "3"), "No such option"),
        (
            ("ingest", GOOD, "--topic", "color=/rgb"),
            "is in no known format; give a capture folder, or one of",
        ),
        (("ingest", "a.bag", "--topic", "color=/rgb"), "a.bag: no such file; correct the path"),
        (("execute", "a.csv"), "--host or --layout"),
        (("execute", "a.csv", "--host", "h", "--layout", "l"), "--host or --layout"),
        (("simulate", "a", "--quasi-static", "perhaps"), "--quasi-static"),
        (("simulate", GOOD, *EI, "--effect", "plastic"), "unknown effect 'plastic'"),
        (("simulate", GOOD, *EI, "--effect", "plastic_bending:limit=8"), "no parameter 'limit'"),
        (("simulate", GOOD, *EI, "--effect", "plastic_bending:yield_curvature=x"), "'x' in a number's place"),
        (("simulate", GOOD, *EI, "--effect", "plastic_bending:yield_curvature=-1"), "out of range"),
    ],
)
def test_usage(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], arguments: tuple[str, ...], says: str
) -> None:
    recording = str(samples.recording_folder(tmp_path / "good"))
    given = (recording if argument == GOOD else argument for argument in arguments)
    assert says in refusal(capfd, tmp_path, *given)


def test_an_output_that_cannot_be_written(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    capture = samples.capture_folder(tmp_path / "good")
    assert run(["ingest", str(capture), "--out", str(tmp_path / "file" / "out")]) == 2
    assert capfd.readouterr().err.count("\n") == 1


def test_the_process_exits_with_2_and_one_line(tmp_path: Path) -> None:
    samples.set_key(samples.capture_folder(tmp_path / "bad") / "capture.json", "camera.fx", 0)
    command = [sys.executable, "-m", "dlolib.cli", "ingest", "bad", "--out", "out"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and done.stdout == ""
    assert (
        done.stderr
        == "dlo: bad/capture.json: camera.fx: Input should be greater than 0, got 0; give a larger value\n"
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad"]


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (("plastic_bending:yield_curvature=8", "plastic_bending:yield_curvature=9"), "is given twice"),
        (("plastic_bending:yield_curvature=8,yield_curvature=9",), "yield_curvature is given twice"),
        (("plastic_bending:yield=8",), "--effect plastic_bending:yield=8: "),
        (("mass_profile:s=9,mass=0.05",), "mass_profile.s = 9 m is beyond the end of a rope of 0.445 m"),
        (("mass_profile:s=0.1,mass=-0.05",), "mass_profile.mass = -0.05 is out of range"),
    ],
)
def test_effects(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], given: tuple[str, ...], says: str
) -> None:
    options = [part for one in given for part in ("--effect", one)]
    good = samples.recording_folder(tmp_path / "good")
    assert says in refusal(capfd, tmp_path, "simulate", good, "--set", "bending_stiffness=3e-4", *options)


def test_a_place_that_cannot_be_written_to_is_refused_before_the_work(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    good = samples.recording_folder(tmp_path / "good")
    assert run(["simulate", str(good), "--set", "bending_stiffness=3e-4", "--out", "/proc/out"]) == 2
    assert "dlo: /proc: cannot be written to; give another" in capfd.readouterr().err


def test_a_robot_for_the_laboratory(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_motion(samples.motion(), tmp_path / "motion.csv")
    there = ("--layout", samples.layout_folder(tmp_path / "layout"), "--robot", tmp_path / "robot.json")
    assert "no robot" in refusal(capfd, tmp_path, "execute", tmp_path / "motion.csv", *there)


def test_a_motion_that_ends_early_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    good = samples.recording_folder(tmp_path / "good")
    rows = (good / "motion.csv").read_text().splitlines(keepends=True)
    (good / "motion.csv").write_text("".join(rows[:3]))
    options = ["--set", "bending_stiffness=3e-4", "--out", str(tmp_path / "out")]
    assert run(["simulate", str(good), *options]) == 0
    assert "before the last frame, and its pose there is taken to hold" in caplog.text


def test_a_terminal_without_a_names_letters(tmp_path: Path) -> None:
    good = samples.recording_folder(tmp_path / "gut é")
    command = [sys.executable, "-m", "dlolib.cli", "simulate", str(good), "--set", "bending_stiffness=3e-4"]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "aus é")],
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
