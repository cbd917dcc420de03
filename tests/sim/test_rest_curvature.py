"""An uneven curvature at rest: a rope that hangs from one end without weight takes exactly that shape."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from sim.ropes import EI, GJ, ROPE, pose

from dlolib.sim.rod import Rod, scene
from dlolib.sim.simulate import Clock, Path, roll_out
from dlolib.sim.start import first_shape
from dlolib.types import Ends, Floats

WEIGHTLESS = np.zeros(3)
HANGING = Ends("clamped", "free")
CURVED = {"kappa": 2.0, "wave_1": 3.0, "wave_3": -8.0}


def curled(axis: int, particles: int) -> Floats:
    """The rope's particles (n, 3) at rest, curved about one of its axes."""
    names = {f"rest_curvature.{name.replace('_', f'_{axis}_')}": value for name, value in CURVED.items()}
    names[f"rest_curvature.kappa_{axis}"] = names.pop("rest_curvature.kappa")
    made = scene([Rod(ROPE, EI, GJ, names, particles)], WEIGHTLESS, HANGING)
    held = pose(0.0, 0.0, 0.0)
    state = first_shape(ROPE.length_m, particles, held, None, WEIGHTLESS)
    still = Path(np.zeros((1, 1, 2, 3)), np.tile(held.quaternion, (1, 1, 2, 1)))
    return roll_out(made, state, still, Clock(None)).final.x[0]


def exact(particles: int) -> Floats:
    """(n, 2): along the clamp and across it, from the integral of the curvature."""
    s, length = np.linspace(0, ROPE.length_m, 10001), ROPE.length_m
    turn = CURVED["kappa"] * s
    for k in (1, 3):
        turn += CURVED[f"wave_{k}"] * length / (k * np.pi) * np.sin(k * np.pi * s / length)
    along, across = (cumulative_trapezoid(by(turn), s, initial=0.0) for by in (np.cos, np.sin))
    at = np.linspace(0, length, particles)
    return np.stack([np.interp(at, s, along), np.interp(at, s, across)], axis=1)


@pytest.mark.parametrize(
    ("axis", "across", "in_line"), [(1, (0, 0, -1), (0, 1, 0)), (2, (0, 1, 0), (0, 0, 1))]
)
def test_a_weightless_rope_takes_the_shape_it_has_at_rest(axis: int, across: tuple, in_line: tuple) -> None:
    misses = []
    for particles in (15, 30, 60):
        x = curled(axis, particles)
        off = np.stack([x[:, 0], x @ across], axis=1) - exact(particles)
        misses.append(np.linalg.norm(off, axis=1).max() / ROPE.length_m)
        assert np.abs(x @ in_line).max() < 1e-9
    assert misses[1] < 1e-3
    assert np.log2(misses[0] / misses[1]) == pytest.approx(2, abs=0.3)
    assert np.log2(misses[1] / misses[2]) == pytest.approx(2, abs=0.3)
