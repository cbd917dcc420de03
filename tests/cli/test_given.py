"""What params.yaml says reaches the commands and the stages, and what an option says goes before it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import yaml
from formats import samples

import dlolib.diagnose
import dlolib.identify
from dlolib.cli import given, run
from dlolib.diagnose import DiagnoseSettings
from dlolib.errors import ParameterError
from dlolib.identify import IdentifySettings
from dlolib.learn import LearnSettings
from dlolib.sim.mesh import Mesh
from stages.diagnose import settings as diagnose_settings
from stages.identify import settings as identify_settings
from stages.learn import settings as learn_settings

ROOT = Path(__file__).resolve().parents[2]
# No value is the default.
ROD = {"particles": 41, "longest_segment_m": 0.02, "time_step_s": 0.004, "solver": "iterative", "sweeps": 77}
IDENTIFY = {"parameters": ["bending_stiffness"], "iterations": 7, "heldout_share": 0.4}
DIAGNOSE = {
    "without": ["grasp_slip"], "chance": 1e-3, "tie": 4.0, "most_effects": 2, "starts": 3, "partners": 5,
    "full": True, "workers": 1, "heldout_share": 0.1, "most_frames": 90, "seed": 4,
}  # fmt: skip
MESH = {key: ROD[key] for key in ("particles", "longest_segment_m", "time_step_s")}


def test_of_a_rope_beside_obstacles_the_thickness_is_asked_for(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    given.recording(folder)
    assert "diameter_m" not in caplog.text
    samples.set_key(folder / "recording.json", "object.diameter_m", None)
    assert given.recording(folder).obstacles
    assert "recording.json: object.diameter_m is not given: its axis may touch obstacles" in caplog.text


class Handed(Exception):  # noqa: N818  (what happened)
    """What a command handed over."""


@pytest.fixture
def there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A folder with such a params.yaml."""
    content = yaml.safe_load((ROOT / "params.yaml").read_text())
    content["rod"] |= ROD
    content["identify"] |= IDENTIFY
    content["diagnose"] |= DIAGNOSE
    content["learn"] |= {"iterations": 11, "seed": 5}
    monkeypatch.chdir(tmp_path)
    written(content)
    samples.recording_folder(tmp_path / "recording")
    return dict(content)


def written(content: dict[str, Any]) -> None:
    Path("params.yaml").write_text(yaml.safe_dump(content))


def handed(monkeypatch: pytest.MonkeyPatch, package: Any, name: str, *words: str) -> tuple[Any, ...]:
    """With what a command calls that function of a package."""

    def call(*arguments: Any) -> None:
        raise Handed(*arguments)

    monkeypatch.setattr(package, name, call)
    with pytest.raises(Handed) as caught:
        run([name if name != "descend" else "identify", "recording", "--out", "out", *words])
    return caught.value.args


@pytest.mark.usefixtures("there")
def test_every_value_of_params_yaml_is_taken() -> None:
    identify = IdentifySettings(
        **MESH, sweeps=77, parameters=("bending_stiffness",), iterations=7, heldout_share=0.4
    )
    diagnose = DiagnoseSettings(**MESH, **{**DIAGNOSE, "without": ("grasp_slip",)})
    for settings, name in ((identify, "identify"), (diagnose, "diagnose")):
        usual = asdict(type(settings)())
        assert not [key for key, value in asdict(settings).items() if value == usual[key]], name
    assert given.identify_settings() == identify_settings() == identify
    assert given.diagnose_settings() == diagnose_settings() == diagnose
    assert given.mesh() == Mesh(**MESH)
    assert given.learn_settings(1.0) == learn_settings(1.0)
    learned = given.learn_settings(1.0)
    assert (learned.iterations, learned.seed, learned.particles) == (11, 5, 51)


def test_without_params_yaml_the_defaults_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for text in (None, "", "[1]", "theirs: {lr: 0.1}"):
        if text is not None:
            Path("params.yaml").write_text(text)
        assert given.diagnose_settings() == DiagnoseSettings()
        assert given.identify_settings() == IdentifySettings()
        assert given.learn_settings(0.1) == LearnSettings()
        assert given.mesh() == Mesh()


def test_a_direct_solver_has_no_sweeps(there: dict[str, Any]) -> None:
    there["rod"]["solver"] = "direct"
    written(there)
    assert given.identify_settings().sweeps is None


def test_what_options_say_of_a_diagnosis_goes_before(
    there: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, settings = handed(
        monkeypatch, dlolib.diagnose, "diagnose", "--without", "length_error", "--workers", "3"
    )
    assert settings.without == ("grasp_slip", "length_error")
    assert (settings.workers, settings.full) == (3, True)
    there["diagnose"]["full"] = False
    written(there)
    for words, full in ((["--full"], True), ([], False)):
        _, settings = handed(monkeypatch, dlolib.diagnose, "diagnose", *words)
        assert (settings.workers, settings.full) == (1, full)


def test_the_papers_descent_runs_where_it_is_asked_for(
    there: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    there["rod"]["solver"] = "direct"
    there["identify"] |= {"method": "gradient_descent", "parameters": None}
    there["identify"]["paper"] |= {"iterations": 9}
    written(there)
    monkeypatch.setattr(dlolib.identify, "identify", lambda *_: None)
    recording, descent, settings = handed(monkeypatch, dlolib.identify, "descend")
    assert recording.name == "small"
    assert descent.iterations == 9
    assert settings == given.identify_settings()


def test_a_stage_refuses_a_name_that_nothing_has(there: dict[str, Any]) -> None:
    there["diagnose"]["without"] = ["plastic"]
    there["identify"]["parameters"] = ["bending"]
    written(there)
    with pytest.raises(ParameterError, match=r"diagnose.without: `plastic` is not among the effects"):
        diagnose_settings()
    with pytest.raises(ParameterError, match=r"identify.parameters: `bending` is not among what is fitted"):
        identify_settings()
