"""docs/diagnosis.md says how a verdict is reached: with the thresholds that the code has."""

import re
from importlib import import_module
from pathlib import Path

from dlolib.diagnose import DiagnoseSettings
from dlolib.sim.effects import EFFECTS

PAGE = " ".join(Path("docs/diagnosis.md").read_text(encoding="utf-8").split())


def test_every_constant_is_that_of_the_code() -> None:
    told = re.findall(r"`(\w+)\.([A-Z_]+) = ([\d.e-]+)`", PAGE)
    assert len(told) > 10
    for module, name, value in told:
        assert getattr(import_module(f"dlolib.diagnose.{module}"), name) == float(value), f"{module}.{name}"


def test_every_setting_is_one_and_has_the_value_told() -> None:
    settings = DiagnoseSettings()
    names = {name for name in re.findall(r"\*(\w+)\*", PAGE) if "_" in name or hasattr(settings, name)}
    assert {"chance", "tie", "most_effects", "partners", "starts", "heldout_share"} <= names
    assert all(hasattr(settings, name) for name in names)
    valued = dict(re.findall(r"\*(\w+)\* \(([\d.e-]+)[),]", PAGE))
    assert set(valued) == {"most_effects", "most_frames", "starts", "partners", "chance", "tie"}
    assert all(getattr(settings, name) == float(value) for name, value in valued.items())
    assert (settings.particles, settings.longest_segment_m, settings.heldout_share) == (30, 0.016, 0.25)
    assert f"the [{len(EFFECTS)} effects]" in PAGE
