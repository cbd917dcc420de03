"""A flat rope that stands on edge between two clamps, and buckles out of its plane while they are close."""

from dataclasses import replace

import numpy as np
from sim.ropes import EI, GRAVITY, LEVEL, ROPE

from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.types import Ends, Motion, Points, Recording

FRAMES, SEEN = 40, 20
FLAT = Rod(ROPE, EI, 0.7 * EI, {"anisotropic_bending.stiffness_ratio": 0.7}, particles=30)
ASIDE = np.array([1.0, -1.0, 1.0])


def buckling() -> Recording:
    """Its points are in the plane: nothing was seen yet."""
    t_s = np.linspace(0.0, 6.0, 61)
    end_m = np.outer(0.36 - 0.16 * np.sin(np.pi * t_s / 6) ** 16, [1.0, 0.0, 0.0])
    held = np.tile(LEVEL, (61, 1))
    motion = Motion(t_s, np.zeros((61, 3)), held, end_m, held)
    frame, s_m = np.repeat(np.arange(FRAMES), SEEN), np.tile(np.linspace(0.01, 0.43, SEEN), FRAMES)
    points = Points(frame, 6.0 * frame / (FRAMES - 1), s_m, np.zeros((len(s_m), 3)))
    return Recording("made", ROPE, GRAVITY, Ends(), motion, points, quasi_static=True)


def seen_aside(noise_m: float = 0.0, particles: int = FLAT.particles) -> Recording:
    """Seen on the side to which a simulation does not go."""
    made = buckling()
    model = RecordingModel(made, particles, None)
    xyz_m = ASIDE * model.predict(FLAT.with_particles(particles)).xyz_m
    xyz_m += np.random.default_rng(4).normal(0.0, noise_m, xyz_m.shape)
    return replace(made, points=replace(made.points, xyz_m=xyz_m))
