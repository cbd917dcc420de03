"""A rope is followed on the side on which it was seen, and its derivatives are those of that side."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sim.buckling import ASIDE, FLAT, SEEN, buckling, seen_aside

from dlolib.sim.branches import _twist
from dlolib.sim.recording import RecordingModel, frame_of
from dlolib.types import Floats, Recording

# The frames in which the rope is out of its plane.
BUCKLED = range(14, 26)
# Laws, and how far from mirrored [m]: what remembers was on the other side for a part of a step.
LAWS = [({}, 1e-6), ({"plastic_bending.yield_curvature": 20.0, "plastic_bending.hardening_ratio": 0.5}, 2e-4)]


def model(made: Recording, *frames: int) -> RecordingModel:
    sought = tuple(frame_of(made.points, frame) for frame in frames)
    return RecordingModel(made, FLAT.particles, None, sought=sought)


def off(one: RecordingModel, xyz_m: Floats) -> Floats:
    """How far a rope is from these points at most, by frame (F,) [m]."""
    return np.abs(one.predict(FLAT).xyz_m - xyz_m).reshape(-1, SEEN, 3).max(axis=(1, 2))


def test_a_rope_is_followed_on_the_side_on_which_it_was_seen() -> None:
    """From the first frame in which it is out of its plane, or from a later one on."""
    made = seen_aside()
    wrong = off(model(made), made.points.xyz_m)
    assert np.array_equal(np.flatnonzero(wrong > 1e-6), BUCKLED) and wrong[BUCKLED].min() > 0.02
    assert off(model(made, 14), made.points.xyz_m).max() < 1e-6
    late = off(model(made, 20), made.points.xyz_m)
    assert np.array_equal(np.flatnonzero(late > 1e-6), BUCKLED[:6])


@pytest.mark.parametrize(("laws", "most_m"), LAWS, ids=str)
def test_the_sides_mirror_each_other_whatever_the_rope_remembers(
    laws: dict[str, float], most_m: float
) -> None:
    """Sought near points that scatter by 1 mm."""
    rod = replace(FLAT, effects={**FLAT.effects, **laws})
    other, found = (one.predict(rod).xyz_m for one in (model(buckling()), model(seen_aside(1e-3), *BUCKLED)))
    assert np.abs(other[:, 1]).max() > 0.02
    assert np.abs(found - ASIDE * other).max() < most_m


def test_derivatives_are_those_of_the_side_seen() -> None:
    one, name, by = model(seen_aside(1e-3), 14, 18), "bending_stiffness", 1e-4

    def stiffer(share: float) -> Floats:
        rod = replace(FLAT, bending_stiffness=FLAT.bending_stiffness * (1 + share))
        return one.predict(rod).xyz_m

    told = FLAT.bending_stiffness * one.predict(FLAT, [name]).by_parameter[..., 0]
    assert np.abs(told).max() > 0.01
    assert np.abs(told - (stiffer(by) - stiffer(-by)) / (2 * by)).max() < 1e-4 * np.abs(told).max()


def test_where_it_was_seen_where_it_goes_it_goes_there() -> None:
    made = buckling()
    own = model(made).predict(FLAT).xyz_m
    seen = replace(made, points=replace(made.points, xyz_m=own))
    assert off(model(seen, 0, 3, 20, 39), own).max() < 1e-6


def test_a_rope_that_is_wound_stays_wound() -> None:
    """What was seen does not tell whole turns: they are those of the way there."""
    made = seen_aside()
    turned = Rotation.from_quat(made.motion.end_q, scalar_first=True) * Rotation.from_rotvec(
        np.linspace(0.0, 2 * np.pi, len(made.motion.t_s))[:, None] * [0.0, 0.0, 1.0]
    )
    motion = replace(made.motion, end_q=turned.as_quat(scalar_first=True, canonical=False))
    wound = replace(made, motion=motion)
    seen = replace(wound, points=replace(wound.points, xyz_m=model(wound).predict(FLAT).xyz_m))
    there, again = (_twist(one.roll_out(FLAT).q[0, -1]) for one in (model(wound), model(seen, 30, 35)))
    assert there > 1.5 * np.pi and again == pytest.approx(there, abs=1e-4)
