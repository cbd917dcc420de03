"""What a diagnosis may answer: the laboratory decides, before any diagnosis, what is there to be found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dlolib.errors import SimulationError
from dlolib.proof.draw import SIGMA_M, Case, draw_case
from dlolib.proof.forms import FORMS, OVER_REST, nearest_parameters
from dlolib.proof.gain import DETECTABLE, GAIN_BODIES, Gain, gain
from dlolib.proof.motions import HELDOUT_FRAMES
from dlolib.proof.play import play, way
from dlolib.proof.world import Experiment
from dlolib.proof.write import write_case
from dlolib.types import Floats

# Half of the motions with an obstacle throw the rope over it sooner or later.
REDRAWS = 30


def detect(case: Case) -> dict[str, Any]:
    """Gains, and the detectable members: of a single effect over the elastic rope, of a pair over the other.

    The frames that the recording declares held out, which no diagnosis may fit, do not count; `everywhere` is
    the same with them. A twin that explains the pair nearly as well leaves no member detectable although
    something is there: `elastic_gain` tells.
    """
    if not case.effects:
        nothing: dict[str, Any] = {"detectable": [], "elastic_gain": 0.0}
        return nothing | {"gains": {}, "everywhere": nothing}
    whole = case.experiment
    truth = play(whole, case.effects, GAIN_BODIES)
    fitted = replace(whole, frame_t_s=whole.frame_t_s[:-HELDOUT_FRAMES])
    found = _gains(case, fitted, truth[:-HELDOUT_FRAMES])
    # what shows in part of the frames shows in all
    everywhere = found if set(found["detectable"]) == set(case.effects) else _gains(case, whole, truth)
    return found | {"everywhere": {name: everywhere[name] for name in ("detectable", "elastic_gain")}}


def _gains(case: Case, experiment: Experiment, truth: Floats) -> dict[str, Any]:
    seen = float(case.seen.mean())
    elastic = gain(experiment, truth, {}, case.noise)
    gains: dict[str, Gain] = {}
    for name in case.effects:
        others = {other: values for other, values in case.effects.items() if other != name}
        gains[name] = gain(experiment, truth, others, case.noise) if others else elastic
        # the elastic rope is one with others of no size: where the search from their true one ends above it
        gains[name] = min(gains[name], elastic, key=lambda one: one.value)
    # Lost points take their share of the information.
    shares = {name: seen * found.value for name, found in gains.items()}
    return {
        "detectable": sorted(name for name, value in shares.items() if value >= DETECTABLE),
        "gains": shares,
        "elastic_gain": seen * elastic.value,
        "elastic_bending_stiffness": elastic.bending_stiffness,
    }


def touched(case: Case) -> Floats | None:
    """Where the rope comes nearest to a hidden sphere, on its surface [m], (3,)."""
    ball = case.effects.get("hidden_obstacle")
    if ball is None:
        return None
    center = np.array([ball[axis] for axis in "xyz"])
    away = (case.points_m - center).reshape(-1, 3)
    nearest = away[np.linalg.norm(away, axis=1).argmin()]
    return np.asarray(center + ball["radius"] * nearest / np.linalg.norm(nearest))


def nearest_laws(case: Case) -> dict[str, dict[str, float]]:
    """What parameters of formats.md's laws come nearest to the laboratory's, where their forms differ."""
    laws = {name: values for name, values in case.effects.items() if name in FORMS}
    if not laws:
        return {}
    went = way(case.experiment, case.effects)
    memory = case.effects.get("rest_curvature", {})
    rest = np.array([memory.get("kappa_1", 0.0), memory.get("kappa_2", 0.0)])
    return {
        name: nearest_parameters(name, values, went.less(rest) if name in OVER_REST else went)
        for name, values in laws.items()
    }


def make_recording(
    seed: int,
    index: int,
    names: tuple[str, ...],
    name: str,
    recordings: Path,
    answers: Path,
    multiple: float | None = None,
) -> None:
    """Draw one case, write its recording and its answer; what is there already stays.

    Raises:
        SimulationError: none of many motions could be played.
    """
    if not (answers / f"{name}.json").exists():
        case, more = answered(seed, index, names, multiple)
        write_case(case, name, recordings, answers, **more)


def answered(
    seed: int,
    index: int,
    names: tuple[str, ...],
    multiple: float | None = None,
    settled_m: float = SIGMA_M,
) -> tuple[Case, dict[str, Any]]:
    """The first case that can be played, and what joins the truth in its answer; arguments as `draw_case`.

    Raises:
        SimulationError: none of many motions could be played.
    """
    for attempt in range(REDRAWS):
        try:
            case = draw_case(seed, index, names, multiple, attempt, settled_m)
            more = detect(case) | {"nearest": nearest_laws(case)}
            break
        except SimulationError:
            if attempt == REDRAWS - 1:
                raise
    touch = touched(case)
    return case, more | {"attempt": attempt, "touch_m": None if touch is None else touch.tolist()}
