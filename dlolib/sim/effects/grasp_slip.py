"""Rope slips through the end's grasp.

The free length is shorter by length · ½ (1 + tanh((t - time) / duration)).
Observed points keep their fraction of the free length, the mass of the free part stays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dlolib.sim.effects.base import Parameter, Setup, Slip

NAME = "grasp_slip"
SAYS = "the rope slips through the grasp"
OF_RECORDING = True
TIMES = (0.15, 0.3, 0.45, 0.6, 0.75, 0.9)
PARAMETERS = (
    Parameter("length", "m", "rope that slips through", 0.0, -0.2, 0.2, 0.001, (0.005, -0.005), end="end"),
    Parameter("time", "s", "the slip's middle", 0.0, -np.inf, np.inf, 0.5, TIMES, along="motion"),
    Parameter("duration", "s", "how long it lasts; 0: a step", 1.0, 0.0, 1e3, 0.2, (0.5,)),
)
SIZES = ("length",)
FORMS = (("length", "time"), ("length", "time", "duration"))


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """The rest lengths of the whole rope shrink together."""
    return replace(setup, slip=Slip(values["length"], values["time"], values["duration"]))
