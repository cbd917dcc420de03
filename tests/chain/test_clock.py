"""The rope as a ruler: the clocks' offset by its length, and arc lengths that it does not spoil."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chain.tubes import FORWARD, Scene, along, index_of, wave, write_capture

from dlolib.captures import open_capture
from dlolib.chain import FrameChain, extract_chain
from dlolib.chain.clock import clocks_apart
from dlolib.formats import write_capture_index
from dlolib.types import CaptureIndex, Floats, Motion

SECONDS, NOWHERE = 24, Path("tube")


def shape(t_s: float, count: int = 600) -> Floats:
    """The rope as one end comes and goes along it, by 76 mm in six seconds."""
    return wave(0.6 + 0.3 * np.sin(2 * np.pi * t_s / 12), count=count)


def logged(offset_s: float, end: str = "end") -> Motion:
    """What a robot logs ten times a second whose clock is behind the camera's; of the rope held the other way
    round, with the start as the end that moves."""
    t_s = np.arange(-20, 10 * SECONDS + 20) / 10
    moved = np.array([shape(t, 60)[-1] for t in t_s])
    still, turn = np.zeros_like(moved), np.tile(FORWARD, (len(t_s), 1))
    if end == "start":
        return Motion(t_s - offset_s, -moved, turn, still, turn)
    return Motion(t_s - offset_s, still, turn, moved, turn)


def measured(index: CaptureIndex, more_m: Floats) -> list[FrameChain]:
    """Chains of nothing but a length, so much more than the rope's."""
    none = np.zeros((0, 3))
    length = index.rope.length_m
    chain = FrameChain(0, 0.0, none[:, 0], none, none[:, :2], none[:, 0], none, none[:, 0] > 0, 0, True, 1, 0)
    return [
        replace(chain, t_s=float(t), measured_m=length + float(more))
        for t, more in zip(index.t_s, more_m, strict=True)
    ]


@pytest.mark.parametrize("offset_s", [0.0, 0.15, -1.6])
def test_arc_lengths_do_not_follow_the_motion(
    tmp_path: Path, offset_s: float, caplog: pytest.LogCaptureFixture
) -> None:
    axes = [shape(float(t)) for t in range(SECONDS)]
    index = replace(write_capture(tmp_path / "capture", axes, Scene()), motion=logged(offset_s))
    write_capture_index(index, tmp_path / "capture")
    result = extract_chain(open_capture(tmp_path / "capture"))
    assert result.clocks_apart_s == pytest.approx(offset_s, abs=0.003)
    assert (result.clocks_apart_s == 0) == (offset_s == 0)
    said = f"the robot logged them at t - ({result.clocks_apart_s:.3f} s): arc lengths count by that"
    assert (said in caplog.text) == (offset_s != 0)
    assert result.metrics()["clocks_apart_s"] == result.clocks_apart_s
    # the clocks stay as they were recorded
    np.testing.assert_allclose(result.recording.motion.t_s, index.motion.t_s, atol=1e-9)
    for axis, chain in zip(axes, result.frames, strict=True):
        tangent = along(axis, chain.s_m + 5e-4) - along(axis, chain.s_m - 5e-4)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        ahead = np.sum((chain.xyz_m - along(axis, chain.s_m)) * tangent, axis=1)
        # at the wrong time they are 3 mm off
        assert np.abs(ahead).max() < 3e-4


def test_an_offset_is_none_that_no_chain_was_made_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the last pass still finds more of it, the chains are those of the pass before."""
    used: list[float] = []
    index = write_capture(tmp_path / "capture", [shape(0.0)], Scene())
    assert index.motion is not None
    logged_s = index.motion.t_s[0]

    def ever_more(_: list[FrameChain], later: CaptureIndex) -> float:
        assert later.motion is not None
        used.append(float(later.motion.t_s[0] - logged_s))
        return 0.01

    monkeypatch.setattr("dlolib.chain.extract.clocks_apart", ever_more)
    result = extract_chain(open_capture(tmp_path / "capture"))
    assert used == pytest.approx([0.0, 0.01, 0.02]) and result.clocks_apart_s == used[-1]


@pytest.mark.parametrize("end", ["start", "end"])
def test_the_offset_comes_out_of_the_length(end: str) -> None:
    rng = np.random.default_rng(0)
    index = replace(index_of(NOWHERE, [shape(0.0)] * SECONDS, Scene()), motion=logged(0.0, end))
    x = np.array([shape(t)[-1, 0] for t in index.t_s + 0.05]) - [shape(t)[-1, 0] for t in index.t_s - 0.05]
    longer = 0.02 * x / 0.1 + rng.normal(0, 3e-5, SECONDS)
    longer[7] += 0.01
    assert clocks_apart(measured(index, longer), index) == pytest.approx(0.02, rel=0.05)


def test_what_does_not_go_with_the_speed_is_no_clock() -> None:
    """A rope that stretches, slips or was measured wrong; ends that are free or stand still; few frames."""
    rng = np.random.default_rng(0)
    index = replace(index_of(NOWHERE, [shape(0.0)] * SECONDS, Scene()), motion=logged(0.0))
    noise = rng.normal(0, 3e-5, SECONDS)
    place = np.array([shape(t)[-1, 0] for t in index.t_s])
    for longer in (0.05 * (place - 0.4), 1e-4 * index.t_s, np.full(SECONDS, 3e-3)):
        assert clocks_apart(measured(index, longer + noise), index) == 0.0
    speed = np.gradient(place)
    assert clocks_apart(measured(index, 0.1 * speed + noise), index) != 0.0
    still = replace(logged(0.0), end_m=np.zeros_like(logged(0.0).end_m))
    free = replace(index, ends=replace(index.ends, start="free", end="free"))
    for other in (replace(index, motion=None), replace(index, motion=still), free):
        assert clocks_apart(measured(index, 0.1 * speed + noise), other) == 0.0
    few = replace(index, t_s=index.t_s[:12])
    assert clocks_apart(measured(few, 0.1 * speed[:12] + noise[:12]), few) == 0.0


def ending(index: CaptureIndex, tips_m: Floats) -> list[FrameChain]:
    """Chains of the rope's own length whose last tips were seen at (F, 3) [m]."""
    pairs = np.stack([np.full_like(tips_m, np.nan), tips_m], axis=1)
    return [
        replace(chain, tips_m=pair)
        for chain, pair in zip(measured(index, np.zeros(len(pairs))), pairs, strict=True)
    ]


@pytest.mark.parametrize("offset_s", [-3.0, 1.3])
def test_a_large_offset_comes_out_of_where_the_rope_ends(offset_s: float) -> None:
    """A gripper may hide the tip in some frames, and the camera may stand elsewhere."""
    index = replace(index_of(NOWHERE, [shape(0.0)] * SECONDS, Scene()), motion=logged(0.0))
    tips = np.array([shape(t - offset_s, 60)[-1] for t in index.t_s]) + np.array([0.0, 0.01, -0.01])
    tips[::5] = np.nan
    tips[3::5] += 0.05
    assert clocks_apart(ending(index, tips), index) == pytest.approx(offset_s, abs=0.01)


def test_where_the_rope_ends_is_no_clock_where_another_cause_moves_it() -> None:
    rng = np.random.default_rng(0)
    index = replace(index_of(NOWHERE, [shape(0.0)] * SECONDS, Scene()), motion=logged(0.0))
    tips = np.array([shape(t, 60)[-1] for t in index.t_s])
    turned = tips @ np.array([[0.9, 0.0, 0.3], [0.0, 1.0, 0.0], [-0.3, 0.0, 0.9]])
    for seen in (tips + 0.03, turned, tips + rng.normal(0, 0.02, tips.shape)):
        assert clocks_apart(ending(index, seen), index) == 0.0
    few = replace(index, t_s=index.t_s[:7])
    late = np.array([shape(t - 1.3, 60)[-1] for t in few.t_s])
    assert clocks_apart(ending(few, late), few) == 0.0
