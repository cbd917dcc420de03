"""The proof's page in words, from its committed summary."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from dlolib.report.sections.proof import _words

SUMMARY = Path(__file__).parents[2] / "reports" / "proof" / "summary.json"


@pytest.fixture
def summary() -> dict[str, Any]:
    return dict(json.loads(SUMMARY.read_text()))


@pytest.mark.parametrize(
    ("counts", "said"), [((1, 1), "once each"), ((2, 2), "2 times each"), ((1, 3), "1 to 3 times each")]
)
def test_how_often_an_effect_was_drawn(summary: dict[str, Any], counts: tuple[int, int], said: str) -> None:
    drawn = {**summary["drawn"], "alone": dict(zip(("creep", "drag"), counts, strict=True))}
    assert f"2 effects were drawn alone, {said}" in _words({**summary, "drawn": drawn}).text


def test_one_recording_is_not_many(summary: dict[str, Any]) -> None:
    where = [
        {"without_more_than": 0.01, "recordings": 2, "ratio": 0.2},
        {"without_more_than": 0.02, "recordings": 1, "ratio": 0.1},
    ]
    bias = {"recordings": 2, "with": 0.01, "without": 0.05, "ratio": 0.2, "where": where}
    text = _words({**summary, "stiffness_bias": bias}).text
    assert "more than 1 % (2 recordings) 0.20; 2 % (1 recording) 0.10" in text
