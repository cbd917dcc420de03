"""What learning may be told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dlolib.errors import ParameterError
from dlolib.learn.arcs import TABLE_I_BOUNDS

Loss = Literal["contact", "mse"]


@dataclass(frozen=True)
class LearnSettings:
    """Settings of Algorithm 2; iterations, weights, h, k and Λ default to the paper's Table I.

    Args:
        iterations: most updates of the weights.
        rate: Adam's learning rate η; Table I has 0.001, with which 200 iterations often are too few.
        forgetting: Adam's β2; 0.9 instead of the usual 0.999, since the first contact's large gradient would
            else hold the steps small for hundreds of iterations.
        contact_weight, goal_weight: ω1 and ω2 [1/m] of (19), whose loss is a length, as in the paper.
        steps: h, simulation steps of the whole path.
        segments: k, sub-trajectories; a divisor of `steps`.
        bounds: Λ = (φ [rad a step], s, θ [rad], Δx [m], Δz [m]).
        hidden: neurons of the two hidden layers (the paper's figure does not survive in its text).
        seed: of the initial weights.
        starts: initial weights to try, of seeds seed, seed + 1, ..., until a path is free and near the goal.
        first_arc: the first path is an arc beside AB with this share of Λ's rate of turn; every seed is tried
            on the one side, then on the other. 0: Xavier's weights alone, whose first path hardly moves;
            the sign of φ that the first contact then chooses soon saturates, on the wrong side as often.
        caught_after, caught_m: weights whose mean goal error has not been below this after so many iterations
            are caught behind an obstacle, and the next are tried.
        near_goal_m: the mean goal error at which that is so; the best of all starts is kept otherwise.
        loss: "contact" for (19) whole, "mse" for its second term alone, as in the ablation.
        step_s: duration of a step [s]: how slowly the trajectory is driven.
        particles: n of the rod.
        contact_margin_m: while learning, the rope counts as thicker by this on every side, so that a path
            free of contact keeps about this clearance.
        contact_zone_m: a particle whose surface is nearer to an obstacle than this counts as contact in the
            loss; more than the margin, so that the term does not go on and off from iterate to iterate.
        clearance_m: an iterate with less clearance is no result.
        goal_tolerance_m: among iterates with a smaller mean goal error the one with most clearance is
            kept; where there is none, the one with the smallest error.
    """

    iterations: int = 200
    rate: float = 0.002
    forgetting: float = 0.9
    contact_weight: float = 0.1
    goal_weight: float = 1.0
    steps: int = 300
    segments: int = 10
    bounds: tuple[float, float, float, float, float] = TABLE_I_BOUNDS
    hidden: tuple[int, int] = (64, 32)
    seed: int = 1
    starts: int = 4
    first_arc: float = 0.75
    near_goal_m: float = 0.002
    caught_after: int = 50
    caught_m: float = 0.025
    loss: Loss = "contact"
    step_s: float = 0.05
    particles: int = 30
    contact_margin_m: float = 0.003
    contact_zone_m: float = 0.007
    clearance_m: float = 0.002
    goal_tolerance_m: float = 0.001

    def __post_init__(self) -> None:
        if self.segments < 1 or self.steps < self.segments or self.steps % self.segments:
            problem = f"{self.steps} steps do not divide into {self.segments} sub-trajectories"
            raise ParameterError(problem, place="learn.steps", mend="choose a multiple of learn.segments")
        if self.contact_margin_m < self.clearance_m:
            problem = (
                f"a margin of {self.contact_margin_m:g} m is less than the clearance {self.clearance_m:g} m"
            )
            raise ParameterError(
                problem, place="learn.contact_margin_m", mend="make it the larger of the two"
            )
        if not self.contact_zone_m > self.contact_margin_m:
            problem = (
                f"a zone of {self.contact_zone_m:g} m is within the margin of {self.contact_margin_m:g} m, "
                "where the rope is never"
            )
            raise ParameterError(problem, place="learn.contact_zone_m", mend="make it the larger of the two")
        if not abs(self.first_arc) < 1:
            problem = f"{self.first_arc:g} is no share of a rate of turn"
            raise ParameterError(problem, place="learn.first_arc", mend="give 0, or a share below 1")
        if self.loss not in ("contact", "mse"):
            raise ParameterError(f"loss {self.loss!r}", place="learn.loss", mend="choose contact or mse")
