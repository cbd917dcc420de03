"""motion.csv: the poses of the held ends over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from dlolib.files import write_csv
from dlolib.formats._schema import LARGEST_M, MILLIMETRES, UNIT_TOLERANCE
from dlolib.formats._table import Table, check_rising, read_table
from dlolib.types import Floats, Motion

AXES = ("x", "y", "z")
TURNS = ("w", "x", "y", "z")
OPPOSITE = 1e-9


def position_columns(end: str) -> list[str]:
    """The three columns of an end's position [m]."""
    return [f"{end}_{axis}_m" for axis in AXES]


def quaternion_columns(end: str) -> list[str]:
    """The four columns of an end's quaternion."""
    return [f"{end}_q{turn}" for turn in TURNS]


def read_motion(csv: Path) -> Motion:
    """Read motion.csv: times rise, an end is given in every row or in none, quaternions are unit.

    Quaternions are normalised (they are stored to a few digits) and keep their sign.

    Raises:
        FormatError: names file, line and column.
    """
    ends = [*position_columns("start"), *quaternion_columns("start")]
    ends += [*position_columns("end"), *quaternion_columns("end")]
    table = read_table(Path(csv), ["t_s", *ends], empties=ends)
    times = check_rising(table, "t_s")
    start_m, start_q = _end(table, "start")
    end_m, end_q = _end(table, "end")
    return Motion(times, start_m, start_q, end_m, end_q)


def write_motion(motion: Motion, csv: Path) -> None:
    """Write motion.csv with nine significant digits; the columns of a free end stay empty."""
    columns: dict[str, Floats] = {"t_s": motion.t_s}
    for end, place, turn in (
        ("start", motion.start_m, motion.start_q),
        ("end", motion.end_m, motion.end_q),
    ):
        columns |= dict(zip(position_columns(end), place.T, strict=True))
        columns |= dict(zip(quaternion_columns(end), turn.T, strict=True))
    write_csv(Path(csv), pd.DataFrame(columns))


def interpolate_motion(motion: Motion, t_s: Floats) -> Motion:
    """The poses at other times t_s (N,) [s]; beyond the table its first and last row hold.

    Positions go linearly, quaternions by slerp of the values as stored: no sign is flipped, so that a
    turn of more than half a revolution between two rows goes the way that the signs tell.
    """
    times = np.atleast_1d(np.asarray(t_s, dtype=np.float64))
    last = len(motion.t_s) - 1
    after = np.clip(np.searchsorted(motion.t_s, times, side="right"), min(1, last), last)
    before = np.maximum(after - 1, 0)
    span = motion.t_s[after] - motion.t_s[before]
    share = (times - motion.t_s[before]) / np.where(span > 0, span, 1.0)
    share = np.clip(share, 0.0, 1.0)[:, None]

    def place(values: Floats) -> Floats:
        between: Floats = values[before] + share * (values[after] - values[before])
        return between

    def turn(values: Floats) -> Floats:
        return _slerp(values[before], values[after], share)

    return Motion(times, place(motion.start_m), turn(motion.start_q), place(motion.end_m), turn(motion.end_q))


def _slerp(first: Floats, second: Floats, share: Floats) -> Floats:
    """Shoemake's slerp of unit quaternions (N, 4) at shares (N, 1) in [0, 1], without flipping a sign."""
    angle = np.arccos(np.clip(np.sum(first * second, axis=-1, keepdims=True), -1.0, 1.0))
    sine = np.sin(angle)
    small = sine < OPPOSITE
    safe = np.where(small, 1.0, sine)
    left = np.where(small, 1.0 - share, np.sin((1.0 - share) * angle) / safe)
    right = np.where(small, share, np.sin(share * angle) / safe)
    mixed = left * first + right * second
    turned: Floats = mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)
    return turned


def _end(table: Table, end: str) -> tuple[Floats, Floats]:
    """Positions (T, 3) and unit quaternions (T, 4) of one end, all NaN where it is free."""
    names = [*position_columns(end), *quaternion_columns(end)]
    values = table.stack(names)
    empty = np.isnan(values)
    if empty.all():
        return values[:, :3], values[:, 3:]
    if empty.any():
        row, column = (int(index) for index in np.argwhere(empty)[0])
        raise table.refusal(
            row, names[column], "empty cell", "give the pose in every row, or in none (free end)"
        )
    far = np.argwhere(np.abs(values[:, :3]) > LARGEST_M)
    if far.size:
        row, column = (int(index) for index in far[0])
        raise table.refusal(row, names[column], f"{values[row, column]:g} m", MILLIMETRES)
    quaternions = values[:, 3:]
    norms = np.linalg.norm(quaternions, axis=1, keepdims=True)
    _check_unit(table, norms[:, 0], names[3])
    quaternions = quaternions / norms
    opposite = np.flatnonzero(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < -1 + OPPOSITE)
    if opposite.size:
        problem = "the quaternion changes its sign and nothing else: a whole turn about an unknown axis"
        raise table.refusal(
            int(opposite[0]) + 1, names[3], problem, "give both rows one sign, or rows between them"
        )
    return values[:, :3], quaternions


def _check_unit(table: Table, norms: Floats, column: str) -> None:
    bad = np.flatnonzero(np.abs(norms - 1) > UNIT_TOLERANCE)
    if not bad.size:
        return
    row = int(bad[0])
    problem = "zero quaternion" if norms[row] == 0 else f"the quaternion's length is {norms[row]:.4g}, not 1"
    raise table.refusal(row, column, problem, "give (w, x, y, z) of length 1")
