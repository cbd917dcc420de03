"""The book of the proof: a row for every shard that was started, written before its diagnosis begins."""

from __future__ import annotations

import hashlib
import json
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from dlolib.errors import ParameterError
from dlolib.files import write_csv

RUNS, SAME = "runs.csv", "same.json"
# What `dlo diagnose` is made of: all that `dlolib.diagnose` imports, the command, and its figures.
PARTS = (
    "dlolib/cli",
    "dlolib/diagnose",
    "dlolib/errors.py",
    "dlolib/files.py",
    "dlolib/formats",
    "dlolib/identify",
    "dlolib/obstacles.py",
    "dlolib/progress.py",
    "dlolib/report/diagnosis.py",
    "dlolib/sim",
    "dlolib/types.py",
)
COLUMNS = ("shard", "started", "commit", "version", "answers_sha256", "size", "state", "seed")


def runs(book: Path) -> list[dict[str, Any]]:
    """The rows of the book in this folder."""
    if not (book / RUNS).exists():
        return []
    table = pd.read_csv(book / RUNS, dtype=str, keep_default_na=False)
    return [{str(key): value for key, value in row.items()} for row in table.to_dict("records")]


def note(book: Path, shard: str, answers: Path, size: int) -> None:
    """Append a shard's row before its diagnosis begins."""
    row = {
        "shard": shard,
        "started": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}",
        "commit": commit(),
        "version": version(),
        "answers_sha256": seal(answers),
        "size": str(size),
        "state": "diagnosing",
        "seed": "",
    }
    write_csv(book / RUNS, pd.DataFrame([*runs(book), row], columns=list(COLUMNS)))


def settle(book: Path, shard: str, answers: Path, seed: int, state: str = "scored") -> None:
    """Reveal a shard's seed and call it scored, or aborted; its answers must be what they were."""
    rows = runs(book)
    for row in rows:
        if row["shard"] == shard:
            if row["answers_sha256"] != seal(answers):
                raise ParameterError("the answers are not those that were sealed", file=answers)
            row |= {"state": state, "seed": str(seed)}
    write_csv(book / RUNS, pd.DataFrame(rows, columns=list(COLUMNS)))


def seal(answers: Path) -> str:
    """SHA-256 over the names and contents of a shard's answers, its seed among them."""
    digest = hashlib.sha256()
    for path in sorted(answers.glob("*.json")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def alike(book: Path, version: str, but_intervals: bool = False) -> set[str]:
    """This version and all whose verdicts were found to be judged the same (`stages.proof_same`) in every
    shard that was compared; or to be so with their intervals left out."""
    rows = compared(book)
    apart = [{row["version"], row["as"]} for row in rows if _otherwise(row, but_intervals)]
    pairs = [pair for row in rows if (pair := {row["version"], row["as"]}) not in apart]
    found = {version}
    while more := {one for pair in pairs if pair & found for one in pair} - found:
        found |= more
    return found


def _otherwise(row: dict[str, Any], but_intervals: bool) -> list[str]:
    """The recordings that two versions judge otherwise. Once it was not asked which intervals differ: each
    verdict that was not the same byte for byte counts as one of these."""
    if but_intervals:
        return list(row["judged_otherwise"])
    return list(row.get("otherwise", row["differ"]))


def compared(book: Path) -> list[dict[str, Any]]:
    """What was found about versions that may be the same, in the order in which it was found."""
    path = book / SAME
    return list(json.loads(path.read_text())["compared"]) if path.exists() else []


def committed() -> None:
    """Go on only where the code is that of the commit which a row or a result is about to name.

    Raises:
        ParameterError: it has changes that are in no commit.
    """
    if _git("status", "--porcelain", "--", "dlolib", "stages", "params.yaml"):
        problem = "dlolib, stages or params.yaml has changes that are in no commit"
        raise ParameterError(problem, mend="commit them first: what is found names the commit that made it")


def commit() -> str:
    """The commit that is checked out."""
    return _git("rev-parse", "HEAD")


def version(*more: str) -> str:
    """What diagnoses, and more: a hash over git's hashes of `PARTS` and of these, with `+changes` where the
    working tree differs.

    Commits that change nothing of it leave it alone, so that shards before and after them count together.
    """
    parts = _git("ls-tree", "-r", "HEAD", "--", *PARTS, *more)
    changed = "+changes" if _git("status", "--porcelain", "--", *PARTS, *more) else ""
    return hashlib.sha1(parts.encode(), usedforsecurity=False).hexdigest() + changed


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], capture_output=True, text=True, check=True)
    return done.stdout.strip()
