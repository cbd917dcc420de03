"""Under a capture held fixed, what the stages from ingest to learn write does not depend on `lab.*`."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from dlolib.lab.record import Experiment, record
from dlolib.lab.rope import LabRope
from dlolib.sim.effects import EFFECTS
from tests.pipeline.conftest import ROOT

OTHERS = sorted(set(EFFECTS) - {"plastic_bending", "clock_offset"})
SMALL = {
    "identify": {"iterations": 5, "paper_on": []},
    "diagnose": {"without": OTHERS, "most_effects": 1, "starts": 1, "workers": 1},
    "rod": {"particles": 12, "longest_segment_m": 0.05},
    "learn": {
        "iterations": 2,
        "steps": 30,
        "starts": 1,
        "ablation": {"layout": "layout_1", "iterations": 2, "seeds": [1]},
    },
}
STAGES = (
    ("ingest",),
    ("chain",),
    ("identify", "captured", "data/recordings/captured"),
    ("diagnose", "captured", "data/recordings/captured"),
    ("learn", "layout_2"),
)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fixed")
    record(
        Experiment(rope=LabRope(bodies=30), waypoints=40, frame_every=20), folder / "held", folder / "truth"
    )
    return folder / "held"


def outputs(folder: Path, capture: Path, laboratory: dict | None) -> dict[str, str]:
    """Run the blind stages with this block `lab` (None: without any) and hash all that they write."""
    params = yaml.safe_load((ROOT / "params.yaml").read_text())
    for name, changes in SMALL.items():
        params[name] |= changes
    params["ingest"]["source"] = "held"
    del params["lab"]
    folder.mkdir()
    (folder / "params.yaml").write_text(
        yaml.safe_dump(params if laboratory is None else params | {"lab": laboratory})
    )
    shutil.copytree(capture, folder / "data/held")
    shutil.copytree(ROOT / "data/layouts/layout_2", folder / "data/layouts/layout_2")
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    for stage in STAGES:
        words = [sys.executable, "-m", f"stages.{stage[0]}", *stage[1:]]
        done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    written = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != "params.yaml"]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in written}


@pytest.mark.slow
def test_outputs_stay_the_same_to_the_byte(capture: Path, tmp_path: Path) -> None:
    rope = {"length_m": 0.6, "bending_stiffness_n_m2": 1e-3, "law": "elastic"}
    other = outputs(tmp_path / "other", capture, {"rope": rope, "waypoints": 50, "sensor": {"seed": 9}})
    without = outputs(tmp_path / "without", capture, None)
    assert other == without
    assert {"data/recordings/captured/points.csv", "reports/diagnose/captured/verdict.json"} <= set(other)
    assert "reports/learn/layout_2/trajectory.csv" in other
