"""A rope that was swung and is taken for quasi-static: that inertia is left out is found."""

from dataclasses import replace

from sim.test_begun import SWINGING, noisy, seen

from dlolib.diagnose import DiagnoseSettings, diagnose
from dlolib.sim.effects import EFFECTS

KEPT = ("inertia_drag", "internal_friction", "end_angle", "stiffness_profile")


def test_inertia_is_named_where_the_recording_begins_in_motion() -> None:
    swung = replace(noisy(seen(SWINGING)), quasi_static=True)
    without = tuple(set(EFFECTS) - set(KEPT))
    settings = DiagnoseSettings(
        particles=20, longest_segment_m=1.0, workers=1, partners=2, without=without, most_effects=2
    )
    verdict = diagnose([swung], settings).verdict
    assert "inertia_drag" in {named.name for named in verdict.effects}, verdict.summary
    ei = verdict.augmented.parameters["bending_stiffness_over_density"]
    assert 0.8 * 0.03 < ei.value < 1.25 * 0.03
