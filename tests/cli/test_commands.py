"""What the commands do with usable input."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from formats import samples
from report.diagnosed import verdict

from dlolib.cli import app, run
from dlolib.formats import read_capture_index, read_fit, read_recording, write_fit, write_verdict
from dlolib.types import Estimate, Fit

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = ["ingest", "chain", "simulate", "identify", "diagnose", "learn", "execute", "report"]
HEAVY = ["quadrants", "open3d", "mujoco", "matplotlib", "cv2", "scipy", "pandas"]


def test_the_commands_are_those_of_the_formats() -> None:
    assert [command.callback.__name__ for command in app.registered_commands if command.callback] == COMMANDS


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(capfd: pytest.CaptureFixture[str], command: str) -> None:
    assert run([command, "--help"]) == 0
    assert "--out" in capfd.readouterr().out


def test_no_arguments_give_help(capfd: pytest.CaptureFixture[str]) -> None:
    assert run([]) == 0
    assert "identify" in capfd.readouterr().out


def test_help_waits_for_nothing_heavy() -> None:
    code = (
        f"import sys, dlolib.cli; dlolib.cli.run(['--help']); print(sorted(set({HEAVY}) & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.stdout.splitlines()[-1] == "[]"


def test_ingest_then_chain(tmp_path: Path) -> None:
    samples.capture_folder(tmp_path / "capture")
    assert run(["ingest", str(tmp_path / "capture"), "--out", str(tmp_path / "checked")]) == 0
    assert len(read_capture_index(tmp_path / "checked").frame) == 2
    assert run(["chain", str(tmp_path / "checked"), "--out", str(tmp_path / "recording")]) == 0
    assert (tmp_path / "recording" / "sheet.png").stat().st_size > 10_000
    points = read_recording(tmp_path / "recording").points
    # The drawn arc is the parabola of `samples`, its skin 4 mm in front of the axis at y = 0.
    for frame in (0, 1):
        x, y, z = points.xyz_m[points.frame == frame].T
        share = x / (0.42 - 0.01 * frame)
        np.testing.assert_allclose(z, -0.25 * share * (1 - share), atol=1.5e-3)
        np.testing.assert_allclose(y, 0.0, atol=1.5e-3)


def test_another_motion_can_be_given(tmp_path: Path) -> None:
    capture = samples.capture_folder(tmp_path / "capture")
    (capture / "motion.csv").rename(tmp_path / "elsewhere.csv")
    status = run(
        ["ingest", str(capture), "--motion", str(tmp_path / "elsewhere.csv"), "--out", str(tmp_path / "out")]
    )
    assert status == 0
    assert (tmp_path / "out" / "motion.csv").read_bytes() == (tmp_path / "elsewhere.csv").read_bytes()


def test_simulate_with_further_physics(tmp_path: Path) -> None:
    recording = str(samples.recording_folder(tmp_path / "recording"))
    plain, plastic, both = (str(tmp_path / name) for name in ("plain", "plastic", "both"))
    stiffness = ["--set", "bending_stiffness=3e-4"]
    effects = ["--effect", "plastic_bending:yield_curvature=1.0,hardening_ratio=0.1"]
    assert run(["simulate", recording, *stiffness, "--out", plain]) == 0
    assert run(["simulate", recording, *stiffness, *effects, "--out", plastic]) == 0
    assert run(["simulate", recording, *stiffness, *effects, "--effect", "inertia_drag", "--out", both]) == 0
    seen = [read_recording(Path(folder)).points.xyz_m for folder in (plain, plastic, both)]
    assert np.abs(seen[1] - seen[0]).max() > 1e-3
    assert 0 < np.abs(seen[2] - seen[1]).max() < 0.05


def test_a_verdict_brings_no_other_recordings_camera(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """How one recording was held stays with it; what is the rope's goes along, and into the fit."""
    recording = samples.recording_folder(tmp_path / "recording")
    name = read_recording(recording).name
    told, aside = verdict(), Estimate(0.01, 0.0, 0.02, "m")
    best = replace(told.augmented, parameters={**told.augmented.parameters, "camera_pose.shift_1": aside})
    seen, warned = {}, {}
    for of in (name, "another"):
        folder = tmp_path / of
        folder.mkdir()
        write_verdict(replace(told, recordings=(of,), nuisances={of: {}}, augmented=best), folder)
        played, given = str(tmp_path / f"{of}_played"), ["--verdict", str(folder / "verdict.json")]
        assert run(["simulate", str(recording), *given, "--out", played]) == 0
        seen[of], warned[of] = read_recording(Path(played)).points.xyz_m, caplog.text
        assert run(["identify", played, *given, "--out", str(tmp_path / f"{of}_fit")]) == 0
        caplog.clear()
        fit = read_fit(tmp_path / f"{of}_fit")
        assert fit.parameters["plastic_bending.yield_curvature"].value == 7.6
        assert "camera_pose.shift_1" not in fit.parameters
    assert np.abs(seen[name] - seen["another"]).max() > 1e-3
    assert "camera_pose: of the recording and not of the rope, left out" in warned["another"]
    assert "camera_pose" not in warned[name]


def test_simulate_identify_and_simulate_again(tmp_path: Path) -> None:
    first, fitted, again = (str(tmp_path / name) for name in ("first", "fitted", "again"))
    recording = samples.recording_folder(tmp_path / "recording")
    assert run(["simulate", str(recording), "--set", "bending_stiffness=3e-4", "--out", first]) == 0
    assert run(["identify", first, "--out", fitted]) == 0
    fit = read_fit(Path(fitted))
    assert fit.parameters["bending_stiffness"].value == pytest.approx(3e-4, rel=0.01)
    assert fit.rmse_m < 1e-6
    assert "iteration" in (Path(fitted) / "loss.csv").read_text()
    assert run(["simulate", first, "--fit", f"{fitted}/fit.json", "--out", again]) == 0
    one, other = read_recording(Path(first)), read_recording(Path(again))
    # the fit corrects a coarse mesh to first order, which leaves some micrometres
    np.testing.assert_allclose(other.points.xyz_m, one.points.xyz_m, atol=1e-5)
    np.testing.assert_array_equal(other.points.s_m, read_recording(recording).points.s_m)


def test_learn_then_execute_in_the_laboratory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    layout = samples.layout_folder(tmp_path / "layout")
    params = yaml.safe_load((ROOT / "params.yaml").read_text(encoding="utf-8"))
    params["learn"] |= {"iterations": 2, "steps": 20, "segments": 2}
    params["rod"]["particles"] = 15
    params["execute"]["laws"] = ["elastic"]
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(params), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    known = {
        "bending_stiffness": Estimate(3e-4, None, None, "N m^2"),
        "end_angle.end_2": Estimate(0.3, 0, 1, "rad"),
    }
    write_fit(Fit(known, 0.0, 1, 1), tmp_path / "fit.json")
    assert run(["learn", str(layout), "--fit", "fit.json", "--out", "learned"]) == 0
    assert "end_angle: of the recording" in caplog.text
    result = json.loads(Path("learned/result.json").read_text())
    assert result["iterations"] == 2
    assert set(result) >= {"goal_error_m", "min_clearance_m", "contacts", "loss"}
    trajectory = "learned/trajectory.csv"
    assert run(["execute", trajectory, "--layout", str(layout), "--out", "executed"]) == 0
    executed = json.loads(Path("executed/result.json").read_text())
    assert executed["completed"] and set(executed["laws"]) == {"elastic"}
    assert Path("executed/log.csv").read_text().startswith("timestamp,")
