"""What a mesh and a time step leave out is foretold from a finer mesh in finer steps."""

from dataclasses import replace

import numpy as np
import pytest
from sim.bar import FALLS, over_the_bar
from sim.ropes import EI, GJ, LEVEL, ROPE, swing
from sim.test_recording import recording

from dlolib.errors import SimulationError
from dlolib.sim.begun import motion_model
from dlolib.sim.continuum import mesh_error, refined, simulated
from dlolib.sim.poses import PosesModel, model_of, near
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.sim.sides import Prediction
from dlolib.sim.steps import dynamic_step
from dlolib.types import Ends, Motion, Points, Recording


def off(model: RecordingModel, finely: RecordingModel) -> tuple[float, float]:
    """How far the model is from a much finer one [m], as it is and corrected."""
    rod = Rod(ROPE, EI, GJ, particles=model.particles)
    true = finely.predict(rod.with_particles(finely.particles)).xyz_m
    coarse = model.predict(rod).xyz_m
    corrected = coarse + mesh_error(model, refined(model, 2), rod)
    return float(np.abs(coarse - true).max()), float(np.abs(corrected - true).max())


def test_a_coarse_mesh_tells_the_continuous_rod() -> None:
    model = RecordingModel(recording(), 30, None)
    plain, corrected = off(model, replace(model, particles=465))
    assert plain > 5e-4
    assert corrected < 0.05 * plain


def test_a_rope_that_slides_along_a_bar_is_followed_on_meshes_that_agree() -> None:
    """The usual mesh takes it elsewhere, by millimetres, and so tells nothing of the continuous rod."""
    fine, found, coarse = (
        over_the_bar(particles, 0.0, finer, FALLS) for particles, finer in ((465, 2), (30, 4), (30, 1))
    )
    off, once = (np.abs(one.points.xyz_m - fine.points.xyz_m).max() for one in (found, coarse))
    assert off < 1e-4 < 5e-3 < once


def quick() -> Recording:
    """Ten times as fast as recorded, the rope swings; its end moves off gently, and stops so."""
    made, u = recording(), np.linspace(0, 1, 601)
    eased = u**3 * (10 - 15 * u + 6 * u**2)
    end = np.stack([np.interp(eased, u, part) for part in swing(601).T], axis=1)
    held = np.tile(LEVEL, (601, 1))
    motion = Motion(0.6 * u, np.zeros((601, 3)), held, end, held)
    points = replace(made.points, t_s=made.points.t_s / 10)
    return replace(made, quasi_static=False, motion=motion, points=points)


def test_long_steps_tell_how_the_rope_swings() -> None:
    made = quick()
    model = RecordingModel(made, 120, 0.02)
    plain, corrected = off(model, replace(model, particles=477, step_s=0.02 / 64))
    still = replace(model, recording=replace(made, quasi_static=True), step_s=None)
    slow = off(still, replace(still, particles=477))[0]
    assert plain > 5 * slow
    assert corrected < 0.15 * plain


def test_half_the_step_leaves_a_quarter_of_the_error() -> None:
    rod = Rod(ROPE, EI, GJ, particles=30)
    shortest, *shapes = (
        RecordingModel(quick(), 30, step_s).predict(rod).xyz_m for step_s in (0.02 / 64, 0.02, 0.01, 0.005)
    )
    errors = np.array([np.abs(shape - shortest).max() for shape in shapes])
    assert errors[:-1] / errors[1:] == pytest.approx([4.0, 4.0], rel=0.1)


def test_steps_follow_what_the_rows_tell() -> None:
    motion = recording().motion
    assert dynamic_step(motion, 0.01) == 0.01
    assert dynamic_step(replace(motion, t_s=motion.t_s / 10), 0.01) == pytest.approx(0.0025)
    assert dynamic_step(replace(motion, t_s=motion.t_s[:1]), 0.01) == 0.01


def test_a_simulated_recording_is_the_continuous_rods() -> None:
    made, rod = recording(), Rod(ROPE, EI, GJ, particles=30)
    true = simulated(made, rod.with_particles(465)).points.xyz_m
    assert np.abs(simulated(made, rod, finer=4).points.xyz_m - true).max() < 2e-5
    assert np.abs(simulated(made, rod).points.xyz_m - true).max() > 5e-4


def test_two_meshes_that_take_two_shapes_make_no_third(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, rod = recording(), Rod(ROPE, EI, GJ, particles=30)
    own, predict = simulated(made, rod).points.xyz_m, RecordingModel.predict

    def snapped(model: RecordingModel, rod: Rod) -> Prediction:
        """The finer rope hangs 5 cm beside the other."""
        seen = predict(model, rod)
        return replace(seen, xyz_m=seen.xyz_m + 0.05) if model.particles == 117 else seen

    monkeypatch.setattr(RecordingModel, "predict", snapped)
    caplog.clear()
    np.testing.assert_array_equal(simulated(made, rod, finer=4).points.xyz_m, own)
    assert "its shape depends on the mesh: a finer one takes another" in caplog.text


def settled_poses() -> Recording:
    """Two held ends, brought near each other and apart again, a pose every 5 s; its points are nowhere."""
    made, t_s = recording(), 5.0 * np.arange(9)
    nearer = np.sin(np.pi * t_s / t_s[-1]) ** 2
    end = np.array([0.33, 0, 0.02]) + nearer[:, None] * np.array([-0.17, 0.0, 0.05])
    turn, s_m = np.tile([0.5, 0.5, 0.5, 0.5], (9, 1)), np.linspace(0.05, 0.4, 7)
    points = Points(np.repeat([*range(9)], 7), np.repeat(t_s, 7), np.tile(s_m, 9), np.zeros((63, 3)))
    return replace(made, motion=Motion(t_s, 0 * end, turn, end, turn), points=points)


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"plastic_bending.yield_curvature": 6.0},
        {"internal_friction.saturation_curvature": 1.0},
        {"viscoelastic_bending.modulus_ratio": 0.4, "viscoelastic_bending.relaxation_time": 20.0},
    ],
    ids=str,
)
def test_settled_poses_are_played_back_as_they_were_fitted(effects: dict[str, float]) -> None:
    """Way unknown: each from where it was seen. Where the points are nowhere they are the motion's."""
    bare, elastic = settled_poses(), Rod(ROPE, EI, GJ, particles=30)
    seen, rod = simulated(bare, elastic), replace(elastic, effects=effects)
    model = model_of(seen, 30, None)
    assert isinstance(model, PosesModel)
    np.testing.assert_array_equal(simulated(seen, rod).points.xyz_m, model.predict(rod).xyz_m)
    corrected = model.predict(rod).xyz_m + mesh_error(model, refined(model, 2), rod)
    np.testing.assert_array_equal(simulated(seen, rod, finer=2).points.xyz_m, corrected)
    followed = near(motion_model(bare, 30, None), elastic) if effects else motion_model(bare, 30, None)
    np.testing.assert_array_equal(simulated(bare, rod).points.xyz_m, followed.predict(rod).xyz_m)


def stretched(apart_m: float) -> Recording:
    """Held so far apart from the first pose on."""
    made = recording()
    motion = made.motion
    end = np.tile([apart_m, 0.0, 0.0], (len(motion.t_s), 1))
    return replace(made, motion=replace(motion, start_m=0 * end, end_m=end, end_q=motion.start_q))


@pytest.mark.parametrize(
    "effects", [{"length_error.relative": 0.05}, {"axial_stretch.axial_stiffness": 10.0}], ids=str
)
def test_what_makes_a_rope_long_enough_counts_from_the_first_pose_on(
    effects: dict[str, float], caplog: pytest.LogCaptureFixture
) -> None:
    rod, made = Rod(ROPE, EI, GJ, particles=30), stretched(0.45)
    with pytest.raises(SimulationError, match="0.45 m apart, the rope is 0.445 m long"):
        simulated(made, rod)
    xyz_m = simulated(made, replace(rod, effects=effects)).points.xyz_m
    assert np.isfinite(xyz_m).all() and not caplog.text
    assert xyz_m[:, 2].min() > -0.06


def test_a_rope_that_is_pulled_longer_than_it_is_is_said(caplog: pytest.LogCaptureFixture) -> None:
    made = stretched(0.46)
    opened = np.linspace([0.40, 0, 0], [0.46, 0, 0], len(made.motion.t_s))
    made = replace(made, motion=replace(made.motion, end_m=opened))
    simulated(made, Rod(ROPE, EI, GJ, particles=30))
    assert "the ends are held 0.46 m apart, the rope is 0.445 m long; check the length" in caplog.text


def test_the_mass_at_the_tip_hangs_at_the_free_end_whichever_it_is() -> None:
    """A cantilever seen from either side; with a lump and a gradient, which count from the start on."""
    made, rope = recording(), replace(ROPE, tip_mass_kg=0.01)
    rows = len(made.motion.t_s)
    held, turn = np.zeros((rows, 3)), np.tile([0.5, 0.5, 0.5, 0.5], (rows, 1))
    nowhere, unturned = np.full((rows, 3), np.nan), np.full((rows, 4), np.nan)
    forth = replace(
        made, rope=rope, ends=Ends("clamped", "free"),
        motion=Motion(made.motion.t_s, held, turn, nowhere, unturned),
    )  # fmt: skip
    back = replace(
        forth, ends=Ends("free", "clamped"), motion=Motion(made.motion.t_s, nowhere, unturned, held, turn),
        points=replace(made.points, s_m=0.445 - made.points.s_m),
    )  # fmt: skip
    lump = {"mass_profile.mass": 0.002}
    rod = Rod(rope, 2e-2, 2e-2, {**lump, "mass_profile.s": 0.1, "mass_profile.gradient": 0.3}, 30)
    other = replace(rod, effects={**lump, "mass_profile.s": 0.345, "mass_profile.gradient": -0.3})
    here, there = simulated(forth, rod).points.xyz_m, simulated(back, other).points.xyz_m
    assert here[:, 2].min() < -0.1
    np.testing.assert_allclose(there * [-1, 1, 1], here, atol=1e-7)


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ({"contact_friction.coefficient": 0.3}, "contact_friction does nothing here"),
        ({"lateral_load.x": 0.0}, "lateral_load does nothing here"),
        ({"prior_history.kappa_1": 3.0}, "prior_history does nothing here"),
        ({"mass_profile.mass": 0.01}, "mass_profile does nothing here"),
        ({"plastic_bending.hardening_ratio": 0.2}, "plastic_bending does nothing here"),
        ({"mass_profile.mass": 0.01, "mass_profile.s": 0.2}, ""),
        ({"grasp_slip.length": 0.01, "grasp_slip.time": 1.0}, "grasp_slip is of an end that nobody holds"),
        ({"end_angle.end_1": 0.1}, "end_angle is of an end that nobody holds"),
        ({"camera_pose.depth": 0.01, "end_angle.start_1": 0.1}, ""),
    ],
    ids=str,
)
def test_an_effect_that_can_do_nothing_is_said(
    effects: dict[str, float], said: str, caplog: pytest.LogCaptureFixture
) -> None:
    made = recording()
    motion = replace(made.motion, end_m=np.nan * made.motion.end_m, end_q=np.nan * made.motion.end_q)
    hangs = replace(made, ends=Ends("clamped", "free"), motion=motion)
    simulated(hangs, Rod(ROPE, EI, GJ, effects, particles=20))
    assert said in caplog.text if said else not caplog.text
