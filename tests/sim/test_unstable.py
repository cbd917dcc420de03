"""A rope does not stay on an equilibrium that it would fall from."""

from dataclasses import replace

import numpy as np
import pytest
from sim.ropes import ROPE
from sim.test_recording import recording

from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.types import Ends, Floats, Motion, Points, Recording

LEVEL, UP = [0.5, 0.5, 0.5, 0.5], [1.0, 0.0, 0.0, 0.0]
FREE = np.full(3, np.nan)
WEIGHT_N_M = ROPE.linear_density_kg_m * 9.81


def moved(t_s: list[float], end_m: Floats, start_q: list[float]) -> Recording:
    """Seen at these times, at the last of which its end is where the last row says; no end: it is free."""
    made, t = recording(), np.array(t_s)
    rows, free = len(t), bool(np.isnan(end_m).any())
    end_q = np.full((rows, 4), np.nan) if free else np.tile(start_q, (rows, 1))
    motion = Motion(t, np.zeros((rows, 3)), np.tile(start_q, (rows, 1)), end_m, end_q)
    s_m = np.linspace(0, ROPE.length_m, 45)
    points = Points(
        np.repeat([*range(rows)], 45), np.repeat(t, 45), np.tile(s_m, rows), np.zeros((45 * rows, 3))
    )
    ends = Ends("clamped", "free" if free else "clamped")
    return replace(made, motion=motion, points=points, ends=ends, planar=None, noise=None)


def shape(made: Recording, rod: Rod) -> Floats:
    """The particles at the last time (n, 3) [m]."""
    return np.asarray(RecordingModel(made, rod.particles, None).roll_out(rod).x[0, -1])


def test_a_soft_standing_rope_falls_to_the_ground() -> None:
    standing = moved([0.0, 1.0], np.tile(FREE, (2, 1)), UP)
    assert shape(standing, Rod(ROPE, 3e-4, 3e-4))[-1, 2] < -0.3


@pytest.mark.parametrize("effects", [{}, {"plastic_bending.yield_curvature": 100.0}], ids=str)
def test_ends_brought_near_each_other_turn_a_rope_out_of_its_plane(effects: dict[str, float]) -> None:
    """As far out as a side force of a thousandth of its weight leads it, though nothing leads it."""
    rod = Rod(ROPE, 1e-3, 5e-4, effects)
    brought = moved([0.0, 10.0], np.array([[0.4, 0, 0], [0.12, 0, 0]]), LEVEL)
    alone = np.abs(shape(brought, rod)[:, 1]).max()
    leading = rod.with_values({"lateral_load.y": 1e-3 * WEIGHT_N_M})
    assert alone == pytest.approx(np.abs(shape(brought, leading)[:, 1]).max(), rel=0.01)
    assert alone > 0.04


def test_a_rope_that_hangs_in_its_plane_stays_there() -> None:
    brought = moved([0.0, 10.0], np.array([[0.4, 0, 0], [0.2, 0, 0]]), LEVEL)
    assert np.abs(shape(brought, Rod(ROPE, 3e-3, 2e-3))[:, 1]).max() < 1e-9
