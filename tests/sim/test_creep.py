"""A rope that creeps while nothing moves: what it does does not depend on how often it is seen."""

from dataclasses import replace

import numpy as np
import pytest
from sim.ropes import LEVEL, ROPE
from sim.test_recording import recording

from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.types import Ends, Floats, Motion, Points

LAST_S = 20.0
BRANCH = {"viscoelastic_bending.modulus_ratio": 2.0}


def tip(frames_s: Floats, relaxation_s: float) -> Floats:
    """Where the tip of a cantilever is at the last frame [m]."""
    t_s, nowhere = np.linspace(0.0, LAST_S, 201), np.full((201, 3), np.nan)
    held = np.tile(LEVEL, (201, 1))
    motion = Motion(t_s, np.zeros((201, 3)), held, nowhere, np.full((201, 4), np.nan))
    frame, count = np.arange(len(frames_s)), len(frames_s)
    points = Points(frame, frames_s, np.full(count, ROPE.length_m), np.zeros((count, 3)))
    seen = replace(recording(), ends=Ends("clamped", "free"), motion=motion, points=points)
    rod = Rod(ROPE, 2e-2, 2e-2, BRANCH | {"viscoelastic_bending.relaxation_time": relaxation_s}, 20)
    return RecordingModel(seen, 20, None).predict(rod).xyz_m[-1]


@pytest.mark.parametrize("relaxation_s", [0.1, 0.5, 2.0, 30.0])
@pytest.mark.parametrize("every_s", [20.0, 10.0, 2.0])
def test_a_rope_that_hangs_and_creeps_is_where_it_is(every_s: float, relaxation_s: float) -> None:
    often = tip(np.arange(0.0, LAST_S + 0.01, 0.05), relaxation_s)
    seldom = tip(np.arange(0.0, LAST_S + 0.01, every_s), relaxation_s)
    crept = np.linalg.norm(often - tip(np.array([0.0]), relaxation_s))
    assert crept > 0.01
    assert np.linalg.norm(seldom - often) < 0.008 * crept
