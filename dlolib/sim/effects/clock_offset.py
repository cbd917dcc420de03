"""What the camera sees at t is the pose (place and turn) that the robot logged at t - time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dlolib.sim.effects.base import Parameter, Setup

NAME = "clock_offset"
SAYS = "the camera's clock and the robot's disagree"
OF_RECORDING = True
PARAMETERS = (
    Parameter("time", "s", "what the images lag behind the robot's log", 0.0, -5.0, 5.0, 0.02, (0.0,)),
)


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """The motion is read earlier by the offset."""
    return replace(setup, delay_s=values["time"])
