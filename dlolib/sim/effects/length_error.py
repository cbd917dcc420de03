"""The free length is (1 + relative) times the recorded one; points likewise; the total mass stays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dlolib.sim.effects.base import Parameter, Setup
from dlolib.sim.scene import LENGTH

NAME = "length_error"
SAYS = "the free rope is longer or shorter than recorded"
OF_RECORDING = True
PARAMETERS = (
    Parameter("relative", "", "free length over the recorded one, less 1", 0.0, -0.4, 0.4, 0.002, (0.0,)),
)


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """All rest lengths times (1 + relative); the points' arc lengths are fractions, which stay."""
    longer = 1.0 + values["relative"]
    joints, segments = setup.joints.copy(), setup.segments.copy()
    joints[:, LENGTH] *= longer
    segments[:, 0] *= longer
    return replace(setup, joints=joints, segments=segments)
