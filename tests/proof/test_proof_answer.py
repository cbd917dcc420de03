"""What the laboratory says of a case before any diagnosis."""

from types import SimpleNamespace

import pytest

from dlolib.errors import SimulationError
from dlolib.proof import answer


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
