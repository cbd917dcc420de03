"""params.yaml is refused in one line that names file, line, key and mend."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from dlolib import params
from dlolib.chain import ChainSettings
from dlolib.diagnose import DiagnoseSettings
from dlolib.errors import ParameterError
from dlolib.identify import DescentSettings, IdentifySettings
from dlolib.identify.parameters import END_ANGLES, REST_CURVATURES, STIFFNESSES, TILT
from dlolib.lab.camera import Sensor
from dlolib.lab.rope import LabRope
from dlolib.learn import LearnSettings
from dlolib.params import EFFECTS, FITTED, Chain, Diagnose, Params, load, load_block
from dlolib.sim.effects import EFFECTS as LIBRARY
from dlolib.sim.upright import ROLL
from stages.diagnose import settings as diagnose_settings
from stages.learn import settings as learn_settings
from tests.pipeline.conftest import ROOT

TEXT = (ROOT / "params.yaml").read_text()


def written(folder: Path, old: str, new: str) -> Path:
    assert TEXT.count(old) >= 1
    path = folder / "params.yaml"
    path.write_text(TEXT.replace(old, new, 1))
    return path


def refused(path: Path) -> str:
    with pytest.raises(ParameterError) as caught:
        load(path)
    line = str(caught.value)
    assert "\n" not in line and line.startswith(str(path))
    return line.removeprefix(f"{path}: ")


def test_the_committed_file_is_good() -> None:
    assert isinstance(load(ROOT / "params.yaml"), Params)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("length_m: 0.445", "lenght_m: 0.445", "lab.rope.lenght_m: unknown key; did you mean `length_m`?"),
        ("rod:\n", "rods:\n", "rods: unknown key; did you mean `rod`?"),
        ("phi_rad: 0.008", "phi: 0.008", "learn.bounds.phi: unknown key; did you mean `phi_rad`?"),
        ("    bias_m: 0.0 ", "    # ", "lab.sensor.bias_m: this key is missing; add it"),
        ("length_m: 0.445", "length_m: 445", "lab.rope.length_m: should be less than or equal to 5 (it"),
        ("length_m: 0.445", "length_m: long", "lab.rope.length_m: should be a valid number (it is 'long')"),
        ("rate: 0.002 ", "rate: 1e-3 ", "with a point before an exponent"),
        ("drag_1_s: 2.0", "drag_1_s: 1.0e9", "and a sign in it (1.0e-4, 1.0e+4)"),
        ("smooth_m: 0.03", "smooth_m: .nan", "chain.smooth_m: should be a finite number (it is nan)"),
        ("particles: 30", "particles: 30.5", "rod.particles: should be a valid integer"),
        ("particles: 30", "particles: 3", "rod.particles: should be greater than or equal to 4 (it is 3)"),
        ("without: []", "without: " + "[" * 3000, "is not valid YAML"),
        ("law: plastic", "law: rubber", "should be 'plastic' or 'elastic' (it is 'rubber')"),
        ("verdict_of: captured", "verdict_of: caught", "`caught` is not among recordings (captured, "),
        ("layout: layout_1", "layout: layout_9", "`layout_9` is not among layouts (layout_1, "),
        ("paper_on: [captured]", "paper_on: [captred]", "identify.paper_on: `captred` is not among"),
        ("paper_on: [captured]", "paper_on: [captred]", "did you mean `captured`?"),
        ("  parameters: null ", "  parameters: [bending_stifness] ", "did you mean `bending_stiffness`?"),
        ("without: []", "without: [plastic_bendng]", "diagnose.without: `plastic_bendng` is not among the"),
        ("without: []", "without: [plastic_bendng]", "did you mean `plastic_bending`?"),
        ("contact_zone_m: 0.007", "contact_zone_m: 0.001", "should be more than learn.contact_margin_m"),
        ("contact_margin_m: 0.003", "contact_margin_m: 0.001", "should be learn.contact_margin_m or less"),
        ("  steps: 300", "  steps: 301", "learn.segments: does not divide learn.steps (it is 10)"),
        ("  first_arc: 0.75", "  first_arc: 1.0", "learn.first_arc: should be less than 1"),
        ("frame_every: 10", "frame_every: 1000", "lab.frame_every: leaves no frame of so many waypoints"),
        ("  steps: 300", "  steps: 300\n  steps: 30", "steps: this key is given twice; remove one"),
        ("layouts: [layout_1", "layouts: [../layout", "layouts.0: should be a name of letters, digits, -"),
        ("layouts: [layout_1", "layouts: [layout_1, layout_1", "layouts: layout_1 stands in it more"),
        ("laws: [elastic, plastic]", "laws: [plastic, plastic]", "execute.laws: plastic stands in it more"),
        ("  parameters: null ", "  parameters: [] ", "identify.parameters: List should have at least 1 item"),
        ("edge_px: 1.5", "edge_px: 150", "chain.edge_px: should be less than or equal to 20"),
        ("  source: lab", "  source: lab: x", "is not valid YAML"),
        ("  steps: 300", "  steps: 2024-13-01", "is not valid YAML"),
    ],
)  # fmt: skip
def test_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert said in refused(written(tmp_path, old, new))


def test_names_that_may_be_given_are_those_of_the_library() -> None:
    assert set(EFFECTS) == set(LIBRARY)
    fitted = (*STIFFNESSES, *END_ANGLES, *REST_CURVATURES, TILT, ROLL)
    assert set(FITTED) == set(fitted)


def test_the_line_is_the_one_in_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, "heldout_share: ", "heldout_shares: ")
    number = next(n for n, line in enumerate(path.read_text().split("\n"), 1) if "heldout_shares" in line)
    assert refused(path).startswith(
        f"line {number}, identify.heldout_shares: unknown key; did you mean `heldout_share`?"
    )


def test_no_file(tmp_path: Path) -> None:
    assert "no such file" in refused(tmp_path / "params.yaml")


def test_a_block_is_read_without_the_others(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_text("".join(TEXT.partition("\nchain:\n")[1:]).replace("seed", "sead"))
    assert load_block(Chain, path) == load_block(Chain, ROOT / "params.yaml")
    with pytest.raises(ParameterError, match="did you mean `seed`"):
        load_block(Diagnose, path)
    path.write_text("rod: {}\n")
    with pytest.raises(ParameterError, match="chain: this block is missing"):
        load_block(Chain, path)


@pytest.mark.parametrize(
    ("block", "settings", "elsewhere"),
    [
        (params.Chain, ChainSettings, set()),
        (params.Identify, IdentifySettings, {"particles", "longest_segment_m", "time_step_s", "sweeps"}),
        (params.PaperDescent, DescentSettings, set()),
        (params.Learn, LearnSettings, {"particles", "loss"}),
        (params.Diagnose, DiagnoseSettings, {"particles", "longest_segment_m", "time_step_s"}),
        (params.LabRope, LabRope, set()),
        (params.LabSensor, Sensor, set()),
    ],
)
def test_blocks_offer_every_setting(block: type[params.Block], settings: type, elsewhere: set[str]) -> None:
    """What can be set in the code can be set in params.yaml.

    `elsewhere`: in block `rod`, by the stage, or for one run only by an option.
    """
    assert {field.name for field in fields(settings)} - elsewhere <= set(block.model_fields)


def test_the_proof_diagnoses_with_the_settings_of_the_pipeline(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shard's recordings are diagnosed where no params.yaml is."""
    monkeypatch.chdir(ROOT)
    assert diagnose_settings() == DiagnoseSettings()


def test_a_long_rope_is_learned_with_more_particles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    assert learn_settings(0.445).particles == 30
    assert learn_settings(1.78).particles > 100
