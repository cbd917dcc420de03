"""The continuous rod that a mesh and a time step stand for: Richardson's extrapolation of its points.

n particles bend like a rod of a few percent less stiffness, an error that falls with the square of the
segments' length; implicit Euler damps a swinging rope, an error that falls with the step. A mesh so many
times as fine, in steps shorter by the square of that, shows most of both, and how much is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dlolib.sim.begun import motion_model
from dlolib.sim.poses import Model
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.sim.steps import dynamic_step
from dlolib.types import Floats, Recording

# A mesh's error is made anew at a fit's own optimum until it changes by no more than this share of the
# length, and so often at most: each time leaves some 3 % of what the stiffness was off at n = 30, 15 % at
# n = 15.
STANDS, MOST_CORRECTIONS = 1e-5, 6
# How the source of simulated points begins.
SIMULATED = "dlo simulate"


def refined(model: Model, finer: int) -> Model:
    """The same recording on a mesh so many times as fine, in steps shorter by the square of that."""
    finely = replace(model, particles=finer * (model.particles - 1) + 1)
    if isinstance(finely, RecordingModel) and finely.step_s is not None:
        return replace(finely, step_s=finely.step_s / finer**2)
    return finely


def mesh_error(model: Model, fine: Model, rod: Rod) -> Floats:
    """What the continuous rod adds to the points that the model predicts, (P, 3) [m].

    Args:
        model, fine: of one recording; `fine` is the other `refined`.
        rod: its stiffness and effects.

    Raises:
        SimulationError: it cannot be simulated on one of the meshes.
    """
    ratio = (fine.particles - 1) / (model.particles - 1)
    finely = fine.predict(rod.with_particles(fine.particles)).xyz_m
    return ratio**2 / (ratio**2 - 1) * (finely - model.predict(rod.with_particles(model.particles)).xyz_m)


def stands(before_m: Floats, after_m: Floats, length_m: float) -> bool:
    """Whether a mesh's error (P, 3) [m], made anew where it led a fit, is what it was: the fit is there."""
    return float(np.abs(after_m - before_m).max(initial=0.0)) < STANDS * length_m


def simulated(
    recording: Recording, rod: Rod, step_s: float | None = 0.01, sweeps: int | None = None, finer: int = 1
) -> Recording:
    """The recording with its points replaced by the simulated ones, at the same times and arc lengths.

    With effects the first shape is sought from that without them, as in a diagnosis: where a rope may rest in
    two shapes, both take the same.

    Args:
        recording, rod: what moves, and the rope with its mesh.
        step_s: longest step of the dynamic clock. sweeps: as in `RecordingModel`.
        finer: so many times as fine is the mesh that foretells the continuous rod; with 1, and with the
            iterative solver, whose stiffness depends on its mesh altogether, the points are the mesh's own.
    """
    near = replace(rod, effects={}) if rod.effects and sweeps is None else None
    if step_s is not None and sweeps is None:
        step_s = dynamic_step(recording.motion, step_s)
    model = motion_model(recording, rod.particles, step_s, sweeps, near)
    xyz = model.predict(rod).xyz_m
    if finer > 1 and sweeps is None:
        xyz = xyz + mesh_error(model, refined(model, finer), rod)
    points = replace(recording.points, xyz_m=xyz, covariance_m2=None)
    told = f"{SIMULATED} {recording.name}"
    return replace(recording, points=points, source=told, position_noise_m=0.0, noise=None)


__all__ = ["MOST_CORRECTIONS", "mesh_error", "refined", "simulated", "stands"]
