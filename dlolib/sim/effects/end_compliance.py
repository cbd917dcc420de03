"""A clamp gives way like a spring about both bending axes, in series with the clamp; twist stays held."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dlolib.sim.effects.base import ENDS, Parameter, Setup

NAME = "end_compliance"
SAYS = "a clamp gives way under the rope's moment"
OF_RECORDING = True
PARAMETERS = tuple(
    Parameter(
        f"{end}_stiffness",
        "N m/rad",
        f"moment over turn of the {end}'s clamp",
        np.inf,
        1e-6,
        np.inf,
        0.1,
        (0.01, 0.1),
        end=end,
    )
    for end in ENDS
)
FORMS = (("start_stiffness",), ("end_stiffness",), ("start_stiffness", "end_stiffness"))
# A clamp that gives way in bending is this much stiffer in roll than the rope's first segment in twist.
ROLL_OVER_TWIST = 1e5


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """Springs between the recorded frames and the rope's own at its ends."""
    grips = setup.grips.copy()
    for end, name in ((0, "start_stiffness"), (-1, "end_stiffness")):
        if np.isfinite(values[name]):
            twist = ROLL_OVER_TWIST * setup.joints[end, 2] / setup.joints[end, 6]
            grips[end] = (values[name], values[name], twist)
    return replace(setup, grips=grips)
