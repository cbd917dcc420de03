"""The ways to tell rope from the rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from chain.tubes import NOWHERE, Scene, along, index_of, photograph, wave

from dlolib.captures.base import Frame
from dlolib.chain import ChainSettings, chain_frame
from dlolib.chain.contrast import rope_levels
from dlolib.chain.extract import LEAST_WIDE, MOST_WIDE
from dlolib.chain.likely import MORE_THAN_ROPE, share_of_rope
from dlolib.chain.segment import PLATEAU, Segmentation, coverage, segment
from dlolib.errors import ChainError, ParameterError
from dlolib.types import CaptureIndex, Obstacle

AXIS = wave(0.6)


def seen(table: tuple[int, int, int] | None = None, level: int = 225) -> tuple[Frame, CaptureIndex]:
    """A white rope before black, or on a table of some colour whose light fades to one side."""
    color, depth = photograph(AXIS, Scene(rope_level=level))
    if table is not None:
        fade = np.linspace(1.0, 0.6, color.shape[1])[None, :, None]
        share = np.clip((color[..., :1].astype(float) - 12) / (level - 12), 0, 1)
        color = np.rint((share * color + (1 - share) * np.array(table)) * fade).astype(np.uint8)
    frame = Frame(0, 0.0, NOWHERE, color=color, depth_m=depth.astype(np.float32) / 1000)
    return frame, index_of(NOWHERE, [AXIS], Scene())


def rms(frame: Frame, index: CaptureIndex, settings: ChainSettings) -> float:
    chain = chain_frame(frame, index, settings)
    assert len(chain.s_m) >= 29
    return float(np.sqrt(np.mean(np.sum((chain.xyz_m - along(AXIS, chain.s_m)) ** 2, axis=1))))


@pytest.mark.parametrize("way", ["auto", "threshold", "local"])
def test_a_white_rope_before_black(way: str) -> None:
    assert rms(*seen(), ChainSettings(segmentation=way)) < 0.8e-3


@pytest.mark.parametrize("table", [(110, 90, 65), (150, 150, 150), (60, 90, 130)])
@pytest.mark.parametrize("way", ["auto", "local"])
def test_a_white_rope_on_a_table_in_uneven_light(table: tuple[int, int, int], way: str) -> None:
    assert rms(*seen(table), ChainSettings(segmentation=way)) < 1e-3


def far_wall(behind_m: float = 1.0) -> tuple[Frame, CaptureIndex]:
    """A rope close to the camera, and a wall so far behind it."""
    near = Scene(camera_m=(0.2, -0.4, -0.02), plate_y_m=behind_m)
    color, depth = photograph(AXIS, near)
    frame = Frame(0, 0.0, NOWHERE, color=color, depth_m=depth.astype(np.float32) / 1000)
    return frame, index_of(NOWHERE, [AXIS], near)


def test_a_rope_far_before_a_wall_is_as_wide_as_it_is_near() -> None:
    assert rms(*far_wall(), ChainSettings(segmentation="local")) < 0.8e-3


def test_what_an_outline_reads_of_a_far_wall_is_not_as_much_rope() -> None:
    frame, index = far_wall()
    mask = np.asarray(frame.color[..., 0] > 110)
    assert frame.depth_m is not None
    frame.depth_m[mask & (cv2.erode(mask.astype(np.uint8), np.ones((3, 3))) == 0)] = 1.4
    assert 0.9 < share_of_rope(mask, frame, index) < MORE_THAN_ROPE


def overexposed(rope: tuple[int, ...], table: tuple[int, ...], share: float = 1.0) -> Frame:
    """A dark rope on a table whose light is too much for the camera over that share of the image's width."""
    frame, _ = seen()
    assert frame.color is not None
    covered = np.clip((frame.color[..., :1].astype(float) - 12) / (225 - 12), 0, 1)
    light = np.full((*covered.shape[:2], 3), table, np.float64)
    light[:, round(share * light.shape[1]) :] = 200
    color = np.clip(np.rint(covered * np.array(rope) + (1 - covered) * light), 0, 255).astype(np.uint8)
    return replace(frame, color=color)


BLACK, BLUE = (20, 20, 20), (30, 60, 160)


@pytest.mark.parametrize("way", ["auto", "local", "color", "background"])
@pytest.mark.parametrize("rope", [BLACK, BLUE], ids=["black", "blue"])
@pytest.mark.parametrize("table", [(254, 254, 254), (255, 255, 255), (255, 240, 230), (600, 600, 600)])
def test_a_dark_rope_on_an_overexposed_table(
    rope: tuple[int, ...], table: tuple[int, ...], way: str, tmp_path: Path
) -> None:
    frame, index = overexposed(rope, table), index_of(NOWHERE, [AXIS], Scene())
    if way == "color":
        index = replace(index, rope_color_hsv=((0, 0, 0), (179, 255, 200)))
    if way == "background":
        empty = np.full((576, 640, 3), np.minimum(table, 255), np.uint8)
        cv2.imwrite(str(tmp_path / "empty.png"), empty[..., ::-1])
        index = replace(index, background_color=tmp_path / "empty.png")
    assert rms(frame, index, ChainSettings(segmentation=way)) < 0.35e-3


@pytest.mark.parametrize("share", [0.3, 0.55, 0.7])
@pytest.mark.parametrize("table", [(255, 240, 230), (600, 600, 600)])
def test_a_table_that_is_overexposed_in_part(table: tuple[int, ...], share: float) -> None:
    frame = overexposed(BLACK, table, share)
    assert rms(frame, index_of(NOWHERE, [AXIS], Scene()), ChainSettings()) < 0.35e-3


def test_what_is_as_dark_as_the_rope_is_no_measure_of_an_overexposed_table() -> None:
    """A pillar is then all that is finite."""
    frame = overexposed(BLACK, (600, 600, 600))
    assert frame.color is not None and frame.depth_m is not None
    color, depth = frame.color.copy(), frame.depth_m.copy()
    color[:, 316:323], depth[:, 316:323] = 20, 0.6
    frame = replace(frame, color=color, depth_m=depth)
    chain = chain_frame(frame, index_of(NOWHERE, [AXIS], Scene()), ChainSettings())
    away = np.linalg.norm(chain.xyz_m - along(AXIS, chain.s_m), axis=1)
    assert np.sqrt(np.mean(away**2)) < 0.35e-3 and len(chain.s_m) >= 28


def test_which_way_a_saturated_channel_counts() -> None:
    """A blue rope on an orange table: what is too blue is more like the rope, what is too red is less."""
    color = np.full((60, 60, 3), (220, 140, 30), np.uint8)
    color[28:32] = (40, 60, 200)
    mask = color[..., 2] == 200
    color[30, 10], color[10, 30], color[50, 30] = (40, 60, 255), (255, 140, 30), (255, 255, 255)
    levels = rope_levels(color, mask)
    assert levels is not None and levels[30, 30] > levels[50, 50]
    assert levels[30, 10] == np.inf and levels[10, 30] == -np.inf and levels[50, 30] == np.inf


def test_a_pillar_brighter_than_the_dark_is_no_rope() -> None:
    frame, index = seen()
    assert frame.color is not None
    color = frame.color.copy()
    pillar = np.s_[:, 300:330]
    color[pillar] = 70
    hidden = frame.depth_m.copy() if frame.depth_m is not None else None
    assert hidden is not None
    hidden[pillar] = 0.6
    chain = chain_frame(replace(frame, color=color, depth_m=hidden), index, ChainSettings())
    away = np.linalg.norm(chain.xyz_m - along(AXIS, chain.s_m), axis=1)
    assert np.sqrt(np.mean(away**2)) < 1.5e-3 and len(chain.s_m) > 22


def test_a_white_rope_on_a_table_is_told_from_a_dark_pillar_that_is_more() -> None:
    """Both are narrow and differ from what is around them, in opposite ways."""
    frame, index = seen((110, 90, 65))
    assert frame.color is not None and frame.depth_m is not None
    color, depth = frame.color.copy(), frame.depth_m.copy()
    pillar = np.s_[:, 316:323]
    color[pillar], depth[pillar] = 20, 0.6
    frame = replace(frame, color=color, depth_m=depth)
    for way in ("auto", "local"):
        chain = chain_frame(frame, index, ChainSettings(segmentation=way))
        away = np.linalg.norm(chain.xyz_m - along(AXIS, chain.s_m), axis=1)
        assert np.sqrt(np.mean(away**2)) < 1.2e-3 and len(chain.s_m) >= 27


@pytest.mark.parametrize("known", [False, True])
def test_a_black_rope_behind_a_black_pillar(known: bool) -> None:
    """Where nobody says that it stands there the rope's length tells that it is no part of it."""
    frame, index = seen()
    assert frame.color is not None and frame.depth_m is not None
    color = np.where(frame.color > 100, 20, np.array((110, 90, 65))).astype(np.uint8)
    depth = frame.depth_m.copy()
    color[:, 316:323], depth[:, 316:323] = 20, 0.6
    frame = replace(frame, color=color, depth_m=depth)
    # at 0.6 m these pixels are 8 mm wide; the camera stands at y = -0.75
    box = {"center_m": (0.2, -0.14, 0.0), "quaternion": (1.0, 0.0, 0.0, 0.0), "size_m": (0.01, 0.02, 1.0)}
    obstacles = (Obstacle("box", box),) if known else ()
    chain = chain_frame(frame, replace(index, obstacles=obstacles), ChainSettings())
    away = np.linalg.norm(chain.xyz_m - along(AXIS, chain.s_m), axis=1)
    assert np.sqrt(np.mean(away**2)) < 1.2e-3 and len(chain.s_m) >= 27 and chain.counts


@pytest.mark.parametrize("diameter", [0.006, 0.012])
def test_noise_that_pierces_a_rope_neither_cuts_nor_narrows_it(diameter: float) -> None:
    scene = Scene(diameter_m=diameter)
    color, depth = photograph(AXIS, scene)
    rope = color[..., 0] > 100
    red = np.where(rope[..., None], (200, 30, 20), (60, 130, 60)).astype(np.uint8)
    lost = np.random.default_rng(3).random(rope.shape) < 0.05
    red[rope & lost] = (90, 60, 55)
    index = replace(index_of(NOWHERE, [AXIS], scene), rope_color_hsv=((0, 150, 80), (10, 255, 255)))
    frame = Frame(0, 0.0, NOWHERE, color=red, depth_m=depth.astype(np.float32) / 1000)
    chain = chain_frame(frame, index, ChainSettings())
    assert len(chain.s_m) == 30 and chain.line_seen.all()
    away = np.linalg.norm(chain.xyz_m - along(AXIS, chain.s_m), axis=1)
    assert np.sqrt(np.mean(away**2)) < 1e-3
    assert LEAST_WIDE * diameter < chain.width_m < MOST_WIDE * diameter


def test_a_part_that_brightness_finds_gives_way_to_the_whole_rope(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a table that counts as bright itself what brightness left of one frame was a sixth of the rope."""
    frame, index = seen((110, 90, 65))
    whole = segment(frame, index, ChainSettings(segmentation="local")).mask
    part = whole.copy()
    part[:, 250:] = False
    assert 0.15 < part.sum() / whole.sum() < 0.5
    monkeypatch.setattr("dlolib.chain.segment._bright", lambda *_: part)
    assert (segment(frame, index, ChainSettings()).mask == whole).all()


def test_as_much_as_the_rope_but_not_at_its_held_ends_gives_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slivers of a table between boxes had the rope's area to a twentieth."""
    frame, index = seen((110, 90, 65))
    whole = segment(frame, index, ChainSettings(segmentation="local")).mask
    elsewhere = np.roll(whole, 120, axis=0)
    # further away the same pixels are more
    elsewhere[:, :240] = False
    assert 0.9 < share_of_rope(elsewhere, frame, index) < 1.1 and not (elsewhere & whole).any()
    monkeypatch.setattr("dlolib.chain.segment._bright", lambda *_: elsewhere)
    assert (segment(frame, index, ChainSettings()).mask == whole).all()


def test_a_wide_board_does_not_tell_how_bright_the_rope_is() -> None:
    """Else a clamp counted that is half as bright as the board and touches the rope."""
    frame, index = seen()
    assert frame.color is not None
    color, bright = frame.color.copy(), frame.color[..., 0] > 60
    rows, columns = np.nonzero(bright)
    first = int(columns.min())
    row = int(rows[columns == first].mean())
    clamp = np.zeros_like(bright)
    clamp[row - 4 : row + 4, first - 24 : first] = True
    color[clamp & ~bright] = 32
    color[420:] = 70
    mask = segment(replace(frame, color=color), index, ChainSettings()).mask
    assert mask[bright].mean() > 0.9 and mask[clamp & ~bright].mean() < 0.1


@pytest.mark.parametrize("what", ["color", "depth", "both"])
def test_what_differs_from_the_empty_scene(what: str, tmp_path: Path) -> None:
    # A rope as dark as a cluttered table is nearer than it; a bright one differs in colour, too.
    frame, index = seen(level=200 if what != "depth" else 30)
    rng = np.random.default_rng(0)
    clutter = np.kron(rng.integers(0, 120, (18, 20, 3)), np.ones((32, 32, 1))).astype(np.uint8)
    assert frame.color is not None and frame.depth_m is not None
    rope = frame.color[..., 0] > 20 if what == "depth" else frame.color[..., 0] > 60
    color = np.where(rope[..., None], frame.color, clutter)
    behind = np.full(rope.shape, 0.85)
    cv2.imwrite(str(tmp_path / "color.png"), cv2.cvtColor(clutter, cv2.COLOR_RGB2BGR))
    cv2.imwrite(str(tmp_path / "depth.png"), np.rint(1000 * behind).astype(np.uint16))
    if what != "depth":
        index = replace(index, background_color=tmp_path / "color.png")
    if what != "color":
        index = replace(index, background_depth=tmp_path / "depth.png")
    assert rms(replace(frame, color=color), index, ChainSettings()) < 1.2e-3


def test_a_rope_is_nearer_than_a_wall_whose_noise_is_as_much_as_the_rope_is_thick(tmp_path: Path) -> None:
    frame, index = far_wall(1.6)
    assert frame.depth_m is not None
    noise = np.random.default_rng(9).normal(0, 8e-4 * (2.0 / 0.7) ** 2, frame.depth_m.shape)
    cv2.imwrite(str(tmp_path / "depth.png"), np.rint(1000 * (2.0 + noise)).astype(np.uint16))
    assert rms(frame, replace(index, background_depth=tmp_path / "depth.png"), ChainSettings()) < 0.8e-3


def test_a_red_rope_on_both_sides_of_hue_0() -> None:
    frame, index = seen()
    assert frame.color is not None
    rope = frame.color[..., 0] > 100
    # hue 176 to the left, 4 to the right, on a green table
    red = np.full_like(frame.color, (200, 30, 50))
    red[:, 320:] = (200, 50, 30)
    frame = replace(frame, color=np.where(rope[..., None], red, np.array((60, 130, 60), np.uint8)))
    found = segment(frame, replace(index, rope_color_hsv=((170, 100, 80), (10, 255, 255))), ChainSettings())
    np.testing.assert_array_equal(found.mask, rope)


@pytest.mark.parametrize("spots", [0, 5])
def test_where_nothing_or_next_to_nothing_differs_there_is_no_rope(spots: int) -> None:
    frame, index = seen()
    assert frame.color is not None
    color = np.full_like(frame.color, 90)
    color[100, 100 : 100 + 7 * spots : 7] = 200
    with pytest.raises(ChainError, match="nothing differs"):
        segment(replace(frame, color=color), index, ChainSettings(segmentation="local"))


def test_a_choice_that_the_capture_cannot_serve_names_the_mend() -> None:
    frame, index = seen()
    for way, mend in (
        ("mask", "frames.csv"),
        ("color", "rope_color_hsv"),
        ("background", "background_color"),
    ):
        with pytest.raises(ChainError, match=mend):
            segment(frame, index, ChainSettings(segmentation=way))
    with pytest.raises(ParameterError, match="auto, threshold, local, color, background, mask"):
        ChainSettings(segmentation="magic")


@pytest.mark.parametrize("shade", [1.0, 0.6])
def test_a_pixel_on_the_outline_counts_by_how_bright_it_is_beside_the_rope(shade: float) -> None:
    """Half covered it is half as bright; on the rope's side in the shade, too."""
    levels = np.full((40, 60), 20.0, np.float32)
    levels[10:15] = 20 + 180 * shade
    levels[[9, 15]] = 20 + 90 * shade
    mask = levels > 20
    found = coverage(Segmentation(mask, levels))
    assert not found[~mask].any() and (found[10:15] == 1).all()
    assert found[9] == pytest.approx(np.full(60, 0.5 / PLATEAU)) and found[15] == pytest.approx(found[9])
    levels[~mask] = np.inf
    np.testing.assert_array_equal(coverage(Segmentation(mask, levels)), mask)


def test_what_is_as_bright_as_the_camera_tells_may_be_brighter() -> None:
    frame, index = seen(level=255)
    levels = segment(frame, index, ChainSettings(segmentation="threshold")).levels
    assert levels is not None and frame.color is not None
    grey = cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY)
    assert (grey == 255).any() and np.isinf(levels[grey == 255]).all()
    np.testing.assert_array_equal(levels[grey < 255], grey[grey < 255])
