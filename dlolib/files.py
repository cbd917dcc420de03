"""Outputs appear whole or not at all: written under a temporary name, then renamed."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pandas as pd

CLOCK = "t_s"


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path`; on a clean exit it becomes `path`, on an error it goes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.partial")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Give a temporary folder; on a clean exit it replaces `path` whole, on an error nothing changes."""
    made = [parent for parent in path.parents if not parent.exists()]
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    temporary.chmod(0o755)
    aside = temporary.with_name(f"{temporary.name}.old")
    try:
        yield temporary
        # what cannot be moved, as a mount or the working folder, is not lost either
        if path.exists():
            os.replace(path, aside)
        os.replace(temporary, path)
    finally:
        if aside.exists() and not path.exists():
            os.replace(aside, path)
        for folder in (temporary, aside):
            shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):  # those that hold something stay
            for parent in made:
                parent.rmdir()


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON with two-space indentation; NaN is refused, since JSON has none."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def write_csv(path: Path, table: pd.DataFrame, digits: int = 9) -> None:
    """Write a table with a header, `.` decimal, no index column, `digits` significant digits.

    Times `t_s` are written in full where so many digits would not tell microseconds apart: a camera's clock
    may count from 1970.
    """
    if CLOCK in table and table[CLOCK].abs().max() >= 10.0 ** (digits - 6):
        table = table.assign(**{CLOCK: [repr(float(time)) for time in table[CLOCK]]})
    # opened here: pandas takes a ~ in a path for somebody's home
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        table.to_csv(file, index=False, float_format=f"%.{digits}g", lineterminator="\n")
