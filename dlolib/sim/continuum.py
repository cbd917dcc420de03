"""The continuous rod that a mesh and a time step stand for: Richardson's extrapolation of its points.

n particles bend like a rod of a few percent less stiffness, an error that falls with the square of the
segments' length; a swing takes a little too long, an error that falls with the square of the step. A mesh so
many times as fine, in steps as many times shorter, shows most of both, and how much is left.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from dlolib.errors import SimulationError
from dlolib.sim.begun import motion_model
from dlolib.sim.effects import parameter
from dlolib.sim.poses import Model, model_of, near
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.sim.steps import dynamic_step
from dlolib.types import Floats, Points, Recording

LOG = logging.getLogger(__name__)
BY_MESH = "its shape depends on the mesh: a finer one takes another; the points are those of {} particles"
# A mesh's error is made anew at a fit's own optimum until it changes by no more than this share of the
# length, and so often at most: each time leaves some 3 % of what the stiffness was off at n = 30, 15 % at
# n = 15.
STANDS, MOST_CORRECTIONS = 1e-5, 6
# A finer mesh moves no point by this share of the length unless the rope snaps: with so many segments it is
# off by some 0.002.
ELSEWHERE, USUAL = 0.02, 29
# What a mesh may leave of all points of a recording, over their variance, and how many times finer it is made
# for that.
LEFT, MOST_FINER = 2.0, 4
# Meshes foretell the same where no point is further apart than this share of the length.
AGREE = 1e-4
# By this share of its length a rope that cannot stretch is held too long before it is said.
TOO_LONG = 0.003
# What moves no point by so much does nothing.
IDLE_M = 1e-6
# What may make a rope as long as its ends are apart.
LENGTHENING = ("axial_stretch", "length_error", "grasp_slip")
# How the source of simulated points begins.
SIMULATED = "dlo simulate"


def refined(model: Model, finer: int) -> Model:
    """The same recording on a mesh so many times as fine, in steps as many times shorter."""
    finely = replace(model, particles=finer * (model.particles - 1) + 1)
    if isinstance(finely, RecordingModel) and finely.step_s is not None:
        return replace(finely, step_s=finely.step_s / finer)
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


def elsewhere(error_m: Floats, model: Model) -> bool:
    """Whether a mesh's error (P, 3) [m] is more than one: the finer rope snapped to another shape."""
    most = ELSEWHERE * max(1.0, USUAL / (model.particles - 1)) ** 2
    return float(np.abs(error_m).max(initial=0.0)) > most * model.recording.rope.length_m


def known_mesh_error(model: Model, fine: Model, rod: Rod) -> Floats | None:
    """The same as `mesh_error`, or None where the finer rope tells nothing of this one: it has no
    equilibrium, or rests in another shape. Of a rope that swings, errors may be as large.

    Raises:
        SimulationError: it cannot be simulated on the model's own mesh.
    """
    try:
        error = mesh_error(model, fine, rod)
    except SimulationError:
        model.predict(rod.with_particles(model.particles))
        return None
    return None if model.recording.quasi_static and elsewhere(error, model) else error


def stands(before_m: Floats, after_m: Floats, length_m: float) -> bool:
    """Whether a mesh's error (P, 3) [m], made anew where it led a fit, is what it was: the fit is there."""
    return float(np.abs(after_m - before_m).max(initial=0.0)) < STANDS * length_m


def simulated(
    recording: Recording, rod: Rod, step_s: float | None = 0.01, sweeps: int | None = None, finer: int = 1
) -> Recording:
    """The recording with its points replaced by the simulated ones, at the same times and arc lengths.

    As in a fit, settled poses each begin where the recording's own points are, if these are a rope's. With
    effects a motion's first shape is sought from that without them, as in a diagnosis: where a rope may rest
    in two shapes, both take the same.

    Args:
        recording, rod: what moves, and the rope with its mesh.
        step_s: longest step of the dynamic clock. sweeps: as in `RecordingModel`.
        finer: so many times as fine is the mesh that foretells the continuous rod, among obstacles of the
            first one on which it foretells what a finer one does; with 1, and with the iterative solver,
            whose stiffness depends on its mesh altogether, the points are the mesh's own.
    """
    if step_s is not None and sweeps is None:
        step_s = dynamic_step(recording.motion, step_s)
    ready = model_of if _are_of_a_rope(recording.points) else motion_model
    model: Model = ready(recording, rod.particles, step_s, sweeps)
    if rod.effects and sweeps is None:
        model = near(model, replace(rod, effects={}))
    xyz = model.predict(rod).xyz_m
    if finer > 1 and sweeps is None:
        continuous = _continuous(model, rod, finer)
        if continuous is None:
            LOG.warning("warning: %s: %s", recording.name, BY_MESH.format(rod.particles))
        else:
            xyz = continuous
    _say_too_long(recording, rod)
    _say_idle(model, rod)
    points = replace(recording.points, xyz_m=xyz, covariance_m2=None)
    told = f"{SIMULATED} {recording.name}"
    return replace(recording, points=points, source=told, position_noise_m=0.0, noise=None)


def _continuous(model: Model, rod: Rod, finer: int) -> Floats | None:
    """The continuous rod's points (P, 3) [m], or None where the mesh tells nothing of it.

    Along an obstacle on which nothing holds it a rope slides further on a coarse mesh than extrapolation
    makes up for: there twice as fine ones are tried until two foretell the same.
    """
    slides = bool(model.recording.obstacles) and model.recording.quasi_static
    found: Floats | None = None
    for times in (1, 2, MOST_FINER) if slides else (1,):
        fine = replace(model, particles=times * (model.particles - 1) + 1)
        finely = rod.with_particles(fine.particles)
        error = known_mesh_error(fine, refined(fine, finer), finely)
        if error is None:
            continue
        before, found = found, fine.predict(finely).xyz_m + error
        if before is not None and float(np.abs(found - before).max()) < AGREE * model.recording.rope.length_m:
            break
    return found


def _are_of_a_rope(points: Points) -> bool:
    """Whether no two neighbours of a frame are in one place, as where only times and arc lengths count."""
    apart_m = np.linalg.norm(np.diff(points.xyz_m, axis=0), axis=1)
    return bool((apart_m[np.diff(points.frame) == 0] > 0.0).all())


def _say_too_long(recording: Recording, rod: Rod) -> None:
    """A rope that cannot stretch and is held further apart than it is long gives way all the same."""
    if recording.ends.start != "clamped" or recording.ends.end != "clamped":
        return
    if {name.partition(".")[0] for name in rod.effects} & set(LENGTHENING):
        return
    motion, length = recording.motion, rod.rope.length_m
    apart = np.linalg.norm(motion.end_m - motion.start_m, axis=1)
    worst = int(np.argmax(apart))
    if apart[worst] > (1 + TOO_LONG) * length:
        at = f"at {motion.t_s[worst]:.4g} s the ends are held {apart[worst]:.4g} m apart"
        mend = "check the length, or give axial_stretch or length_error"
        LOG.warning("warning: %s: %s, the rope is %.4g m long; %s", recording.name, at, length, mend)


def _say_idle(model: Model, rod: Rod) -> None:
    """Effects that can do nothing in this recording, or belong to an end that nobody holds."""
    ends, name = model.recording.ends, model.recording.name
    for effect in dict.fromkeys(part.partition(".")[0] for part in rod.effects):
        own = {part for part in rod.effects if part.partition(".")[0] == effect}
        without = replace(rod, effects={part: rod.effects[part] for part in rod.effects if part not in own})
        held_at = {parameter(part).end for part in own if rod.effects[part] != parameter(part).neutral} - {""}
        if "free" in {getattr(ends, end) for end in held_at}:
            LOG.warning("warning: %s: %s is of an end that nobody holds", name, effect)
        elif _moves(model, rod, without) < IDLE_M:
            LOG.warning("warning: %s: %s does nothing here", name, effect)


def _moves(model: Model, rod: Rod, without: Rod) -> float:
    """How far [m] an effect moves any point at most."""
    one, other = model.setup(rod), model.setup(without)
    if one.mechanics == other.mechanics and one.camera == other.camera:
        return 0.0
    try:
        apart = model.predict(rod).xyz_m - model.predict(without).xyz_m
    except SimulationError:
        return np.inf  # without it there is no such rope
    return float(np.linalg.norm(apart, axis=1).max())


__all__ = [
    "LEFT",
    "MOST_CORRECTIONS",
    "MOST_FINER",
    "mesh_error",
    "refined",
    "simulated",
    "stands",
]
