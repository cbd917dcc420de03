"""The sheet of a capture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from chain.tubes import Scene, wave, write_capture

from dlolib.captures import open_capture
from dlolib.chain import chain_on_image, extract_chain, write_sheet


def test_the_same_capture_gives_the_same_picture(tmp_path: Path) -> None:
    write_capture(tmp_path / "tube", [wave(0.4), wave(0.8)], Scene())
    source = open_capture(tmp_path / "tube")
    result = extract_chain(source)
    for name in ("one.png", "two.png"):
        write_sheet(result, source, tmp_path / name)
    picture = cv2.imread(str(tmp_path / "one.png"))
    assert picture.shape[0] > 300 and np.ptp(picture) > 200
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    assert b"tIME" not in (tmp_path / "one.png").read_bytes()


def test_the_chain_is_drawn_where_the_rope_is(tmp_path: Path) -> None:
    write_capture(tmp_path / "tube", [wave(0.6)], Scene(noisy=False))
    source = open_capture(tmp_path / "tube")
    (chain,) = extract_chain(source).frames
    (frame,) = source.frames()
    assert frame.color is not None
    drawn = chain_on_image(frame.color, chain).astype(int)
    red = (drawn[..., 0] > 200) & (drawn[..., 1] < 100)
    assert red.sum() > 500
    # Round each red dot lies the white rope, not the black plate.
    grown = cv2.dilate(red.astype(np.uint8), np.ones((5, 5))) > 0
    assert np.mean(drawn[grown & ~red].min(axis=-1) > 30) > 0.7


@pytest.mark.parametrize("beyond", [(640.4, 300.0), (300.0, 575.6)])
def test_a_line_that_ends_beyond_the_image_is_drawn(tmp_path: Path, beyond: tuple[float, float]) -> None:
    """As that of a rope which leaves the image obliquely."""
    write_capture(tmp_path / "tube", [wave(0.4)], Scene(noisy=False))
    source = open_capture(tmp_path / "tube")
    result = extract_chain(source)
    (chain,) = result.frames
    leaving = replace(chain, pixel=np.concatenate([chain.pixel[:-1], [beyond]]))
    write_sheet(replace(result, frames=(leaving,)), source, tmp_path / "sheet.png")
    assert (tmp_path / "sheet.png").stat().st_size > 0
