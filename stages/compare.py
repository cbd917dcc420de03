"""`make compare`: this tree's metrics against the committed ones, each within its stated tolerance.

Another CPU may differ in the last bits of LLVM, Embree or MuJoCo, and so in every hash; the figures may
differ by no more than reports/tolerances.yaml says.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console
from rich.table import Table

from dlolib.errors import DloError
from stages import REPORTS, run

METRICS = REPORTS / "metrics"
TOLERANCES = REPORTS / "tolerances.yaml"
REPORT = REPORTS / "report.json"
LOCK = Path("dvc.lock")


@dataclass(frozen=True)
class Row:
    """One figure: here, committed, and how far apart they may be (absolute, relative)."""

    name: str
    here: float | None
    committed: float | None
    absolute: float
    relative: float

    @property
    def within(self) -> bool:
        if self.here is None or self.committed is None:
            return self.here is self.committed
        return abs(self.here - self.committed) <= max(self.absolute, self.relative * abs(self.committed))


def main() -> None:
    check_ran(REPORT, LOCK)
    here, there = _here(), committed()
    tolerances = yaml.safe_load(TOLERANCES.read_text(encoding="utf-8"))
    rows = compare(here, there, tolerances)
    _show(rows)
    outside = [row.name for row in rows if not row.within]
    if outside:
        raise DloError(
            f"{len(outside)} of {len(rows)} figures are outside: {', '.join(outside)}",
            file=METRICS,
            mend="find the cause, or commit the new figures",
        )
    print(f"all {len(rows)} figures agree within their tolerances")


def check_ran(report: Path, lock: Path) -> None:
    """Refuse a tree in which the pipeline did not run: git keeps the metrics, and they agree with themselves.

    Args:
        report: report.json, which git does not keep.
        lock: dvc.lock, in which DVC notes the sum of every output of the pipeline.

    Raises:
        DloError: the report is not there, or not the one that the lock file speaks of.
    """
    if not report.is_file():
        raise DloError(
            "no such file: the pipeline has not run here", file=report, mend="run make repro first"
        )
    content = yaml.safe_load(lock.read_text(encoding="utf-8")) if lock.is_file() else {}
    outputs = content.get("stages", {}).get("report", {}).get("outs", [])
    sums = {output["path"]: output["md5"] for output in outputs}
    if sums.get(report.as_posix()) != hashlib.md5(report.read_bytes()).hexdigest():
        raise DloError(f"is of another run than {lock}", file=report, mend="run make repro first")


def compare(
    here: Mapping[str, float | None],
    committed: Mapping[str, float | None],
    tolerances: Mapping[str, Mapping[str, float]],
) -> list[Row]:
    """Pair the figures of two trees; the first pattern of `tolerances` that a name matches holds for it.

    Raises:
        DloError: a figure is in one tree only, or no tolerance is stated for it.
    """
    rows = []
    for name in sorted({*here, *committed}):
        if name not in here or name not in committed:
            where = "the committed metrics" if name not in committed else "this tree"
            raise DloError(f"{name} is missing in {where}", file=METRICS, mend="run make repro, or commit it")
        stated = next((value for pattern, value in tolerances.items() if fnmatchcase(name, pattern)), None)
        if stated is None:
            raise DloError(f"no tolerance for {name}", file=TOLERANCES, mend="add a line for it")
        absolute, relative = stated.get("absolute", 0.0), stated.get("relative", 0.0)
        rows.append(Row(name, here[name], committed[name], absolute, relative))
    return rows


def flattened(content: Any, name: str) -> Iterator[tuple[str, float | None]]:
    """`{"a": {"b": 1}}` of chain.json as ("chain.a.b", 1.0); true is 1, and texts are no figures."""
    if isinstance(content, Mapping):
        for key, value in content.items():
            yield from flattened(value, f"{name}.{key}")
    elif content is None or isinstance(content, int | float):
        yield name, None if content is None else float(content)


def _here() -> dict[str, float | None]:
    paths = sorted(METRICS.glob("*.json"))
    return dict(pair for path in paths for pair in flattened(json.loads(path.read_text("utf-8")), path.stem))


def committed() -> dict[str, float | None]:
    """The figures of the last commit, by name."""
    listed = _git("ls-tree", "--name-only", "HEAD", f"{METRICS}/").split()
    files = {Path(path).stem: json.loads(_git("show", f"HEAD:{path}")) for path in listed}
    if not files:
        raise DloError("no metrics are committed", file=METRICS, mend="run make repro and commit them")
    return dict(pair for stem, content in files.items() for pair in flattened(content, stem))


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise DloError(f"git says: {done.stderr.strip()}", mend="run this in a git checkout with a commit")
    return done.stdout


def _show(rows: list[Row]) -> None:
    table = Table("figure", "here", "committed", "may differ by", "")
    for row in rows:
        allowed = f"{row.absolute:g} or {row.relative:.2%}"
        table.add_row(
            row.name, _text(row.here), _text(row.committed), allowed, "" if row.within else "outside"
        )
    Console(width=140).print(table)


def _text(value: float | None) -> str:
    return "–" if value is None else f"{value:.6g}"


if __name__ == "__main__":
    run(main)
