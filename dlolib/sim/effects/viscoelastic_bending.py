"""A moment that depends on the rate, creeps and relaxes: a Maxwell branch beside EI.

    q' = -q / time + ratio EI κ',   M = EI κ + q

integrated exactly along a step, whose curvature changes evenly (Simo and Hughes 1998, section 10.3). What
happens at once (the way to the first shape) charges the branch in full.
"""

from dlolib.sim.effects.base import Parameter
from dlolib.sim.runtime import mat2, ti, vec2

NAME = "viscoelastic_bending"
SAYS = "the rope's moment depends on how fast it is bent, and relaxes"
PARAMETERS = (
    Parameter("modulus_ratio", "", "stiffness of the relaxing branch over EI", 0.0, 0.0, 20.0, 0.05, (0.3,)),
    Parameter(
        "relaxation_time",
        "s",
        "time in which the branch's moment falls to 1/e",
        5.0,
        0.002,
        500.0,
        0.5,
        (0.05, 1.0, 6.0, 30.0),
        along="duration",
    ),
)
IDEAL = True
SIZES = ("modulus_ratio",)
SYMMETRIC = True
RELAXES = 1


def coefficients(values):
    """Modulus ratio and relaxation time [s]."""
    return (values["modulus_ratio"], values["relaxation_time"]) if values["modulus_ratio"] else (0.0, 0.0)


@ti.func
def respond(
    now: vec2, before: vec2, past: vec2, rest: vec2, p: vec2, d: vec2, ei: float, dt: float, branch: int
):
    """See `effects.base.Law`; the history is q [N m]."""
    a = dt / p[1]
    fade = ti.exp(-a)
    share = 1.0 - a * (0.5 - a / 6.0)
    if a > 1e-4:
        share = (1.0 - fade) / a
    change = now - before
    charge = p[0] * share * d
    q = fade * past + charge * change
    work = fade * past.dot(change) + 0.5 * (charge * change * change).sum()
    none = mat2([[0.0, 0.0], [0.0, 0.0]])
    by_change, h_past = none, none
    for r in ti.static(range(2)):
        by_change[r, r] = charge[r]
        h_past[r, r] = fade
    return q, q, work, by_change, -by_change, h_past, by_change, -by_change, h_past, 0
