"""CSV at the border: every cell checked, a bad one named by line and column."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from dlolib.errors import FormatError
from dlolib.formats._json import existing
from dlolib.types import Floats, Ints

# Numbers are read as floats, which tell whole ones apart up to this.
LARGEST_WHOLE = 2.0**53 - 1


@dataclass(frozen=True)
class Table:
    """The rows of a CSV: numbers by column (R,), texts by column, and each row's line in the file."""

    path: Path
    numbers: dict[str, Floats]
    texts: dict[str, tuple[str, ...]]
    lines: Ints

    def stack(self, names: Sequence[str]) -> Floats:
        """The named columns side by side, shape (R, len(names))."""
        return np.stack([self.numbers[name] for name in names], axis=-1)

    def refusal(self, row: int, column: str, problem: str, mend: str) -> FormatError:
        """The error that names line and column of `row`."""
        place = f"line {self.lines[row]}, column {column}"
        return FormatError(problem, file=self.path, place=place, mend=mend)


def read_table(
    path: Path,
    numbers: Sequence[str],
    *,
    texts: Sequence[str] = (),
    optional: Collection[str] = (),
    empties: Collection[str] = (),
) -> Table:
    """Read the named columns; other columns are ignored.

    Args:
        numbers: columns of finite numbers.
        texts: columns of text.
        optional: columns that the file may lack (they are then absent from the result).
        empties: number columns whose cells may be empty (they are then NaN).
    """
    raw = _raw(existing(path, "a CSV table"))
    wanted = [name for name in (*numbers, *texts) if name not in optional]
    lacking = [name for name in wanted if name not in raw.columns]
    if lacking:
        problem = f"no column {lacking[0]}, found {', '.join(map(str, raw.columns))[:120]}"
        raise FormatError(problem, file=path, place="line 1", mend="name it in a comma-separated header")
    twice = [name for name in (*numbers, *texts) if f"{name}.1" in raw.columns]
    if twice:
        raise FormatError(f"two columns {twice[0]}", file=path, place="line 1", mend="remove one of them")
    rows = raw[(raw != "").any(axis=1)]
    if rows.empty:
        raise FormatError("has no rows", file=path, mend="give at least one")
    lines = rows.index.to_numpy(dtype=np.int64) + 2
    text = {name: tuple(cell.strip() for cell in rows[name]) for name in texts if name in rows}
    cells = {name: [cell.strip() for cell in rows[name]] for name in numbers if name in rows}
    table = Table(path, {name: _numbers(column) for name, column in cells.items()}, text, lines)
    _check_finite(table, cells, empties)
    return table


def check_whole(table: Table, column: str) -> Ints:
    """The column as whole numbers >= 0, shape (R,)."""
    values = table.numbers[column]
    bad = np.flatnonzero((values != np.round(values)) | (values < 0) | (values > LARGEST_WHOLE))
    if bad.size:
        row = int(bad[0])
        raise table.refusal(
            row, column, f"{values[row]:g} is no frame number", "count from 0 in whole numbers below 2^53"
        )
    return values.astype(np.int64)


def check_rising(table: Table, column: str) -> Floats:
    """The column where each row's value is larger than the one before, shape (R,)."""
    values = table.numbers[column]
    bad = np.flatnonzero(np.diff(values) <= 0)
    if bad.size:
        row = int(bad[0]) + 1
        if values[row] == values[row - 1]:
            problem = f"the same {column} = {values[row]:.12g} as in line {table.lines[row - 1]}"
            raise table.refusal(row, column, f"two rows with {problem}", "remove one of them")
        problem = f"{column} falls from {values[row - 1]:.12g} to {values[row]:.12g}"
        raise table.refusal(row, column, problem, f"sort the rows by {column}")
    return values


def _raw(path: Path) -> pd.DataFrame:
    """All cells as text, row i from line i + 2."""
    try:
        raw = pd.read_csv(
            path,
            dtype=str,
            na_filter=False,
            skip_blank_lines=False,
            encoding="utf-8-sig",
            skipinitialspace=True,
        )
    except UnicodeDecodeError as error:
        raise FormatError("is not text in UTF-8", file=path, mend="save it as a CSV in UTF-8") from error
    except pd.errors.EmptyDataError as error:
        raise FormatError("is empty", file=path, mend="write a header line and rows") from error
    except pd.errors.ParserError as error:
        problem = f"is no table: {str(error).split('error: ')[-1]}"
        raise FormatError(problem, file=path, mend="give every row as many cells as the header") from error
    if not isinstance(raw.index, pd.RangeIndex):
        raise FormatError(
            "has more cells than the header", file=path, place="line 2", mend="remove the index column"
        )
    raw.columns = pd.Index([str(name).strip() for name in raw.columns])
    return raw.fillna("")


def _numbers(cells: Sequence[str]) -> Floats:
    return np.array([_number(cell) for cell in cells], dtype=np.float64)


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def _check_finite(table: Table, cells: dict[str, list[str]], empties: Collection[str]) -> None:
    """Refuse the first cell, by row, that is no finite number and may not be empty."""
    first: tuple[int, str] | None = None
    for name, values in table.numbers.items():
        for row in np.flatnonzero(~np.isfinite(values)).tolist():
            if not (name in empties and cells[name][row] == ""):
                first = min(first, (row, name)) if first else (row, name)
                break
    if first is None:
        return
    row, name = first
    cell = cells[name][row]
    if cell == "":
        raise table.refusal(row, name, "empty cell", "give the number or remove the row")
    if cell.lstrip("+-").lower() in ("nan", "inf", "infinity"):
        raise table.refusal(
            row, name, f"{cell} is not a finite number", "remove the row; what was not seen has none"
        )
    raise table.refusal(row, name, f"{cell[:40]!r} in a number's place", "give a number with a decimal point")
