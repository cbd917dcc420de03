"""The rod against the laboratory's, by the same parameters."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from dlolib.proof.draw import Case
from stages import agreement


def test_a_rope_with_an_effect_is_the_same_by_both_solvers(monkeypatch: pytest.MonkeyPatch) -> None:
    same = agreement.apart("end_angle", 0)
    assert same["goal_percent"] == 0.5 and same["frames_elsewhere"] == 0
    assert 0 < same["mean_percent"] < same["most_percent"] < 0.05
    # and another rope is another one
    told = agreement.options

    def softer(*given: Any) -> list[str]:
        return ["bending_stiffness=1e-4" if "bending_stiffness" in one else one for one in told(*given)]

    monkeypatch.setattr(agreement, "options", softer)
    assert agreement.apart("end_angle", 0)["most_percent"] > 0.5


def test_a_law_of_another_form_is_given_the_nearest_parameters() -> None:
    effects = {"plastic_bending": {"yield_curvature": 4.0, "hardening_ratio": 0.2}, "end_twist": {"end": 0.1}}
    case: Any = SimpleNamespace(
        experiment=SimpleNamespace(bending_stiffness=3e-4, torsional_stiffness=2e-4), effects=effects
    )
    assert list(agreement.options(cast(Case, case), {"plastic_bending": {"yield_curvature": 5.0}})) == [
        "--set",
        "bending_stiffness=0.0003",
        "--set",
        "torsional_stiffness=0.0002",
        "--effect",
        "plastic_bending:yield_curvature=5.0,hardening_ratio=0.2",
        "--effect",
        "end_twist:end=0.1",
    ]


def test_what_is_refused_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(agreement, "options", lambda *_: ["--set", "bending_stiffness=-1"])
    told = agreement.apart("", 0)
    assert "not a positive number" in told["refused"] and "most_percent" not in told
