"""Meshes so fine that what they leave out of the continuous rod could not be taken for physics.

Extrapolated from 30 particles and 59, a free rope is as good as continuous. One that slides along an obstacle
on which nothing holds it, or all but snaps, goes millimetres further for a stiffness a percent less: there
the extrapolation itself is off, and least squares makes it up by whatever effect it can.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.study import Bools, DiagnoseSettings, Seen, Study
from dlolib.errors import SimulationError
from dlolib.identify.problem import axes
from dlolib.sim.continuum import LEFT, MOST_FINER, known_mesh_error, mesh_error, refined
from dlolib.sim.rod import Rod
from dlolib.types import Floats

# A finer mesh is worth its time if it leaves half of the error at most, of χ² a quarter: what does not come
# to that leaps between meshes, as a rope does that is all but limp in twist for want of an effect. Between
# two meshes one that slides may leap once: a finer one tells.
CONVERGES = 0.25


def fine_enough(
    study: Study, model: Fitted, settings: DiagnoseSettings, again: Callable[[Study], Fitted]
) -> Study:
    """The study on meshes that are fine enough for a fitted model: itself, where they are or none would be.

    Args:
        study, model, settings: see there.
        again: fits the model to a study on other meshes.
    """
    left = _left(study, model)
    finer, more = study, left
    while more.max() > LEFT:
        before, finer = finer, _finer(finer, more > LEFT, settings)
        if finer is before:
            break
        try:
            more = _left(finer, again(finer))
        except SimulationError:
            break  # a finer rope that cannot be simulated tells nothing
        if more.sum() <= CONVERGES * left.sum():
            study, left = finer, more
    return study


def _left(study: Study, model: Fitted) -> Floats:
    """What is left of each recording's mesh error (R,), in χ²; of one that is not quasi-static nothing that
    a mesh could mend: its time step leaves more out."""
    return np.array(
        [
            sum(left_by_meshes(part, study.rod(k, model.values(k))).sum() for part in study.parts(k))
            if one.recording.quasi_static
            else 0.0
            for k, one in enumerate(study.seen)
        ]
    )


def _finer(study: Study, which: Bools, settings: DiagnoseSettings) -> Study:
    """The study with the meshes of these recordings (R,) twice as fine, but for those that are fine already;
    steps in time stay as they were."""

    def doubled(k: int, one: Seen) -> Seen:
        usual = settings.particles_for(one.recording.rope.length_m)
        particles = 2 * one.model.particles - 1
        if not which[k] or particles > MOST_FINER * (usual - 1) + 1:
            return one
        return replace(one, model=replace(one.model, particles=particles))

    seen = tuple(doubled(k, one) for k, one in enumerate(study.seen))
    if all(new is old for new, old in zip(seen, study.seen, strict=True)):
        return study
    return replace(study, seen=seen, ahead={k: doubled(k, one) for k, one in study.ahead.items()})


def left_by_meshes(one: Seen, rod: Rod, offsets_m: Floats | None = None) -> Floats:
    """What the correction of the mesh's error leaves of it in each frame (F,), in χ²: how far from it the
    next finer meshes put the points. Next to nothing of a free rope; more of one that lies on an obstacle. 0
    where the finer rope has no equilibrium.

    Args:
        one: a recording on its mesh.
        rod: of any mesh.
        offsets_m: the correction (P, 3) [m], where it is not the rod's own.
    """
    own, finely = rod.with_particles(one.model.particles), rod.with_particles(one.fine.particles)
    try:
        if offsets_m is None:
            offsets_m = known_mesh_error(one.model, one.fine, own)
        finer_m = one.fine.predict(finely).xyz_m + mesh_error(one.fine, refined(one.fine, 2), finely)
        left = finer_m - one.model.predict(own).xyz_m - (0.0 if offsets_m is None else offsets_m)
    except SimulationError:
        return np.zeros(one.whitener.shape[0])
    return np.asarray(np.sum(one.whitener(left[:, axes(one.model), None]) ** 2, axis=(1, 2, 3)))
