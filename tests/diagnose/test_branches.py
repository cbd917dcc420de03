"""A rope that buckled to the other side by chance is told from one that something bends aside."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from sim.bar import over_the_bar
from sim.buckling import FLAT, FRAMES, seen_aside

from dlolib.diagnose import DiagnoseSettings, branches
from dlolib.diagnose.branches import on_the_side_seen, told_sides
from dlolib.diagnose.diagnose import raw_study
from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.search import Searched, baseline
from dlolib.diagnose.study import Study
from dlolib.diagnose.tasks import Task, refit
from dlolib.diagnose.workers import Workers
from dlolib.identify.parameters import Unknown
from dlolib.sim.recording import frame_of
from dlolib.types import Noise, Recording

SETTINGS = DiagnoseSettings(workers=1, heldout_share=0.1)
NAME, NOISE_M = "anisotropic_bending", 1e-3


def study_of(made: Recording) -> Study:
    study = raw_study([made], SETTINGS)
    seen = [
        replace(one, whitener=replace(one.whitener, noise=Noise(NOISE_M, 0.0, 0.0))) for one in study.seen
    ]
    return replace(study, seen=tuple(seen))


def test_a_flat_rope_is_found_on_the_side_to_which_it_went() -> None:
    """Where a simulation goes to the other side its fit stays away from what buckles."""
    study = study_of(seen_aside(NOISE_M, 233))
    elastic = baseline(study)
    begun = {**elastic.point, Unknown(f"{NAME}.stiffness_ratio"): 0.95}
    flat = refit(study, Task({NAME: ("stiffness_ratio",)}, (begun,), elastic.offsets_m, 1))
    assert flat is not None and flat.chi2 > 2 * flat.coordinates
    with Workers(1) as run:
        run.begin(study)
        sided, fits = on_the_side_seen(study, Searched(elastic, (flat,)), SETTINGS, run)
    assert len(fits) == 1 and abs(fits[0].chi2 - flat.coordinates) < 3 * np.sqrt(2 * flat.coordinates)
    ratio = fits[0].values(0)[f"{NAME}.stiffness_ratio"]
    assert ratio == pytest.approx(FLAT.effects[f"{NAME}.stiffness_ratio"], rel=0.02)
    sought = sided.seen[0].model.sought
    assert 5 < len(sought) <= FRAMES / 3 and sided.ahead[0].model.sought == sought
    assert not told_sides(study) and len(told_sides(sided)) == 1


def test_frames_in_which_the_rope_was_sought_are_told_in_runs() -> None:
    study = study_of(seen_aside())
    (one,) = study.seen
    points = one.recording.points
    some = tuple(frame_of(points, k) for k in (2, 3, 4, 7, 9, 10))
    sought = replace(study, seen=(replace(one, model=replace(one.model, sought=some)),))
    (told,) = told_sides(sought)
    assert "in frames 2 to 4, 7, 9 to 10 it was sought where it was seen" in told


def fitted(chi2: float, left: Sequence[float], effects: tuple[str, ...] = ()) -> Fitted:
    residuals = np.sqrt(np.asarray(left, float))[:, None, None]
    unknowns = (Unknown("bending_stiffness"),)
    return Fitted(effects, unknowns, np.ones(1), chi2, np.eye(1), (residuals,), (), 0, {}, (), 1)


FEW = [500.0 if k in (10, 11) else 60.0 for k in range(36)]
CASES = {
    "gains, and is as good as the best": (FEW, 2000.0, True),
    "gains, and others are better": (FEW, 2100.0, False),
    "gains no more than it may by another start": (FEW, 2950.0, False),
    "no frame stands out": ([60.0] * 36, 2000.0, False),
    "most of the frames stand out": ([500.0] * 20 + [60.0] * 16, 2000.0, False),
}


@pytest.mark.parametrize(("left", "after", "taken"), CASES.values(), ids=CASES)
def test_the_side_seen_is_taken_where_a_model_gains_by_it(
    left: Sequence[float], after: float, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = study_of(seen_aside())
    models = (fitted(2010.0, left, ("rest_curvature",)), fitted(3000.0, left, (NAME,)))
    monkeypatch.setattr(branches, "_begun", lambda study, one, settings: one)
    monkeypatch.setattr(branches, "task_from", lambda one: one)
    begun: list[Study] = []

    class Run:
        def begin(self, study: Study) -> None:
            begun.append(study)

        def __call__(self, function: Callable[..., Any], jobs: Sequence[Fitted], what: str) -> list[Fitted]:
            return [
                replace(one, chi2=min(one.chi2, after if one.effects == (NAME,) else np.inf)) for one in jobs
            ]

    searched = Searched(fitted(5000.0, left), models)
    sided, fits = on_the_side_seen(study, searched, SETTINGS, cast(Workers, Run()))
    assert (sided is not study) is bool(fits) is taken
    # the processes go on with the study that is returned
    assert not begun or begun[-1] is sided


def test_a_rope_among_obstacles_lies_where_they_let_it() -> None:
    study, model = raw_study([over_the_bar(30)], SETTINGS), fitted(5000.0, FEW)
    run = cast(Workers, SimpleNamespace())
    assert on_the_side_seen(study, Searched(model, ()), SETTINGS, run) == (study, [])
