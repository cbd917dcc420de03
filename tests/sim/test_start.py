"""First shapes: from what was seen of a rope, and from how its ends are held."""

from __future__ import annotations

import numpy as np
import pytest

from dlolib.errors import SimulationError
from dlolib.sim.start import off_clamps, shape_seen
from dlolib.types import Floats, Pose

LENGTH_M, PARTICLES, NOISE_M = 0.4, 30, 1e-3
ALONG_X = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])


def pose(x_m: float) -> Pose:
    return Pose(np.array([x_m, 0.0, 0.0]), ALONG_X)


def length(x_m: Floats) -> float:
    return float(np.linalg.norm(np.diff(x_m, axis=0), axis=1).sum())


@pytest.mark.parametrize("gap_m", [0.0, 1e-12, 1e-9, 1e-6, 1e-5, 1e-4])
@pytest.mark.parametrize("end", [0, -1])
def test_a_marker_on_a_clamp_makes_no_kink(gap_m: float, end: int) -> None:
    """A straight rope, of which the point beside a held end is seen a millimetre aside."""
    s_m = np.linspace(0.0, LENGTH_M, 9)
    seen = np.outer(s_m, [1.0, 0.0, 0.0])
    s_m[end] += gap_m if end == 0 else -gap_m
    seen[end, 1] += NOISE_M
    shape = shape_seen(s_m, seen, LENGTH_M, PARTICLES, pose(0.0), pose(LENGTH_M))
    assert length(shape.x[0]) == pytest.approx(LENGTH_M, rel=1e-6)


def test_what_lies_off_the_clamps_is_kept() -> None:
    s_m = np.array([0.0, 3e-4, 5e-4, 0.2, 0.3995, 0.3999])
    assert off_clamps(s_m, LENGTH_M, (0.0, LENGTH_M)).tolist() == [2, 3, 4]
    assert off_clamps(s_m, LENGTH_M, ()).tolist() == [0, 1, 2, 3, 4, 5]


def test_of_which_nothing_but_its_clamp_was_seen_a_rope_is_straight() -> None:
    shape = shape_seen(np.zeros(1), np.zeros((1, 3)), LENGTH_M, PARTICLES, pose(0.0), None)
    assert np.allclose(shape.x[0], np.outer(np.linspace(0.0, LENGTH_M, PARTICLES), [1.0, 0.0, 0.0]))
    with pytest.raises(SimulationError, match="no end is held"):
        shape_seen(np.zeros(1), np.zeros((1, 3)), LENGTH_M, PARTICLES, None, None)
