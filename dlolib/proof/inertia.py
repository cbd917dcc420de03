"""Inertia and drag at the chain's vertices: one step in time as a few balances of the chain.

Alexander's diagonally implicit Runge-Kutta method of order three (SIAM J. Numer. Anal. 14 (1977), 1006): each
stage is a balance with a Drift, the last of them ends the step, and nothing that swings faster than the steps
can follow is left to ring on.
"""

from __future__ import annotations

import numpy as np

from dlolib.proof.equilibrium import Drift
from dlolib.proof.world import Effects, Experiment, vertex_masses
from dlolib.types import Floats

# The root of x³ - 3 x² + 3/2 x - 1/6 between a sixth and a half.
GAMMA = 0.4358665215084590
_LATER = -1.5 * GAMMA**2 + 4 * GAMMA - 0.25
STAGES = ((GAMMA,), ((1 - GAMMA) / 2, GAMMA), (_LATER, 1 - GAMMA - _LATER, GAMMA))
# When each of them is, as a share of the step.
SHARES = (GAMMA, (1 + GAMMA) / 2, 1.0)


class Inertia:
    """The chain's motion through the stages of a step.

    Args:
        experiment, effects: with `inertia_drag`.
        bodies: of the chain.
        vertices: where it stands at first (N + 1, 3) [m].
    """

    def __init__(self, experiment: Experiment, effects: Effects, bodies: int, vertices: Floats) -> None:
        effect = effects["inertia_drag"]
        self.mass = effect["inertia"] * vertex_masses(experiment, effects, bodies)[:, None]
        length = np.full((bodies + 1, 1), experiment.sizes.length_m / bodies)
        length[[0, -1]] /= 2
        self.drag = effect["drag"] * length
        # Place and velocity at the step's begin; velocity and acceleration in each stage of it since.
        self.state = vertices.copy(), np.zeros_like(vertices)
        self.rates: list[tuple[Floats, Floats]] = []

    def drift(self, step_s: float) -> Drift:
        """The missing force of the next stage as rate * x - drift, of a step that takes so long."""
        place, velocity, own_s = self._begin(step_s)
        return Drift(
            self.mass / own_s**2 + self.drag / own_s,
            self.mass * (place / own_s + velocity) / own_s + self.drag * place / own_s,
        )

    def keep(self, vertices: Floats, step_s: float) -> None:
        """Take where a stage's balance is (N + 1, 3) [m]; the last one ends the step."""
        place, velocity, own_s = self._begin(step_s)
        speed = (vertices - place) / own_s
        self.rates.append((speed, (speed - velocity) / own_s))
        if len(self.rates) == len(STAGES):
            self.state, self.rates = (vertices.copy(), speed), []

    def _begin(self, step_s: float) -> tuple[Floats, Floats, float]:
        """Place and velocity that the stage's own rates are added to, over its own time [s]."""
        *earlier, own = STAGES[len(self.rates)]
        place, velocity = self.state
        for share, (speed, acceleration) in zip(earlier, self.rates, strict=True):
            place = place + share * step_s * speed
            velocity = velocity + share * step_s * acceleration
        return place, velocity, own * step_s
