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
from dlolib.errors import ChainError
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
        in_turn = many.chains_of(frames, index, ChainSettings())
    assert shared == list(range(FRAMES))
    shared.clear()
    at_once = many.chains_of(frames, index, ChainSettings())
    np.testing.assert_equal([astuple(one) for one in at_once], [astuple(one) for one in in_turn])
    # The start goes round with the rope, and that could not be guessed from long before everywhere.
    assert in_turn[0].line_m[0, 0] < in_turn[0].line_m[-1, 0]
    assert in_turn[FRAMES // 2 + 1].line_m[0, 0] > in_turn[FRAMES // 2 + 1].line_m[-1, 0]
    assert 0 < len(shared) < FRAMES


def test_a_frame_without_a_rope_is_named_as_ever(
    turning: tuple[list[Frame], CaptureIndex], shared: list[int]
) -> None:
    frames, index = turning
    dark = replace(frames[5], color=np.zeros_like(frames[5].color), file=Path("dark.png"))
    with pytest.raises(ChainError, match="no rope") as caught:
        many.chains_of([*frames[:5], dark, *frames[6:]], index, ChainSettings())
    assert caught.value.file == Path("dark.png") and caught.value.place == "frame 5"
    assert shared == [5]
