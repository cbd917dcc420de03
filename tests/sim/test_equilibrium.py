"""Where the iteration of a step ends, and how soon."""

from dataclasses import replace

import numpy as np
import pytest
from sim.bar import FALLS, over_the_bar
from sim.ropes import EI, GJ, ROPE

from dlolib.sim import simulate
from dlolib.sim.begun import motion_model
from dlolib.sim.rod import Rod
from dlolib.types import Floats, Recording

SCENES = {
    "elastic": {},
    "plastic": {"plastic_bending.yield_curvature": 5.0, "plastic_bending.hardening_ratio": 0.3},
    "friction inside": {
        "internal_friction.saturation_curvature": 1.0,
        "internal_friction.transition_curvature": 3.0,
    },
    "friction at the bar": {"contact_friction.coefficient": 0.4},
}


@pytest.fixture(scope="module")
def lifted() -> Recording:
    return over_the_bar(30, frames=FALLS - 3)


def rolled(recording: Recording, effects: dict[str, float]) -> tuple[Floats, Floats]:
    """All positions (T, n, 3) [m], and the iterations of each step (T - 1,)."""
    found = motion_model(recording, 30, None).roll_out(Rod(ROPE, EI, GJ, effects, 30))
    return found.x[0], np.ravel(found.iterations).astype(float)


@pytest.mark.parametrize("bar", [True, False], ids=["bar", "free"])
@pytest.mark.parametrize("effects", SCENES.values(), ids=SCENES)
def test_an_iteration_that_is_left_out_would_have_moved_nothing(
    effects: dict[str, float], bar: bool, lifted: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A step of Newton's method foretells what it leaves: no iteration only confirms it. In a hard step,
    of dozens, last digits decide how many it takes: so steps are counted."""
    if not bar and "contact_friction.coefficient" in effects:
        pytest.skip("nothing to rub at")
    recording = lifted if bar else replace(lifted, obstacles=())
    x, taken = rolled(recording, effects)
    monkeypatch.setattr(simulate, "TOLERANCE", 1e-11)
    to_the_end, more = rolled(recording, effects)
    assert np.abs(x - to_the_end).max() < 1e-8
    assert np.sum(taken < more) > np.sum(taken > more)


def test_a_rope_that_rubs_does_not_creep(lifted: Recording) -> None:
    """Where a contact comes to stick or slide no step lessened the forces, but a sixteenth of it: 30 to 120
    iterations, in which each got a little nearer to the next such contact."""
    frictions = (0.2, 0.3, 0.4, 0.6, 0.8)
    taken = [rolled(lifted, {"contact_friction.coefficient": mu})[1].mean() for mu in frictions]
    # 21 while each step had to lessen them
    assert np.mean(taken) < 18.0
