"""Identification on real recordings, and the paper's own method beside ours."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from sim.ropes import EI, ROPE
from sim.test_recording import recording

from dlolib.errors import SimulationError
from dlolib.formats import read_fit, read_recording
from dlolib.identify import DescentSettings, IdentifySettings, descend, identify, write_identified
from dlolib.sim.continuum import simulated
from dlolib.sim.iterative import alpha_b_from_stiffness, stiffness_from_alpha_b
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.sim.sides import Prediction
from dlolib.sim.upright import about_axis

WIRES = Path("data/wires")
CABLES = Path("../shared/data/real")
SETTINGS = IdentifySettings()


@pytest.mark.parametrize(
    ("wire", "low", "high", "rms_m"),
    [("wire_white", 0.7e-4, 1.4e-4, 5e-3), ("wire_black", 0.7e-3, 1.5e-3, 12e-3)],
)
def test_real_wires(wire: str, low: float, high: float, rms_m: float) -> None:
    fit = identify([read_recording(WIRES / wire)], SETTINGS).fit
    found = fit.parameters["bending_stiffness"]
    assert low < found.value < high
    assert found.low is not None and found.high is not None and found.low < found.value < found.high
    assert fit.rmse_m < rms_m


@pytest.mark.parametrize("name", ["weighted", "short_weighted"])
def test_real_cables(name: str) -> None:
    folder = CABLES / f"pac_black_{name}_settled"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not here: its data have no licence and are not in the repository")
    found = identify([read_recording(folder)], SETTINGS).fit.parameters["bending_stiffness"]
    assert 0.08 < found.value < 0.18


def test_the_papers_descent_goes_down_to_the_same_stiffness() -> None:
    made = recording()
    # in one plane, since the paper's single parameter says nothing of torsion
    flat = replace(made.motion, end_m=made.motion.end_m * [1, 0, 1])
    made = simulated(replace(made, motion=flat), Rod(ROPE, EI, EI))
    start = alpha_b_from_stiffness(0.5 * EI, ROPE, 30)
    end = descend(made, DescentSettings(start=start, rate=start**2 / 2, iterations=120), SETTINGS)
    assert end.loss_m < 0.3 * end.loss["loss_m"].iloc[0]
    assert end.bending_stiffness == pytest.approx(EI, rel=0.05)


def test_the_papers_alpha_b_is_a_ropes_stiffness() -> None:
    assert stiffness_from_alpha_b(0.0089, ROPE, 30) == pytest.approx(2.6e-4, rel=0.03)


def test_a_stiffness_at_which_the_rope_tears_is_none_to_begin_with(monkeypatch: pytest.MonkeyPatch) -> None:
    made = simulated(recording(), Rod(ROPE, EI, EI), finer=4)
    predict = RecordingModel.predict

    def torn(self: RecordingModel, rod: Rod, parameters: Sequence[str] = ()) -> Prediction:
        if rod.bending_stiffness < 0.5 * EI:
            raise SimulationError("it would tear")
        return predict(self, rod, parameters)

    monkeypatch.setattr(RecordingModel, "predict", torn)
    found = identify([made], SETTINGS).fit.parameters["bending_stiffness"]
    assert found.value == pytest.approx(EI, rel=0.01)


def test_declared_heldout_frames_never_enter_the_fit() -> None:
    made = replace(recording(), heldout_frames=(4, 5))
    spoiled = made.points.xyz_m.copy()
    spoiled[made.points.frame >= 4] += 0.05
    found = identify([replace(made, points=replace(made.points, xyz_m=spoiled))], SETTINGS)
    clean = identify([made], SETTINGS)
    assert found.fit == clean.fit
    assert found.heldout_rmse_m is not None and found.heldout_rmse_m > 0.05


def test_what_is_written_reads_back(tmp_path: Path) -> None:
    made = recording()
    found = identify([made], SETTINGS)
    write_identified(found, [made], tmp_path / "out", descend(made, DescentSettings(iterations=2), SETTINGS))
    assert read_fit(tmp_path / "out").parameters["bending_stiffness"].value == pytest.approx(
        found.fit.parameters["bending_stiffness"].value, rel=1e-8
    )
    loss = pd.read_csv(tmp_path / "out" / "loss.csv")
    assert set(loss["method"]) == {"least_squares", "gradient_descent"}
    shapes = pd.read_csv(tmp_path / "out" / "shapes.csv")
    assert np.allclose(shapes[["x_m", "y_m", "z_m"]], made.points.xyz_m, atol=1e-7)


def test_a_coarse_mesh_finds_the_stiffness_of_the_continuous_rod() -> None:
    fine = recording()
    for particles, within in ((30, 0.01), (60, 0.003)):
        found = identify([fine], replace(SETTINGS, particles=particles)).fit.parameters["bending_stiffness"]
        assert found.value == pytest.approx(EI, rel=within)


def test_what_a_verdict_has_for_each_recording_holds_while_stiffness_is_fitted() -> None:
    shared = {"plastic_bending.yield_curvature": 3.0, "plastic_bending.hardening_ratio": 0.2}
    rods = [
        Rod(ROPE, EI, EI, shared),
        Rod(ROPE, EI, EI, {**shared, "camera_pose.shift_1": 0.02, "end_angle.end_1": 0.2}),
    ]
    one, other = (simulated(recording(), rod.with_particles(117)) for rod in rods)
    found = identify([one, replace(other, name="other")], SETTINGS, rods).fit
    assert found.parameters["bending_stiffness"].value == pytest.approx(EI, rel=0.01)
    assert found.nuisances["other"]["end_angle.end_1"].value == pytest.approx(0.2, abs=0.01)
    assert found.rmse_m < 2e-4
    # what held goes along: without it the fit is that of no rope
    assert {name: found.parameters[name].value for name in shared} == shared
    assert found.nuisances["other"]["camera_pose.shift_1"].value == 0.02


def test_how_one_end_is_rolled_is_fitted_where_nobody_recorded_it() -> None:
    """Far from where the fit begins; the roll of the file stands for nothing."""
    made = recording()
    unknown = replace(made, ends=replace(made.ends, end_roll_known=False))
    truth = Rod(ROPE, EI, 0.7 * EI).with_values({"end_twist.end": 2.2})
    turned = replace(made.motion, end_q=about_axis(made.motion.end_q, 1.0))
    found = identify([replace(simulated(unknown, truth, finer=4), motion=turned)], SETTINGS).fit.parameters
    assert found["end_twist.end"].value == pytest.approx(2.2, abs=0.02)
    assert found["bending_stiffness"].value == pytest.approx(EI, rel=0.01)
    assert found["torsional_stiffness"].value == pytest.approx(0.7 * EI, rel=0.02)


def test_a_value_at_its_bound_is_said(caplog: pytest.LogCaptureFixture) -> None:
    """A clamp that points elsewhere by more than is looked for, 1 rad."""
    made = recording()
    own = Rotation.from_quat(made.motion.start_q, scalar_first=True)
    turned = (own * Rotation.from_rotvec([1.3, 0.0, 0.0])).as_quat(scalar_first=True)
    wrong = replace(made, motion=replace(made.motion, start_q=turned))
    settings = replace(SETTINGS, particles=20, parameters=("end_angle.start_1", "end_angle.start_2"))
    found = identify([wrong], settings).fit.nuisances[made.name]["end_angle.start_1"]
    assert found.value == pytest.approx(-1.0, abs=1e-6)
    assert "end_angle.start_1 = -1 rad is the bound of what is looked for: no measurement" in caplog.text
    assert "start_2" not in caplog.text
