"""dvc.yaml against the code: its deps are the real imports, and whatever infers cannot see the laboratory."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.pipeline.conftest import ROOT, names, stages_of
from tests.pipeline.imports import import_graph, modules_of, parts_of

STAGES = ("lab", "ingest", "chain", "identify", "diagnose", "learn", "execute", "report")
BLIND = ("ingest", "chain", "identify", "diagnose", "learn")
TRUTH = "data/truth"


@pytest.fixture(scope="module")
def resolved() -> dict[str, dict]:
    return stages_of(ROOT / "dvc.yaml", ROOT / "params.yaml")


def of(resolved: dict[str, dict], stage: str) -> list[dict]:
    """All the stages of one script: `learn` gives learn@layout_1 and so on."""
    return [content for name, content in resolved.items() if name.split("@")[0] == stage]


def parameters(content: dict) -> set[str]:
    return {entry for entry in content.get("params", []) if isinstance(entry, str)}


def test_every_stage_is_looked_at(resolved: dict[str, dict]) -> None:
    assert {name.split("@")[0] for name in resolved} == set(STAGES)


@pytest.mark.parametrize("stage", STAGES)
def test_deps_are_the_real_imports(resolved: dict[str, dict], stage: str) -> None:
    for content in of(resolved, stage):
        listed = {path for path in names(content["deps"]) if path.startswith(("dlolib", "stages"))}
        assert sorted(listed) == sorted(parts_of(stage))


def test_the_package_itself_defines_nothing() -> None:
    """Why dlolib/__init__.py may stay out of the deps of a stage that does not ask for the version: beside it
    there is but the number of threads."""
    body = ast.parse((ROOT / "dlolib/__init__.py").read_text()).body
    assert all(isinstance(node, ast.Expr | ast.Assign | ast.Import) for node in body)
    assert not import_graph().find_modules_directly_imported_by("dlolib")


@pytest.mark.parametrize("stage", BLIND)
def test_blind_stages_reach_neither_laboratory_nor_truth(resolved: dict[str, dict], stage: str) -> None:
    for content in of(resolved, stage):
        assert not {entry for entry in parameters(content) if entry.split(".")[0] == "lab"}
        assert not [path for path in names(content["deps"]) if Path(path).is_relative_to(TRUTH)]
        assert not [path for path in names(content["deps"]) if Path(TRUTH).is_relative_to(path)]
    reached = modules_of(stage)
    assert not {module for module in reached if module.startswith("dlolib.lab")}
    source = (ROOT / f"stages/{stage}.py").read_text()
    assert "truth" not in source and "Lab" not in source and "params.load(" not in source


def test_truth_is_read_by_the_report_alone(resolved: dict[str, dict]) -> None:
    readers = {name for name, content in resolved.items() if TRUTH in names(content["deps"])}
    assert readers == {"report"}


def test_settings_of_the_laboratory_are_listed_by_three_stages_alone(resolved: dict[str, dict]) -> None:
    listing = {name.split("@")[0] for name, content in resolved.items() if "lab" in parameters(content)}
    assert listing == {"lab", "execute", "report"}


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_lists_each_block_that_its_script_reads(resolved: dict[str, dict], stage: str) -> None:
    tree = ast.parse((ROOT / f"stages/{stage}.py").read_text())
    calls = [
        node for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    ]
    read = {call.args[0].id.lower() for call in calls if call.func.id == "load_block"}
    for content in of(resolved, stage):
        assert read <= {entry.split(".")[0] for entry in parameters(content)}
