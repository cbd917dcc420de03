"""The tool path of a trajectory, and the checks before the first motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlolib.errors import MotionRefused
from dlolib.execute import Limits, RobotConfig, check_path, path_in_base
from dlolib.execute.path import check_samples, sampled, tool_vectors, turn_as_stored
from dlolib.execute.surroundings import Surroundings
from dlolib.types import Motion, Obstacle

from .conftest import FIRST_M, TURN, arc

QUARTER = ((0.0, -1.0, 0.0, 0.5), (1.0, 0.0, 0.0, 0.1), (0.0, 0.0, 1.0, 0.2), (0.0, 0.0, 0.0, 1.0))
GRASP = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.15), (0.0, 0.0, 0.0, 1.0))


def test_by_default_the_tool_is_the_grasp_and_the_base_the_world() -> None:
    first = tool_vectors(path_in_base(arc(), RobotConfig()))[0]
    assert first[:3] == pytest.approx(FIRST_M)
    # The rope's tangent, its third axis, is the world's x: 120 degrees about (1, 1, 1).
    assert first[3:] == pytest.approx(np.full(3, 2 * np.pi / 3 / np.sqrt(3)))


def test_tool_and_base_enter_as_matrices() -> None:
    config = RobotConfig(base_from_world=QUARTER, tool_from_grasp=GRASP)
    path = path_in_base(arc(), config)
    grasp = np.eye(4)
    grasp[:3, :3] = Rotation.from_quat(TURN, scalar_first=True).as_matrix()
    grasp[:3, 3] = FIRST_M
    tool = np.array(QUARTER) @ grasp @ np.linalg.inv(np.array(GRASP))
    first = tool_vectors(path)[0]
    assert first[:3] == pytest.approx(tool[:3, 3])
    assert Rotation.from_rotvec(first[3:]).as_matrix() == pytest.approx(tool[:3, :3])
    # 0.15 m back along the tangent (world x), turned by a quarter about z: 0.25 m of x become y.
    assert first[:3] == pytest.approx([0.5, 0.35, 0.5])


def test_a_pose_that_stays_turns_by_nothing_or_with_its_sign_by_all() -> None:
    """Rounding leaves q q a little above 1 for some, of which there is no angle."""
    q = Rotation.random(1000, random_state=0).as_quat()
    assert (np.sum(q * q, axis=1) > 1).any()
    assert turn_as_stored(q, q) == pytest.approx(np.zeros(1000), abs=1e-7)
    assert turn_as_stored(q, -q) == pytest.approx(np.full(1000, 2 * np.pi), abs=1e-7)


def test_the_signs_of_quaternions_stay_so_that_a_long_turn_goes_the_way_it_was_meant() -> None:
    angle = np.array([0.0, 0.75, 1.5]) * np.pi
    turn = np.stack([np.cos(angle / 2), 0 * angle, 0 * angle, np.sin(angle / 2)], axis=1)
    place = np.tile(FIRST_M, (3, 1))
    config = RobotConfig(base_from_world=QUARTER)
    path = path_in_base(Motion(np.arange(3.0), place, turn, place, turn), config)
    assert np.sum(path.end_q[1:] * path.end_q[:-1], axis=1) == pytest.approx(np.cos([0.375 * np.pi] * 2))


def test_time_scale_slows_the_path() -> None:
    slow = path_in_base(arc(0.2), RobotConfig(time_scale=4.0))
    assert slow.t_s[-1] == pytest.approx(0.8)
    check_path(slow, Limits())
    with pytest.raises(MotionRefused, match="time_scale"):
        check_path(path_in_base(arc(0.2), RobotConfig()), Limits())


def test_a_path_may_begin_at_any_time() -> None:
    late = replace(arc(), t_s=arc().t_s + 7.0)
    slow = path_in_base(late, RobotConfig(time_scale=4.0))
    assert (slow.t_s[0], slow.t_s[-1]) == pytest.approx((7.0, 7.0 + 4.0 * np.ptp(late.t_s)))
    assert sampled(late, 0.002) == pytest.approx(sampled(arc(), 0.002))


def test_samples_are_one_period_apart_and_end_at_the_end() -> None:
    poses = sampled(arc(), 0.002)
    assert len(poses) == 401
    assert poses[-1] == pytest.approx(tool_vectors(arc())[-1])
    assert sampled(arc(), 0.3)[-1] == pytest.approx(tool_vectors(arc())[-1])


def turning(rad: float) -> Motion:
    """A turn about y by rad in 0.2 s, in place."""
    motion, angle = arc(0.2, 0.0), np.linspace(0, rad, 11)
    turn = np.stack([np.cos(angle / 2), 0 * angle, np.sin(angle / 2), 0 * angle], axis=1)
    return replace(motion, end_q=turn)


def flipping() -> Motion:
    """A turn about y from 178 to 182 degrees in 0.8 s, logged with w >= 0: half way all signs flip."""
    motion, angle = arc(0.8, 0.0), np.deg2rad(np.linspace(178.2, 182, 41))
    turn = np.stack([np.cos(angle / 2), 0 * angle, np.sin(angle / 2), 0 * angle], axis=1)
    return replace(motion, end_q=np.where(turn[:, :1] < 0, -turn, turn))


def with_row(row: int, value: float) -> Motion:
    """The arc with one row's x [m] replaced."""
    end_m = arc().end_m.copy()
    end_m[row, 0] = value
    return replace(arc(), end_m=end_m)


REFUSED = {
    "turns too fast": (turning(0.5), "turns at 2.5 rad/s"),
    "turns too far in a step": (turning(2.5), "turns at"),
    "signs flip": (flipping(), "row 20 .*the long way, by 6.28 rad.; give .* one sign"),
    "out of reach": (with_row(7, 0.9), "row 8 .t_s = 0.14.: the tool at .0.900"),
    "one jump": (with_row(20, 0.47), "row 21"),
    "the clock jumps": (replace(arc(), t_s=np.r_[arc().t_s[:-1], 1.7e9]), "would last 1.7e.09 s, 3600 s"),
    "time stands still": (replace(arc(), t_s=np.r_[arc().t_s[:-1], arc().t_s[-2]]), "does not rise"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_the_first_offending_row_is_named(case: str) -> None:
    path, message = REFUSED[case]
    with pytest.raises(MotionRefused, match=message) as refused:
        check_path(path, Limits())
    assert refused.value.mend


def test_a_path_within_the_limits_passes() -> None:
    for path in (arc(), turning(0.19)):
        check_path(path, Limits())
        check_samples(sampled(path, 0.002), 0.002, Limits())


def test_what_would_be_streamed_is_held_against_the_speed_limits_itself() -> None:
    for path, message in ((flipping(), "would turn at 314 rad/s"), (arc(0.2), "would move at 0.469 m/s")):
        with pytest.raises(MotionRefused, match=message):
            check_samples(sampled(path, 0.002), 0.002, Limits())


def test_speed_up_from_rest_counts_as_acceleration() -> None:
    # 0.118 m/s at once, and what the circle of 30 mm takes beside it within a look-ahead of 0.1 s.
    check_path(arc(), Limits(acceleration_m_s2=1.6))
    with pytest.raises(MotionRefused, match=r"accelerates at 1\.5\d m/s\^2"):
        check_path(arc(), Limits(acceleration_m_s2=1.5))


@pytest.mark.parametrize("step_s", [0.025, 0.04, 0.045, 0.05, 0.06])
def test_shaking_within_the_look_ahead_counts_as_acceleration(step_s: float) -> None:
    t_s, odd = step_s * np.arange(41), np.arange(41) % 2
    place, turn = np.tile(FIRST_M, (41, 1)), Rotation.from_quat(TURN, scalar_first=True)
    # 0.2 m/s to and fro
    shaken = place + 0.2 * step_s * odd[:, None] * [0, 1, 0]
    turned = (Rotation.from_rotvec(0.8 * step_s * odd[:, None] * [0, 1, 0]) * turn).as_quat(scalar_first=True)
    straight = np.tile(TURN, (41, 1))
    with pytest.raises(MotionRefused, match="accelerates at"):
        check_path(Motion(t_s, shaken, straight, shaken, straight), Limits())
    with pytest.raises(MotionRefused, match=r"speeds up its turn at .*, the limit is 10 rad/s\^2"):
        check_path(Motion(t_s, place, turned, place, turned), Limits())


@pytest.mark.parametrize("step_s", [0.002, 0.03, 0.05, 0.07])
def test_a_steady_acceleration_counts_as_what_it_is(step_s: float) -> None:
    # 0.15 m/s^2 for a second, and as much against it for another
    t_s = np.arange(0, 2 + step_s / 2, step_s)
    place = np.tile(FIRST_M, (len(t_s), 1))
    place[:, 1] += 0.15 * np.where(t_s < 1, t_s**2, 2 - (2 - t_s) ** 2) * 0.5
    straight = np.tile(TURN, (len(t_s), 1))
    path = Motion(t_s, place, straight, place, straight)
    check_path(path, Limits(acceleration_m_s2=0.18))
    with pytest.raises(MotionRefused, match="accelerates at"):
        check_path(path, Limits(acceleration_m_s2=0.149))


def test_a_free_end_or_a_single_row_is_no_path() -> None:
    free = np.full_like(arc().end_m, np.nan)
    with pytest.raises(MotionRefused, match="no pose"):
        path_in_base(replace(arc(), end_m=free), RobotConfig())
    one = Motion(*(value[:1] for value in vars(arc()).values()))
    with pytest.raises(MotionRefused, match="fewer than two rows"):
        path_in_base(one, RobotConfig())


def test_the_held_end_enters_an_obstacle_by_the_ropes_radius_where_robot_and_grasp_stand_so() -> None:
    """A sphere of 30 mm at the world's x = 0.3; the tool comes along its x, the grasp 0.15 m ahead."""
    sphere = Obstacle("sphere", {"center_m": (0.3, 0.0, 0.2), "radius_m": (0.03,)})
    around = Surroundings((sphere,), 0.004, QUARTER, GRASP)
    tool_x_m = np.array([0.0, 0.1, 0.115, 0.117, 0.12])
    turned = Rotation.from_matrix(np.array(QUARTER)[:3, :3]) * Rotation.from_rotvec([0.0, np.pi / 2, 0.0])
    world = np.stack([tool_x_m, 0 * tool_x_m, 0 * tool_x_m + 0.2], axis=1)
    base = world @ np.array(QUARTER)[:3, :3].T + np.array(QUARTER)[:3, 3]
    poses = np.hstack([base, np.tile(turned.as_rotvec(), (5, 1))])
    # 0.3 - 0.15 - 0.034 = 0.116 m is as far as the tool may come
    assert around.entered(poses[:3]) is None
    assert around.entered(poses) == (3, "the held end would go 4.0 mm into obstacle 0 (sphere)")
    assert Surroundings.read(around.content()) == around
