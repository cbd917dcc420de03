"""What is learned with: the rope's own physics, on a mesh as fine as the one that it was found on."""

from __future__ import annotations

import pytest

from dlolib.learn import of_the_rope
from dlolib.learn.own import OF_THE_RECORDING
from dlolib.sim.effects import EFFECTS
from dlolib.types import Estimate, Fit
from stages.learn import settings
from tests.pipeline.conftest import ROOT

ONE = Estimate(1.0, None, None, "")
KEPT = (
    "bending_stiffness",
    "torsional_stiffness_over_density",
    "plastic_bending.yield_curvature",
    "rest_curvature.kappa_1",
    "mass_profile.gradient",
    "contact_friction.coefficient",
    "prior_history.kappa_1",
    "inertia_drag.drag",
)
LEFT = (
    "hidden_obstacle.x",
    "hidden_obstacle.radius",
    "end_angle.end_2",
    "camera_pose.depth",
    "clock_offset.time",
)


def test_what_belongs_to_the_recording_is_left_out_and_named() -> None:
    fit = Fit(dict.fromkeys((*KEPT, *LEFT), ONE), 0.001, 10, 100, {"captured": {"end_angle.start_1": ONE}})
    own, left = of_the_rope(fit)
    assert set(own.parameters) == set(KEPT)
    assert not own.nuisances and own.rmse_m == fit.rmse_m
    assert left == ("camera_pose", "clock_offset", "end_angle", "hidden_obstacle")
    assert of_the_rope(own) == (own, ())


def test_every_name_is_an_effect() -> None:
    assert set(EFFECTS) >= OF_THE_RECORDING


def test_a_long_rope_has_more_particles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    assert settings(0.445).particles == 30
    assert settings(1.78).particles > 100
