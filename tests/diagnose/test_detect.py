"""What size would have been seen, of changes that are made up."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from diagnose.test_diagnose import QUICK, made
from sim.ropes import EI

from dlolib.diagnose import detect
from dlolib.diagnose.detect import Size, Sized, detectable, gain_needed, sized
from dlolib.diagnose.diagnose import raw_study
from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.study import Study, acting_only
from dlolib.identify.identify import FIRST_STIFFNESS_M4_S2
from dlolib.identify.parameters import Unknown

ROPE = SimpleNamespace(linear_density_kg_m=0.04)
STUDY = cast(Study, SimpleNamespace(seen=[SimpleNamespace(recording=SimpleNamespace(rope=ROPE))]))


@pytest.fixture
def beside(monkeypatch: pytest.MonkeyPatch) -> Sized:
    """A baseline that takes up the first of what is made up, linearly."""
    monkeypatch.setattr(detect, "_white", lambda study, moved: moved[0])
    return Sized(cast(Any, None), (), np.array([[1.0], [0.0]]), 5e-5)


def test_drag_is_seen_by_what_it_changes_beside_inertia(
    beside: Sized, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rope with drag is inert, too, which alone changes much in a quick motion."""

    def moved(study: Study, beside: Sized, values: dict[str, float]) -> Any:
        return (np.array([1000.0, 500.0 * values["inertia_drag.drag"]]),)

    monkeypatch.setattr(detect, "_moved", moved)
    found = detectable(STUDY, (beside, Size("inertia_drag", "drag", {})))
    assert found.value == pytest.approx(np.sqrt(gain_needed(5e-5, 1)) / 500.0, rel=0.05)
    assert found.unit == "N s/m^2"


@pytest.mark.parametrize(("deviation", "ratio"), [(3.0, 0.1), (0.3, 1e-4)])
def test_sizes_are_asked_of_a_rope_of_usual_twist_where_next_to_nothing_tells_of_it(
    deviation: float, ratio: float
) -> None:
    """A rope that ran limp in twist for no reason shows more, and on another machine another size."""
    study = acting_only(raw_study([made({})], QUICK), FIRST_STIFFNESS_M4_S2)
    unknowns = tuple(map(Unknown, study.stiffnesses))
    theta, covariance = np.log([EI, 1e-4 * EI]), np.diag([0.01, deviation]) ** 2
    base = Fitted((), unknowns, theta, 1e3, covariance, (), (), 100, {}, (), 1)
    beside = sized(study, base, 5e-5)
    assert beside.base.point == {unknowns[0]: pytest.approx(EI), unknowns[1]: pytest.approx(ratio * EI)}
    shape = study.seen[0].model.predict(study.rod(0, beside.base.values(0))).xyz_m
    np.testing.assert_array_equal(beside.clean_m[0], shape)


@pytest.mark.parametrize(("share", "seen"), [(1.0, 1.0), (0.25, 2.0), (0.0, None)])
def test_what_the_baseline_takes_up_in_full_is_not_seen_though_a_linear_step_leaves_some(
    beside: Sized, share: float, seen: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A load along gravity is another stiffness: a linear step of that leaves what goes with its square."""

    def moved(study: Study, beside: Sized, values: dict[str, float]) -> Any:
        return (1e3 * values["lateral_load.z"] * np.array([10.0, 1.0]),)

    monkeypatch.setattr(detect, "_moved", moved)
    monkeypatch.setattr(detect, "_left", lambda study, beside, some: share * some[0][1] ** 2)
    found = detectable(STUDY, (beside, Size("lateral_load", "z", {})))
    linear = np.sqrt(gain_needed(5e-5, 2)) / 1e3
    assert found.value is None if seen is None else found.value == pytest.approx(seen * linear, rel=0.05)
