"""observed = exp(rotation) true + depth x viewing axis + shift, about the world's origin.

The axis is the camera's +z in world axes, world +y where the recording names no camera. The shift is what may
lie between two recordings of one object; no single recording's camera is suspected of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dlolib.sim.effects.base import Camera, Parameter, Setup

NAME = "camera_pose"
SAYS = "the camera stands or looks elsewhere than its calibration says"
OF_RECORDING = True
PARAMETERS = (
    *(
        Parameter(f"rotation_{k}", "rad", f"turn about world axis {k}", 0.0, -0.5, 0.5, 0.005, (0.0,))
        for k in (1, 2, 3)
    ),
    Parameter("depth", "m", "shift along the viewing axis", 0.0, -0.5, 0.5, 0.002, (0.0,)),
    *(
        Parameter(f"shift_{k}", "m", f"shift along world axis {k}", 0.0, -0.5, 0.5, 0.002, (0.0,))
        for k in (1, 2, 3)
    ),
)
ROTATION = ("rotation_1", "rotation_2", "rotation_3")
SIZES = (*ROTATION, "depth")
FORMS = (("depth",), ROTATION, (*ROTATION, "depth"))


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """The rope moves as before; only what is seen of it changes."""
    turn = (values["rotation_1"], values["rotation_2"], values["rotation_3"])
    shift = (values["shift_1"], values["shift_2"], values["shift_3"])
    return replace(setup, camera=Camera(turn, values["depth"], shift))
