"""The laboratory's rope against the exact elastica, its plastic law, its clearance."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlolib.errors import DloError, ParameterError, SimulationError
from dlolib.lab.arc import ALONG_X, arc_motion
from dlolib.lab.elastica import planar_elastica
from dlolib.lab.plastic import return_mapping
from dlolib.lab.play import LabRun, play
from dlolib.lab.rope import LabRope
from dlolib.types import Floats, Motion, Obstacle

ELASTIC, PLASTIC = LabRope(law="elastic"), LabRope()
COARSE = replace(PLASTIC, bodies=20)
WEIGHT = ELASTIC.linear_density_kg_m * 9.81


def path(*xz: tuple[float, float], leg_s: float = 2.0) -> Motion:
    """The end from one place to the next, x and z [m]."""
    places = np.array([[x, 0.0, z] for x, z in xz])
    pose = np.tile(ALONG_X, (len(places), 1))
    return Motion(leg_s * np.arange(len(places)), 0 * places, pose, places, pose)


def off_elastica(run: LabRun, stiffness: float) -> Floats:
    """Largest distance [m] of each sample from the exact elastica with the same ends."""
    worst, guess = [], None
    for xyz in run.xyz_m:
        ends = ((xyz[0, 0], xyz[0, 2]), (xyz[-1, 0], xyz[-1, 2]))
        guess = planar_elastica(ELASTIC.length_m, stiffness, WEIGHT, ends[0], 0.0, ends[1], 0.0, guess)
        exact = np.stack([np.interp(run.s_m, guess[0], guess[1]), np.interp(run.s_m, guess[0], guess[2])], 1)
        worst.append(np.linalg.norm(xyz[:, [0, 2]] - exact, axis=1).max())
    return np.array(worst)


def bending(run: LabRun) -> Floats:
    """Curvature about the first axis at the inner joints [1/m], shape (F, M - 2)."""
    pieces = np.diff(run.xyz_m, axis=1)
    angle = np.unwrap(np.arctan2(pieces[..., 2], pieces[..., 0]), axis=1)
    return np.asarray(-np.diff(angle, axis=1) / (run.s_m[1] - run.s_m[0]))


def test_elastic_rope_agrees_with_the_exact_elastica_along_the_arc() -> None:
    motion = arc_motion(120, 0.1)
    run = play(ELASTIC, motion, sample_times_s=motion.t_s[::17], settle_s=0.0)
    assert off_elastica(run, ELASTIC.bending_stiffness_n_m2).max() < 0.5e-3
    assert np.allclose(run.xyz_m[:, -1], motion.end_m[::17], atol=1e-4)
    assert np.abs(run.xyz_m[..., 1]).max() < 1e-6


def test_rope_at_rest_is_nearer_still() -> None:
    run = play(ELASTIC, path((0.38, 0.0), (0.2, 0.19)), sample_times_s=np.array([4.0]), settle_s=2.0)
    assert off_elastica(run, ELASTIC.bending_stiffness_n_m2).max() < 0.25e-3


def test_without_yield_only_the_hardening_is_left() -> None:
    rope = replace(PLASTIC, yield_curvature_1_m=1e-9, hardening_ratio=1.0)
    run = play(rope, path((0.38, 0.0), (0.3, 0.1)), sample_times_s=np.array([2.0, 4.0]), settle_s=2.0)
    assert off_elastica(run, ELASTIC.bending_stiffness_n_m2 / 2).max() < 0.5e-3


def test_a_yield_that_is_never_reached_changes_nothing() -> None:
    motion = path((0.38, 0.0), (0.3, 0.1), leg_s=0.5)
    hard = play(replace(COARSE, yield_curvature_1_m=1e3), motion)
    assert np.array_equal(hard.xyz_m, play(replace(COARSE, law="elastic"), motion).xyz_m)


def test_plastic_rope_keeps_its_law_and_a_permanent_bend() -> None:
    motion = path((0.42, 0.0), (0.2, 0.19), (0.42, 0.0), leg_s=3.0)
    run = play(PLASTIC, motion, sample_times_s=np.array([0.0, 3.0, 6.0, 7.0]), settle_s=1.0)
    moment = bending(run) - (1 + PLASTIC.hardening_ratio) * run.plastic_1_m[:, 1:-1, 0]
    assert np.abs(moment).max() < PLASTIC.yield_curvature_1_m * 1.01
    assert np.abs(run.plastic_1_m[-1]).max() > 5
    # The same pose before and after: a rope without history against one that was bent.
    assert np.linalg.norm(run.xyz_m[-1] - run.xyz_m[0], axis=1).max() > 5e-3
    elastic = play(ELASTIC, motion, sample_times_s=np.array([0.0, 7.0]), settle_s=1.0)
    assert np.linalg.norm(elastic.xyz_m[1] - elastic.xyz_m[0], axis=1).max() < 0.2e-3


def test_before_the_first_row_curvature_counts_as_grown_at_once() -> None:
    run = play(PLASTIC, path((0.3, 0.1), (0.3, 0.1)), sample_times_s=np.array([0.0]))
    bent = np.stack([bending(run)[0], np.zeros(PLASTIC.bodies - 1)], axis=1)
    at_once = return_mapping(bent, 0 * bent, PLASTIC.yield_curvature_1_m, PLASTIC.hardening_ratio)
    assert np.allclose(run.plastic_1_m[0, 1:-1], at_once, atol=0.02)


def test_return_mapping_obeys_the_yield_condition_in_any_direction() -> None:
    rng = np.random.default_rng(1)
    plastic = np.zeros((50, 2))
    for _ in range(20):
        curvature = rng.normal(0, 15, (50, 2))
        before, plastic = plastic, return_mapping(curvature, plastic, 8.0, 0.2)
        left = np.linalg.norm(curvature - 1.2 * plastic, axis=1)
        assert left.max() <= 8 + 1e-9
        inside = np.linalg.norm(curvature - 1.2 * before, axis=1) <= 8
        assert np.array_equal(plastic[inside], before[inside])


def test_the_last_sample_is_there_whatever_the_clock_begins_at() -> None:
    motion = path((0.38, 0.0), (0.38, 0.0), leg_s=1.937)
    # half a step, which rounds up for the sample and down for the whole
    late = replace(motion, t_s=np.array([4.587, 6.524]))
    assert np.array_equal(play(COARSE, late).t_s, late.t_s)


def test_turning_the_world_turns_the_rope() -> None:
    turn = Rotation.from_euler("z", 90, degrees=True)
    motion = path((0.38, 0.0), (0.3, 0.1), leg_s=0.5)
    pose = (turn * Rotation.from_quat(motion.end_q, scalar_first=True)).as_quat(scalar_first=True)
    shift = np.array([0.1, 0.2, 0.3])
    turned = Motion(motion.t_s, motion.start_m + shift, pose, turn.apply(motion.end_m) + shift, pose)
    here, there = play(COARSE, motion), play(COARSE, turned)
    assert np.allclose(turn.apply(here.xyz_m.reshape(-1, 3)), there.xyz_m.reshape(-1, 3) - shift, atol=1e-6)


def test_same_call_same_bytes_and_a_log_at_125_hz() -> None:
    motion = path((0.38, 0.0), (0.36, 0.05), leg_s=0.4)
    first, second = play(COARSE, motion), play(COARSE, motion)
    assert first.xyz_m.tobytes() == second.xyz_m.tobytes()
    assert np.allclose(np.diff(first.log_t_s), 0.008)
    assert np.allclose(first.log_m[-1], motion.end_m[-1], atol=1e-3)


def cylinder(x: float, z: float) -> Obstacle:
    values = {"center_m": (x, 0.0, z), "axis": (0.0, 1.0, 0.0), "radius_m": (0.03,), "height_m": (0.06,)}
    return Obstacle("cylinder", values)


def test_clearance_beside_a_cylinder_is_the_elasticas() -> None:
    run = play(
        ELASTIC, path((0.36, 0.0), (0.36, 0.0)), (cylinder(0.18, 0.0),), sample_times_s=np.array([0.0])
    )
    _, x, z, _ = planar_elastica(ELASTIC.length_m, 3e-4, WEIGHT, (0.0, 0.0), 0.0, (0.36, 0.0), 0.0)
    expected = np.hypot(x - 0.18, z).min() - 0.03 - 0.004
    assert run.min_clearance_m == pytest.approx(expected, abs=0.3e-3)
    assert run.clearance_m[0] == pytest.approx(expected, abs=0.3e-3)


def test_clearance_counts_between_the_samples() -> None:
    motion = path((0.36, 0.0), (0.36, -0.04), (0.36, 0.0), leg_s=1.0)
    run = play(COARSE, motion, (cylinder(0.18, -0.18),), sample_times_s=np.array([0.0, 2.0]))
    assert run.min_clearance_m < run.clearance_m.min() - 5e-3


@pytest.mark.parametrize(
    "obstacle",
    [
        cylinder(0.18, -0.15),
        Obstacle("sphere", {"center_m": (0.18, 0.0, -0.15), "radius_m": (0.03,)}),
        Obstacle("plane", {"point_m": (0.0, 0.0, -0.12), "normal": (0.0, 0.0, 1.0)}),
        Obstacle(
            "box",
            {"center_m": (0.18, 0.0, -0.15), "quaternion": (1.0, 0.0, 0.0, 0.0), "size_m": (0.06,) * 3},
        ),
        replace(cylinder(0.18, -0.15), shape="capsule"),
    ],
    ids=lambda one: one.shape,
)
def test_the_rope_rests_on_every_obstacle(obstacle: Obstacle) -> None:
    motion, samples = path((0.38, 0.0), (0.34, -0.03), leg_s=2.0), np.array([0.0, 4.0])
    run = play(replace(ELASTIC, bodies=30), motion, (obstacle,), sample_times_s=samples, settle_s=2.0)
    free = play(replace(ELASTIC, bodies=30), motion, sample_times_s=samples, settle_s=2.0)
    assert run.clearance_m[0] > 1e-3
    assert -0.4e-3 < run.min_clearance_m < 0
    assert abs(run.clearance_m[-1]) < 0.1e-3
    assert np.linalg.norm(run.xyz_m[-1] - free.xyz_m[-1], axis=1).max() > 3e-3


def test_an_obstacle_in_the_first_shape_is_refused() -> None:
    motion, beside = path((0.38, 0.0), (0.36, 0.0)), cylinder(0.18, -0.15)
    with pytest.raises(ParameterError, match=r"obstacle 1 \(cylinder\): .* first shape is \d+\.\d mm inside"):
        play(COARSE, motion, (beside, cylinder(0.18, -0.1)))
    assert play(COARSE, motion, (beside,)).clearance_m[0] > 0


def test_what_the_laboratory_refuses() -> None:
    motion = path((0.38, 0.0), (0.36, 0.0))
    moving = replace(motion, start_m=motion.start_m + np.array([[0, 0, 0], [0.01, 0, 0]]))
    free = replace(motion, end_m=np.full((2, 3), np.nan), end_q=np.full((2, 4), np.nan))
    for bad, word in ((moving, "start"), (free, "both ends"), (path((0.38, 0.0), (0.46, 0.0)), "apart")):
        with pytest.raises(ParameterError, match=word):
            play(COARSE, bad)
    with pytest.raises(ParameterError, match="sample"):
        play(COARSE, motion, sample_times_s=np.array([3.0]))
    with pytest.raises(DloError, match="obstacle"):
        play(COARSE, motion, (Obstacle("torus", {"center_m": (0.0, 0.0, 0.0)}),))


def test_an_unstable_rope_is_an_error_and_leaves_no_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SimulationError, match="unstable"):
        play(COARSE, path((0.38, 0.0), (0.36, 0.0)), gravity_m_s2=(0.0, 0.0, -1e7))
    assert not list(tmp_path.iterdir())
