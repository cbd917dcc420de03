"""Permanent bending past a yield curvature: linear kinematic hardening (Prager), twist elastic.

    M = EI (κ - κp),   |M - H EI κp| ≤ EI κy,   dκp along M - H EI κp

with κ over the curvature at rest, the norm over both material axes, and a return mapping that minimises the
step's incremental energy (Simo and Hughes, Computational Inelasticity, 1998, chapter 1; here with two
stiffnesses where the rope is anisotropic). EI κy and H EI κp take the rope's uniform EI.
"""

import numpy as np

from dlolib.sim.effects.base import Parameter
from dlolib.sim.runtime import mat2, ti, vec2

NAME = "plastic_bending"
SAYS = "the rope stays bent where it was bent past a yield curvature"
PARAMETERS = (
    Parameter(
        "yield_curvature",
        "1/m",
        "curvature past which it stays bent",
        np.inf,
        0.3,
        200.0,
        0.1,
        (0.1, 0.2, 0.35, 0.6, 0.9),
        along="bend",
    ),
    Parameter(
        "hardening_ratio",
        "",
        "kinematic modulus H over EI; past it H / (1 + H) of EI is left",
        0.0,
        0.0,
        2.0,
        0.05,
        (0.2,),
    ),
)
IDEAL = True
ABRUPT = True
REMEMBERS = True
SIZES = ("yield_curvature",)
SYMMETRIC = True
# How exactly the trial moment is mapped back, in shares of it.
ROUNDING = 4e-16


def coefficients(values):
    """Yield curvature [1/m], 0 for a rope that never yields, and hardening ratio."""
    limit = values["yield_curvature"]
    return (limit if np.isfinite(limit) else 0.0, values["hardening_ratio"])


@ti.func
def respond(
    now: vec2, before: vec2, past: vec2, rest: vec2, p: vec2, d: vec2, ei: float, dt: float, branch: int
):
    """See `effects.base.Law`; the history is κp."""
    limit, hardening = ei * p[0], ei * p[1]
    a = d + hardening
    elastic = now - rest
    trial = d * (elastic - past) - hardening * past
    flow = vec2(0.0)
    by_trial = mat2([[0.0, 0.0], [0.0, 0.0]])
    size = trial.norm()
    g = 0.0
    yields = branch
    if branch < 0:
        yields = 0
        if size > limit:
            yields = 1
    if yields == 1:
        # |trial_k / (limit + a_k g)| = 1 for the multiplier g; exact at once where both axes are equal
        g = (size - limit) / ti.max(a[0], a[1])
        for _ in range(12):
            u = trial / (limit + a * g)
            off = u.norm() - 1.0
            if ti.abs(off) < ROUNDING:
                break
            g += off * u.norm() / (u * u * a / (limit + a * g)).sum()
        w = 1.0 / (limit + a * g)
        n = (trial * w).normalized()
        flow = g * n
        wn = w * n
        scale = 1.0 / (n * a * wn).sum()
        for r in ti.static(range(2)):
            by_trial[r, r] = g * w[r]
            for c in ti.static(range(2)):
                by_trial[r, c] += scale * (1.0 - g * w[r] * a[r]) * n[r] * wn[c]
    plastic = past + flow
    left = elastic - plastic
    work = 0.5 * (d * left * left).sum() - 0.5 * (d * elastic * elastic).sum()
    work += 0.5 * hardening * plastic.dot(plastic) + limit * g
    none = mat2([[0.0, 0.0], [0.0, 0.0]])
    m_now, m_past, h_now, h_past = none, none, none, none
    for r in ti.static(range(2)):
        h_past[r, r] = 1.0
        for c in ti.static(range(2)):
            m_now[r, c] = -d[r] * by_trial[r, c] * d[c]
            h_now[r, c] = by_trial[r, c] * d[c]
            h_past[r, c] -= by_trial[r, c] * a[c]
    for r in ti.static(range(2)):
        for c in ti.static(range(2)):
            m_past[r, c] = -d[r] * h_past[r, c]
    return -d * plastic, plastic, work, m_now, none, m_past, h_now, none, h_past, yields
