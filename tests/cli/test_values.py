"""How `--set` and `--fit` meet in one rope."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dlolib.cli.values import parse_values
from dlolib.errors import ParameterError
from dlolib.rope_values import RopeValues, rope_values, with_effects
from dlolib.types import PER_DENSITY, Estimate, Fit, Rope

WEIGHED, UNWEIGHED = Rope("rope", 0.445, 0.008, 0.04), Rope("rope", 0.445)


def fit(**values: float) -> Fit:
    parameters = {name: Estimate(value, None, None, "") for name, value in values.items()}
    own = {"one": {"end_angle.start_1": Estimate(0.1, None, None, "rad")}}
    return Fit(parameters, 0.001, 3, 30, own)


def test_given_values_stand_over_the_fit() -> None:
    known = rope_values(
        WEIGHED, "one", fit(bending_stiffness=3e-4, torsional_stiffness=2e-4), {"bending_stiffness": 1e-3}
    )
    assert known.parameters == {
        "bending_stiffness": 1e-3,
        "torsional_stiffness": 2e-4,
        "end_angle.start_1": 0.1,
    }


@pytest.mark.parametrize(
    ("density", "says"),
    [
        (40.0, "8e.05 kg/m³, more than any material has; g/m are"),
        (-1.0, "greater than 0"),
    ],
)
def test_a_given_density_is_one_that_a_file_may_say(density: float, says: str) -> None:
    given = {"bending_stiffness": 1e-3, "linear_density": density}
    with pytest.raises(ParameterError, match=says) as refused:
        rope_values(WEIGHED, "one", None, given)
    assert str(refused.value).startswith(f"--set linear_density={density:g}: ")


def test_nuisances_belong_to_their_recording() -> None:
    known = rope_values(WEIGHED, "another", fit(bending_stiffness=3e-4), {})
    assert known.parameters == {"bending_stiffness": 3e-4, "torsional_stiffness": 3e-4}


def test_stiffness_over_density() -> None:
    ratio = fit(bending_stiffness_over_density=0.02)
    assert rope_values(UNWEIGHED, "two", ratio, {}).parameters["bending_stiffness"] == 0.02
    known = rope_values(UNWEIGHED, "two", ratio, {"linear_density": 0.05})
    assert known.rope.linear_density_kg_m == 0.05
    assert known.parameters["bending_stiffness"] == pytest.approx(0.001)


def test_forces_and_masses_of_a_rope_that_was_not_weighed_go_with_its_density() -> None:
    load, place = Estimate(2.0, None, None, "N/m" + PER_DENSITY), Estimate(0.1, None, None, "m")
    found = fit(bending_stiffness_over_density=0.02)
    found = replace(found, parameters={**found.parameters, "lateral_load.x": load, "mass_profile.s": place})
    assert rope_values(UNWEIGHED, "two", found, {}).parameters["lateral_load.x"] == 2.0
    known = rope_values(UNWEIGHED, "two", found, {"linear_density": 0.05}).parameters
    assert (known["lateral_load.x"], known["mass_profile.s"]) == (pytest.approx(0.1), 0.1)


def test_a_mass_of_a_rope_that_nobody_weighed_counts_per_density(caplog: pytest.LogCaptureFixture) -> None:
    known = RopeValues(UNWEIGHED, {"bending_stiffness": 0.02})
    assert with_effects(known, {"mass_profile.mass": 0.05}).parameters["mass_profile.mass"] == 0.05
    assert "what mass_profile.mass has in kg counts as kg per kg/m; give --set linear_density" in caplog.text
    caplog.clear()
    with_effects(known, {"clock_offset.time": 0.05})
    with_effects(
        replace(known, rope=replace(UNWEIGHED, linear_density_kg_m=0.05)), {"mass_profile.mass": 0.05}
    )
    assert not caplog.text


def test_newtons_need_a_density() -> None:
    with pytest.raises(ParameterError, match="density of rope is not known; give its linear_density_kg_m"):
        rope_values(UNWEIGHED, "two", fit(bending_stiffness=3e-4), {})


def test_newtons_that_are_set_without_a_density_are_of_a_rope_of_one_kg_per_metre(
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert (
        rope_values(UNWEIGHED, "two", None, {"bending_stiffness": 0.02}).parameters["bending_stiffness"]
        == 0.02
    )
    assert "it is simulated as 1 kg/m" in caplog.text
    caplog.clear()
    rope_values(UNWEIGHED, "two", None, {"bending_stiffness": 3e-4, "linear_density": 0.04})
    rope_values(WEIGHED, "one", None, {"bending_stiffness": 3e-4})
    assert not caplog.text


def test_nothing_given() -> None:
    with pytest.raises(ParameterError, match="no bending_stiffness is given; give --set"):
        rope_values(WEIGHED, "one", None, {"torsional_stiffness": 1.0})


def test_parsing() -> None:
    given = ["bending_stiffness=3e-4", "linear_density=0.05"]
    assert parse_values(given) == {"bending_stiffness": 3e-4, "linear_density": 0.05}


def test_parameters_of_another_rope_are_said(caplog: pytest.LogCaptureFixture) -> None:
    thick = replace(fit(bending_stiffness=3e-4), rope=replace(WEIGHED, diameter_m=0.02))
    thin, unmeasured = replace(WEIGHED, diameter_m=0.008), replace(WEIGHED, diameter_m=None)
    rope_values(unmeasured, "one", thick, {})
    rope_values(replace(WEIGHED, diameter_m=0.02, length_m=0.2), "one", thick, {})
    assert not caplog.messages
    rope_values(thin, "one", thick, {})
    assert "one has object.diameter_m = 0.008, the stored parameters are of 0.02" in caplog.text
