"""What the truth itself gains in the held-out frames."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dlolib.errors import SimulationError
from dlolib.proof.draw import draw_case
from dlolib.proof.heldout import chi2, foretold
from dlolib.proof.noise import whiten
from dlolib.types import Noise
from stages import proof_heldout
from stages.proof_heldout import by_the_truth, shares

NOISE = Noise(0.0015, 1.5, 0.7)


def test_chi_squared_is_the_whitened_sum_where_all_is_seen() -> None:
    error = np.random.default_rng(0).normal(size=(24, 30, 3)) * 1e-3
    everything = np.ones((24, 30), dtype=bool)
    assert chi2(error, everything, NOISE) == pytest.approx(np.sum(whiten(error, NOISE) ** 2), rel=1e-9)


def test_a_point_that_is_lost_counts_for_nothing() -> None:
    error = np.random.default_rng(0).normal(size=(24, 30, 3)) * 1e-3
    seen = np.random.default_rng(1).random((24, 30)) > 0.2
    before = chi2(error, seen, NOISE)
    error[~seen] = 7.0
    assert chi2(error, seen, NOISE) == before


def test_the_truth_gains_what_shows_give_or_take_the_noise() -> None:
    case = draw_case(3, 0, ("end_angle",), 4.0)
    found = foretold(case)
    assert found.shows > 40
    assert 0 < abs(found.change + found.shows) < 4 * 2 * np.sqrt(found.shows)
    exact = foretold(replace(case, noise_m=np.zeros_like(case.noise_m)))
    assert exact.change == pytest.approx(-exact.shows, rel=1e-9)


def row(named: bool, change: float) -> dict[str, Any]:
    return {"named_better": named, "shows": 1.0, "change": change}


def test_what_was_named_is_counted_beside_what_the_truth_would_do() -> None:
    rows = [row(True, -9.0), row(False, -1.0), row(False, 2.0), row(True, 1.0), {"named_better": True}]
    found = shares(rows)
    counts = {name: (one["count"], one["of"]) for name, one in found.items()}
    assert counts == {
        "named_better": (2, 4),
        "truth_better": (2, 4),
        "named_better_where_truth_is": (1, 2),
    }


def refuse(problem: str) -> Callable[..., None]:
    def raised(*_: object, **__: object) -> None:
        raise SimulationError(problem)

    return raised


def test_an_elastic_rope_that_cannot_go_the_way_is_told_and_not_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(proof_heldout, "answer_in", lambda *_: {"effects": ["end_angle"], "attempt": 0})
    monkeypatch.setattr(proof_heldout, "draw_case", lambda *_, **__: None)
    monkeypatch.setattr(proof_heldout, "foretold", refuse("it is held longer than it is"))
    told = by_the_truth(3, "shard", "000", True)
    assert told["not_played"].startswith("it is held longer") and shares([told])["named_better"]["of"] == 0
