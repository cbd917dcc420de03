"""What happened before the recording: the rope was once bent to a uniform curvature, and only then to its
first shape.

It was bent there from straight in a straight line of the curvature, at once, and from there to the first
row's shape likewise. Laws with history (`plastic_bending`, `internal_friction`) see that detour. A Maxwell
branch that is charged and discharged at once keeps nothing of it, and a rope without such a law neither.
"""

from __future__ import annotations

from collections.abc import Mapping

from dlolib.sim.effects.base import Parameter, Setup
from dlolib.sim.scene import PRIOR

NAME = "prior_history"
SAYS = "the rope was bent before the recording, and remembers"
OF_RECORDING = True
STARTS = (-10.0, 10.0)
PARAMETERS = (
    Parameter("kappa_1", "1/m", "curvature it once had about the first axis", 0.0, -60.0, 60.0, 0.1, STARTS),
    Parameter("kappa_2", "1/m", "curvature it once had about the second axis", 0.0, -60.0, 60.0, 0.1, STARTS),
)


def apply(setup: Setup, values: Mapping[str, float]) -> Setup:
    """The same earlier curvature in every joint."""
    return setup.with_joints(slice(PRIOR, PRIOR + 2), [values["kappa_1"], values["kappa_2"]])
