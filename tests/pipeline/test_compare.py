"""`make compare` can fail: outside the tolerance, a figure that is missing, a figure without a tolerance."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
import yaml

from dlolib.errors import DloError
from stages.compare import TOLERANCES as TOLERANCE_FILE
from stages.compare import check_ran, committed, compare, flattened
from stages.report import read_headline

TOLERANCES = {"chain.rms_m": {"absolute": 1e-5}, "learn_*.loss": {"relative": 0.01}, "chain.*": {}}


def test_flattened() -> None:
    content = {"a": {"b": 1, "c": None}, "done": True, "why": "text", "d": 2.5}
    assert dict(flattened(content, "chain")) == {
        "chain.a.b": 1.0,
        "chain.a.c": None,
        "chain.done": 1.0,
        "chain.d": 2.5,
    }


@pytest.mark.parametrize(
    ("name", "here", "committed", "within"),
    [
        ("chain.rms_m", 1.005e-3, 1e-3, True),
        ("chain.rms_m", 1.02e-3, 1e-3, False),
        ("learn_layout_1.loss", 1.009, 1.0, True),
        ("learn_layout_1.loss", 1.02, 1.0, False),
        ("chain.frames", 40.0, 40.0, True),
        ("chain.frames", 39.0, 40.0, False),
        ("chain.share", None, None, True),
        ("chain.share", 1.0, None, False),
        ("chain.share", float("nan"), 1.0, False),
    ],
)
def test_within(name: str, here: float | None, committed: float | None, within: bool) -> None:
    (row,) = compare({name: here}, {name: committed}, TOLERANCES)
    assert row.within is within


def test_a_figure_on_one_side_only_is_refused() -> None:
    with pytest.raises(DloError, match="chain.frames is missing in the committed metrics"):
        compare({"chain.frames": 1.0}, {}, TOLERANCES)
    with pytest.raises(DloError, match="chain.frames is missing in this tree"):
        compare({}, {"chain.frames": 1.0}, TOLERANCES)


def test_a_figure_without_a_tolerance_is_refused() -> None:
    with pytest.raises(DloError, match="no tolerance for identify_captured.rmse_m"):
        compare({"identify_captured.rmse_m": 1.0}, {"identify_captured.rmse_m": 1.0}, TOLERANCES)


def test_every_committed_figure_has_a_tolerance() -> None:
    figures = committed()
    assert len(figures) > 50
    assert all(
        row.within for row in compare(figures, figures, yaml.safe_load(TOLERANCE_FILE.read_text("utf-8")))
    )


def test_figures_without_a_report_are_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DloError, match="reports/report.json: no such file; run make repro first"):
        read_headline()


def test_a_tree_in_which_nothing_ran_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    report, lock = Path("reports/report.json"), Path("dvc.lock")
    with pytest.raises(DloError, match="report.json: .* has not run here; run make repro first"):
        check_ran(report, lock)
    report.parent.mkdir()
    report.write_text("{}")
    with pytest.raises(DloError, match="of another run than dvc.lock; run make repro"):
        check_ran(report, lock)
    output = {"path": "reports/report.json", "hash": "md5", "md5": hashlib.md5(b"{}").hexdigest()}
    lock.write_text(yaml.safe_dump({"schema": "2.0", "stages": {"report": {"outs": [output]}}}))
    check_ran(report, lock)
    report.write_text("{ }")
    with pytest.raises(DloError, match="of another run"):
        check_ran(report, lock)
