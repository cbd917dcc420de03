"""Recordings that begin in motion: where their ropes start, how fast, and when that is so."""

from dataclasses import replace

import numpy as np
import pytest
from pipeline.test_deform import HALF, ROPE, TRUE, shaken
from scipy.spatial.transform import Rotation
from sim import ropes

from dlolib.errors import SimulationError
from dlolib.sim.begun import BegunModel, in_motion, motion_model
from dlolib.sim.continuum import simulated
from dlolib.sim.effects import parameter
from dlolib.sim.effects.base import Camera
from dlolib.sim.observe import seen as seen_through
from dlolib.sim.observe import viewing_axis
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.types import Ends, Floats, Motion, Points, Recording

STEP_S, NOISE_M = 0.0025, 5e-4
AT_REST, SWINGING = 0, 12


def seen(first: int) -> Recording:
    """A rope between two clamps, one of which goes to and fro, from a frame on."""
    return replace(shaken(first=first), ends=Ends())


def rod(particles: int = 30) -> Rod:
    return Rod(ROPE, 1.0, 1.0, {}, particles).with_values({**TRUE, "inertia_drag.inertia": 1.0})


def noisy(recording: Recording) -> Recording:
    off = np.random.default_rng(5).normal(0.0, NOISE_M, recording.points.xyz_m.shape)
    points = replace(recording.points, xyz_m=recording.points.xyz_m + off)
    return replace(recording, points=points, position_noise_m=NOISE_M)


def mean_off(found: Floats, recording: Recording) -> float:
    return float(np.linalg.norm(found - recording.points.xyz_m, axis=1).mean())


def test_a_recording_whose_ends_move_begins_in_motion() -> None:
    swinging = seen(SWINGING)
    assert not in_motion(seen(AT_REST)) and in_motion(swinging)
    assert isinstance(motion_model(swinging, 20, STEP_S), BegunModel)
    slow = replace(swinging.motion, t_s=100 * swinging.motion.t_s)
    assert not in_motion(replace(swinging, motion=slow))
    assert not in_motion(replace(swinging, planar="xz"))


def test_it_goes_on_as_it_was_seen_also_where_inertia_is_an_effect() -> None:
    """A quasi-static rod has no such start; one with inertia starts as a dynamic recording's does."""
    swinging = replace(seen(SWINGING), quasi_static=True)
    begun = motion_model(swinging, 30, STEP_S)
    assert mean_off(begun.predict(rod()).xyz_m, swinging) < 1.2e-3
    assert mean_off(begun.predict(replace(rod(), effects={})).xyz_m, swinging) > 5e-3
    from_rest = RecordingModel(swinging, 30, STEP_S).predict(rod()).xyz_m
    assert mean_off(from_rest, swinging) > 3e-3
    assert mean_off(simulated(swinging, rod()).points.xyz_m, swinging) < 1.2e-3


def test_noise_of_the_markers_hardly_moves_what_is_begun() -> None:
    swinging = seen(SWINGING)
    clean, off = (motion_model(one, 30, STEP_S).predict(rod()).xyz_m for one in (swinging, noisy(swinging)))
    assert 0 < np.linalg.norm(off - clean, axis=1).mean() < 2 * NOISE_M


def test_a_swing_between_clamps_of_unknown_roll_is_solved() -> None:
    """Its energy all but cancels: what it is rounded by goes by its parts."""
    swinging = shaken(first=SWINGING)
    assert mean_off(motion_model(swinging, 30, STEP_S).predict(rod()).xyz_m, swinging) < 5e-3


def test_held_ends_stand_where_they_are_held() -> None:
    """Whatever the markers beside them say: a start apart from that would be a blow."""
    swinging = noisy(seen(SWINGING))
    model = motion_model(swinging, 30, STEP_S)
    rest = model.at_rest(rod())
    first = swinging.motion
    held = first.end_m[0] - STEP_S * (first.end_m[1] - first.end_m[0]) / (first.t_s[1] - first.t_s[0])
    assert np.abs(rest.x[0, -1, -1] - held).max() < 2e-5
    lengths = np.linalg.norm(np.diff(rest.x[0, -1], axis=0), axis=1)
    assert lengths == pytest.approx(np.full(29, ROPE.length_m / 29), rel=5e-3)


def test_too_few_points_are_no_shape_to_begin_with() -> None:
    swinging = seen(SWINGING)
    at = np.isclose(swinging.points.s_m, 0.3)
    points = swinging.points
    one = Points(points.frame[at], points.t_s[at], points.s_m[at], points.xyz_m[at])
    with pytest.raises(SimulationError, match="when 1 points of the rope are seen"):
        motion_model(replace(swinging, points=one), 30, STEP_S).predict(rod())


BENT = {"plastic_bending.yield_curvature": 6.0, "plastic_bending.hardening_ratio": 0.2}
AIR = {"inertia_drag.inertia": 1.0, "inertia_drag.drag": 0.2}


def bent_before(still_s: float = 0.0) -> Recording:
    """A plastic rope bent and straightened before it is seen; its log begins in motion, or still."""
    t_s = np.arange(0.0, 12.01, 0.05)
    end = np.zeros((len(t_s), 3))
    end[:, 0] = 0.40 - 0.30 * np.interp(t_s, [0, 2, 4], [0, 1, 0])
    start, q = np.zeros_like(end), np.tile([HALF, 0.0, HALF, 0.0], (len(t_s), 1))
    if still_s:
        t_s, end = np.append(-still_s, t_s), np.append(end[:1], end, axis=0)
        start, q = np.append(start[:1], start, axis=0), np.append(q[:1], q, axis=0)
    s_m = np.linspace(0, ropes.ROPE.length_m, 23)
    frame = np.repeat(np.arange(3), len(s_m))
    points = Points(frame, 8.0 + 2.0 * frame, np.tile(s_m, 3), np.zeros((len(frame), 3)))
    motion = Motion(t_s, start, q, end, q)
    blank = Recording("bent", ropes.ROPE, ropes.GRAVITY, Ends(), motion, points)
    return simulated(blank, Rod(ropes.ROPE, ropes.EI, ropes.GJ, BENT))


def test_what_a_rope_went_through_before_it_was_seen_is_remembered() -> None:
    """It hangs for seconds when it is seen first, whatever the first rows of the log."""
    begun, rod = bent_before(), Rod(ropes.ROPE, ropes.EI, ropes.GJ)
    assert in_motion(begun) and not in_motion(bent_before(0.2))
    plastic, elastic = (
        simulated(begun, replace(rod, effects=effects)).points.xyz_m for effects in ({**BENT, **AIR}, AIR)
    )
    assert mean_off(plastic, begun) < 0.3 * mean_off(elastic, begun)


def test_how_a_rope_was_bent_once_acts_on_one_that_begins_in_motion() -> None:
    swinging = seen(SWINGING)
    bent = rod().with_values({"plastic_bending.yield_curvature": 2.0, "plastic_bending.hardening_ratio": 0.2})
    prior = bent.with_values({"prior_history.kappa_1": 8.0})
    one, other = (motion_model(swinging, 30, STEP_S).predict(each).xyz_m for each in (bent, prior))
    assert np.linalg.norm(one - other, axis=1).max() > 1e-3


def underway() -> Recording:
    """A rope of which an end moves and turns, by the log from 0.9 s and in the frames from 1 s on."""
    t_s = np.linspace(0.0, 4.0, 81)
    gone = np.sin(t_s * np.pi / 4) ** 2
    end = np.array([0.33, 0.0, 0.02]) + gone[:, None] * [-0.12, 0.03, 0.06]
    start, level = np.zeros_like(end), np.tile(ropes.LEVEL, (len(t_s), 1))
    turned = Rotation.from_rotvec(gone[:, None] * [0.3, 0.4, 0.9]) * Rotation.from_quat(
        level, scalar_first=True
    )
    parts = t_s, start, level, end, turned.as_quat(scalar_first=True)
    frame, s_m = np.repeat(np.arange(10), 8), np.linspace(0.0, ropes.ROPE.length_m, 10)[1:-1]
    points = Points(frame, 1.0 + 0.1 * frame, np.tile(s_m, 10), np.zeros((80, 3)))
    blank = Recording("made", ropes.ROPE, ropes.GRAVITY, Ends(), Motion(*parts), points, quasi_static=False)
    xyz_m = RecordingModel(blank, 30, 0.01).predict(Rod(ropes.ROPE, ropes.EI, ropes.GJ)).xyz_m
    logged = Motion(*(part[t_s >= 0.9] for part in parts))
    return replace(blank, motion=logged, points=replace(points, xyz_m=xyz_m))


def seen_by(recording: Recording, camera: Camera) -> Recording:
    """The same, shown by a camera that is not where it is believed to be."""
    xyz_m = seen_through(recording.points.xyz_m, camera, viewing_axis(recording))
    return replace(recording, points=replace(recording.points, xyz_m=xyz_m))


def most_off(recording: Recording, effects: dict[str, float]) -> float:
    """How far [m] from where it was seen the rope is, at the worst."""
    rod = Rod(ropes.ROPE, ropes.EI, ropes.GJ, effects)
    found = motion_model(recording, 30, 0.01).predict(rod).xyz_m
    return float(np.linalg.norm(found - recording.points.xyz_m, axis=1).max())


@pytest.mark.parametrize(
    ("camera", "effects"),
    [
        (Camera(depth_m=0.02), {"camera_pose.depth": 0.02}),
        (Camera(rotation=(0.0, 0.05, 0.0)), {"camera_pose.rotation_2": 0.05}),
        (Camera(shift_m=(0.01, 0.0, 0.01)), {"camera_pose.shift_1": 0.01, "camera_pose.shift_3": 0.01}),
    ],
    ids=str,
)
def test_it_begins_where_it_was_and_not_where_a_camera_showed_it(
    camera: Camera, effects: dict[str, float]
) -> None:
    truly = most_off(underway(), {})
    assert most_off(seen_by(underway(), camera), effects) == pytest.approx(truly, rel=1e-3)
    assert most_off(seen_by(underway(), camera), {}) > 3 * truly


@pytest.mark.parametrize("late_s", [0.15, 0.05, -0.05, -0.15])
def test_its_ends_begin_where_the_camera_s_clock_has_them(late_s: float) -> None:
    """Also before the log's first row, when they moved as after it."""
    made = underway()
    logged = replace(made, motion=replace(made.motion, t_s=made.motion.t_s - late_s))
    truly = most_off(made, {})
    assert most_off(logged, {"clock_offset.time": late_s}) < 1.5 * truly


def test_where_the_ends_were_before_the_log_s_first_row() -> None:
    """They go on as after it, in place and in turn, for as long as the first frames last."""
    made = underway()
    model, first = motion_model(made, 30, 0.01), made.motion.t_s[0]
    now, early, late = (model._logged(np.array([first + by])) for by in (0.0, -0.2, 0.2))
    assert early.end_m == pytest.approx(2 * now.end_m - late.end_m)
    turns = [
        Rotation.from_quat(a.end_q, scalar_first=True).inv() * Rotation.from_quat(b.end_q, scalar_first=True)
        for a, b in ((early, now), (now, late))
    ]
    assert turns[0].as_rotvec() == pytest.approx(turns[1].as_rotvec())
    assert np.isnan(model._logged(np.array([first - 9.0])).end_m).sum() == 0


def check_derivatives(recording: Recording, rod: Rod, names: list[str]) -> None:
    """By these parameters, against differences that are extrapolated."""
    model = motion_model(recording, rod.particles, 0.01)
    assert isinstance(model, BegunModel)
    found = model.predict(rod, names).by_parameter

    def difference(name: str, width: float) -> Floats:
        values = (rod.value(name) + by for by in (width, -width))
        ahead, behind = (model.predict(rod.with_values({name: value})).xyz_m for value in values)
        return (ahead - behind) / (2 * width)

    for k, name in enumerate(names):
        width = 1e-4 * (parameter(name).scale if name in rod.effects else rod.value(name))
        by = (4 * difference(name, width / 2) - difference(name, width)) / 3
        assert np.abs(found[..., k] - by).max() < 1e-4 * np.abs(by).max(), name


VISCOUS = {"viscoelastic_bending.modulus_ratio": 0.4, "viscoelastic_bending.relaxation_time": 2.3}


@pytest.mark.parametrize(
    "effects",
    [
        {"length_error.relative": 0.03},
        VISCOUS,
        {**VISCOUS, "end_angle.start_1": 0.1, "end_angle.end_2": 0.1, "end_twist.end": -0.3},
        {"internal_friction.saturation_curvature": 1.0, "internal_friction.transition_curvature": 3.0},
        {"camera_pose.rotation_2": 0.05, "camera_pose.depth": 0.02, "clock_offset.time": 0.033},
        {**VISCOUS, "camera_pose.rotation_3": 0.05, "camera_pose.shift_1": 0.01},
        {**VISCOUS, "clock_offset.time": 0.033},
        {**VISCOUS, "clock_offset.time": -0.033, "grasp_slip.length": 0.01, "grasp_slip.time": 1.1},
        {**BENT, "end_angle.start_1": 0.1, "length_error.relative": 0.03, "prior_history.kappa_1": 8.0},
    ],
    ids=str,
)
def test_what_parameters_do_to_the_start_is_in_the_derivatives(effects: dict[str, float]) -> None:
    """To where the rope is drawn, to how its ends are turned, and to what it remembers."""
    rod = Rod(ropes.ROPE, ropes.EI, ropes.GJ, effects)
    check_derivatives(underway(), rod, ["bending_stiffness", "torsional_stiffness", *effects])


@pytest.mark.parametrize(
    "effects",
    [
        {"plastic_bending.yield_curvature": 2.0, "prior_history.kappa_1": 8.0},
        {"viscoelastic_bending.modulus_ratio": 0.5, "viscoelastic_bending.relaxation_time": 2.3},
        {"internal_friction.saturation_curvature": 1.0},
    ],
    ids=str,
)
def test_what_is_remembered_of_a_long_way_has_derivatives(effects: dict[str, float]) -> None:
    rod = Rod(ropes.ROPE, ropes.EI, ropes.GJ, {**AIR, **effects}, 20)
    check_derivatives(bent_before(), rod, ["bending_stiffness", *effects])


@pytest.mark.parametrize("noise_m", [0.0, NOISE_M])
def test_derivatives_by_what_moves_the_start_where_the_log_begins_with_the_frames(noise_m: float) -> None:
    """A clock or a camera that is a little off takes the rope to either side of where it was seen."""
    made = underway()
    rows = made.motion
    later = Motion(*(part[2:] for part in (rows.t_s, rows.start_m, rows.start_q, rows.end_m, rows.end_q)))
    made = replace(made, motion=later, position_noise_m=noise_m)
    names = ["clock_offset.time", "camera_pose.rotation_1", "camera_pose.depth", "length_error.relative"]
    rod = Rod(ropes.ROPE, ropes.EI, ropes.GJ, dict.fromkeys(names, 0.0))
    check_derivatives(made, rod, names)
