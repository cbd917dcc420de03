"""The figures that the paper states, in one place (Ying and Yamazaki, sections VI-A and VI-B).

C. Ying and K. Yamazaki, "Motion Generation for Shaping Deformable Linear Objects with Contact Avoidance
Using Differentiable Simulation".
"""

from __future__ import annotations

CITATION = (
    "C. Ying and K. Yamazaki, Motion Generation for Shaping Deformable Linear Objects with Contact "
    "Avoidance Using Differentiable Simulation"
)
ROPE_LENGTH_M = 0.445
LINEAR_DENSITY_KG_M = 0.04
"""Not in the paper: the density that the laboratory's rope has, needed to turn α_b into newton metres."""
PARTICLES = 30
IDENTIFY_ITERATIONS = 300
START_ALPHA_B = 0.1
FINAL_ALPHA_B = 0.0089
FINAL_LOSS_M = 0.2
"""Fig. 9: the loss (12) converges to about 0.2 m over 40 frames, which is 5 mm a point."""
LEARN_ITERATIONS = 200
FINAL_CONTACT_LOSS_M = 0.01
"""Fig. 11: with the contact term the loss falls below 0.01 m."""


def stiffness_n_m2(alpha_b: float, linear_density_kg_m: float = LINEAR_DENSITY_KG_M) -> float:
    """EI [N m²] that the paper's inverse stiffness α_b stands for.

    For C_b = Im(q̄q') ≈ κ l / 2 the energy EI κ² l / 2 needs EI = l / (4 α_b); the paper's particles have
    unit mass, so the true mass ρ l of a particle scales it: EI = l ρ l / (4 α_b · 1 kg).
    """
    segment_m = ROPE_LENGTH_M / (PARTICLES - 1)
    return segment_m * linear_density_kg_m * segment_m / (4 * alpha_b)
