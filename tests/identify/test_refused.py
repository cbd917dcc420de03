"""Recordings from which no stiffness can be told are refused, not fitted."""

from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from sim.ropes import EI, ROPE
from sim.test_recording import recording

from dlolib.errors import ParameterError, SimulationError
from dlolib.identify import IdentifySettings, identify
from dlolib.sim.continuum import simulated
from dlolib.sim.rod import STIFFEST_M4_S2, Rod
from dlolib.types import Estimate, Recording

SETTINGS = IdentifySettings()


@pytest.mark.parametrize("what", ["linear_density_kg_m", "diameter_m", "length_m", "name"])
def test_recordings_of_different_objects(what: str) -> None:
    other = {"linear_density_kg_m": None, "diameter_m": 0.02, "length_m": 0.6, "name": "hose"}[what]
    one = recording()
    with pytest.raises(ParameterError, match=f"other has object.{what}"):
        identify([one, replace(one, name="other", rope=replace(ROPE, **{what: other}))], SETTINGS)


def test_recordings_of_one_name() -> None:
    with pytest.raises(ParameterError, match="2 recordings are named made"):
        identify([recording(), recording()], SETTINGS)


def test_segments_in_micrometres() -> None:
    with pytest.raises(ParameterError, match="a rope of 0.445 m in segments of 1e-05 m has 44501 particles"):
        replace(SETTINGS, longest_segment_m=1e-5).particles_for(0.445)


def test_recordings_of_known_and_of_unknown_roll() -> None:
    """One number would stand for the roll of all."""
    one = recording()
    other = replace(one, name="other", ends=replace(one.ends, start_roll_known=False))
    with pytest.raises(ParameterError, match="rolled is known in made and not in other") as refused:
        identify([one, other], SETTINGS)
    assert refused.value.place == "recording.json" and '"roll_known": {"start": false}' in str(
        refused.value.mend
    )


def test_a_rope_that_nothing_loads() -> None:
    floating = simulated(replace(recording(), gravity_m_s2=np.zeros(3)), Rod(ROPE, EI, EI))
    with pytest.raises(ParameterError, match="no load tells"):
        identify([floating], SETTINGS)


def test_a_fit_that_goes_on_to_where_no_load_bends_the_rope() -> None:
    """Gravity with the wrong sign: only a rope that does not sag at all comes near."""
    made = recording()
    upwards = replace(made, gravity_m_s2=-made.gravity_m_s2)
    with pytest.raises(ParameterError, match="no load tells .* at the best EI"):
        identify([upwards], SETTINGS)


def test_a_rope_that_was_seen_elsewhere_than_it_is_held() -> None:
    made = recording()
    turned = replace(made.points, s_m=made.points.s_m - 0.01, xyz_m=made.points.xyz_m[::-1])
    with pytest.raises(ParameterError, match="made: the rope's start was seen .* mm from where it was held"):
        identify([replace(made, points=turned)], SETTINGS)


def test_a_parameter_that_is_none_of_the_fit() -> None:
    """How an end is rolled is fitted only where nobody recorded it."""
    with pytest.raises(ParameterError, match="cannot fit end_twist.end here; choose from bending_stiffness"):
        identify([recording()], replace(SETTINGS, parameters=("bending_stiffness", "end_twist.end")))


def test_a_rope_that_tears_at_every_stiffness(monkeypatch: pytest.MonkeyPatch) -> None:
    def torn(*_: Any) -> Any:
        raise SimulationError("it would tear", mend="do not")

    monkeypatch.setattr(import_module("dlolib.identify.identify"), "_solve", torn)
    with pytest.raises(SimulationError, match="no stiffness could be simulated; check the recording's units"):
        identify([recording()], SETTINGS)


def test_all_frames_held_out() -> None:
    with pytest.raises(ParameterError, match="every frame is held out"):
        identify([replace(recording(), heldout_frames=(0, 5))], SETTINGS)


def test_a_clock_that_jumped() -> None:
    made = recording(quasi_static=False)
    t_s = made.points.t_s + np.where(made.points.frame > 3, 1e8, 0.0)
    with pytest.raises(SimulationError, match="look for a jump of the clock"):
        simulated(replace(made, points=replace(made.points, t_s=t_s)), Rod(ROPE, EI, EI))


def test_one_frame_of_a_long_motion_has_an_interval() -> None:
    made = recording()
    found = _found_in(made, made.points.frame == 3)
    assert found.low is not None and found.high is not None and found.low < EI < found.high


def test_one_point_has_no_interval() -> None:
    """Nothing tells how it differs from others; an interval of no width would say that it is exact."""
    made = recording()
    only = (made.points.frame == 3) & (made.points.s_m == made.points.s_m[2])
    found = _found_in(made, only, parameters=("bending_stiffness",))
    assert found.low is None and found.high is None and found.value == pytest.approx(EI, rel=0.1)


def _found_in(made: Recording, only: np.ndarray, **settings: Any) -> Estimate:
    """What EI is found in some of the points."""
    points = replace(
        made.points,
        frame=made.points.frame[only],
        t_s=made.points.t_s[only],
        s_m=made.points.s_m[only],
        xyz_m=made.points.xyz_m[only] + np.random.default_rng(1).normal(0, 2e-4, (int(only.sum()), 3)),
    )
    one: Recording = replace(made, points=points)
    return identify([one], replace(SETTINGS, **settings)).fit.parameters["bending_stiffness"]


def test_a_known_rope_stiffer_than_any_is_a_start_all_the_same() -> None:
    """Ten times what a verdict says may be beyond what is fitted at all."""
    stiff = Rod(ROPE, 0.5 * STIFFEST_M4_S2 * ROPE.linear_density_kg_m, 1e-3, {}, SETTINGS.particles)
    found = identify([recording()], SETTINGS, [stiff]).fit.parameters["bending_stiffness"]
    assert found.value == pytest.approx(EI, rel=0.01)
