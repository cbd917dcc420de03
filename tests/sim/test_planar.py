"""Pictures from the side, which do not show how deep in the scene a rope is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE

from dlolib.formats import read_recording, write_recording
from dlolib.sim.poses import PosesModel, model_of
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.types import Ends, Motion, Obstacle, Points, Recording

ASIDE_M, SEEN = 0.3, 12


def over_a_cylinder(t_s: list[float]) -> Recording:
    """The end comes 0.1 m nearer over a cylinder no longer than the ends are aside of y = 0."""
    rows = len(t_s)
    start, end = np.zeros((rows, 3)), np.zeros((rows, 3))
    start[:, 1] = end[:, 1] = ASIDE_M
    end[:, 0], end[:, 2] = np.linspace(0.33, 0.23, rows), 0.02
    values = {"center_m": (0.17, ASIDE_M, -0.06), "axis": (0, 1, 0), "radius_m": (0.02,), "height_m": (0.3,)}
    s_m = np.linspace(0, ROPE.length_m, SEEN + 2)[1:-1]
    at_s = np.linspace(t_s[0], t_s[-1], 3)
    points = Points(
        np.repeat([*range(3)], SEEN), np.repeat(at_s, SEEN), np.tile(s_m, 3), np.zeros((3 * SEEN, 3))
    )
    held = np.tile(LEVEL, (rows, 1))
    motion = Motion(np.array(t_s), start, held, end, held)
    return Recording("aside", ROPE, GRAVITY, Ends(), motion, points, (Obstacle("cylinder", values),))


@pytest.mark.parametrize("t_s", [np.linspace(0, 4, 41).tolist(), [0.0, 5.0, 10.0]], ids=["motion", "poses"])
def test_a_rope_seen_from_the_side_lies_on_the_obstacle_that_it_was_seen_on(
    tmp_path: Path, t_s: list[float]
) -> None:
    made, rod = over_a_cylinder(t_s), Rod(ROPE, EI, GJ)
    true = RecordingModel(made, rod.particles, None).predict(rod).xyz_m
    flat = replace(made.points, xyz_m=true * [1.0, 0.0, 1.0])
    write_recording(replace(made, points=flat, planar="xz"), tmp_path / "r")
    model = model_of(read_recording(tmp_path / "r"), rod.particles, None)
    assert isinstance(model, PosesModel) == (len(t_s) == 3)
    assert np.abs(model.predict(rod).xyz_m - true).max() < 1e-6
