"""How `make clouds` lays a rope out anew: along the line that it says, over itself where that crosses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from dlolib.chain import ChainSettings, FrameChain, chain_frame
from dlolib.types import Camera, CaptureIndex, Ends, Floats, Rope
from stages.cloud_layouts import OVER_M, Strip, laid_out, strip_of
from stages.clouds import laid_anew

FOCAL, FAR_M, LONG_PX, WIDE_PX = 900.0, 0.46, 1800, 10


@pytest.fixture(scope="module")
def strip() -> Strip:
    """Of a rope on a plane, a point a pixel."""
    column, row = np.meshgrid(np.arange(float(LONG_PX)), np.arange(WIDE_PX) - 0.5 * (WIDE_PX - 1))
    pixel = np.stack([column.ravel(), row.ravel()], axis=-1)
    ends = np.array([[0.0, 0.0], [LONG_PX - 1.0, 0.0]])
    return strip_of(space(pixel), space(np.linspace(*ends, 400)))


def space(pixel: Floats) -> Floats:
    return np.concatenate([pixel / FOCAL, np.ones((len(pixel), 1))], axis=1) * FAR_M


def test_a_strip_tells_where_each_reading_lies(strip: Strip) -> None:
    assert strip.focal_px == pytest.approx(FOCAL) and strip.length_px == pytest.approx(LONG_PX - 1)
    np.testing.assert_allclose(np.unique(np.round(strip.aside_px, 6)), np.arange(WIDE_PX) - 4.5)
    assert np.abs(strip.behind_m).max() < 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_a_rope_lies_along_its_new_line_and_over_itself(strip: Strip, seed: int) -> None:
    layout = laid_out(strip, np.random.default_rng(seed))
    pixel, line = (FOCAL * points[:, :2] / points[:, 2:] for points in (layout.cloud_m, layout.line_m))
    assert cKDTree(line).query(pixel)[0].max() < 0.5 * WIDE_PX + 3
    assert cKDTree(pixel).query(line)[0].max() < 2
    # what lies under is hidden: a point a pixel
    assert len(np.unique(np.round(pixel), axis=0)) == len(pixel)
    assert FAR_M - 3.1 * OVER_M < layout.cloud_m[:, 2].min() < FAR_M - 0.9 * OVER_M


def test_the_chain_of_such_a_rope_is_counted_as_in_order_or_not(
    strip: Strip, monkeypatch: pytest.MonkeyPatch
) -> None:
    rope, camera = Rope("rope", 0.9, None, None), Camera(np.eye(4))
    down = np.array([0.0, 0.0, -9.81])
    index = CaptureIndex("cloud", Path(), rope, down, Ends("free", "free"), camera, np.arange(1), np.zeros(1))
    found = laid_anew([strip], index, ChainSettings(), 2)
    assert found["ordered"] == 2 and not found["out_of_order"] and found["off_rms_m"] < 1e-3

    def swapped(*given: Any) -> FrameChain:
        """The second half of it before the first."""
        chain = chain_frame(*given)
        return replace(chain, xyz_m=np.roll(chain.xyz_m, len(chain.s_m) // 2, axis=0))

    monkeypatch.setattr("stages.clouds.chain_frame", swapped)
    assert laid_anew([strip], index, ChainSettings(), 2)["out_of_order"] == [0, 1]
