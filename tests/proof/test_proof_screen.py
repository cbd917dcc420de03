"""What the screen of pairs misses is counted by what it leads to."""

from __future__ import annotations

from typing import Any

from stages.proof_screen import _row


def verdict(models: dict[tuple[str, ...], float], *tie: tuple[str, ...]) -> dict[str, Any]:
    best = min(models.values())
    listed = [
        {"effects": list(effects), "kind": "library", "delta_bic": bic - best}
        for effects, bic in models.items()
    ]
    return {"status": "explained", "equivalent": [list(one) for one in tie], "candidates": listed}


def test_a_better_pair_that_was_not_fitted_is_missed() -> None:
    alone, pair, other = ("end_angle",), ("clock_offset", "end_angle"), ("end_angle", "length_error")
    screened = verdict({alone: 100.0, pair: 80.0}, pair)
    full = verdict({alone: 100.0, pair: 80.0, other: 60.0}, other)
    row = _row("007", screened, full)
    assert row["missed"] and row["otherwise"] and row["gain"] == 20.0
    assert row["screened"] == pair and row["full"] == other


def test_the_same_best_model_is_none_missed() -> None:
    alone, pair, other = ("end_angle",), ("clock_offset", "end_angle"), ("end_angle", "length_error")
    screened = verdict({alone: 100.0, pair: 80.0}, pair)
    full = verdict({alone: 100.0, pair: 80.0, other: 85.0}, pair)
    row = _row("007", screened, full)
    assert not row["missed"] and not row["otherwise"] and row["gain"] == 0.0
    # a little better is a tie
    close = verdict({alone: 100.0, pair: 80.0, other: 76.0}, pair, other)
    row = _row("007", screened, close)
    assert not row["missed"] and row["otherwise"]
    assert _row("007", screened, None)["gain"] is None
