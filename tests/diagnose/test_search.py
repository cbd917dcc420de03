"""The search's own choices, on fits that are made up."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.search import _refined, _settled
from dlolib.diagnose.study import Study
from dlolib.diagnose.tasks import Task
from dlolib.diagnose.workers import Workers
from dlolib.identify.parameters import Unknown

STUDY = cast(Study, SimpleNamespace(frames=70))


def fitted(chi2: float, effects: tuple[str, ...] = (), parts: Sequence[str] = ()) -> Fitted:
    names = ["bending_stiffness", *(f"{effects[-1]}.{part}" for part in parts)]
    unknowns = tuple(map(Unknown, names))
    theta = np.ones(len(names))
    return Fitted(effects, unknowns, theta, chi2, np.eye(len(names)), (), (), 1)


LUMP, SLOPED = ("s", "mass"), ("s", "mass", "gradient")


def test_which_form_is_best_shows_with_the_mesh_error_of_each() -> None:
    """The larger form is ahead until the mesh's error is that at each one's own optimum."""
    baseline = fitted(8400.0)
    found = [fitted(8182.6, ("mass_profile",), LUMP), fitted(8165.2, ("mass_profile",), SLOPED)]
    found.append(fitted(8390.0, ("end_angle",), ("start_1",)))
    after = {LUMP: 8163.6, SLOPED: 8160.0}

    def run(function: Callable[[Study, Task], Any], jobs: Sequence[Task], what: str) -> list[Fitted | None]:
        chosen = [job.terms["mass_profile"] for job in jobs]
        return [fitted(after[parts], ("mass_profile",), parts) for parts in chosen]

    best = _refined(STUDY, found, baseline, cast(Workers, run), "effects")
    assert [one.effects for one in best] == [("mass_profile",), ("end_angle",)]
    assert [u.name for u in best[0].unknowns[1:]] == ["mass_profile.s", "mass_profile.mass"]
    assert best[0].chi2 == after[LUMP]


def test_the_winner_is_one_whose_mesh_error_stands() -> None:
    """A pair is ahead of its first effect only as long as the mesh's error of that does not stand."""
    baseline = fitted(10770.1)
    alone = fitted(8110.2, ("anisotropic_bending",), ("stiffness_ratio",))
    pair = fitted(8090.7, ("anisotropic_bending", "rest_curvature"), ("kappa_1", "kappa_2"))
    far = fitted(10000.0, ("mass_profile",), LUMP)
    stand = {id(alone): 8091.7, id(pair): 8090.2}

    def run(function: Callable[[Study, Fitted], Any], jobs: Sequence[Fitted], what: str) -> list[Fitted]:
        return [replace(job, chi2=stand[id(job)]) for job in jobs]

    best = _settled(STUDY, [pair, alone, far], baseline, cast(Workers, run))
    assert [one.effects for one in best] == [alone.effects, pair.effects, far.effects]
