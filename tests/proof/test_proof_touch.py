"""What a hidden obstacle takes by chance is counted as so many places would give it."""

from __future__ import annotations

import numpy as np
import pytest

from stages.proof_touch import summarise


def test_chance_at_many_places_is_told_as_so_many() -> None:
    rng = np.random.default_rng(0)
    # the rarest of fifty
    best = rng.uniform(size=(4000, 50)).min(axis=1)
    free = [{"named": False, "by_chance": float(p)} for p in best]
    found = summarise([], [*free, {"named": True, "by_chance": 1e-9}])
    assert found["places"] == pytest.approx(50, rel=0.05)
    assert found["alarms"]["count"] == 1
    assert found["alarms_at_one_place"]["count"] == 1 + sum(p < 5e-5 for p in best)
    assert found["place"]["share"] is None


def test_only_what_is_detectable_must_be_found() -> None:
    seen = {"named": True, "detectable": True, "off_m": 0.002}
    far, none = {**seen, "off_m": 0.02}, {"named": False, "detectable": True}
    small = {"named": False, "detectable": False, "off_m": 0.1}
    found = summarise([seen, far, none, small], [])
    assert (found["named"]["count"], found["named"]["of"]) == (2, 3)
    assert (found["place"]["count"], found["place"]["of"]) == (1, 3)
    assert found["places"] is None
