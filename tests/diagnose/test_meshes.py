"""Meshes are made finer where an extrapolated one would be taken for physics, and only where that helps."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from sim.bar import over_the_bar
from sim.ropes import EI, GJ, ROPE

from dlolib.diagnose import DiagnoseSettings, diagnose, meshes
from dlolib.diagnose.diagnose import _study, raw_study
from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.meshes import fine_enough, left_by_meshes
from dlolib.diagnose.noise import known_noise
from dlolib.diagnose.search import baseline
from dlolib.diagnose.study import Study
from dlolib.diagnose.workers import Workers
from dlolib.errors import SimulationError
from dlolib.sim.continuum import MOST_FINER
from dlolib.sim.rod import Rod

SETTINGS = DiagnoseSettings(workers=1)


@pytest.mark.parametrize("finely", [False, True])
def test_a_rope_that_slides_on_a_bar_is_as_stiff_as_it_is(
    finely: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the usual mesh alone it came out stiffer by 4 %, with 200 in χ² left for an effect to explain."""
    if not finely:
        monkeypatch.setattr(sys.modules[diagnose.__module__], "fine_enough", lambda study, *_: study)
    recording = over_the_bar(233)
    with Workers(1) as run:
        study, _ = _study([recording], [known_noise(recording)], run, SETTINGS)
        elastic = baseline(study)
    beyond = (elastic.chi2 - elastic.coordinates) / np.sqrt(2 * elastic.coordinates)
    right = study.seen[0].model.particles > 30, bool(abs(beyond) < 2)
    assert (*right, elastic.values(0)["bending_stiffness"] == pytest.approx(EI, rel=0.01)) == 3 * (finely,)
    assert study.ahead[0].model.particles == study.seen[0].model.particles


@pytest.mark.parametrize(
    ("left", "finer"),
    [
        ((1.9,), 1),
        ((500.0, 400.0, 300.0), 1),
        ((500.0, 30.0, 8.0), 2),
        ((500.0, 30.0, 7.0), 4),
        ((115.0, 48.0, 6.0), 4),
    ],
)
def test_a_mesh_is_made_finer_as_long_as_that_helps(
    left: Sequence[float], finer: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To half of the error, be it by two meshes at once, and no further than so many times as fine."""
    assert MOST_FINER == 4
    study = raw_study([over_the_bar(30)], SETTINGS)
    told, fits = iter(left), []
    monkeypatch.setattr(meshes, "_left", lambda *_: np.array([next(told)]))

    def again(other: Study) -> Fitted:
        fits.append(other.seen[0].model.particles)
        return cast(Fitted, None)

    found = fine_enough(study, cast(Fitted, None), SETTINGS, again)
    assert found.seen[0].model.particles == found.ahead[0].model.particles == 29 * finer + 1
    assert (found is study) is (finer == 1) and fits == [59, 117][: len(left) - 1]


def test_where_a_finer_rope_cannot_be_simulated_the_mesh_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    study = raw_study([over_the_bar(30)], SETTINGS)
    monkeypatch.setattr(meshes, "_left", lambda *_: np.array([500.0]))

    def torn(other: Study) -> Fitted:
        raise SimulationError("no stiffness could be simulated", mend="do not")

    assert fine_enough(study, cast(Fitted, None), SETTINGS, torn) is study


def test_a_rope_that_swings_keeps_its_mesh() -> None:
    """Its time step leaves more out."""
    study = raw_study([replace(over_the_bar(30), quasi_static=False)], SETTINGS)
    model = SimpleNamespace(values=lambda k: {"bending_stiffness": EI})
    assert fine_enough(study, cast(Fitted, model), SETTINGS, lambda _: pytest.fail("fitted")) is study


def test_a_finer_rope_without_equilibrium_tells_of_no_error() -> None:
    def torn(rod: Rod) -> Any:
        raise SimulationError("it would tear", mend="do not")

    model, fine = (SimpleNamespace(particles=n, predict=torn) for n in (30, 59))
    one = SimpleNamespace(model=model, fine=fine, whitener=SimpleNamespace(shape=(7, 5, 3)))
    left = left_by_meshes(cast(Any, one), Rod(ROPE, EI, GJ), np.zeros((35, 3)))
    assert left.shape == (7,) and not left.any()


def test_the_best_model_on_the_first_mesh_is_tried_on_the_finer_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pair that explained all was not found again there, and nothing was explained."""
    recording, finer, best = over_the_bar(30), object(), object()
    study, told = _study([recording], [known_noise(recording)], Workers(1), SETTINGS)

    def search(some: Study, settings: DiagnoseSettings, run: Workers, known: Sequence[Fitted] = ()) -> Any:
        if some is finer:
            raise InterruptedError(known)
        return SimpleNamespace(models=(best, object()))

    module = sys.modules[diagnose.__module__]
    stubs = {
        "_study": lambda *_: (study, told),
        "search": search,
        "on_the_side_seen": lambda *_: (study, []),
        "fine_enough": lambda *_: finer,
    }
    for name, stub in stubs.items():
        monkeypatch.setattr(module, name, stub)
    with pytest.raises(InterruptedError) as stopped:
        diagnose([recording], SETTINGS)
    assert stopped.value.args == ([best],)
