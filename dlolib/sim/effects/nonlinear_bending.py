"""Moment that is not proportional to curvature, k² = κ1² + κ2².

    M = EI κ (1 + c k²) for c > 0,   M = EI κ / √(1 + 2 |c| k²) for c < 0

(softening, monotone, the same to first order), κ over the curvature at rest.
"""

from dlolib.sim.effects.base import Parameter
from dlolib.sim.runtime import mat2, ti, vec2

NAME = "nonlinear_bending"
SAYS = "the rope's moment is not proportional to its curvature"
PARAMETERS = (
    Parameter(
        "cubic", "m^2", "growth of EI with the square of the curvature", 0.0, -1.0, 1.0, 1e-3, (0.003, -0.003)
    ),
)
IDEAL = True
FORGETS = True
SYMMETRIC, ROUND = False, True  # together with anisotropic_bending it has no potential


def coefficients(values):
    """c [m^2]."""
    return (values["cubic"], 0.0)


@ti.func
def respond(
    now: vec2, before: vec2, past: vec2, rest: vec2, p: vec2, d: vec2, ei: float, dt: float, branch: int
):
    """See `effects.base.Law`; there is no history."""
    c = p[0]
    k = now - rest
    square = k.dot(k)
    factor, slope = c * square, 2.0 * c
    energy = 0.25 * c * square
    if c < 0.0:
        root = ti.sqrt(1.0 - 2.0 * c * square)
        # 1 / root - 1, without its cancellation
        factor = 2.0 * c * square / (root * (1.0 + root))
        slope = 2.0 * c / (root * root * root)
        energy = c * square / ((1.0 + root) * (1.0 + root))
    none = mat2([[0.0, 0.0], [0.0, 0.0]])
    m_now = none
    for r in ti.static(range(2)):
        m_now[r, r] = factor * d[r]
        for j in ti.static(range(2)):
            m_now[r, j] += slope * d[r] * k[r] * k[j]
    work = energy * (d * k * k).sum()
    return factor * d * k, vec2(0.0), work, m_now, none, none, none, none, none, 0
