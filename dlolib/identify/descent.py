"""The paper's own identification (Section VI.A): gradient descent on its inverse bending stiffness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from autograd.misc.optimizers import sgd

from dlolib.identify.identify import IdentifySettings
from dlolib.identify.problem import axes
from dlolib.progress import track
from dlolib.sim.iterative import stiffness_from_alpha_b
from dlolib.sim.poses import model_of
from dlolib.sim.rod import Rod
from dlolib.types import Floats, Recording

# No descent step leaves the positive numbers: an inverse stiffness of this much is a steel rod's.
SMALLEST_ALPHA_B = 1e-6


@dataclass(frozen=True)
class DescentSettings:
    """The paper's figures: start 0.1, rate 1e-4, 300 iterations, in alpha_b with unit particle masses."""

    start: float = 0.1
    rate: float = 1e-4
    iterations: int = 300


@dataclass(frozen=True)
class Descended:
    """Where the descent ended. loss: one row an iteration: iteration, loss_m, alpha_b, bending_stiffness."""

    alpha_b: float
    bending_stiffness: float
    loss_m: float
    loss: pd.DataFrame


def descend(recording: Recording, descent: DescentSettings, settings: IdentifySettings) -> Descended:
    """Minimise the loss (12) over alpha_b alone, by its gradient through the simulator.

    dL/dalpha_b = sum over frames and points of (x - y) / |x - y| . dx/dEI dEI/dalpha_b / n.
    """
    n = settings.particles_for(recording.rope.length_m)
    model = model_of(recording, n, settings.time_step_s)
    per_frame = 1.0 / pd.Series(recording.points.frame).groupby(recording.points.frame).transform(
        "size"
    ).to_numpy(float)
    observed = recording.points.xyz_m[:, axes(model)]
    rows: list[dict[str, float]] = []
    steps = iter(track(range(descent.iterations + 1), f"{recording.name}: gradient descent"))

    def gradient(alpha: Floats, _: int) -> Floats:
        next(steps, None)
        alpha_b = max(float(alpha[0]), SMALLEST_ALPHA_B)
        stiffness = stiffness_from_alpha_b(alpha_b, recording.rope, n)
        rod = Rod(recording.rope, stiffness, stiffness, particles=n)
        made = model.predict(rod, ["bending_stiffness"])
        difference = made.xyz_m[:, axes(model)] - observed
        distance = np.linalg.norm(difference, axis=1)
        rows.append(
            {
                "iteration": len(rows),
                "loss_m": float(np.sum(distance * per_frame)),
                "alpha_b": alpha_b,
                "bending_stiffness": stiffness,
            }
        )
        unit = difference / np.maximum(distance, 1e-12)[:, None]
        by_stiffness = float(np.sum(unit * made.by_parameter[:, axes(model), 0] * per_frame[:, None]))
        return np.array([-by_stiffness * stiffness / alpha_b])

    end = sgd(
        gradient, np.array([descent.start]), num_iters=descent.iterations, step_size=descent.rate, mass=0.0
    )
    gradient(end, descent.iterations)  # the loss where it ended
    loss = pd.DataFrame(rows)
    last = loss.iloc[-1]
    return Descended(float(last["alpha_b"]), float(last["bending_stiffness"]), float(last["loss_m"]), loss)
