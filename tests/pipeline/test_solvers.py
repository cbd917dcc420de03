"""The rope of `make solvers`: exact, and the direct solver's floor on it."""

from dataclasses import replace

import numpy as np
import pytest

from dlolib.identify import IdentifySettings
from dlolib.lab.arc import arc_motion
from dlolib.types import Rope
from stages.solvers import _distance, _model, _paper_ends, exact

ROPE = Rope("exact", 0.445, 0.008, 0.04)
EI = 3e-4


def test_the_direct_solver_comes_down_to_its_floor_and_the_papers_ends_do_not() -> None:
    recording = exact(ROPE, EI, arc_motion(101, 0.04), 30, 10)
    xyz = recording.points.xyz_m.reshape(10, 30, 3)
    chords = np.linalg.norm(np.diff(xyz, axis=1), axis=2)
    assert chords.max() <= ROPE.length_m / 29 * (1 + 1e-6) and chords.min() > 0.95 * ROPE.length_m / 29
    assert xyz[:, -1] == pytest.approx(recording.motion.end_m[10::10], abs=1e-8)
    still, fit = replace(recording, quasi_static=True), IdentifySettings(time_step_s=0.04)
    assert _distance(_model(still, fit)(EI), still).max() < 0.0025 * ROPE.length_m
    assert _distance(_paper_ends(recording, fit)(EI), recording).max() > 0.01 * ROPE.length_m
