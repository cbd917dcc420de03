"""A rope that was swung: taken for quasi-static, inertia is found to be left out; else nothing is."""

from dataclasses import replace

import numpy as np
from sim.ropes import EI, GJ, GRAVITY, ROPE
from sim.test_begun import SWINGING, noisy, seen

from dlolib.diagnose import DiagnoseSettings, diagnose
from dlolib.sim.continuum import elsewhere, mesh_error, refined
from dlolib.sim.effects import EFFECTS
from dlolib.sim.poses import model_of
from dlolib.sim.rod import Rod
from dlolib.sim.steps import dynamic_step
from dlolib.types import Ends, Motion, Noise, Points, Recording

KEPT = ("inertia_drag", "internal_friction", "end_angle", "stiffness_profile")


def test_inertia_is_named_where_the_recording_begins_in_motion() -> None:
    swung = replace(noisy(seen(SWINGING)), quasi_static=True)
    without = tuple(set(EFFECTS) - set(KEPT))
    settings = DiagnoseSettings(
        particles=20, longest_segment_m=1.0, workers=1, partners=2, without=without, most_effects=2
    )
    verdict = diagnose([swung], settings).verdict
    assert "inertia_drag" in {named.name for named in verdict.effects}, verdict.summary
    ei = verdict.augmented.parameters["bending_stiffness_over_density"]
    assert 0.8 * 0.03 < ei.value < 1.25 * 0.03


def pushed() -> Recording:
    """A hanging rope whose clamp goes 0.15 m aside in 0.3 s; no points are filled in yet."""
    t = np.linspace(0.0, 2.0, 201)
    u = np.clip((t - 0.2) / 0.3, 0.0, 1.0)
    start = np.stack([0.15 * (10 * u**3 - 15 * u**4 + 6 * u**5), 0 * t, 0 * t], axis=1)
    down, free = np.tile([0.0, 1.0, 0.0, 0.0], (len(t), 1)), np.full((len(t), 4), np.nan)
    motion = Motion(t, start, down, free[:, :3], free)
    frame, at, s = (
        np.repeat(np.arange(40), 12),
        np.linspace(0.05, 2.0, 40),
        np.linspace(0.0, ROPE.length_m, 12),
    )
    points = Points(frame, at[frame], np.tile(s, 40), np.zeros((len(frame), 3)))
    ends, noise = Ends("clamped", "free"), Noise(1e-3, 0.0, 0.0)
    return Recording("pushed", ROPE, GRAVITY, ends, motion, points, quasi_static=False, noise=noise)


def test_what_a_mesh_leaves_out_of_a_swing_is_not_taken_for_physics() -> None:
    """By more than a rope at rest may be off without resting elsewhere."""
    blank, rod = pushed(), Rod(ROPE, EI, GJ, {}, 30)
    model = model_of(blank, 30, dynamic_step(blank.motion, 0.01))
    assert elsewhere(mesh_error(model, refined(model, 2), rod), model)
    twice, often = (refined(model, finer) for finer in (2, 4))
    coarse_m, fine_m = (one.predict(rod.with_particles(one.particles)).xyz_m for one in (twice, often))
    true_m = fine_m + (fine_m - coarse_m) / 3
    noise_m = np.random.default_rng(0).normal(0.0, 1e-3, true_m.shape)
    recording = replace(blank, points=replace(blank.points, xyz_m=true_m + noise_m))
    settings = DiagnoseSettings(workers=1, without=tuple(set(EFFECTS) - {"end_angle"}), heldout_share=0.0)
    assert diagnose([recording], settings).verdict.status == "no_mismatch"
