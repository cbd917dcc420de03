"""What of a fit is the rope's own, and what belongs to the recording that it was found in."""

from __future__ import annotations

from dataclasses import replace

from dlolib.types import Fit

# How a recording's ends were held, what it was seen by, and what stood beside it: another layout has its own.
OF_THE_RECORDING = frozenset(
    {
        "camera_pose",
        "clock_offset",
        "end_angle",
        "end_compliance",
        "end_twist",
        "grasp_slip",
        "hidden_obstacle",
        "lateral_load",
        "length_error",
    }
)


def of_the_rope(fit: Fit) -> tuple[Fit, tuple[str, ...]]:
    """The fit with what the rope takes along to any layout: stiffnesses, laws, profiles, friction, history.

    Returns:
        That, without the nuisances of recordings, and the names of the effects that were left out.
    """
    own = {name: value for name, value in fit.parameters.items() if _effect(name) not in OF_THE_RECORDING}
    left = sorted({_effect(name) for name in fit.parameters.keys() - own.keys()})
    return replace(fit, parameters=own, nuisances={}), tuple(left)


def _effect(name: str) -> str:
    return name.partition(".")[0]
