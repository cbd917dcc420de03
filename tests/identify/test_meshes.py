"""Finer meshes are tried where the usual one leaves too much out of the rope."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sim.bar import FALLS, FRAMES, over_the_bar
from sim.ropes import EI, GJ

from dlolib.errors import DloError, ParameterError, SimulationError
from dlolib.identify import IdentifySettings, identify
from dlolib.identify.identify import _begin, _finely, _left_by_meshes
from dlolib.identify.parameters import Unknown
from dlolib.sim.continuum import LEFT, MOST_FINER

MODULE = sys.modules[identify.__module__]


def test_a_rope_that_slides_along_a_bar_needs_a_finer_mesh() -> None:
    """Off by more than LEFT at the true stiffness, and by much less on a finer mesh; a free rope is right."""
    recording = replace(over_the_bar(233), heldout_frames=(FALLS, FRAMES - 1))
    left = []
    free = replace(recording, obstacles=())
    for one, particles in ((recording, 30), (recording, 59), (free, 30)):
        problem, _ = _begin([one], IdentifySettings(particles=particles), None)
        at = {Unknown("bending_stiffness"): np.log(EI), Unknown("torsional_stiffness"): np.log(GJ)}
        left.append(_left_by_meshes(problem, np.array([at.get(u, 0.0) for u in problem.unknowns])))
    assert left[0] > 50 * LEFT and left[1] < 0.3 * left[0] and left[2] < 0.2 * LEFT


@pytest.mark.parametrize(
    ("left", "costs", "meshes", "best"),
    [
        ((1.0,), (5.0,), [30], 30),
        ((9.0, 1.0), (5.0, 3.0), [30, 59], 59),
        ((9.0, 12.0), (5.0, 4.0), [30, 59], 59),
        ((90.0, 9.0, 3.0), (5.0, 3.0, 4.0), [30, 59, 117], 59),
    ],
)
def test_finer_meshes_are_tried_as_long_as_they_leave_less_and_the_best_fit_is_kept(
    left: Sequence[float],
    costs: Sequence[float],
    meshes: list[int],
    best: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert MOST_FINER == 4
    told, tried = dict(zip((30, 59, 117), zip(left, costs, strict=True), strict=False)), []

    def fitted(recordings: Any, settings: IdentifySettings, given: Any) -> Any:
        tried.append(settings.particles)
        assert settings.longest_segment_m == pytest.approx(0.016 * 29 / (settings.particles - 1))
        return settings.particles, np.zeros(1), []

    monkeypatch.setattr(MODULE, "_fitted", fitted)
    monkeypatch.setattr(MODULE, "_left_by_meshes", lambda n, theta: told[n][0])
    monkeypatch.setattr(MODULE, "_cost", lambda n, theta: told[n][1])
    assert _finely([], IdentifySettings(), None)[0] == best and tried == meshes


@pytest.mark.parametrize("error", [ParameterError, SimulationError])
def test_a_finer_rope_that_cannot_be_had_leaves_the_fit_as_it_is(
    error: type[DloError], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A long rope's finer mesh may have more particles than any rope needs, or tear."""

    def fitted(recordings: Any, settings: IdentifySettings, given: Any) -> Any:
        if settings.particles > 30:
            raise error("too many", mend="none")
        return settings.particles, np.zeros(1), []

    monkeypatch.setattr(MODULE, "_fitted", fitted)
    monkeypatch.setattr(MODULE, "_left_by_meshes", lambda *_: 500.0)
    monkeypatch.setattr(MODULE, "_cost", lambda *_: 1.0)
    assert _finely([], IdentifySettings(), None)[0] == 30


def test_the_iterative_solver_keeps_its_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its stiffness depends on it altogether."""
    monkeypatch.setattr(MODULE, "_fitted", lambda *_: (30, np.zeros(1), []))
    monkeypatch.setattr(MODULE, "_left_by_meshes", lambda *_: pytest.fail("looked at"))
    monkeypatch.setattr(MODULE, "_cost", lambda *_: 1.0)
    assert _finely([], IdentifySettings(sweeps=20), None)[0] == 30
