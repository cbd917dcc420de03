"""Is the laboratory fine enough? What twice the bodies, half the steps or harder obstacles would change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dlolib.errors import SimulationError
from dlolib.proof.draw import Case, draw_case
from dlolib.proof.gain import gain
from dlolib.proof.play import play
from dlolib.types import Noise

ENOUGH, HARDER = 1.0, 4.0
WHITE = Noise(0.0015, 0.0, 0.0)
EFFECTS: tuple[tuple[str, ...], ...] = (
    (),
    (),
    (),
    (),
    ("plastic_bending",),
    ("internal_friction",),
    ("viscoelastic_bending",),
    ("inertia_drag",),
    ("hidden_obstacle",),
    ("contact_friction",),
)


def refined(seed: int, index: int) -> dict[str, Any]:
    """What a finer laboratory would show of one of `EFFECTS`: nulls first, then what remembers or touches.

    `gain` is the noise-free chi-squared (white noise of 1.5 mm) that the best rope of as many bodies as the
    recording took leaves of one with twice as many and the same effects, refitted unless it is below 1
    anyway; `harder_gain` likewise of obstacles four times as hard. `bodies_m`, `steps_m` and `harder_m` are
    the largest changes of a point for twice the bodies, for half the steps and for such obstacles [m].
    """
    names = EFFECTS[index]
    case = _playable(seed, index, names)
    experiment, effects, bodies = case.experiment, case.effects, case.bodies
    fine = play(experiment, effects, 2 * bodies)
    hard = play(replace(experiment, hardness=HARDER * experiment.hardness), effects, bodies)
    half = play(experiment, effects, bodies, finer=2)
    left, harder = (gain(experiment, one, effects, WHITE, bodies, doubtless=ENOUGH) for one in (fine, hard))
    return {
        "effects": list(names),
        "obstacles": len(experiment.obstacles),
        "bodies": bodies,
        "gain": left.value,
        "bodies_m": float(np.abs(fine - case.points_m).max()),
        "steps_m": float(np.abs(half - case.points_m).max()),
        "harder_gain": harder.value,
        "harder_m": float(np.abs(hard - case.points_m).max()),
    }


def _playable(seed: int, index: int, names: Sequence[str]) -> Case:
    for attempt in range(30):
        try:
            return draw_case(seed, index, names, 3.0 if names else None, attempt)
        except SimulationError:
            continue
    raise SimulationError("no motion could be played", mend="take another seed")
