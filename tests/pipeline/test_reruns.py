"""Which stages run again for one changed line of params.yaml: each its own and what depends on it."""

from __future__ import annotations

import pytest

from tests.pipeline.conftest import Pipeline

LAYOUTS = ("layout_1", "layout_2", "layout_3", "layout_4")
RECORDINGS = ("captured", "wire_white", "wire_black")
LEARN = {f"learn@{name}" for name in LAYOUTS}
EXECUTE = {f"execute@{name}" for name in LAYOUTS}
IDENTIFY = {f"identify@{name}" for name in RECORDINGS}
DIAGNOSE = {f"diagnose@{name}" for name in RECORDINGS}
PLAN = LEARN | EXECUTE | {"report"}
ALL = {"lab", "ingest", "chain", "report"} | IDENTIFY | DIAGNOSE | LEARN | EXECUTE

CAPTURED = {"identify@captured", "diagnose@captured"}

# The line, what it becomes, and what runs again when every stage gives something new.
TABLE = [
    ("particles: 30", "particles: 40", IDENTIFY | DIAGNOSE | PLAN),
    ("hardening_ratio: 0.2", "hardening_ratio: 0.3", {"lab", "ingest", "chain"} | CAPTURED | PLAN),
    ("points: 30", "points: 20", {"chain"} | CAPTURED | PLAN),
    (
        "wire_white: {path: data/wires/wire_white}",
        "wire_white: {path: data/wires/wire_black}",
        {"identify@wire_white", "diagnose@wire_white", "report"},
    ),
    ("iterations: 50 ", "iterations: 40 ", IDENTIFY | {"report"}),
    ("tie: 6.0", "tie: 5.0", DIAGNOSE | PLAN),
    ("contact_weight: 0.1", "contact_weight: 0.2", PLAN),
    ("laws: [elastic, plastic]", "laws: [plastic]", EXECUTE | {"report"}),
    (
        "layouts: [layout_1, layout_2, layout_3, layout_4]",
        "layouts: [layout_1, layout_2, layout_3]",
        {"report"},
    ),
]


def test_first_run_has_every_stage_and_leaves_git_clean(finished: Pipeline) -> None:
    assert set((finished.folder / ".bin/log").read_text().split()) == ALL
    assert finished.git("status", "--porcelain") == ""


def test_second_run_has_no_stage(pipeline: Pipeline) -> None:
    assert pipeline.repro() == []


@pytest.mark.parametrize(("old", "new", "expected"), TABLE, ids=[old.split(":")[0] for old, _, _ in TABLE])
def test_changed_line(pipeline: Pipeline, old: str, new: str, expected: set[str]) -> None:
    pipeline.change(old, new)
    assert sorted(pipeline.stale()) == sorted(expected)


def test_what_is_stale_is_what_runs(pipeline: Pipeline) -> None:
    pipeline.change("contact_weight: 0.1", "contact_weight: 0.2")
    stale = pipeline.stale()
    assert set(pipeline.repro()) == stale == PLAN


def test_changed_layout_runs_its_own_again(pipeline: Pipeline) -> None:
    (pipeline.folder / "data/layouts/layout_2/layout.json").write_text('{"changed": 1}')
    assert pipeline.stale() == {"learn@layout_2", "execute@layout_2", "report"}


def test_changed_recording_runs_its_own_again(pipeline: Pipeline) -> None:
    with (pipeline.folder / "data/wires/wire_black/points.csv").open("a") as points:
        points.write("\n")
    assert pipeline.stale() == {"identify@wire_black", "diagnose@wire_black", "report"}


def test_changed_code_runs_again_what_imports_it(pipeline: Pipeline) -> None:
    with (pipeline.folder / "dlolib/execute/__init__.py").open("a") as code:
        code.write("\n# changed\n")
    assert pipeline.stale() == EXECUTE | {"report"}
