"""The commands that DVC's users know, on the real dvc.yaml: dag, metrics, params, exp, push and pull."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.pipeline.conftest import ROOT, Pipeline, finished_in


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Pipeline:
    """One layout will do here: each stage takes DVC half a second."""
    return finished_in(tmp_path_factory.mktemp("one_layout"), layouts=1)


def test_make_lists_its_commands_in_two_columns() -> None:
    listed = subprocess.run(["make", "-s", "-C", ROOT, "help"], capture_output=True, text=True, check=True)
    lines = re.findall(r"(?m)^(  make [a-z-]+ +)\S", listed.stdout)
    assert len(lines) > 20 and len({len(line) for line in lines}) == 1


def test_dag_shows_the_way_of_the_data(pipeline: Pipeline) -> None:
    arrows = pipeline.dvc("dag", "--dot").replace('"', "").replace(";", "").split("\n")
    for arrow in (
        "lab -> ingest",
        "ingest -> chain",
        "chain -> identify@captured",
        "chain -> diagnose@captured",
        "diagnose@captured -> learn@layout_1",
        "learn@layout_1 -> execute@layout_1",
        "execute@layout_1 -> report",
    ):
        assert arrow in arrows


def test_metrics_show_and_params_diff(pipeline: Pipeline) -> None:
    shown = json.loads(pipeline.dvc("metrics", "show", "--json"))
    files = shown[""]["data"]
    assert {"reports/metrics/chain.json", "reports/metrics/learn_layout_1.json"} <= set(files)
    pipeline.change("iterations: 50", "iterations: 51")
    difference = json.loads(pipeline.dvc("params", "diff", "--json"))
    assert difference == {"params.yaml": {"identify.iterations": {"old": 50, "new": 51, "diff": 1}}}


def test_exp_run_sets_a_parameter_and_runs_what_depends_on_it(pipeline: Pipeline) -> None:
    log = pipeline.folder / ".bin/log"
    log.write_text("")
    pipeline.dvc("exp", "run", "-S", "identify.iterations=20", "--name", "fewer")
    ran = log.read_text().split()
    assert "identify@captured" in ran and "report" in ran and "chain" not in ran
    assert "iterations: 20" in pipeline.params.read_text()
    assert "fewer" in pipeline.dvc("exp", "show", "--csv")


def test_a_colleague_pulls_instead_of_computing(pipeline: Pipeline, tmp_path: Path) -> None:
    remote = tmp_path / "remote"
    pipeline.dvc("remote", "add", "--local", "--default", "ours", str(remote))
    pipeline.dvc("push")
    clone = tmp_path / "clone"
    pipeline.git("clone", "-q", str(pipeline.folder), str(clone))
    shutil.copytree(pipeline.folder / ".bin", clone / ".bin")
    colleague = Pipeline(clone)
    colleague.dvc("remote", "add", "--local", "--default", "ours", str(remote))
    colleague.dvc("pull")
    assert (clone / "reports/report.json").read_bytes() == (
        pipeline.folder / "reports/report.json"
    ).read_bytes()
    assert colleague.repro() == []
    assert colleague.git("status", "--porcelain") == ""


def test_a_changed_frame_of_ones_own_rope_runs_ingest_again_and_not_the_laboratory(
    pipeline: Pipeline,
) -> None:
    capture = pipeline.folder / "data/my_rope/capture.json"
    capture.parent.mkdir()
    capture.write_text("{}")
    pipeline.dvc("add", "data/my_rope")
    text = pipeline.params.read_text()
    pipeline.params.write_text(text.replace("ingest:\n  source: lab", "ingest:\n  source: my_rope"))
    assert "ingest" in pipeline.repro()
    capture.write_text('{"changed": 1}')
    again = pipeline.stale()
    assert {"ingest", "report"} <= again and "lab" not in again
    assert not {"identify@wire_white", "identify@wire_black", "diagnose@wire_white"} & again
