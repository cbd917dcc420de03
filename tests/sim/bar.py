"""A rope that is lifted over a smooth bar, on which it slides aside and from which it falls in the end."""

from dataclasses import replace

import numpy as np
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE

from dlolib.sim.continuum import simulated
from dlolib.sim.rod import Rod
from dlolib.types import Ends, Motion, Noise, Obstacle, Points, Recording

SIGMA, FRAMES, SEEN = 1.5e-3, 45, 15
# The first frame in which it is about to fall.
FALLS = 33
BAR = Obstacle(
    "cylinder",
    {"center_m": (0.249, -0.008, 0.032), "axis": (-0.218, 0.976, 0), "radius_m": (0.0238,), "height_m": (1,)},
)


def over_the_bar(particles: int, sigma_m: float = SIGMA, finer: int = 1, frames: int = FRAMES) -> Recording:
    """Its first frames as `simulated` shows them, with noise."""
    t = np.linspace(0.0, 20.0, 201)
    up = np.sin(0.5 * np.pi * np.clip(t / 16.0, 0.0, 1.0)) ** 2
    end = np.stack([0.436 - 0.162 * up, -0.015 * np.sqrt(up), 0.117 * np.sin(0.9 * np.pi * up)], axis=1)
    held = np.tile(LEVEL, (len(t), 1))
    motion = Motion(t, np.zeros((len(t), 3)), held, end, held)
    frame, at = np.repeat(np.arange(frames), SEEN), np.linspace(0.5, 19.5, FRAMES)
    places = np.tile(np.linspace(0.0, ROPE.length_m, SEEN), frames)
    points = Points(frame, at[frame], places, np.zeros((len(frame), 3)))
    blank = Recording(
        "bar", ROPE, GRAVITY, Ends(), motion, points, noise=Noise(SIGMA, 0.0, 0.0), obstacles=(BAR,)
    )
    clean = simulated(blank, Rod(ROPE, EI, GJ, particles=particles), finer=finer)
    noise = np.random.default_rng(3).normal(0.0, sigma_m, clean.points.xyz_m.shape)
    seen = replace(clean.points, xyz_m=clean.points.xyz_m + noise)
    return replace(clean, points=seen, noise=blank.noise)
