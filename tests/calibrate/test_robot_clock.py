"""The offset between camera and robot, against the one that was put in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlolib.calibrate import clock_offset
from dlolib.types import Ends, Floats, Motion, Points, Recording, Rope

LENGTH = 0.445
Path = Callable[[Floats], Floats]


def arcs(t: Floats) -> Floats:
    """To and fro on arcs, slower and faster."""
    a, b = 0.06 * np.sin(0.9 * t + 0.4 * np.sin(0.31 * t)), 0.04 * np.cos(0.53 * t + 1)
    return np.stack([0.36 + a, 0.02 * np.sin(0.4 * t), b], axis=-1)


def turns(t: Floats) -> Rotation:
    """The end's frame: the rope's tangent +x, swinging a little."""
    swing = Rotation.from_rotvec(0.2 * np.sin(0.7 * t)[:, None] * [0, 1, 0])
    return swing * Rotation.from_quat([0.5, 0.5, 0.5, 0.5])


def recorded(
    path: Path = arcs,
    offset_s: float = 0.0,
    seed: int = 0,
    sigma_m: float = 6e-4,
    rate_hz: float = 5.0,
    span_s: float = 20.0,
    camera_rad: float = 0.005,
) -> Recording:
    """A rope from the origin to an end on this path, as a camera turned by a little sees it."""
    rng = np.random.default_rng(seed)
    logged = np.arange(-2.0, span_s + 2.0, 0.02)
    end, turn = path(logged), turns(logged).as_quat(scalar_first=True)
    still = np.zeros((len(logged), 3))
    motion = Motion(logged, still, np.tile([0.5, 0.5, 0.5, 0.5], (len(logged), 1)), end, turn)
    frames = np.arange(0, span_s, 1 / rate_hz)
    s = np.linspace(0, LENGTH, 30)
    away = LENGTH - s
    now = frames - offset_s
    tangent = turns(now).apply([0, 0, 1])
    # near the end a bend that changes with the motion; further off whatever
    sag = np.array([0, 0, -1.0]) * (1 + np.sin(0.5 * now))[:, None, None] * away[None, :, None] ** 2
    xyz = path(now)[:, None] - away[None, :, None] * tangent[:, None] + sag
    xyz = Rotation.from_rotvec([0, camera_rad, camera_rad / 2]).apply(xyz.reshape(-1, 3))
    xyz += np.array([0.004, 0, 0.002])
    xyz += rng.normal(0, sigma_m, xyz.shape)
    number = np.repeat(np.arange(len(frames)), len(s))
    points = Points(number, np.repeat(frames, len(s)), np.tile(s, len(frames)), xyz)
    gravity = np.array([0, 0, -9.81])
    return Recording("r", Rope("r", LENGTH, 0.008), gravity, Ends(), motion, points)


@pytest.mark.parametrize("offset_s", [-1.3, -0.05, 0.0, 0.12, 2.0])
def test_the_offset_comes_out(offset_s: float) -> None:
    found = clock_offset(recorded(offset_s=offset_s))
    assert found.time_s is not None and found.low_s is not None and found.high_s is not None, found.reason
    assert abs(found.time_s - offset_s) < 0.03
    assert found.low_s <= offset_s <= found.high_s and found.high_s - found.low_s < 0.1
    assert found.end == "end" and found.residual_m is not None and found.residual_m < 3e-3
    assert f"t - ({found.time_s:.3f} s)" in found.says and "the clocks stay as recorded" in found.says


def test_the_interval_holds_the_offset_as_often_as_it_says() -> None:
    rng = np.random.default_rng(3)
    held = 0
    for seed in range(20):
        offset = float(rng.uniform(-1, 1))
        found = clock_offset(recorded(offset_s=offset, seed=seed))
        assert found.low_s is not None and found.high_s is not None, found.reason
        held += found.low_s <= offset <= found.high_s
    assert held >= 17


def test_clocks_that_count_from_1970() -> None:
    recording = recorded(offset_s=0.12)
    motion, points = recording.motion, recording.points
    late = replace(
        recording,
        motion=replace(motion, t_s=motion.t_s + 1.7e9),
        points=replace(points, t_s=points.t_s + 1.7e9),
    )
    first, second = clock_offset(recording), clock_offset(late)
    assert first.time_s is not None and second.time_s is not None
    assert abs(first.time_s - second.time_s) < 1e-4


def test_nothing_is_shifted() -> None:
    recording = recorded(offset_s=0.5)
    before = recording.motion.t_s.copy(), recording.points.t_s.copy()
    clock_offset(recording)
    np.testing.assert_array_equal(recording.motion.t_s, before[0])
    np.testing.assert_array_equal(recording.points.t_s, before[1])


def still(t: Floats) -> Floats:
    return np.tile([0.4, 0.0, 0.0], (len(t), 1))


def even(t: Floats) -> Floats:
    """At one speed along a line: a camera that stands elsewhere looks the same."""
    return np.stack([0.3 + 0.005 * t, 0 * t, 0 * t], axis=-1)


def circling(t: Floats) -> Floats:
    return np.stack([0.36 + 0.05 * np.sin(3 * t), 0 * t, 0.05 * np.cos(3 * t)], axis=-1)


def elsewhere(t: Floats) -> Floats:
    """What is seen is another end than the one that was logged."""
    return 5 * arcs(1.7 * t + 3)


@pytest.mark.parametrize(
    ("recording", "why"),
    [
        (recorded(still), "no held end moves by 5 mm"),
        (recorded(even), "more than a frame; move the end faster, to and fro, and not evenly"),
        (recorded(circling), "fit alike: the motion repeats itself"),
        (recorded(span_s=1.2), "the end is seen in 6 frames, 8 are needed"),
        (replace(recorded(), ends=Ends("clamped", "free")), "no held end moves by 5 mm"),
        (replace(recorded(), points=recorded(elsewhere).points), "mm from the logged one at any offset"),
    ],
    ids=["still", "even", "circling", "short", "free", "elsewhere"],
)
def test_a_motion_that_does_not_tell_is_refused_with_the_reason(recording: Recording, why: str) -> None:
    found = clock_offset(recording)
    assert found.time_s is None and found.low_s is None and found.high_s is None
    assert found.reason is not None and why in found.reason
    assert found.says.startswith("the points do not tell whether camera and robot share a clock: ")
