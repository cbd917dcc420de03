"""A rope does not stay on an equilibrium that it would fall from."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
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


def turned_over(rows: int = 50) -> Recording:
    """The other end free, the start turned from level through upright, 140 degrees in 7 s."""
    t_s, angles = np.linspace(0, 7, rows), np.linspace(0, np.deg2rad(140), rows)
    about_y = Rotation.from_rotvec(-angles[:, None] * np.array([0.0, 1.0, 0.0]))
    turned = about_y * Rotation.from_quat(LEVEL, scalar_first=True)
    made = moved(t_s.tolist(), np.tile(FREE, (rows, 1)), LEVEL)
    return replace(made, motion=replace(made.motion, start_q=turned.as_quat(scalar_first=True)))


# Laws without a history, of next to no size.
HARDLY = [{}, {"nonlinear_bending.cubic": 1e-9}, {"nonlinear_bending.cubic": -1e-9}]


@pytest.mark.parametrize("effects", HARDLY, ids=str)
def test_a_soft_standing_rope_falls_to_the_ground(effects: dict[str, float]) -> None:
    standing = moved([0.0, 1.0], np.tile(FREE, (2, 1)), UP)
    assert shape(standing, Rod(ROPE, 3e-4, 3e-4, effects))[-1, 2] < -0.3


@pytest.mark.parametrize("stiffness", [1e-3, 3e-3])
@pytest.mark.parametrize("effects", HARDLY[1:], ids=str)
def test_a_law_without_a_history_and_of_no_size_snaps_as_no_law_does(
    effects: dict[str, float], stiffness: float
) -> None:
    made, rod = turned_over(), Rod(ROPE, stiffness, stiffness)
    plain, other = shape(made, rod), shape(made, replace(rod, effects=effects))
    assert plain[-1, 0] < -0.1
    assert np.abs(other - plain).max() < 1e-5 * ROPE.length_m


@pytest.mark.parametrize("cubic", [3e-3, -3e-3])
@pytest.mark.parametrize("ratio", [1.0, 1.05])
def test_a_rope_whose_moment_is_not_proportional_snaps_to_where_it_would_settle(
    cubic: float, ratio: float
) -> None:
    values = {"nonlinear_bending.cubic": cubic, "anisotropic_bending.stiffness_ratio": ratio}
    made, rod = turned_over(), Rod(ROPE, 3e-3, 3e-3, values)
    there = replace(made, motion=replace(made.motion, start_q=np.tile(made.motion.start_q[-1], (50, 1))))
    assert shape(made, rod) == pytest.approx(shape(there, rod), abs=1e-5 * ROPE.length_m)


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
