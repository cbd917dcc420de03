"""The rod under a recording's motion: derivatives of the points, and a stiffness recovered."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE, pose, swing, way_of

from dlolib.errors import ParameterError, SimulationError
from dlolib.identify import IdentifySettings, identify
from dlolib.sim.continuum import simulated
from dlolib.sim.effects import named
from dlolib.sim.effects.base import Setup
from dlolib.sim.poses import PosesModel, model_of
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod, scene, unit_of
from dlolib.sim.simulate import Rollout
from dlolib.sim.start import first_shape, settle
from dlolib.types import PER_DENSITY, Ends, Floats, Motion, Obstacle, Points, Recording

FRAMES, SEEN = 6, 12
MIDWAY = {"mass_profile.s": 0.2}


def recording(quasi_static: bool = True) -> Recording:
    """A made-up recording of the paper's rope; where the points were seen is filled in by the rod."""
    t_s = np.linspace(0, 6, 61)
    way = swing(61)
    held = np.tile(LEVEL, (61, 1))
    motion = Motion(t_s, np.zeros((61, 3)), held, way, held)
    frame = np.repeat(np.arange(FRAMES), SEEN)
    s = np.tile(np.linspace(0.01, 0.43, SEEN), FRAMES)
    points = Points(frame, 1.0 + 0.93 * frame, s, np.zeros((len(s), 3)))
    made = Recording("made", ROPE, GRAVITY, Ends(), motion, points, quasi_static=quasi_static)
    return simulated(made, Rod(ROPE, EI, GJ, particles=481))


def test_planted_stiffnesses_are_found() -> None:
    made = recording()
    noisy = replace(
        made.points,
        xyz_m=made.points.xyz_m + np.random.default_rng(3).normal(0, 2e-4, made.points.xyz_m.shape),
    )
    fit = identify([replace(made, points=noisy)], IdentifySettings()).fit
    found = fit.parameters["bending_stiffness"]
    assert found.value == pytest.approx(EI, rel=0.02)
    assert (
        found.low is not None and found.high is not None and found.low < EI * 1.02 and found.high > EI * 0.98
    )
    assert fit.parameters["torsional_stiffness"].value == pytest.approx(GJ, rel=0.3)
    assert fit.rmse_m == pytest.approx(2e-4 * np.sqrt(3), rel=0.15)


def test_in_one_plane_torsion_does_not_act() -> None:
    made = recording()
    flat = replace(made.motion, end_m=made.motion.end_m * [1, 0, 1])
    made = simulated(replace(made, motion=flat), Rod(ROPE, EI, GJ, particles=121))
    assert "torsional_stiffness" not in identify([made], IdentifySettings()).fit.parameters


def test_a_name_that_cannot_be_fitted_is_refused() -> None:
    with pytest.raises(ParameterError, match="choose from"):
        identify([recording()], IdentifySettings(parameters=("stiffness",)))


def test_unknown_density_gives_ratios() -> None:
    made = recording()
    unweighed = replace(made, rope=replace(ROPE, linear_density_kg_m=None))
    found = identify([unweighed], IdentifySettings()).fit.parameters["bending_stiffness_over_density"]
    assert found.value == pytest.approx(EI / 0.04, rel=0.02)
    assert found.unit == "m^4/s^2"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mass_profile.mass", 2e-3),
        ("lateral_load.y", 0.05),
        ("end_compliance.start_stiffness", 0.01),
        ("axial_stretch.axial_stiffness", 2.0),
        ("inertia_drag.drag", 0.5),
    ],
)
def test_what_is_told_of_an_unweighed_rope_is_so_much_for_its_density(name: str, value: float) -> None:
    made, density = recording(quasi_static="drag" not in name), 0.04
    unweighed = replace(ROPE, linear_density_kg_m=None)
    ropes = [
        Rod(replace(ROPE, linear_density_kg_m=density), EI, GJ, {**MIDWAY, name: value}),
        Rod(unweighed, EI / density, GJ / density, {**MIDWAY, name: value / density}),
    ]
    seen = [RecordingModel(made, 30, 0.02).predict(rod).xyz_m for rod in ropes]
    assert seen[0] == pytest.approx(seen[1], abs=1e-7)
    bare = RecordingModel(made, 30, 0.02).predict(Rod(ROPE, EI, GJ)).xyz_m
    assert np.abs(seen[0] - bare).max() > 1e-4
    assert unit_of(name, weighed=False) == unit_of(name) + PER_DENSITY
    assert unit_of("plastic_bending.yield_curvature", weighed=False) == "1/m"


def test_settled_poses_are_solved_one_by_one() -> None:
    made = recording()
    frames = np.unique(made.points.t_s)
    rows = np.searchsorted(made.motion.t_s, frames)
    rows[1::2] = rows[1::2][::-1]  # far apart, so that the ways between are long
    motion = made.motion
    sparse = Motion(
        frames, motion.start_m[rows], motion.start_q[rows], motion.end_m[rows], motion.end_q[rows]
    )
    model = model_of(replace(made, motion=sparse), 30, None)
    assert isinstance(model, PosesModel)
    whole = RecordingModel(replace(made, motion=sparse), 30, None)
    rod = Rod(ROPE, EI, GJ)
    each, one = model.predict(rod, ["bending_stiffness"]), whole.predict(rod, ["bending_stiffness"])
    assert np.abs(each.xyz_m - one.xyz_m).max() < 1e-8
    assert np.abs(each.by_parameter - one.by_parameter).max() < 1e-6 * np.abs(one.by_parameter).max()


def test_rows_of_a_fast_motion_are_no_settled_poses() -> None:
    """However far they are apart: in so short a time the ends went no other way."""
    way, ends = np.array([90.0, 120, 150]), Ends("clamped", "clamped")
    assert isinstance(model_of(poses(way, ends, every_s=10.0), 20, None), PosesModel)
    assert isinstance(model_of(poses(way, ends, every_s=0.1), 20, None), RecordingModel)


def test_a_rod_of_another_mesh_is_refused() -> None:
    for model in (RecordingModel(recording(), 20, None), PosesModel(recording(), 20)):
        with pytest.raises(ParameterError, match="30 particles where the recording's model has 20"):
            model.predict(Rod(ROPE, EI, GJ))


def poses(degrees: Floats, ends: Ends, every_s: float = 30.0) -> Recording:
    """A rope seen at each of some angles about y to which its start was turned."""
    t_s, count = every_s * np.arange(len(degrees)), len(degrees)
    half = np.deg2rad(degrees) / 2
    turned = np.stack([np.cos(half), 0 * half, np.sin(half), 0 * half], axis=1)
    still = np.tile([0.2, 0.0, 0.3], (count, 1))
    motion = Motion(t_s, np.zeros((count, 3)), turned, still, np.tile([1.0, 0, 0, 0], (count, 1)))
    tips = Points(np.arange(count), t_s, np.full(count, 0.445), still)
    return Recording("made", ROPE, GRAVITY, ends, motion, tips, quasi_static=True)


RUBS = Rod(ROPE, 5 * EI, GJ, named("internal_friction", {"saturation_curvature": 3.0}), particles=20)


def test_a_rope_that_remembers_follows_the_order_of_settled_poses() -> None:
    """From either side it comes to another shape at the same angle; an elastic one to the same."""
    hanging = Ends("clamped", "free")
    to_and_fro, back = np.array([90.0, 120, 150, 120, 90]), np.array([150.0, 120, 90])
    made, other = (model_of(poses(way, hanging), 20, None) for way in (to_and_fro, back))
    assert isinstance(made, PosesModel)
    rubs, plain = (made.predict(rod).xyz_m for rod in (RUBS, replace(RUBS, effects={})))
    assert np.abs(plain[[0, 1]] - plain[[4, 3]]).max() < 1e-6
    assert np.linalg.norm(rubs[[0, 1]] - rubs[[4, 3]], axis=1).min() > 0.005
    assert np.linalg.norm(rubs[1:4] - other.predict(RUBS).xyz_m[[1, 0, 1]], axis=1).min() > 0.002


def test_some_of_the_settled_poses_come_out_as_all_of_them() -> None:
    """Those between are passed, too."""
    made = poses(np.array([90.0, 120, 150, 120, 90]), Ends("clamped", "free"))
    some = [0, 1, 4]
    points = Points(
        *(part[some] for part in (np.arange(5), made.points.t_s, made.points.s_m, made.points.xyz_m))
    )
    whole = PosesModel(made, 20).predict(RUBS).xyz_m[some]
    assert np.abs(PosesModel(replace(made, points=points), 20).predict(RUBS).xyz_m - whole).max() < 1e-8


@pytest.mark.parametrize("effects", [RUBS.effects, {}], ids=["remembers", "does not"])
def test_what_settles_is_at_rest(effects: dict[str, float]) -> None:
    """Settled poses have no speed: nothing tells of inertia in them, and no time step is asked for."""
    made = model_of(poses(np.array([90.0, 120, 150]), Ends("clamped", "free")), 20, None)
    plain = replace(RUBS, effects=effects)
    inert = plain.with_values(named("inertia_drag", {"inertia": 1.0, "drag": 0.1}))
    assert np.abs(made.predict(inert).xyz_m - made.predict(plain).xyz_m).max() < 1e-9


def test_what_slips_is_a_length_however_long_the_rope_is() -> None:
    slip = {"length": 0.02, "time": -1.0, "duration": 0.0}
    longer = {**named("grasp_slip", slip), **named("length_error", {"relative": 0.1})}
    model = RecordingModel(recording(), 20, None)
    x = model.roll_out(Rod(ROPE, EI, GJ, longer, particles=20)).x[0, -1]
    free_m = np.linalg.norm(np.diff(x, axis=0), axis=1).sum()
    assert free_m == pytest.approx(1.1 * ROPE.length_m - 0.02, abs=1e-5)


def test_what_settles_has_relaxed() -> None:
    """A viscous rope is seen as an elastic one, long after it came there."""
    viscous = {"modulus_ratio": 0.5, "relaxation_time": 2.0}
    made = model_of(poses(np.array([90.0, 120, 150]), Ends("clamped", "free")), 20, None)
    slack, plain = (replace(RUBS, effects=e) for e in (named("viscoelastic_bending", viscous), {}))
    off = np.linalg.norm(made.predict(slack).xyz_m - made.predict(plain).xyz_m, axis=1)
    assert off[0] > 0.005 and off[1:].max() < 1e-3


def test_between_two_held_ends_each_settled_pose_is_reached_from_straight() -> None:
    way = np.array([90.0, 100, 110, 100, 90])
    found = model_of(poses(way, Ends("clamped", "clamped")), 20, None).predict(RUBS).xyz_m
    assert np.abs(found[[0, 1]] - found[[4, 3]]).max() < 1e-6


def test_frames_close_to_each_other_are_interpolated() -> None:
    made = recording()
    t_s = np.linspace(0.5, 6.0, 800)
    frame = np.arange(800)
    s = np.full(800, 0.2)
    dense = replace(made, points=Points(frame, t_s, s, np.zeros((800, 3))))
    rod, model = Rod(ROPE, EI, GJ), RecordingModel(dense, 30, None)
    assert len(model.times(model.setup(rod))) < 150
    found = model.predict(rod).xyz_m
    for k in (150, 400, 622):
        # up to this frame alone it is the last one, which is solved for
        alone = Points(frame[k : k + 1], t_s[k : k + 1], s[:1], np.zeros((1, 3)))
        exact = RecordingModel(replace(made, points=alone), 30, None).predict(rod).xyz_m[0]
        assert np.abs(found[k] - exact).max() < 2e-4 * ROPE.length_m


def test_a_like_rod_s_first_shape_leads_to_the_same_equilibrium() -> None:
    made = recording()
    rod = Rod(ROPE, EI, GJ)
    plain, near = (RecordingModel(made, 30, None, near=one) for one in (None, Rod(ROPE, 0.5 * EI, GJ)))
    assert np.abs(plain.predict(rod).xyz_m - near.predict(rod).xyz_m).max() < 1e-9


def test_what_moves_the_camera_alone_is_differentiated_without_the_rope() -> None:
    made = recording()
    names = ["camera_pose.rotation_2", "bending_stiffness", "camera_pose.shift_1"]
    values = {"bending_stiffness": EI, "torsional_stiffness": GJ, "camera_pose.rotation_2": 0.1}
    model = RecordingModel(made, 30, None)
    by = model.predict(Rod.of(ROPE, values, 30), names).by_parameter
    for k, (name, step) in enumerate(zip(names, (1e-5, 1e-4 * EI, 1e-5), strict=True)):
        sides = [{**values, name: values.get(name, 0.0) + side} for side in (step, -step)]
        ahead, behind = (model.predict(Rod.of(ROPE, side, 30)).xyz_m for side in sides)
        expected = (ahead - behind) / (2 * step)
        assert np.abs(by[:, :, k] - expected).max() < 1e-5 * np.abs(expected).max()


def test_a_prediction_does_not_depend_on_those_before() -> None:
    made, rod = recording(), Rod(ROPE, EI, GJ)
    names = ["bending_stiffness", "camera_pose.depth"]
    alone = RecordingModel(made, 30, None).predict(rod, names)
    model = RecordingModel(made, 30, None)
    for share in (1.0, 1.1, 0.9, 1.0, 1.2, 0.8, 1.3, 1.0, 1.0):
        # what lies elsewhere but where it is moves nothing, and is solved for once
        again = model.predict(
            replace(rod, bending_stiffness=share * EI, effects={"mass_profile.s": share / 9}), names
        )
        if share == 1.0:
            np.testing.assert_array_equal(again.xyz_m, alone.xyz_m)
            np.testing.assert_array_equal(again.by_parameter, alone.by_parameter)


def test_a_derivative_does_not_depend_on_what_else_is_asked_for() -> None:
    made = recording()
    effects = {
        "plastic_bending.yield_curvature": 3.0,
        "internal_friction.saturation_curvature": 1.0,
        "rest_curvature.wave_1_2": 0.5,
        "mass_profile.mass": 0.004,
    }
    rod = Rod(ROPE, EI, GJ, effects)
    names = [
        "bending_stiffness",
        "torsional_stiffness",
        *effects,
        "length_error.relative",
        "end_angle.start_1",
        "clock_offset.time",
    ]
    model = RecordingModel(made, 30, None)
    together = model.predict(rod, names).by_parameter
    for k, name in enumerate(names):
        alone = model.predict(rod, [name]).by_parameter[:, :, 0]
        np.testing.assert_allclose(together[:, :, k], alone, rtol=0, atol=1e-12 * np.abs(alone).max())


def test_effects_are_simulated_from_the_shape_that_the_rope_has_without_them() -> None:
    made = recording()
    effects = {"rest_curvature.kappa_1": 3.0, "internal_friction.saturation_curvature": 2.0}
    rod = Rod(ROPE, EI, GJ, effects)
    near = RecordingModel(made, 30, None, near=Rod(ROPE, EI, GJ))
    assert np.array_equal(simulated(made, rod).points.xyz_m, near.predict(rod).xyz_m)


BAR = Obstacle(
    "cylinder",
    {"center_m": (0.2, 0.0, -0.3), "axis": (0.0, 1.0, 0.0), "radius_m": (0.02,), "height_m": (1.0,)},
)


@pytest.mark.parametrize(
    ("friction", "follows", "share"), [(0.5, 0.3, 0.25), (0.5, 0.1, 0.0625), (0.0, 0.3, None)]
)
def test_a_rope_that_rubs_is_followed_in_shorter_steps(
    monkeypatch: pytest.MonkeyPatch, friction: float, follows: float, share: float | None
) -> None:
    """Where long steps find no equilibrium, as where friction holds it until it slides far and at once."""
    model = RecordingModel(replace(recording(), obstacles=(BAR,)), 30, None)
    rod = Rod(ROPE, EI, GJ, {"contact_friction.coefficient": friction})
    moved, shares = RecordingModel._moved, []

    def tried(self: RecordingModel, made: Setup, rest: Rollout) -> Rollout:
        shares.append(self.share)
        if self.share > follows:
            raise SimulationError("no equilibrium", mend="")
        return moved(self, made, rest)

    monkeypatch.setattr(RecordingModel, "_moved", tried)
    if share is None:
        with pytest.raises(SimulationError) as refused:
            model.predict(rod)
        assert refused.value.place == model.recording.name
        assert shares == [1.0]
        return
    rollout, times = model.timed(rod)
    assert shares[-1] == share and len(times) == rollout.x.shape[1] - 1
    assert len(times) > 2 * len(model.times(model.setup(rod)))
    assert model.predict(rod).xyz_m.shape == (FRAMES * SEEN, 3)


MEMORIES = {
    "none": {},
    "plastic": {"plastic_bending.yield_curvature": 2.0, "plastic_bending.hardening_ratio": 0.2},
    "friction": {
        "internal_friction.saturation_curvature": 2.0,
        "internal_friction.transition_curvature": 1.0,
    },
    "viscous": {"viscoelastic_bending.modulus_ratio": 0.5, "viscoelastic_bending.relaxation_time": 2.0},
}


@pytest.mark.parametrize("law", MEMORIES)
@pytest.mark.parametrize("quasi_static", [True, False])
@pytest.mark.parametrize("time_s", [-0.5, -1.5])
def test_a_log_that_is_ahead_loses_nothing_of_the_motion(law: str, quasi_static: bool, time_s: float) -> None:
    """What the camera's clock calls the time before the first row bends the rope, too."""
    made = replace(recording(), quasi_static=quasi_static)
    shifted = replace(made, motion=replace(made.motion, t_s=made.motion.t_s + time_s))
    found, right = (
        RecordingModel(one, 30, 0.01).predict(Rod(ROPE, EI, GJ, {**MEMORIES[law], **also})).xyz_m
        for one, also in ((made, {"clock_offset.time": time_s}), (shifted, {}))
    )
    assert np.linalg.norm(found - right, axis=1).max() < 1e-4


@pytest.mark.parametrize("law", MEMORIES)
@pytest.mark.parametrize("time_s", [2.0, -0.8])
def test_steps_follow_the_motion_when_it_is_seen(law: str, time_s: float) -> None:
    """The rope moves while nothing is seen: an end goes out and back, and rolls one that could not yield."""
    t_s, made = np.linspace(0, 10, 201), recording()
    gone = np.where((t_s > 1) & (t_s < 3), np.sin(np.pi * (t_s - 1) / 2), 0.0)[:, None]
    rolled = (0.0 if MEMORIES[law] else 3 * np.pi) * np.clip((t_s[:, None] - 1) / 2, 0, 1)
    level = Rotation.from_quat(LEVEL, scalar_first=True)
    q = (level * Rotation.from_rotvec(rolled * [0.0, 0.0, 1.0])).as_quat(canonical=False, scalar_first=True)
    start, held = np.zeros((201, 3)), np.tile(LEVEL, (201, 1))
    motion = Motion(t_s, start, held, [0.33, 0.0, 0.02] + gone * [-0.17, 0.0, 0.05], q)
    frame = np.repeat(np.arange(3), SEEN)
    points = Points(
        frame, np.array([0.0, 4.0, 9.0])[frame], made.points.s_m[: 3 * SEEN], np.zeros((3 * SEEN, 3))
    )
    made = replace(made, motion=motion, points=points)
    shifted = replace(made, motion=replace(motion, t_s=t_s + time_s))
    found, right = (
        RecordingModel(one, 30, None).predict(Rod(ROPE, EI, GJ, {**MEMORIES[law], **also})).xyz_m
        for one, also in ((made, {"clock_offset.time": time_s}), (shifted, {}))
    )
    assert found == pytest.approx(right, abs=1e-8)


@pytest.mark.parametrize("law", MEMORIES)
@pytest.mark.parametrize("time_s", [-0.313, 0.313])
def test_derivatives_by_a_log_that_is_ahead_or_late(law: str, time_s: float) -> None:
    model, name = RecordingModel(recording(), 30, None), "clock_offset.time"
    rod = Rod(ROPE, EI, GJ, {**MEMORIES[law], name: time_s})
    found = model.predict(rod, [name]).by_parameter[:, :, 0]
    ahead, behind = (model.predict(rod.with_values({name: time_s + by})).xyz_m for by in (1e-5, -1e-5))
    by = (ahead - behind) / 2e-5
    assert np.abs(found - by).max() < 1e-3 * np.abs(by).max()


def test_a_rope_begins_on_the_side_of_an_obstacle_where_it_was_seen() -> None:
    """It hangs over a bar, and would hang under it as well."""
    values = {"center_m": (0.16, 0.0, 0.01), "axis": (0.0, 1.0, 0.0), "radius_m": (0.01,), "height_m": (0.6,)}
    bar, rod, made = (Obstacle("cylinder", values),), Rod(ROPE, EI, GJ), recording()
    start, end = pose(0, 0, 0), pose(0.33, 0.0, 0.0)
    over = first_shape(ROPE.length_m, 30, start, end, -GRAVITY)
    held = way_of(end.position_m[None])
    shape = settle(scene([rod], GRAVITY, Ends(), bar), over, held).x[0, -1]
    assert shape[:, 2].max() > 0.02
    s_m = np.linspace(0.0, ROPE.length_m, 30)[1:-1]
    noise = np.random.default_rng(2).normal(0.0, 5e-4, (28, 3))
    points = Points(np.zeros(28, int), np.zeros(28), s_m, shape[1:-1] + noise)
    motion = Motion(np.array([0.0, 1.0]), *(np.repeat(part, 2, axis=0) for part in (
        np.zeros((1, 3)), LEVEL[None], end.position_m[None], LEVEL[None])))  # fmt: skip
    lies = replace(made, motion=motion, points=points, obstacles=bar)
    found = RecordingModel(lies, 30, None).predict(rod).xyz_m
    assert np.abs(found - shape[1:-1]).max() < 1e-5
    unseen = replace(points, xyz_m=np.zeros((28, 3)))
    assert RecordingModel(replace(lies, points=unseen), 30, None).predict(rod).xyz_m[:, 2].max() < 0.005
