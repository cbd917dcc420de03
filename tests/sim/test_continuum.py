"""What a mesh and a time step leave out is foretold from a finer mesh in finer steps."""

from dataclasses import replace

import numpy as np
import pytest
from sim.ropes import EI, GJ, ROPE
from sim.test_recording import recording

from dlolib.sim.continuum import mesh_error, refined, simulated
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.sim.steps import dynamic_step


def off(model: RecordingModel, finely: RecordingModel) -> tuple[float, float]:
    """How far the model is from a much finer one [m], as it is and corrected."""
    rod = Rod(ROPE, EI, GJ, particles=model.particles)
    true = finely.predict(rod.with_particles(finely.particles)).xyz_m
    coarse = model.predict(rod).xyz_m
    corrected = coarse + mesh_error(model, refined(model, 2), rod)
    return float(np.abs(coarse - true).max()), float(np.abs(corrected - true).max())


def test_a_coarse_mesh_tells_the_continuous_rod() -> None:
    model = RecordingModel(recording(), 30, None)
    plain, corrected = off(model, replace(model, particles=465))
    assert plain > 5e-4
    assert corrected < 0.05 * plain


def test_long_steps_tell_how_the_rope_swings() -> None:
    """Ten times as fast as recorded, the rope swings, and implicit Euler damps that."""
    made = recording()
    motion, points = made.motion, made.points
    fast = replace(
        made,
        quasi_static=False,
        motion=replace(motion, t_s=motion.t_s / 10),
        points=replace(points, t_s=points.t_s / 10),
    )
    model = RecordingModel(fast, 60, 0.002)
    plain, corrected = off(model, replace(model, particles=237, step_s=0.002 / 64))
    still = replace(model, recording=replace(fast, quasi_static=True), step_s=None)
    slow = off(still, replace(still, particles=237))[0]
    assert plain > 5 * slow
    assert corrected < 0.15 * plain


def test_steps_follow_what_the_rows_tell() -> None:
    motion = recording().motion
    assert dynamic_step(motion, 0.01) == 0.01
    assert dynamic_step(replace(motion, t_s=motion.t_s / 10), 0.01) == pytest.approx(0.0025)
    assert dynamic_step(replace(motion, t_s=motion.t_s[:1]), 0.01) == 0.01


def test_a_simulated_recording_is_the_continuous_rods() -> None:
    made, rod = recording(), Rod(ROPE, EI, GJ, particles=30)
    true = simulated(made, rod.with_particles(465)).points.xyz_m
    assert np.abs(simulated(made, rod, finer=4).points.xyz_m - true).max() < 2e-5
    assert np.abs(simulated(made, rod).points.xyz_m - true).max() > 5e-4
