"""What size would have been seen, of changes that are made up."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dlolib.diagnose import detect
from dlolib.diagnose.detect import Size, Sized, detectable, gain_needed
from dlolib.diagnose.study import Study

ROPE = SimpleNamespace(linear_density_kg_m=0.04)
STUDY = cast(Study, SimpleNamespace(seen=[SimpleNamespace(recording=SimpleNamespace(rope=ROPE))]))


def test_drag_is_seen_by_what_it_changes_beside_inertia(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rope with drag is inert, too, which alone changes much in a quick motion."""

    def changed(study: Study, beside: Sized, values: dict[str, float]) -> Any:
        return np.array([1000.0, 500.0 * values["inertia_drag.drag"]])

    monkeypatch.setattr(detect, "_changed", changed)
    beside = Sized(cast(Any, None), (), np.zeros((2, 0)), 5e-5)
    found = detectable(STUDY, (beside, Size("inertia_drag", "drag", {})))
    assert found.value == pytest.approx(np.sqrt(gain_needed(5e-5, 1)) / 500.0, rel=0.05)
    assert found.unit == "N s/m^2"
