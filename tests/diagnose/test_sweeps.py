"""What `make sweeps` counts."""

import numpy as np
import pytest
from diagnose.test_diagnose import made

from dlolib.types import Points
from stages.sweeps import halved, tip_rmse


def test_a_tip_is_the_furthest_point_of_its_frame() -> None:
    frame = np.array([3, 3, 4, 4, 5])
    s_m = np.array([0.3, 0.6, 0.6, 0.3, 0.3])
    points = Points(frame, 0.1 * frame, s_m, np.zeros((5, 3)))
    assert tip_rmse(points, np.array([9.0, 1.0, 2.0, 9.0, 4.0])) == pytest.approx(np.sqrt(7.0))


def test_the_second_half_is_held_out() -> None:
    recording = made({})
    first, last = halved(recording).heldout_frames
    frames = np.unique(recording.points.frame)
    assert last == frames[-1]
    assert abs(np.sum(frames < first) - np.sum(frames >= first)) <= 1
