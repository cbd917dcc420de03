"""What the laboratory says of a case before any diagnosis."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dlolib.errors import SimulationError
from dlolib.proof import answer
from dlolib.proof.draw import Case
from dlolib.proof.gain import Gain


def test_a_case_whose_laws_cannot_be_held_against_ours_is_drawn_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shard with one that finds no balance on the way could never be finished."""
    tried: list[int] = []

    def drawn(
        seed: int, index: int, names: object, multiple: object, attempt: int, settled_m: float
    ) -> object:
        return SimpleNamespace(attempt=attempt, effects={})

    def nearest(case: SimpleNamespace) -> dict[str, object]:
        tried.append(case.attempt)
        if case.attempt < 2:
            raise SimulationError("the laboratory's rope found no balance")
        return {}

    monkeypatch.setattr(answer, "draw_case", drawn)
    monkeypatch.setattr(answer, "detect", lambda case: {"detectable": []})
    monkeypatch.setattr(answer, "nearest_laws", nearest)
    case, more = answer.answered(1, 0, ("plastic_bending",))
    assert tried == [0, 1, 2] and case.attempt == more["attempt"] == 2  # type: ignore[attr-defined]
    assert more["nearest"] == {} and more["touch_m"] is None


def test_no_member_is_seen_better_beside_the_other_than_both_against_the_elastic_rope(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two that cancel: the best rope with the other alone may have none of it, which a search from its true
    size does not find (recording 014 of shard_20261130T021819: 41 beside it, 28 against the elastic rope)."""
    left = {(): 28.0, ("end_angle",): 41.0, ("camera_pose",): 0.4}
    monkeypatch.setattr(
        answer, "gain", lambda ours, truth, others, noise: Gain(left[tuple(others)], 3e-4, 3e-4)
    )
    case: Any = SimpleNamespace(
        effects={"camera_pose": {"depth": 0.01}, "end_angle": {"end_1": 0.002}}, seen=np.ones(3), noise=None
    )
    found = answer._gains(cast(Case, case), cast(Any, None), np.zeros(0))
    assert found["gains"] == {"camera_pose": 28.0, "end_angle": 0.4} and found["detectable"] == []
