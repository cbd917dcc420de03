"""motion.csv and what lies between its rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from formats import samples
from scipy.spatial.transform import Rotation

from dlolib.errors import FormatError
from dlolib.formats import interpolate_motion, read_motion, write_motion
from dlolib.types import Motion


def turning(*quaternions: tuple[float, ...]) -> Motion:
    rows = len(quaternions)
    free = np.full((rows, 3), np.nan)
    turns = np.array(quaternions, dtype=np.float64)
    return Motion(
        np.arange(rows, dtype=np.float64), np.zeros((rows, 3)), turns, free, np.full((rows, 4), np.nan)
    )


def test_positions_go_linearly_and_hold_beyond_the_table() -> None:
    between = interpolate_motion(samples.motion(), np.array([-3.0, 0.0, 0.5, 3.999, 4.0, 9.0]))
    expected = [0.42, 0.42, 0.415, 0.38001, 0.38, 0.38]
    np.testing.assert_allclose(between.end_m[:, 0], expected, atol=1e-12)


def test_slerp_halves_the_angle() -> None:
    half = interpolate_motion(turning((1, 0, 0, 0), (0, 0, 1, 0)), np.array([0.25]))
    turned = Rotation.from_quat(half.start_q[0], scalar_first=True).as_rotvec()
    np.testing.assert_allclose(turned, [0, np.pi / 4, 0], atol=1e-12)


def test_signs_tell_which_way_round_an_end_turned() -> None:
    # The same two attitudes, 60 degrees apart; with the second sign the way goes over 300 degrees.
    cosine, sine = np.cos(np.pi / 6), np.sin(np.pi / 6)
    short = interpolate_motion(turning((1, 0, 0, 0), (cosine, 0, sine, 0)), np.array([0.5]))
    long = interpolate_motion(turning((1, 0, 0, 0), (-cosine, 0, -sine, 0)), np.array([0.5]))
    angles = [Rotation.from_quat(q.start_q[0], scalar_first=True).as_rotvec()[1] for q in (short, long)]
    np.testing.assert_allclose(angles, [np.pi / 6, np.pi / 6 - np.pi], atol=1e-9)


def test_one_row_is_held_for_ever() -> None:
    held = interpolate_motion(turning((1, 0, 0, 0)), np.array([-1.0, 0.0, 7.0]))
    np.testing.assert_array_equal(held.start_q, np.tile([1, 0, 0, 0], (3, 1)))
    assert np.isnan(held.end_m).all()


def test_round_trip_keeps_signs_and_free_ends(tmp_path: Path) -> None:
    written = turning((1, 0, 0, 0), (-0.6, 0, -0.8, 0))
    write_motion(written, tmp_path / "motion.csv")
    again = read_motion(tmp_path / "motion.csv")
    for name in ("t_s", "start_m", "start_q", "end_m", "end_q"):
        np.testing.assert_array_equal(getattr(again, name), getattr(written, name))
    assert "nan" not in (tmp_path / "motion.csv").read_text().lower()


@pytest.mark.parametrize(
    ("line", "column", "value", "says"),
    [
        (3, "end_x_m", "far", "line 3, column end_x_m: 'far' in a number's place; give a number"),
        (4, "end_z_m", "nan", "line 4, column end_z_m: nan is not a finite number"),
        (4, "end_z_m", "inf", "line 4, column end_z_m: inf is not a finite number"),
        (4, "end_z_m", "", "line 4, column end_z_m: empty cell; give the pose in every row"),
        (4, "t_s", "", "line 4, column t_s: empty cell"),
        (4, "t_s", "0.5", "line 4, column t_s: t_s falls from 1 to 0.5; sort the rows by t_s"),
        (4, "t_s", "1", "line 4, column t_s: two rows with the same t_s = 1 as in line 3; remove one"),
        (5, "start_qw", "0.9", "line 5, column start_qw: the quaternion's length is 1.249, not 1"),
    ],
)
def test_a_bad_cell_is_named(tmp_path: Path, line: int, column: str, value: str, says: str) -> None:
    path = tmp_path / "motion.csv"
    write_motion(samples.motion(), path)
    samples.set_cell(path, line, column, value)
    with pytest.raises(FormatError) as caught:
        read_motion(path)
    assert str(caught.value).startswith(f"{path}: {says}")


def test_zero_quaternion(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    write_motion(samples.motion(), path)
    for turn in "wxyz":
        samples.set_cell(path, 3, f"end_q{turn}", "0")
    with pytest.raises(FormatError, match=r"line 3, column end_qw: zero quaternion; give"):
        read_motion(path)


def test_a_whole_turn_about_an_unknown_axis_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    write_motion(samples.motion(), path)
    for turn in "wxyz":
        samples.set_cell(path, 4, f"end_q{turn}", "-0.5")
    with pytest.raises(FormatError, match=r"line 4, column end_qw: the quaternion changes its sign"):
        read_motion(path)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("t_s;start_x_m\n0;0\n", "line 1: no column t_s, found t_s;start_x_m"),
        ("t_s,start_x_m\n", "no column start_y_m"),
        ("t_s\n0,1\n", "line 2: has more cells than the header"),
        ("a,b\n0,1\n0,1,2\n", "give every row as many cells as the header"),
    ],
)
def test_what_is_no_table(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "motion.csv"
    path.write_text(text)
    with pytest.raises(FormatError) as caught:
        read_motion(path)
    assert says in str(caught.value) and str(path) in str(caught.value)


def test_bytes_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    path.write_bytes(b"\x89PNG\r\n\xff\xfe\x00")
    with pytest.raises(FormatError, match="not text in UTF-8"):
        read_motion(path)


def test_a_truncated_row_is_an_empty_cell(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    write_motion(samples.motion(), path)
    path.write_text(path.read_text()[:-20])
    with pytest.raises(FormatError, match=r"line 6, column end_y_m: empty cell"):
        read_motion(path)


def test_blank_lines_do_not_shift_line_numbers(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    write_motion(samples.motion(), path)
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, "", *rows, "", ""]))
    assert len(read_motion(path).t_s) == 5
    samples.set_cell(path, 4, "t_s", "soon")
    with pytest.raises(FormatError, match="line 4, column t_s: 'soon'"):
        read_motion(path)
