"""The parts of Algorithm 1, each by itself."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from dlolib.chain.anchor import Anchor
from dlolib.chain.axis import Axis, assemble
from dlolib.chain.greedy import greedy_chain
from dlolib.chain.lift import Strand, half_widths
from dlolib.chain.mixing import unmixed
from dlolib.chain.order import in_order, length
from dlolib.chain.skeleton import MOST_LINES, centre_lines
from dlolib.chain.uncertainty import covariances
from dlolib.chain.view import View
from dlolib.types import Floats, Rope

SMOOTH = {"bridge_m": 0.006, "smooth_m": 0.03}
# What is put in order lies before the camera, about as many samples wide.
FAR_M, WIDTH = np.array([0.0, 0.0, 0.7]), 6.0


def drawn(points: Floats, thickness: int = 6) -> np.ndarray:
    image = np.zeros((300, 400), np.uint8)
    cv2.polylines(image, [np.round(points).astype(np.int32)], False, 1, thickness)
    return image > 0


def strand(points: Floats) -> Strand:
    return Strand(points[:, :2], points, np.ones(len(points), np.bool_), 1e-3)


@pytest.mark.parametrize("degrees", range(0, 180, 15))
def test_a_straight_rope_is_one_line_at_every_angle(degrees: int) -> None:
    way = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    lines, width = centre_lines(drawn(np.array([[200, 150] - 120 * way, [200, 150] + 120 * way])))
    assert len(lines) == 1 and 4 <= width <= 8
    off = (lines[0] - [200, 150]) @ [-way[1], way[0]]
    assert np.abs(off).max() < 2.5 and len(lines[0]) > 150


def test_a_skeleton_is_cut_where_the_rope_crosses_itself() -> None:
    mask = drawn(np.array([[50, 50], [350, 250]])) | drawn(np.array([[50, 250], [350, 50]]))
    lines, _ = centre_lines(mask)
    assert len([line for line in lines if len(line) > 80]) == 4


def test_a_pinhole_is_no_fork() -> None:
    mask = drawn(np.array([[50, 150], [350, 150]]), 8)
    mask[149:152, 199:202] = False
    assert len(centre_lines(mask)[0]) == 1


def test_of_an_image_of_noise_no_more_than_some_lines_are_looked_at() -> None:
    """All the time of such a frame went into lines that no rope has."""
    noise = np.random.default_rng(5).random((300, 400)) < 0.3
    lines, _ = centre_lines(noise)
    assert len(lines) == MOST_LINES


def test_strands_are_put_in_order_through_gaps_and_turned() -> None:
    angle = np.linspace(0, np.pi, 301)
    arc = np.stack([np.cos(angle), np.sin(angle), np.zeros(301)], axis=-1) * 0.14 + FAR_M
    parts = [arc[200:], arc[:90][::-1], arc[110:180]]
    start = Anchor(arc[0], np.array([0.0, 1.0, 0.0]))
    end = Anchor(arc[-1], np.array([0.0, -1.0, 0.0]))
    ordered = in_order([strand(part) for part in parts], WIDTH, start, end, 0.14 * np.pi)
    joined = np.concatenate([part.points_m for part in ordered])
    np.testing.assert_array_equal(joined, np.concatenate([arc[:90], arc[110:180], arc[200:]]))


def test_a_crossing_is_gone_straight_through() -> None:
    # A loop: along x, around, and back across itself along y. Four strands meet at the crossing.
    t = np.linspace(0, 1, 60)[:, None]
    first = np.array([-0.1, 0, 0]) * (1 - t) + np.array([-0.01, 0, 0]) * t + FAR_M
    angle = np.linspace(-np.pi / 2, np.pi, 200)
    loop = np.stack([0.08 + 0.08 * np.cos(angle), 0.08 + 0.08 * np.sin(angle), 0 * angle], axis=-1)
    loop = np.concatenate([np.array([[0.01, 0, 0]]), loop, np.array([[0, 0.01, 0]])]) + FAR_M
    last = np.array([0, -0.01, 0]) * (1 - t) + np.array([0, -0.1, 0]) * t + FAR_M
    strands = [strand(last), strand(loop[::-1]), strand(first)]
    ordered = in_order(
        strands, WIDTH, Anchor(first[0], np.array([1.0, 0, 0])), None, sum(map(length, strands))
    )
    np.testing.assert_array_equal(
        np.concatenate([s.points_m for s in ordered]), np.concatenate([first, loop, last])
    )


@pytest.mark.parametrize("seed", range(8))
def test_strands_that_bend_into_a_crossing_and_lose_their_depth_there_go_straight_on(seed: int) -> None:
    """As in a stereo camera's clouds: within a width of the fork a skeleton runs into the other strand, and
    the depth read there is that of neither."""
    rng = np.random.default_rng(seed)
    there, back = np.array([0.9, 0.4, 0.0]), np.array([-0.9, 0.4, 0.0])
    loop = CubicHermiteSpline([0, 1], np.zeros((2, 3)), [0.8 * there, 0.8 * back])(np.linspace(0, 1, 300))
    way = np.linspace(0, 0.1, 60)[:, None]
    bent = []
    for arm, tips in ((-there * way[::-1], (-1,)), (loop, (0, -1)), (back * way, (0,))):
        points = arm + FAR_M
        for tip in tips:
            into = np.clip(1 - np.arange(len(arm)) / WIDTH, 0, 1)[:: 1 if tip == 0 else -1, None]
            points = points + into * rng.uniform(-1, 1, 3) * [0.004, 0.004, 0.015]
        bent.append(points)
    strands = [strand(bent[2]), strand(bent[1][::-1]), strand(bent[0])]
    start = Anchor(bent[0][0], there)
    ordered = in_order(strands, WIDTH, start, None, sum(map(length, strands)))
    np.testing.assert_array_equal(np.concatenate([s.points_m for s in ordered]), np.concatenate(bent))


def test_a_stray_piece_is_left_out() -> None:
    line = np.linspace([0, 0, 0], [0.4, 0, 0], 300) + FAR_M
    stray = np.linspace([0.2, 0.2, 0], [0.22, 0.22, 0], 20) + FAR_M
    anchors = [Anchor(line[i], np.array([1.0, 0, 0])) for i in (0, -1)]
    ordered = in_order([strand(stray), strand(line)], WIDTH, *anchors, 0.4)
    assert len(ordered) == 1 and len(ordered[0].points_m) == 300


@pytest.mark.parametrize("held", [0, 1])
def test_what_is_more_than_the_rope_is_left_out(held: int) -> None:
    """Another cable, longer than what lies between: to leave it out is no loss."""
    line = np.linspace([0, 0, 0], [0.4, 0, 0], 300) + FAR_M
    other = np.linspace([0.5, 0.2, 0], [0.85, 0.2, 0], 300) + FAR_M
    start = Anchor(line[0], np.array([1.0, 0, 0])) if held else None
    (ordered,) = in_order([strand(line), strand(other)], WIDTH, start, None, 0.4)
    assert np.ptp(ordered.points_m[:, 1]) == 0 and ordered.points_m[:, 1].max() == 0
    # one that long is all of it
    assert len(in_order([strand(line), strand(other)], WIDTH, start, None, 0.9)) == 2


def hairpin() -> Axis:
    """Two legs 20 mm apart: the nearest point at distance l lies on the other leg."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 200)
    bow = np.stack([0.2 + 0.01 * np.cos(angle), 0.01 + 0.01 * np.sin(angle)], axis=-1)
    flat = np.concatenate(
        [np.linspace([0, 0], bow[0], 400)[:-1], bow, np.linspace(bow[-1], [0, 0.02], 400)[1:]]
    )
    points = np.column_stack([flat, np.zeros(len(flat))])
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return Axis(s, points, np.ones(len(s), np.bool_), flat, float(s[-1]), True, np.zeros(len(s)))


def test_the_greedy_chain_only_goes_forward() -> None:
    axis = hairpin()
    s, points, _ = greedy_chain(axis, axis.measured_m / 19, 20)
    np.testing.assert_allclose(s, np.linspace(0, axis.measured_m, 20), atol=1e-9)
    np.testing.assert_allclose(points[-1], [0, 0.02, 0], atol=1e-9)
    np.testing.assert_allclose(points[0], [0, 0, 0], atol=1e-9)


def test_no_point_where_nothing_was_seen() -> None:
    axis = hairpin()
    seen = (axis.s_m < 0.1) | (axis.s_m > 0.2)
    s, _, _ = greedy_chain(replace(axis, seen=seen), 0.01, 40)
    assert len(s) > 20 and not ((s > 0.1) & (s < 0.2)).any()


@pytest.mark.parametrize("start", [(0, 0, 0.7), (0.35, 0.1, 0.7), (-0.3, -0.2, 0.8)])
@pytest.mark.parametrize("way", [(1, 0, 0), (0, 1, 0), (0.6, 0.5, 0.3)])
def test_the_outline_of_a_round_rope_is_as_wide_as_its_skin_looks(
    start: tuple[float, float, float], way: tuple[float, float, float]
) -> None:
    unread = np.zeros((576, 640), np.float32)
    view = View(unread > 0, unread, unread, 504.0, 504.0, 320.0, 288.0)
    along = np.array(way) / np.linalg.norm(way)
    axis = np.array(start) + np.linspace(-0.05, 0.05, 2001)[:, None] * along
    pixel = view.pixel(axis)
    way_px = np.r_[0, np.cumsum(np.linalg.norm(np.diff(pixel, axis=0), axis=1))]
    at = np.linspace(0, way_px[-1], int(way_px[-1]))
    grid = np.stack([np.interp(at, way_px, pixel[:, k]) for k in range(2)], axis=-1)
    wide = half_widths(grid, np.interp(at, way_px, axis[:, 2]), view, 0.004)
    first = np.cross(along, (0.3, 0.5, 0.8))
    first /= np.linalg.norm(first)
    turn = np.linspace(0, 2 * np.pi, 721)[:, None]
    round_it = np.cos(turn) * first + np.sin(turn) * np.cross(along, first)
    skin = view.pixel((axis[:, None] + 0.004 * round_it).reshape(-1, 3))
    middle, heading = grid[len(grid) // 2], grid[-1] - grid[0]
    heading /= np.linalg.norm(heading)
    beside = skin[np.abs((skin - middle) @ heading) < 0.3] - middle
    across = beside @ np.array([-heading[1], heading[0]])
    assert wide[len(grid) // 2] == pytest.approx(0.5 * np.ptp(across), rel=3e-3)


@pytest.mark.parametrize("held", ["start", "end"])
def test_arc_length_is_surest_at_the_end_that_is_held(held: str) -> None:
    """Half of a rope of 0.4 m is in sight: what lies further from the held end is off by 0.3 % of the way."""
    line = np.linspace([0.0, 0.0, 0.7], [0.2, 0.0, 0.7], 201)
    sigma = np.full(201, 1e-5)
    half = replace(strand(line), depth_sigma_m=sigma, across_sigma_m=sigma)
    way = np.array([1.0, 0.0, 0.0])
    start = Anchor(line[0] - 0.001 * way, way) if held == "start" else None
    end = Anchor(line[-1] + 0.001 * way, way) if held == "end" else None
    axis = assemble([half], start, end, length_m=0.4, **SMOOTH)
    tips = covariances(axis, axis.s_m[[0, -1]], axis.points_m[[0, -1]], Rope("rope", 0.4, 0.008))
    along = np.sqrt(tips[:, 0, 0])
    near, far = along if held == "start" else along[::-1]
    assert near < 4e-5 and far == pytest.approx(6e-4, rel=0.02)


def along_at(parts: list[Strand], length_m: float, s_m: float) -> float:
    """The deviation [m] along a rope, held at both ends along x, of the place at this arc length."""
    ends = parts[0].points_m[0], parts[-1].points_m[-1]
    axis = assemble(parts, *(Anchor(place, np.array([1.0, 0.0, 0.0])) for place in ends), length_m, **SMOOTH)
    assert axis.fitted and axis.s_m[-1] == pytest.approx(length_m)
    at = np.array([s_m])
    point = np.stack([np.interp(at, axis.s_m, axis.points_m[:, k]) for k in range(3)], axis=-1)
    return float(np.sqrt(covariances(axis, at, point, Rope("rope", length_m, 0.008))[0, 0, 0]))


def level(count: int = 301, sigma_m: float = 1e-5) -> Strand:
    """A straight strand, a sample a millimetre, 0.7 m before the camera."""
    sigma = np.full(count, sigma_m)
    line = np.linspace([0.0, 0.0, 0.7], [1e-3 * (count - 1), 0.0, 0.7], count)
    return replace(strand(line), depth_sigma_m=sigma, across_sigma_m=sigma)


def test_what_one_hidden_stretch_is_longer_than_its_bridge_moves_no_point_that_was_seen() -> None:
    """Of a rope in sight that is 1 mm short of its known length both ends tell where a place is, each to its
    share of that; of one with a hidden stretch longer than it looks the end on the same side does."""
    rope = level()
    for share in (1 / 6, 1 / 2):
        told = 1e-3 * share * (1 - share) / np.hypot(share, 1 - share)
        assert along_at([rope], 0.301, 0.301 * share) == pytest.approx(told, rel=0.03)
    cut = [rope.part(slice(0, 101)), rope.part(slice(200, 301))]
    assert along_at(cut, 0.310, 0.05) < 5e-5


def test_a_hidden_stretch_is_no_shorter_than_a_straight_line() -> None:
    """A rope of 300 mm that is said to be 8 mm shorter: its gap of 49 mm is straight, the rest gives way."""
    rope = level()
    parts = [rope.part(slice(0, 151)), rope.part(slice(199, 301))]
    places, way = (rope.points_m[0], rope.points_m[-1]), np.array([1.0, 0.0, 0.0])
    axis = assemble(parts, *(Anchor(place, way) for place in places), 0.292, **SMOOTH)
    first, last = np.flatnonzero(~axis.seen)[[0, -1]] + (-1, 1)
    assert axis.fitted and axis.s_m[-1] == pytest.approx(0.292)
    assert axis.s_m[last] - axis.s_m[first] == pytest.approx(0.049, rel=1e-6)


def test_between_two_hidden_stretches_neither_end_tells_where_a_place_is() -> None:
    """A bridge of 49 mm may be off by a tenth, in the middle of two by that over the root of two; by more
    where the known length says so."""
    rope = level()
    parts = [rope.part(slice(0, 51)), rope.part(slice(99, 201)), rope.part(slice(249, 301))]
    assert along_at(parts, 0.300, 0.02) < 5e-5
    assert along_at(parts, 0.300, 0.15) == pytest.approx(4.9e-3 / np.sqrt(2), rel=0.03)
    assert along_at(parts, 0.320, 0.16) == pytest.approx(1e-2 / np.sqrt(2), rel=0.05)


def test_a_line_that_goes_to_and_fro_is_too_long_by_half_of_its_squared_slope() -> None:
    """Deviations of 0.6 mm over waves of 12 mm: an eighth of a per cent of what is far from the held end."""
    rough = level(201, 6e-4)
    start = Anchor(rough.points_m[0], np.array([1.0, 0.0, 0.0]))
    doubt_m = assemble([rough], start, None, 0.4, **SMOOTH).doubt_m
    # of each of the two deviations, beside 0.3 % of the way
    assert doubt_m[-1] == pytest.approx(0.2 * (0.003 + 2 * 0.5 * (0.6 / 12) ** 2), rel=0.02)


@pytest.mark.parametrize("radius_px", [0.95, 3.0])
def test_what_lies_behind_a_narrow_rope_is_taken_out_of_its_depth(radius_px: float) -> None:
    """A pixel gathers depth over 1.5 px: of a rope and of what is 30 mm behind it, by their shares."""
    rope_m, behind_m, edge_px, row = 0.7, 0.73, 1.5, 20.45
    rows = np.arange(40)
    low, high = rows - 0.5 * edge_px, rows + 0.5 * edge_px
    share = (
        np.clip(np.minimum(high, row + radius_px) - np.maximum(low, row - radius_px), 0, edge_px) / edge_px
    )
    depth = np.tile((share * rope_m + (1 - share) * behind_m)[:, None], 60).astype(np.float32)
    mask = np.tile((np.abs(rows - row) < radius_px)[:, None], 60)
    view = View(mask, mask.astype(np.float32), depth, 500.0, 500.0, 30.0, 20.0)
    grid = np.stack([np.arange(60.0), np.full(60, row)], axis=-1)
    column, line = view.pixels.astype(int).T
    given = depth[line, column].astype(np.float64)
    found, mostly = unmixed(given, column, line - row, grid, np.full(60, radius_px), view, edge_px)
    assert mostly.sum() >= 60 and np.abs(given[mostly] - rope_m).max() > (5e-3 if radius_px < 1 else -1)
    np.testing.assert_allclose(found[mostly], rope_m, atol=1e-5)
    # what no pixel reads mixes into none
    alone = replace(view, depth_m=np.where(mask, rope_m, 0.0).astype(np.float32))
    same, _ = unmixed(
        np.full(len(line), rope_m), column, line - row, grid, np.full(60, radius_px), alone, edge_px
    )
    np.testing.assert_array_equal(same, rope_m)


def test_a_rope_in_many_pieces_is_put_in_order() -> None:
    """As a coil of some turns is seen: each a little beside the one before."""
    rng = np.random.default_rng(4)
    at = np.linspace(0.0, 6.0 * np.pi, 601)
    coil = (
        np.stack([0.01 * at + 0.05 * np.cos(at), 0.05 * np.sin(at), 0.02 * np.cos(at + 1.0)], axis=1) + FAR_M
    )
    pieces = [strand(coil[50 * k + 2 : 50 * k + 48]) for k in range(12)]
    mixed = [pieces[k] if rng.random() < 0.5 else pieces[k].turned() for k in rng.permutation(12)]
    length_m = float(np.linalg.norm(np.diff(coil, axis=0), axis=1).sum())
    start = Anchor(coil[0], coil[1] - coil[0])
    found = in_order(mixed, WIDTH, start, None, length_m)
    assert [piece.points_m[0].tolist() for piece in found] == [piece.points_m[0].tolist() for piece in pieces]
