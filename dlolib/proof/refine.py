"""Is the laboratory fine enough? What twice the bodies, half the steps or harder obstacles would change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dlolib.errors import SimulationError
from dlolib.proof.draw import Case, draw_case
from dlolib.proof.gain import GAIN_BODIES, gain
from dlolib.proof.play import play
from dlolib.types import Noise

ENOUGH, HARDER = 1.0, 4.0
WHITE = Noise(0.0015, 0.0, 0.0)
LARGE, SMALL = 3.0, 0.5
# Names and size over the one that is found. A rope with little drag swings longest.
EFFECTS: tuple[tuple[tuple[str, ...], float | None], ...] = (
    ((), None),
    ((), None),
    ((), None),
    ((), None),
    (("plastic_bending",), LARGE),
    (("internal_friction",), LARGE),
    (("viscoelastic_bending",), LARGE),
    (("inertia_drag",), LARGE),
    (("hidden_obstacle",), LARGE),
    (("contact_friction",), LARGE),
    (("inertia_drag",), SMALL),
)


def refined(seed: int, index: int) -> dict[str, Any]:
    """What a finer laboratory would show of one of `EFFECTS`: nulls first, then what remembers or touches.

    `gain` is the noise-free chi-squared (white noise of 1.5 mm) that the best rope of as many bodies as the
    recording took leaves of one with twice as many and the same effects, refitted unless it is below 1
    anyway; `steps_gain` and `harder_gain` likewise of half the steps and of harder obstacles, with
    the bodies that gains are taken with. `bodies_m`, `steps_m` and `harder_m` are the largest changes of a
    point for these [m]. `row_s` is the time between rows of the motion, `size` that of the effects over the
    one that is found.
    """
    names, size = EFFECTS[index]
    case = _playable(seed, index, names, size)
    experiment, effects, bodies = case.experiment, case.effects, case.bodies
    hard = replace(experiment, hardness=HARDER * experiment.hardness)
    shown = play(experiment, effects, GAIN_BODIES)
    fine = play(experiment, effects, 2 * bodies)
    half = play(experiment, effects, GAIN_BODIES, finer=2)
    harder = play(hard, effects, GAIN_BODIES)
    left = gain(experiment, fine, effects, WHITE, bodies, doubtless=ENOUGH)
    less, more = (gain(experiment, one, effects, WHITE, doubtless=ENOUGH) for one in (half, harder))
    return {
        "effects": list(names),
        "size": size,
        "row_s": float(np.median(np.diff(experiment.motion.t_s))),
        "obstacles": len(experiment.obstacles),
        "bodies": bodies,
        "gain": left.value,
        "bodies_m": float(np.abs(fine - case.points_m).max()),
        "steps_gain": less.value,
        "steps_m": float(np.abs(half - shown).max()),
        "harder_gain": more.value,
        "harder_m": float(np.abs(harder - shown).max()),
    }


def _playable(seed: int, index: int, names: Sequence[str], size: float | None) -> Case:
    for attempt in range(30):
        try:
            return draw_case(seed, index, names, size, attempt)
        except SimulationError:
            continue
    raise SimulationError("no motion could be played", mend="take another seed")
