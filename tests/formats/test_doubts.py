"""What is odd about a motion and yet may be meant."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlolib.formats import motion_doubts
from dlolib.types import Floats, Motion

FILE, FRAMES_S = Path("motion.csv"), np.linspace(0.0, 2.0, 21)


@pytest.fixture
def motion() -> Motion:
    """A held start, and an end that goes along x and rolls, 100 rows a second."""
    t_s = np.linspace(0.0, 2.0, 201)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (201, 1))
    end_m = np.outer(t_s, np.array([0.05, 0.0, 0.0])) + np.array([0.4, 0.0, 0.0])
    rolled = Rotation.from_rotvec(np.outer(0.1 * t_s, [0.0, 0.0, 1.0])).as_quat(scalar_first=True)
    return Motion(t_s, np.zeros((201, 3)), still, end_m, rolled)


def without(motion: Motion, first: int, last: int) -> Motion:
    """Rows from the first to the one before the last lost."""
    kept = np.r_[0:first, last:201]
    columns = ("t_s", "start_m", "start_q", "end_m", "end_q")
    return replace(motion, **{name: getattr(motion, name)[kept] for name in columns})


def test_a_whole_motion_is_not_odd(motion: Motion) -> None:
    assert motion_doubts(motion, FRAMES_S, FILE) == []


def test_rows_that_were_lost_while_an_end_moved_are_told(motion: Motion) -> None:
    (line,) = motion_doubts(without(motion, 51, 150), FRAMES_S, FILE)
    assert "motion.csv" in line and "no row between 0.5 and 1.5 s" in line
    assert motion_doubts(without(motion, 51, 56), FRAMES_S, FILE) == []
    # where nobody saw the rope, or the ends stood, nothing is amiss
    assert motion_doubts(without(motion, 51, 150), FRAMES_S[[0, 1, 20]], FILE) == []
    still = replace(motion, end_m=np.tile(motion.end_m[:1], (201, 1)))
    assert motion_doubts(without(still, 51, 150), FRAMES_S, FILE) == []


def test_frames_beyond_the_motion_are_told(motion: Motion) -> None:
    """By more than half the time from one to the next, which is none where there is but one."""
    assert motion_doubts(motion, FRAMES_S + 0.04, FILE) == motion_doubts(motion, FRAMES_S - 0.04, FILE) == []
    (line,) = motion_doubts(motion, FRAMES_S + 0.06, FILE)
    assert "ends 0.06 s before the last frame" in line
    (line,) = motion_doubts(motion, FRAMES_S - 0.06, FILE)
    assert "begins 0.06 s after the first frame" in line
    assert motion_doubts(motion, FRAMES_S[:1], FILE) == motion_doubts(motion, FRAMES_S[-1:], FILE) == []


def test_a_motion_in_milliseconds_is_told(motion: Motion) -> None:
    lines = motion_doubts(replace(motion, t_s=1e3 * motion.t_s), FRAMES_S + 1.0, FILE)
    assert "goes on for 2000 s, and the frames for 2 s; give seconds" in lines[0]
    still = replace(motion, t_s=1e3 * motion.t_s, end_m=np.tile(motion.end_m[:1], (201, 1)))
    assert motion_doubts(still, FRAMES_S + 1.0, FILE) == []


def test_times_of_a_clock_that_counts_from_1970_are_told_apart(motion: Motion) -> None:
    late = replace(motion, t_s=motion.t_s + 1.7e9)
    (line,) = motion_doubts(without(late, 51, 150), FRAMES_S + 1.7e9, FILE)
    assert "no row between 1700000000.5 and 1700000001.5 s" in line


def flipped(q: Floats, rows: slice) -> Floats:
    """The same poses with other signs."""
    found = q.copy()
    found[rows] *= -1
    return found


def test_a_sign_that_turns_an_end_the_long_way_round_is_told(motion: Motion) -> None:
    (line,) = motion_doubts(replace(motion, end_q=flipped(motion.end_q, slice(51, None))), FRAMES_S, FILE)
    assert "end_qw" in line and "359.9°" in line and "0.5 and 0.51 s" in line and "other" not in line
    (line,) = motion_doubts(replace(motion, end_q=flipped(motion.end_q, slice(1, None, 2))), FRAMES_S, FILE)
    assert "199 other places" in line
    # an end that is turned by three quarters of a turn may be meant
    rolled = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, 0.0, 1.5 * np.pi]]).as_quat(scalar_first=True)
    rolled[1] *= -np.sign(rolled[1] @ rolled[0])
    two = replace(without(motion, 1, 200), end_q=rolled)
    assert motion_doubts(two, FRAMES_S[[0, 20]], FILE) == []
