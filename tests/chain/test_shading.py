"""A rope in light from one side: where its middle is must not depend on where the light is."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from chain.tubes import FOCAL, Scene, along, seen_by, wave, without_diameter

from dlolib.chain import ChainSettings, chain_frame
from dlolib.chain.shading import shaded_middles
from dlolib.chain.view import View
from dlolib.types import Floats

ABOVE, BELOW, BEHIND = (0.3, -0.5, 0.8), (-0.3, -0.6, -0.7), (0.0, 0.3, 0.95)


def across_px(axis: Floats, s_m: Floats, xyz_m: Floats, scene: Scene) -> Floats:
    """Signed distance [px] (K,) of points from the axis in the image, upwards where the rope runs right."""
    true, near = along(axis, s_m), along(axis, s_m + 1e-3) - along(axis, s_m - 1e-3)
    ray = true - np.array(scene.camera_m)
    normal = np.cross(ray, near)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.sign(normal @ np.array([0.0, 0.0, 1.0]))[:, None]
    return np.asarray(np.einsum("ij,ij->i", xyz_m - true, normal) / ray[:, 1] * FOCAL)


@pytest.mark.parametrize("known", [True, False], ids=["diameter known", "diameter unknown"])
@pytest.mark.parametrize("light", [ABOVE, BELOW, BEHIND], ids=["above", "below", "from behind"])
def test_a_rope_lit_from_one_side_stays_in_its_middle(light: tuple[float, float, float], known: bool) -> None:
    axis, scene = wave(0.8), Scene(light=light, camera_m=(0.2, -0.7, 0.0))
    frame, index = seen_by(axis, scene)
    chain = chain_frame(frame, index if known else without_diameter(index), ChainSettings())
    inner = slice(2, -2)
    off = across_px(axis, chain.s_m, chain.xyz_m, scene)[inner]
    assert len(off) == 26
    assert abs(off.mean()) < 0.1 and np.abs(off).max() < 0.35


SLOPE, ROW, RADIUS = 0.15, 14.0, 2.8


def picture(
    offset: float,
    background: tuple[float, float],
    blur: float = 0.5,
    ambient: float = 60,
    light: float = 160,
    aside: float = 0.8,
) -> Floats:
    """Grey levels (41, 80) of a straight rope, dark on one side, its middle at ROW + offset + SLOPE x."""
    fine = 8
    row, column = (np.mgrid[: 41 * fine, : 80 * fine] + 0.5) / fine - 0.5
    u = (row - ROW - offset - SLOPE * column) / np.hypot(1, SLOPE) / RADIUS
    ahead = np.sqrt(1 - aside**2)
    lit = ambient + light * np.maximum(ahead * np.sqrt(np.maximum(1 - u**2, 0)) - aside * u, 0)
    level = np.where(np.abs(u) <= 1, lit, np.where(u < 0, *background))
    level = cv2.GaussianBlur(level, (0, 0), fine * blur, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(level.reshape(41, fine, 80, fine).mean(axis=(1, 3)))


def viewed(level: Floats) -> View:
    noise = np.random.default_rng(0).normal(0, 2, level.shape)
    grey = np.clip(np.rint(level + noise), 0, 255).astype(np.float32)
    row, column = np.mgrid[:41, :80]
    mask = np.abs(row - ROW - SLOPE * column) <= RADIUS
    unread = np.zeros(level.shape, np.float32)
    return View(mask, unread, unread, FOCAL, FOCAL, 40.0, 20.0, grey)


def centre_guess() -> Floats:
    column = np.arange(5.0, 75.0)
    return np.stack([column, ROW + SLOPE * column], axis=-1)


@pytest.mark.parametrize("background", [(12.0, 12.0), (12.0, 30.0)], ids=["even", "lighter below"])
@pytest.mark.parametrize("offset", [-0.4, 0.0, 0.3])
def test_the_middle_of_a_section_is_found_to_a_tenth_of_a_pixel(
    offset: float, background: tuple[float, float]
) -> None:
    level = picture(offset, background)
    (moved,), (error,) = shaded_middles([centre_guess()], [np.full(70, RADIUS)], True, viewed(level), 10.0)
    assert (error > 0).all() and error.max() < 0.15
    off = moved[:, 1] - ROW - offset - SLOPE * moved[:, 0]
    assert abs(off[5:-5].mean()) < 0.1
    # The yardstick can tell: by brightness the middle would lie elsewhere.
    bright = level[:, 40] - level[:, 40].min()
    if background == (12.0, 12.0):
        assert bright @ np.arange(41) / bright.sum() - ROW - offset - SLOPE * 40 < -0.3


@pytest.mark.parametrize("aside", [0.3, 0.56])
def test_a_table_as_bright_as_the_dark_side_does_not_move_the_middle(aside: float) -> None:
    level = picture(0.3, (72.0, 72.0), 0.5, 80.0, 150.0, aside)
    (moved,), _ = shaded_middles([centre_guess()], [np.full(70, RADIUS)], True, viewed(level), 7.3)
    assert abs((moved[:, 1] - ROW - 0.3 - SLOPE * moved[:, 0])[5:-5].mean()) < 0.1


def test_without_levels_lines_stay_as_they_are() -> None:
    view = replace(viewed(picture(0.3, (12.0, 12.0))), levels=None)
    line = centre_guess()
    (same,), _ = shaded_middles([line], [np.full(70, RADIUS)], True, view, 10.0)
    np.testing.assert_array_equal(same, line)


def test_how_sharp_the_camera_is_does_not_move_the_middle() -> None:
    """The light from one side moves the middle by what the blur is off: it must not jump between steps."""
    found = []
    for blur in np.linspace(0.4, 0.9, 11):
        view = viewed(picture(0.3, (12.0, 12.0), blur))
        column = np.arange(4.0, 76.0)
        line = np.stack([column, ROW + SLOPE * column], axis=-1)
        lines, _ = shaded_middles([line], [np.full(len(line), RADIUS)], True, view, 8.0)
        found.append(float(np.mean(lines[0][:, 1] - ROW - SLOPE * lines[0][:, 0])))
    assert np.ptp(found) < 0.04


@pytest.mark.parametrize("offset", [-0.4, 0.0, 0.25])
def test_in_even_light_the_middle_is_found_to_a_hundredth_of_a_pixel(offset: float) -> None:
    """An error that is the same in every frame is no noise: what looks alike on both sides has none."""
    (moved,), _ = shaded_middles(
        [centre_guess()], [np.full(70, RADIUS)], True, viewed(picture(offset, (12.0, 12.0), aside=0.0)), 10.0
    )
    assert abs((moved[:, 1] - ROW - offset - SLOPE * moved[:, 0])[5:-5].mean()) < 0.01
