"""Where the fits of a study begin."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnose.test_diagnose import QUICK, made
from sim.ropes import EI

from dlolib.diagnose import fitting, tasks
from dlolib.diagnose import study as study_module
from dlolib.diagnose.diagnose import raw_study
from dlolib.diagnose.search import backed, baseline
from dlolib.diagnose.study import acting_only, library
from dlolib.errors import SimulationError
from dlolib.identify.identify import FIRST_STIFFNESS_M4_S2
from dlolib.identify.parameters import Unknown
from dlolib.sim import continuum
from dlolib.sim.effects import rest_curvature
from dlolib.sim.recording import RecordingModel
from dlolib.sim.upright import ROLL, ROLLS
from dlolib.types import Ends


@pytest.fixture(scope="module")
def study():
    return acting_only(raw_study([made({})], QUICK), FIRST_STIFFNESS_M4_S2)


def test_a_fit_begins_also_where_the_effect_is_not_there_yet(study):
    ratios = [
        one["anisotropic_bending.stiffness_ratio"]
        for one in study.starts("anisotropic_bending", ("stiffness_ratio",), [])
    ]
    assert ratios == [0.5, 2.0, 1.0]
    starts = study.starts("internal_friction", ("saturation_curvature", "transition_curvature"), [])
    absent = [one for one in starts if one["internal_friction.saturation_curvature"] == 0.0]
    assert len(starts) == 6 and len({one["internal_friction.transition_curvature"] for one in absent}) == 2


def test_a_rope_yields_first_below_its_largest_curvature(study):
    starts = study.starts("plastic_bending", ("yield_curvature", "hardening_ratio"), [])
    yields = [one["plastic_bending.yield_curvature"] for one in starts]
    assert 0.5 * study.most_bent_1_m < max(yields) < study.most_bent_1_m
    assert len(set(yields)) == len(yields)


def test_no_branch_relaxes_slower_than_the_recording_lasts(study):
    """It would not fade, and stand for what never does."""
    time, ratio = map(Unknown, ("viscoelastic_bending.relaxation_time", "viscoelastic_bending.modulus_ratio"))
    ((begin, end),) = study.spans_s
    assert study.bounds(time) == pytest.approx((np.log(0.002), np.log(end - begin)))
    assert study.bounds(ratio) == ratio.bounds
    starts = study.starts("viscoelastic_bending", ("modulus_ratio", "relaxation_time"), [])
    assert {one["viscoelastic_bending.relaxation_time"] for one in starts} == {0.05, 1.0, 6.0, 30.0}
    still = replace(study, seen=(at_once(study.seen[0]),))
    low, high = still.bounds(time)
    assert low < high


def test_no_wall_is_fitted_that_could_guide_the_rope_anywhere_though_one_may_be_set(study):
    radius = Unknown("hidden_obstacle.radius")
    assert study.bounds(radius) == radius.bounds == (0.0, 0.1)
    assert study.rod(0, {"bending_stiffness": EI, radius.name: 0.5}).value(radius.name) == 0.5


def test_the_longest_recording_bounds_what_a_branch_may_take(study):
    """What fades in a long one is no less real for a short one that begins the study."""
    one = study.seen[0]
    points = one.recording.points
    slower = replace(one.recording, points=replace(points, t_s=3 * points.t_s))
    both = replace(study, seen=(one, replace(one, model=replace(one.model, recording=slower))))
    time = Unknown("viscoelastic_bending.relaxation_time")
    assert both.bounds(time)[1] == pytest.approx(study.bounds(time)[1] + np.log(3))


def test_a_moment_of_the_motion_is_sought_in_every_recording(study):
    one = study.seen[0]
    points, ((begin, end),) = one.recording.points, study.spans_s
    later = replace(one.recording, points=replace(points, t_s=points.t_s + 100.0))
    both = replace(study, seen=(one, replace(one, model=replace(one.model, recording=later))))
    assert both.spans_s == [(begin, end), (begin + 100.0, end + 100.0)]
    time = Unknown("grasp_slip.time")
    assert both.bounds(time) == (begin, end + 100.0)
    starts = [
        {one["grasp_slip.time"] for one in some.starts("grasp_slip", ("time", "length"), [])}
        for some in (study, both)
    ]
    assert sorted(starts[1]) == pytest.approx(sorted(starts[0] | {start + 100.0 for start in starts[0]}))


def test_what_was_before_is_as_unknown_where_the_first_frames_are_held_out(study):
    one = study.seen[0]
    motion, points = one.recording.motion, one.recording.points
    early = replace(one.recording, points=replace(points, t_s=points.t_s - points.t_s.min() + motion.t_s[0]))
    later = replace(early, points=replace(early.points, t_s=early.points.t_s + 1.0))
    seen = [replace(one, model=replace(one.model, recording=some)) for some in (later, early)]
    assert not replace(study, seen=(seen[0],)).begins_unseen(0)
    assert replace(study, seen=(seen[0],), ahead={0: seen[1]}).begins_unseen(0)


def test_each_recording_begins_near_the_rod_in_it():
    """Where a recording's length differs the rod of another would not fit its mesh's shapes."""
    short = made({})
    long = replace(short, rope=replace(short.rope, linear_density_kg_m=2 * short.rope.linear_density_kg_m))
    both = acting_only(raw_study([short, long], QUICK), FIRST_STIFFNESS_M4_S2)
    densities = [one.model.near.rope.linear_density_kg_m for one in both.seen]
    assert densities == [one.rope.linear_density_kg_m for one in (short, long)]


def at_once(seen):
    """All of its frames at the same time."""
    points = seen.recording.points
    points = replace(points, t_s=np.zeros_like(points.t_s))
    recording = replace(seen.recording, points=points)
    return replace(seen, model=replace(seen.model, recording=recording))


def test_softer_ropes_are_tried_where_the_stiffness_tells_nothing(study):
    found = baseline(study).point
    assert not study.rigid(found) and study.beginnings(found, "mass_profile") == [{}]
    rigid = dict.fromkeys(map(Unknown, study.stiffnesses), 2e4 * EI)
    assert study.rigid(rigid)
    first, *others = study.beginnings(rigid, "mass_profile")
    assert first == {} and others and all(set(one) == set(rigid) for one in others)
    assert all(0 < one[Unknown("bending_stiffness")] < rigid[Unknown("bending_stiffness")] for one in others)


def test_a_fit_begins_with_a_usual_twist_where_the_baseline_ran_limp(study):
    ei, gj = Unknown("bending_stiffness"), Unknown("torsional_stiffness")
    for ran_to, begins in ((1e-6 * EI, 0.1 * EI), (1e3 * EI, 10.0 * EI)):
        found = study.beginnings({ei: EI, gj: ran_to}, "rest_curvature")
        assert all(set(one) == {gj} for one in found)
        assert [one[gj] for one in found] == pytest.approx([begins, EI])
    assert study.beginnings({ei: EI, gj: 0.7 * EI}, "rest_curvature") == [{}]


@pytest.mark.parametrize("effect", ["anisotropic_bending", "inertia_drag"])
def test_softer_ropes_are_tried_beside_what_is_taken_for_stiffness(study, effect):
    stiff = dict.fromkeys(map(Unknown, study.stiffnesses), 200 * EI)
    assert not study.rigid(stiff) and study.beginnings(stiff, "mass_profile") == [{}]
    first, *others = study.beginnings(stiff, effect)
    assert first == {} and others
    assert all(0 < one[Unknown("bending_stiffness")] < 200 * EI for one in others)
    soft = dict.fromkeys(map(Unknown, study.stiffnesses), 1e-3 * EI)
    assert study.beginnings(soft, effect) == [{}]


def test_a_load_along_gravity_is_sought_where_it_is_more_than_another_stiffness(study):
    """Twice as stiff and pulled at twice as much a rope in balance looks the same: fitted with all three
    parts of a load, EI came out 60 % off."""

    def told(*changes: dict[str, object]) -> list[tuple[str, ...]]:
        some = [
            replace(study.seen[0], model=replace(study.seen[0].model, recording=replace(recording, **change)))
            for change in changes
        ]
        return [
            form for name, form in library(replace(study, seen=tuple(some)), ()) if name == "lateral_load"
        ]

    recording, every = study.seen[0].recording, ("x", "y", "z")
    rope, held = recording.rope, Ends("clamped", "free")
    assert told({}) == [("x", "y")]
    assert told({"gravity_m_s2": np.array([0.1, -9.8, 1.0])}) == [("x", "z")]
    assert told({"quasi_static": False}) == [("x", "y"), every]
    loaded = replace(rope, tip_mass_kg=0.01)
    assert told({"rope": loaded}) == [("x", "y")]
    assert told({"rope": loaded, "ends": held}) == [("x", "y"), every]
    assert told({"ends": held}) == [("x", "y")]
    # pulled at in two directions, one rope tells the load's part along either
    assert told({}, {"gravity_m_s2": np.array([0.0, -9.81, 0.0])}) == [("x", "y"), every]


def test_what_a_rope_is_too_stiff_for_want_of_is_fitted_from_every_stiffness(study):
    """Linear steps from a soft rope promise nothing although a fit from there wins: none outranks another."""
    stiff = SimpleNamespace(point=dict.fromkeys(map(Unknown, study.stiffnesses), 200 * EI), offsets_m=())
    found = {
        name: tasks.beginnings(study, stiff, {}, name, form, [], 2)
        for name, form in (("inertia_drag", ("drag",)), ("mass_profile", ("s", "mass")))
    }
    tried = [{start[Unknown("bending_stiffness")] for start in one.starts} for one in found["inertia_drag"]]
    assert len(tried) > 1 and all(len(one) == 1 for one in tried) and len(set.union(*tried)) == len(tried)
    assert len(found["mass_profile"]) == 1


def test_a_finer_mesh_that_snaps_elsewhere_tells_no_error_of_the_mesh(study, monkeypatch):
    found = baseline(study)
    for moved_m, taken in ((0.001, True), (0.1, False)):
        elsewhere = tuple(np.full_like(one, moved_m) for one in found.offsets_m)
        monkeypatch.setattr(continuum, "mesh_error", lambda *_, new=elsewhere[0]: new)
        again = tasks.refit(study, tasks.task_from(found))
        assert np.array_equal(again.offsets_m[0], elsewhere[0]) is taken
        assert np.array_equal(again.offsets_m[0], found.offsets_m[0]) is not taken


def test_a_fit_is_repeated_until_the_meshs_error_stands(study):
    """From another mesh error than its optimum has once is not enough; wherever it begins, it ends alike."""
    found = baseline(study)
    ends = []
    for wrong in (0.0, 3.0):
        begun = replace(found, offsets_m=tuple(wrong * one for one in found.offsets_m))
        ends.append(tasks.settled(study, begun))
        (own,) = fitting.mesh_error(study, ends[-1].point)
        moved = np.abs(own - ends[-1].offsets_m[0]).max()
        assert moved < 0.01 * np.abs(own).max()
    assert ends[0].chi2 == pytest.approx(ends[1].chi2, abs=0.05)
    assert tasks.settled(study, ends[0]) is ends[0]


def test_a_model_settles_whatever_the_order_of_its_effects(study):
    form = {"end_angle": ("start_1",), "clock_offset": ("time",)}
    start = {**baseline(study).point, Unknown("clock_offset.time"): 0.01}
    pair = tasks.refit(study, tasks.Task(form, (start,), baseline(study).offsets_m, 1))
    turned = replace(pair, effects=("clock_offset", "end_angle"))
    off = replace(turned, offsets_m=tuple(3.0 * one for one in pair.offsets_m))
    assert tasks.settled(study, off).chi2 == pytest.approx(tasks.settled(study, pair).chi2, abs=0.05)


def test_a_stiffness_at_which_the_rope_tears_is_none_to_begin_with(monkeypatch):
    """The softest may hang itself up on an obstacle that the rope passes, and be pulled apart."""
    raw = raw_study([made({})], QUICK)
    expected = acting_only(raw, FIRST_STIFFNESS_M4_S2)
    predict = RecordingModel.predict

    def torn_if(torn):
        def one(self, rod, parameters=()):
            if torn(rod.bending_stiffness):
                raise SimulationError("it would tear")
            return predict(self, rod, parameters)

        monkeypatch.setattr(RecordingModel, "predict", one)

    torn_if(lambda ei: ei < 0.5 * EI)
    assert acting_only(raw, FIRST_STIFFNESS_M4_S2).stiffnesses == expected.stiffnesses
    torn_if(lambda ei: True)
    with pytest.raises(SimulationError, match="tear"):
        acting_only(raw, FIRST_STIFFNESS_M4_S2)


def test_the_parts_of_a_pair_begin_where_the_pair_ended(study):
    """The first effect alone got stuck; the second does nothing but lead it out."""
    elastic = baseline(study)
    form = {"clock_offset": ("time",), "end_angle": ("start_1",)}
    start = {**elastic.point, Unknown("clock_offset.time"): 0.01, Unknown("end_angle.start_1"): 0.01}
    pair = tasks.refit(study, tasks.Task(form, (start,), elastic.offsets_m, 1))
    stuck = replace(elastic, effects=("end_angle",), chi2=elastic.chi2 + 1e4)
    models = {("end_angle",): stuck, ("clock_offset", "end_angle"): pair}
    backed(study, models, 2, lambda work, jobs, what: [work(study, job) for job in jobs])
    assert set(models) == {("end_angle",), ("clock_offset",), ("clock_offset", "end_angle")}
    assert models["end_angle",].chi2 < elastic.chi2 + 1.0
    assert [u.name for u in models["end_angle",].unknowns if "." in u.name] == ["end_angle.start_1"]


def test_one_pose_cannot_tell_an_uneven_set(study, monkeypatch):
    uneven = ("rest_curvature", rest_curvature.FORMS[-1])
    assert uneven in library(study, ())
    monkeypatch.setattr(study_module, "poses", lambda *_: 1)
    assert uneven not in library(study, ()) and ("rest_curvature", ("kappa_1",)) in library(study, ())


def test_nothing_is_sought_at_an_end_that_nobody_holds(study):
    one = study.seen[0]
    recording = replace(one.recording, ends=Ends("clamped", "free"))
    hanging = replace(study, seen=(replace(one, model=replace(one.model, recording=recording)),))
    found = library(hanging, ())
    assert "grasp_slip" in dict(library(study, ())) and "grasp_slip" not in dict(found)
    assert [form for name, form in found if name == "end_angle"] == [("start_1", "start_2")]
    both = replace(study, seen=(*hanging.seen, one))
    assert library(both, ()) == library(study, ())


def test_what_leaves_the_bounds_together_cannot_be_simulated(study):
    with pytest.raises(SimulationError, match="end_angle.start_1"):
        study.rod(0, {"bending_stiffness": EI, "end_angle.start_1": 1.03})


def test_how_one_end_is_rolled_joins_every_model_where_nobody_recorded_it(study):
    rolled = replace(study, rolls=(ROLL,))
    assert ROLL in [u.name for u in fitting.hypothesis(rolled, {}, study_offsets(study)).unknowns]
    assert "end_twist" in dict(library(study, ())) and "end_twist" not in dict(library(rolled, ()))
    point = {Unknown("bending_stiffness"): EI, Unknown("torsional_stiffness"): EI, Unknown(ROLL): 3.0}
    assert rolled.beginnings(point, "mass_profile") == [{}]
    sided = [one[Unknown(ROLL)] for one in rolled.beginnings(point, "rest_curvature")]
    assert sided[0] == pytest.approx(3.0) and len(sided) == len(ROLLS)
    assert np.abs(sided).max() <= np.pi


def study_offsets(study):
    return [np.zeros_like(one.recording.points.xyz_m) for one in study.seen]
