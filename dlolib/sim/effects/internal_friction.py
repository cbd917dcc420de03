"""Rate-free hysteresis between a cable's strands: Dahl's model (1968), in both axes.

    M = EI (κ + z),   dz = (sat dκ/|dκ| - z) |dκ| / trans,   z = 0 while straight

integrated exactly along a step, whose curvature goes in a straight line. EI z takes the rope's uniform EI.
"""

from dlolib.sim.effects.base import Parameter
from dlolib.sim.runtime import mat2, ti, vec2

NAME = "internal_friction"
SAYS = "the strands of the rope rub against each other as it bends"
PARAMETERS = (
    Parameter(
        "saturation_curvature", "1/m", "moment of friction over EI, at most", 0.0, 0.0, 50.0, 0.1, (0.5, 2.0)
    ),
    Parameter(
        "transition_curvature",
        "1/m",
        "change of curvature over which it builds up",
        3.0,
        0.05,
        60.0,
        0.1,
        (0.5, 3.0),
    ),
)
IDEAL = True
REMEMBERS = True
SIZES = ("saturation_curvature",)
SYMMETRIC = False


def coefficients(values):
    """Saturation and transition curvature [1/m]."""
    if values["saturation_curvature"] == 0.0:
        return (0.0, 0.0)
    return (values["saturation_curvature"], values["transition_curvature"])


@ti.func
def respond(
    now: vec2, before: vec2, past: vec2, rest: vec2, p: vec2, d: vec2, ei: float, dt: float, branch: int
):
    """See `effects.base.Law`; the history is z."""
    saturation, transition = p[0], p[1]
    change = now - before
    s = change.norm()
    a = s / transition
    fade = ti.exp(-a)
    # f = (1 - fade) / s and its derivative over s
    f = (1.0 - a * (0.5 - a / 6.0)) / transition
    slope = -(0.5 - a / 3.0) / (transition * transition)
    lost = saturation * s * a * (0.5 - a / 6.0)
    if a > 1e-4:
        f = (1.0 - fade) / s
        slope = (fade / transition - f) / s
        lost = saturation * (s - transition * (1.0 - fade))
    direction = change / ti.max(s, 1e-300)
    z = fade * past + saturation * f * change
    by_change = saturation * slope * change.outer_product(direction)
    by_change -= past.outer_product(direction) * fade / transition
    none = mat2([[0.0, 0.0], [0.0, 0.0]])
    h_past = none
    for r in ti.static(range(2)):
        by_change[r, r] += saturation * f
        h_past[r, r] = fade
    work = ei * (lost + past.dot(change) * transition * f)
    return ei * z, z, work, ei * by_change, -ei * by_change, ei * h_past, by_change, -by_change, h_past, 0
