"""A clamp or grasp points elsewhere than recorded: R = R_recorded exp([a1, a2, 0])."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dlolib.sim.effects.base import ENDS, Parameter, Setup

NAME = "end_angle"
SAYS = "a clamp or grasp holds the rope at another angle than recorded"
OF_RECORDING = True
PARAMETERS = tuple(
    Parameter(
        f"{end}_{axis}",
        "rad",
        f"turn of the {end}'s frame about its axis {axis}",
        0.0,
        -1.0,
        1.0,
        0.01,
        (0.0,),
        end=end,
    )
    for end in ENDS
    for axis in (1, 2)
)
FORMS = (("start_1", "start_2"), ("end_1", "end_2"), ("start_1", "start_2", "end_1", "end_2"))


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """Both ends' frames turned."""
    start, end = (values["start_1"], values["start_2"]), (values["end_1"], values["end_2"])
    return replace(setup, turns=(start, end))
