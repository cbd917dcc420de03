"""Is the laboratory fine enough? What twice the bodies, or half the steps, would change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dlolib.errors import SimulationError
from dlolib.proof.draw import Case, draw_case
from dlolib.proof.gain import left_over
from dlolib.proof.play import play
from dlolib.types import Noise

ENOUGH = 1.0
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
    anyway; `bodies_m` and `steps_m` are the largest changes of a point for twice the bodies and for half the
    steps [m].
    """
    names = EFFECTS[index]
    case = _playable(seed, index, names)
    fine = play(case.experiment, case.effects, 2 * case.bodies)
    left = left_over(case.experiment, fine, case.effects, WHITE, case.bodies, doubtless=ENOUGH)
    half = play(case.experiment, case.effects, case.bodies, finer=2)
    return {
        "effects": list(names),
        "obstacles": len(case.experiment.obstacles),
        "bodies": case.bodies,
        "gain": left.value,
        "bodies_m": float(np.abs(fine - case.points_m).max()),
        "steps_m": float(np.abs(half - case.points_m).max()),
    }


def _playable(seed: int, index: int, names: Sequence[str]) -> Case:
    for attempt in range(30):
        try:
            return draw_case(seed, index, names, 3.0 if names else None, attempt)
        except SimulationError:
            continue
    raise SimulationError("no motion could be played", mend="take another seed")
