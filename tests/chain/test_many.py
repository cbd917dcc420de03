"""Frames shared out among processes give the chains that they give one after the other."""

from __future__ import annotations

from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest
from chain.tubes import Scene, wave, write_capture
from scipy.spatial.transform import Rotation

from dlolib.captures import open_capture
from dlolib.captures.base import Frame
from dlolib.chain import ChainSettings, FrameChain, many
from dlolib.types import CaptureIndex

FRAMES = 9


@pytest.fixture(scope="module")
def turning(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Frame], CaptureIndex]:
    """A free rope that turns by more than half a turn: which tip is the start only the frames before tell."""
    folder = tmp_path_factory.mktemp("turning") / "capture"
    middle = wave(0.6).mean(axis=0)
    turns = Rotation.from_rotvec(np.outer(np.linspace(0, 1.2 * np.pi, FRAMES), [0, 1, 0]))
    axes = [turn.apply(wave(0.6) - middle) + middle for turn in turns]
    write_capture(folder, axes, Scene(noisy=False), clamped=False)
    source = open_capture(folder)
    return list(source.frames()), source.index


@pytest.fixture
def shared(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Two processes for captures as short as ours; the frames that this process looks at itself."""
    looked: list[int] = []
    chain_frame = many.chain_frame

    def look(frame: Frame, *others: object) -> FrameChain:
        looked.append(frame.frame)
        return chain_frame(frame, *others)  # type: ignore[arg-type]

    for name, value in {"MANY": 2, "STRETCH": 2, "AHEAD": 1, "cpu_count": lambda: 2}.items():
        monkeypatch.setattr(many, name, value)
    monkeypatch.setattr(many, "chain_frame", look)
    return looked


def test_they_are_the_same_where_what_comes_before_matters(
    turning: tuple[list[Frame], CaptureIndex], shared: list[int]
) -> None:
    frames, index = turning
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(many, "MANY", FRAMES + 1)
        in_turn = many.chains_of(frames, index, ChainSettings()).chains
    assert shared == list(range(FRAMES))
    shared.clear()
    at_once = many.chains_of(frames, index, ChainSettings()).chains
    np.testing.assert_equal([astuple(one) for one in at_once], [astuple(one) for one in in_turn])
    # The start goes round with the rope, and that could not be guessed from long before everywhere.
    assert in_turn[0].line_m[0, 0] < in_turn[0].line_m[-1, 0]
    assert in_turn[FRAMES // 2 + 1].line_m[0, 0] > in_turn[FRAMES // 2 + 1].line_m[-1, 0]
    assert 0 < len(shared) < FRAMES


def test_frames_without_a_rope_are_left_out_and_named_as_ever(
    turning: tuple[list[Frame], CaptureIndex], shared: list[int]
) -> None:
    frames, index = turning
    dark = replace(frames[5], color=np.zeros_like(frames[5].color), file=Path("dark.png"))
    darkened = [*frames[:5], dark, *frames[6:]]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(many, "MANY", FRAMES + 1)
        in_turn = many.chains_of(darkened, index, ChainSettings())
    at_once = many.chains_of(darkened, index, ChainSettings())
    assert [chain.frame for chain in at_once.chains] == [0, 1, 2, 3, 4, 6, 7, 8]
    np.testing.assert_equal(*([astuple(one) for one in found.chains] for found in (at_once, in_turn)))
    for found in (at_once, in_turn):
        (error,) = found.refused
        assert "no rope" in error.problem
        assert error.file == Path("dark.png") and error.place == "frame 5"


def test_what_does_not_count_is_not_gone_on_from(
    turning: tuple[list[Frame], CaptureIndex], shared: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a frame in which another thing is taken for the rope: which way round it lay there says nothing."""
    frames, index = turning
    chain_frame = many.chain_frame

    def wrong(frame: Frame, *others: object) -> FrameChain:
        chain = chain_frame(frame, *others)  # type: ignore[arg-type]
        turned = replace(chain, line_m=chain.line_m[::-1], counts=False)
        return turned if frame.frame in (3, 4) else chain

    right = many.chains_of(frames, index, ChainSettings()).chains
    monkeypatch.setattr(many, "chain_frame", wrong)
    monkeypatch.setattr(many, "MANY", FRAMES + 1)
    found = many.chains_of(frames, index, ChainSettings()).chains
    for frame in (5, 6, 7, 8):
        np.testing.assert_array_equal(found[frame].xyz_m, right[frame].xyz_m)
