"""Ropes that cross themselves, partly hidden ones, and the tracker: scored by arc length on an exact axis."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from chain.test_clouds import cloud_of
from chain.tubes import FORWARD, NOWHERE, Scene, along, index_of, photograph, wave

from dlolib.captures.base import Frame
from dlolib.chain import ChainSettings, Tracker, chain_frame, frame
from dlolib.types import Floats, Pose


def loop(side: float = 1.0, depth: float = 0.25, length_m: float = 0.445, count: int = 600) -> Floats:
    """An axis (count, 3) [m] with a full turn: it crosses itself, one strand before the other."""
    u = np.linspace(0, 1, count)
    share = np.clip((u - 0.5) / 0.8 + 0.5, 0, 1)
    angle = side * 2 * np.pi * share**2 * (3 - 2 * share)
    way = np.stack([np.cos(angle), depth * np.sin(2 * np.pi * u), np.sin(angle)], axis=-1)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    steps = 0.5 * (way[1:] + way[:-1]) * length_m / (count - 1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def seen(axis: Floats, scene: Scene, number: int = 0) -> Frame:
    color, depth = photograph(axis, scene, number)
    return Frame(number, float(number), NOWHERE, color=color, depth_m=depth.astype(np.float32) / 1000)


def off(axis: Floats, s_m: Floats, xyz_m: Floats) -> Floats:
    return np.linalg.norm(xyz_m - along(axis, s_m), axis=1)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("depth", [-0.25, 0.25])
@pytest.mark.parametrize("diameter", [0.005, 0.008, 0.012])
def test_a_loop_is_followed_the_way_the_rope_runs(side: float, depth: float, diameter: float) -> None:
    axis, scene = loop(side, depth), Scene(diameter_m=diameter)
    chain = chain_frame(seen(axis, scene), index_of(NOWHERE, [axis], scene), ChainSettings())
    assert chain.fitted and len(chain.s_m) >= 27
    away = off(axis, chain.s_m, chain.xyz_m)
    assert np.sqrt(np.mean(away**2)) < 1.5e-3 and away.max() < 8e-3


def test_a_loop_behind_a_pillar_keeps_its_order() -> None:
    axis = loop()
    scene = Scene(boxes=(((0.10, -0.08, -0.3), (0.03, 0.02, 0.6)),))
    chain = chain_frame(seen(axis, scene), index_of(NOWHERE, [axis], scene), ChainSettings())
    away = off(axis, chain.s_m, chain.xyz_m)
    assert np.sqrt(np.mean(away**2)) < 2.5e-3 and away.max() < 8e-3


@pytest.mark.parametrize("boxes", [(), (((0.10, -0.08, -0.3), (0.03, 0.02, 0.6)),)])
@pytest.mark.parametrize("crosses", [True, False])
def test_a_first_look_is_spared_only_where_it_would_change_nothing(
    crosses: bool, boxes: tuple[Any, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    axis = loop() if crosses else np.linspace([0.0, 0.0, 0.0], [0.445, 0.0, 0.0], 600)
    scene = Scene(boxes=boxes)
    shot, index = seen(axis, scene), index_of(NOWHERE, [axis], scene)
    asked, judge = [], frame.may_be_joined
    monkeypatch.setattr(frame, "may_be_joined", lambda *given: asked.append(judge(*given)) or asked[-1])
    chain = chain_frame(shot, index, ChainSettings())
    assert asked == ([not boxes] if crosses or boxes else [])
    monkeypatch.setattr(frame, "may_be_joined", lambda *_: True)
    again = chain_frame(shot, index, ChainSettings())
    np.testing.assert_array_equal(chain.xyz_m, again.xyz_m)


def test_a_loop_of_unknown_diameter_in_a_cloud_is_one_chain() -> None:
    axis, scene = loop(), Scene()
    index = index_of(NOWHERE, [axis], scene, clamped=False)
    index = replace(index, rope=replace(index.rope, diameter_m=None))
    cloud = cloud_of(*photograph(axis, scene), scene)
    chain = chain_frame(Frame(0, 0.0, NOWHERE, cloud_m=cloud), index, ChainSettings())
    either = (off(axis, chain.s_m, chain.xyz_m), off(axis[::-1], chain.s_m, chain.xyz_m))
    # The skin lies a radius before the axis.
    assert min(np.sqrt(np.mean(one**2)) for one in either) < 6e-3


@pytest.mark.parametrize("at_end", [False, True])
def test_what_is_seen_between_a_clamp_and_a_box_beside_it_is_rope(at_end: bool) -> None:
    """Over less than its skeleton needs: there the held end tells the direction."""
    axis = wave(0.6)
    # seen from the camera it begins 12 mm before the rope's end
    near = np.array([0.012, axis[-1, 0] - 0.012])[int(at_end)]
    edge = 0.2 + (near - 0.2) * 0.7 / 0.75
    box = ((edge - 0.03 * at_end, -0.05, -0.03), (0.03, 0.02, 0.06))
    scene = Scene(diameter_m=0.012, boxes=(box,))
    chain = chain_frame(seen(axis, scene), index_of(NOWHERE, [axis], scene), ChainSettings())
    assert chain.s_m[-1 if at_end else 0] == pytest.approx(0.445 if at_end else 0.0, abs=1e-3)
    assert off(axis, chain.s_m, chain.xyz_m).max() < 2.5e-3 and np.diff(chain.s_m).max() > 0.04


def test_a_pillar_that_leaves_slivers_leaves_no_points_there() -> None:
    axis = np.stack([np.full(400, 0.2), np.zeros(400), np.linspace(-0.2, 0.2, 400)], axis=-1)
    # It covers most of the upright rope's width over the upper half.
    scene = Scene(boxes=(((0.1985, -0.05, 0.0), (0.05, 0.02, 0.3)),))
    index = index_of(NOWHERE, [axis], scene, clamped=False)
    chain = chain_frame(seen(axis, scene), index, ChainSettings())
    assert not ((chain.xyz_m[:, 2] > 0.02) & (chain.xyz_m[:, 2] < 0.18)).any()


@pytest.mark.parametrize("light", [None, (0.3, -0.5, 0.8), (-0.8, -0.5, 0.3)], ids=["even", "above", "left"])
@pytest.mark.parametrize("side", [-1, 1], ids=["left hidden", "right hidden"])
def test_beside_a_pillar_that_hides_one_edge_the_middle_stays_the_rope_s(
    side: int, light: tuple[float, float, float] | None
) -> None:
    axis = np.stack([np.full(400, 0.2), np.zeros(400), np.linspace(-0.2, 0.2, 400)], axis=-1)
    # Of the upright rope's 8 mm it covers 2.3 over the upper half.
    edge = 0.2 + side * 0.0016
    scene = Scene(boxes=(((edge if side > 0 else edge - 0.05, -0.05, 0.0), (0.05, 0.02, 0.3)),), light=light)
    index = index_of(NOWHERE, [axis], scene, clamped=False)
    chain = chain_frame(seen(axis, scene), index, ChainSettings())
    upper = (chain.xyz_m[:, 2] > 0.03) & (chain.xyz_m[:, 2] < 0.17)
    assert upper.sum() >= 9
    # half a pixel; the middle of what shows is a whole one aside
    assert np.sqrt(np.mean((chain.xyz_m[upper, 0] - 0.2) ** 2)) < 0.75e-3


@pytest.mark.parametrize("side", [-1, 1], ids=["left hidden", "right hidden"])
def test_the_rope_is_seen_right_up_to_what_hides_it(side: int) -> None:
    z = np.linspace(-0.2, 0.2, 400)
    axis = np.stack([0.2 + 0.01 * z, np.zeros(400), z], axis=-1)
    # It covers half of the rope's width from 25 mm below the middle to 25 above.
    box = ((0.2 if side > 0 else 0.15, -0.05, -0.025), (0.05, 0.02, 0.05))
    scene = Scene(boxes=(box,))
    index = index_of(NOWHERE, [axis], scene, clamped=False)
    chain = chain_frame(seen(axis, scene), index, ChainSettings(points=200))
    gap = int(np.argmax(np.diff(chain.s_m)))
    low, high = chain.xyz_m[gap : gap + 2, 2]
    assert -0.028 < low < -0.024 and 0.025 < high < 0.029


def test_the_tracker_gives_the_chain_of_each_frame() -> None:
    axes = [loop(depth=0.25), loop(depth=0.27)]
    scene = Scene()
    index = index_of(NOWHERE, axes, scene)
    tracker = Tracker(replace(index, motion=None))
    alone = None
    for number, axis in enumerate(axes):
        frame = seen(axis, scene, number)
        held = [Pose(place, FORWARD) for place in axis[[0, -1]]]
        chain = tracker.see(frame, *held)
        alone = chain_frame(frame, index, ChainSettings(), alone)
        np.testing.assert_allclose(chain.xyz_m, alone.xyz_m, atol=1e-9)
        assert tracker.chain is chain
    assert np.sqrt(np.mean(off(axes[-1], chain.s_m, chain.xyz_m) ** 2)) < 1e-3


def test_a_tracked_rope_that_is_let_go_keeps_its_start() -> None:
    axis, scene = loop(), Scene()
    tracker = Tracker(index_of(NOWHERE, [axis], scene))
    held = [Pose(place, FORWARD) for place in axis[[0, -1]]]
    tracker.see(seen(axis, scene, 0), *held)
    chain = tracker.see(seen(axis, scene, 1))
    assert np.linalg.norm(chain.xyz_m[0] - axis[0]) < 5e-3


@pytest.mark.parametrize(("diameter", "grain_px"), [(0.004, 0.0), (0.008, 0.0), (0.008, 1.0), (0.008, 2.0)])
def test_ellipsoids_hold_the_truth(diameter: float, grain_px: float) -> None:
    """Of a stereo camera, too, whose noise goes together over some pixels."""
    squares = []
    for number, axis in enumerate([loop(1.0), loop(-1.0), loop(1.0, -0.3)]):
        scene = Scene(diameter_m=diameter, grain_px=grain_px)
        chain = chain_frame(seen(axis, scene, number), index_of(NOWHERE, [axis], scene), ChainSettings())
        assert chain.covariance_m2 is not None and chain.covariance_m2.shape == (len(chain.s_m), 3, 3)
        np.testing.assert_allclose(chain.covariance_m2, np.swapaxes(chain.covariance_m2, 1, 2))
        error = chain.xyz_m - along(axis, chain.s_m)
        squares.append(np.einsum("ki,kij,kj->k", error, np.linalg.inv(chain.covariance_m2), error))
    # The tests' own camera is another one than that on which the figures were set: rough agreement only.
    assert np.mean(np.concatenate(squares) < 7.815) > 0.8
