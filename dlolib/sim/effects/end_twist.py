"""A held end is rolled: R = R_recorded exp([a1, a2, 0]) exp([0, 0, a])."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dlolib.sim.effects.base import Parameter, Setup

NAME = "end_twist"
SAYS = "a held end is rolled against what was recorded"
OF_RECORDING = True
PARAMETERS = (
    Parameter("start", "rad", "roll of the start", 0.0, -6.0, 6.0, 0.05, (0.0,), end="start"),
    Parameter("end", "rad", "roll of the end", 0.0, -6.0, 6.0, 0.05, (0.0,), end="end"),
)
FORMS = (("start",), ("end",), ("start", "end"))


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """Both ends' frames rolled, after `end_angle` turned them."""
    return replace(setup, rolls=(values["start"], values["end"]))
