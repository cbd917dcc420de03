"""The blind proof (`make proof SHARDS=k SIZE=50`): recordings whose effects a secret seed drew, diagnosed.

A shard is made, its row with the hash of its answers goes into reports/proof/runs.csv, then the diagnosis
runs, then its seed is revealed and its verdicts are scored. An interrupted shard is taken up again by the
next call, and its row stays whatever becomes of it. `--calibration` makes recordings with their answers
beside them, under a seed of its own; they never count.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import secrets
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from dlolib.errors import ParameterError
from dlolib.files import write_json
from dlolib.progress import track
from dlolib.proof import book
from dlolib.proof.answer import make_recording
from dlolib.proof.draw import draw_names
from dlolib.proof.score import INTERVALS, owns_up, score, share, summarise
from dlolib.proof.sizes import NAMES
from stages import DATA, REPORTS, known, run

WORK = DATA / "proof"
RECORDINGS, SEALED, VERDICTS = WORK / "recordings", WORK / "sealed", WORK / "verdicts"
CALIBRATION = WORK / "calibration"
BOOK = REPORTS / "proof"
COMMAND = "dlo diagnose {recording} --out {out} --workers 1"
FILES = ("recording.json", "motion.csv", "points.csv")
KEPT = ("verdict.json", "next_motion.csv")
WORKERS, LIMIT_S = os.cpu_count() or 1, 1800
CALIBRATION_NULLS, CALIBRATION_SIZE = 12, 3.0
# By no more than this does the laboratory's χ² of a recording differ between processors: 2e-8 was seen.
ROUNDED = 1e-6
# What is told of every version.
TOLD = (
    "detectable", "right_or_tied", "tied", "confidently_wrong", "wrong_of_too_small", "false_alarms",
    "pairs_both_named", "heldout_better", "heldout_better_than_black_box", "place", "stiffness_bias",
)  # fmt: skip


def main(*arguments: str) -> None:
    asked = _options().parse_args(arguments)
    if asked.calibration:
        calibrate(asked.seed)
        return
    if asked.without is not None:
        found = without(asked.command, asked.without)
        write_json(BOOK / "without.json", made_by("make proof-without") | found)
        return
    book.committed()
    for _ in range(asked.shards):
        shard = unfinished() or begin(asked.size)
        finish(shard, asked.command)
    write_json(BOOK / "summary.json", totals())


def _options() -> argparse.ArgumentParser:
    options = argparse.ArgumentParser(prog="python -m stages.proof", description=__doc__)
    options.add_argument("--shards", type=int, default=1, help="how many to finish")
    options.add_argument("--size", type=int, default=50, help="recordings in a new shard, at most 50")
    options.add_argument(
        "--command", default=COMMAND, help="what diagnoses; {recording} and {out} are filled in"
    )
    options.add_argument(
        "--without",
        nargs="*",
        metavar="SHARD",
        help="scored singles of these shards, of all where none is named, their effect taken out",
    )
    options.add_argument("--calibration", action="store_true", help="make recordings to set thresholds by")
    options.add_argument("--seed", type=int, default=1, help="of the calibration")
    return options


def begin(size: int) -> str:
    """Make a new shard's recordings and answers from a secret seed; its name."""
    if not 1 <= size <= 50:
        raise ParameterError(f"a shard of {size} recordings", mend="give 1 to 50")
    shard = f"shard_{datetime.now(UTC):%Y%m%dT%H%M%S}"
    seed = secrets.randbits(63)
    write_json(SEALED / shard / "shard.json", {"seed": seed, "size": size})
    return shard


def unfinished() -> str | None:
    """A shard that was begun here and not scored; what another version began to diagnose is aborted."""
    rows = {row["shard"]: row for row in book.runs(BOOK)}
    for shard in sorted(path.parent.name for path in SEALED.glob("shard_*/shard.json")):
        row = rows.get(shard)
        if row is None or (row["state"] == "diagnosing" and row["version"] == book.version()):
            return shard
        if row["state"] == "diagnosing":
            seed = json.loads((SEALED / shard / "shard.json").read_text())["seed"]
            book.settle(BOOK, shard, SEALED / shard, seed, "aborted")
    return None


def finish(shard: str, command: str) -> None:
    """Take a shard from wherever it stands to its score."""
    sealed = json.loads((SEALED / shard / "shard.json").read_text())
    make(sealed["seed"], draw_names(sealed["seed"], sealed["size"]), RECORDINGS / shard, SEALED / shard)
    if shard not in {row["shard"] for row in book.runs(BOOK)}:
        book.note(BOOK, shard, SEALED / shard, sealed["size"])
    names = [called(index) for index in range(sealed["size"])]
    tasks = [((RECORDINGS / shard / name,), VERDICTS / shard / name, command) for name in names]
    together(ThreadPoolExecutor(WORKERS), diagnose, tasks, f"diagnosing {shard}")
    rows = {
        name: score(verdict_in(VERDICTS / shard / name), answer_in(shard, name))
        | {"verdict_sha256": verdict_sha256(VERDICTS / shard / name)}
        for name in names
    }
    figures = summarise(list(rows.values()))
    # before the row says that there are scores: an interruption between the two leaves the shard unfinished
    write_json(BOOK / f"{shard}.json", {"shard": shard, "summary": figures, "recordings": rows})
    book.settle(BOOK, shard, SEALED / shard, sealed["seed"])


def called(index: int) -> str:
    """What the recording of this number is called. What else lies beside it an interrupted call left."""
    return f"{index:03d}"


def make(
    seed: int,
    names: Sequence[tuple[str, ...]],
    recordings: Path,
    answers: Path,
    multiples: Sequence[float | None] | None = None,
) -> None:
    """Make what is not made yet."""
    sizes = multiples or [None] * len(names)
    tasks = [
        (seed, index, which, called(index), recordings, answers, multiple)
        for index, (which, multiple) in enumerate(zip(names, sizes, strict=True))
    ]
    together(ProcessPoolExecutor(WORKERS), make_recording, tasks, "laboratory")


def together(pool: Executor, work: Callable[..., None], tasks: Sequence[tuple[Any, ...]], what: str) -> None:
    """Do all tasks, a few at a time."""
    with pool:
        waiting = [pool.submit(work, *task) for task in tasks]
        for one in track(waiting, what):
            one.result()


def diagnose(recordings: Sequence[Path], verdict: Path, command: str) -> None:
    """Run the diagnosis on copies of the recordings in a folder of its own, far from any answer."""
    if (verdict / "done.json").exists():
        return
    with tempfile.TemporaryDirectory() as folder:
        copies, out = [Path(folder) / one.name for one in recordings], Path(folder) / "out"
        for one, copy in zip(recordings, copies, strict=True):
            copy.mkdir()
            for name in FILES:
                shutil.copy(one / name, copy)
        words = [
            filled
            for word in shlex.split(command)
            for filled in (map(str, copies) if word == "{recording}" else [word.format(out=out)])
        ]
        begun = time.monotonic()
        try:
            done = subprocess.run(
                words, cwd=folder, capture_output=True, text=True, timeout=LIMIT_S, check=False
            )
            status, said = done.returncode, done.stderr[-2000:]
        except subprocess.TimeoutExpired:
            status, said = -1, f"stopped after {LIMIT_S} s"
        verdict.mkdir(parents=True, exist_ok=True)
        for name in KEPT:
            if (out / name).exists():
                shutil.copy(out / name, verdict / name)
        seconds = round(time.monotonic() - begun, 1)
        write_json(verdict / "done.json", {"exit_status": status, "seconds": seconds, "stderr": said})


def totals() -> dict[str, Any]:
    """All scored shards of the last version of what diagnoses, and of those that give the same verdicts,
    together; every started one is counted. Intervals are those of versions whose own are the same."""
    started = book.runs(BOOK)
    scored = [row for row in started if row["state"] == "scored"]
    last = scored[-1]["version"] if scored else None
    same = book.alike(BOOK, last, but_intervals=True) if last else set()
    whole = book.alike(BOOK, last) if last else set()
    shards = {row["shard"]: row["version"] in whole for row in scored if row["version"] in same}
    rows = []
    for shard, intervals in shards.items():
        for row in json.loads((BOOK / f"{shard}.json").read_text())["recordings"].values():
            rows.append({key: value for key, value in row.items() if intervals or key not in INTERVALS})
    counts = {"started": len(started), "scored": len(scored), "version": last, "shards": list(shards)}
    counts |= {"shards_of_intervals": [shard for shard, intervals in shards.items() if intervals]}
    return counts | summarise(rows) | {"versions": versions(scored)}


def versions(scored: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """What came of every version of what diagnoses, those judged alike as one, in the order of their last
    shards: how they went on from each other, whichever counts."""
    groups: dict[frozenset[str], list[str]] = {}
    for row in scored:
        same = frozenset(book.alike(BOOK, row["version"], but_intervals=True))
        groups[same] = [*groups.pop(same, []), row["shard"]]
    found = []
    for shards in groups.values():
        read = [json.loads((BOOK / f"{shard}.json").read_text())["recordings"] for shard in shards]
        told = summarise([row for one in read for row in one.values()])
        found.append({"shards": shards, "recordings": told["recordings"]} | {key: told[key] for key in TOLD})
        found[-1]["coverage"] = {"all": told["coverage"]["all"]}
    return found


def made_by(command: str) -> dict[str, str]:
    """What made a result."""
    return {"command": command, "commit": book.commit(), "version": book.version()}


def own_folder(name: str, *more: str) -> Path:
    """Where verdicts of this version, and of what else makes them, lie: none of another is taken for them."""
    return WORK / name / book.version(*more)


def seed_of(folder: Path) -> int:
    """A secret seed of this folder's own; an interrupted run is taken up again."""
    kept = folder / "seed.json"
    if not kept.exists():
        write_json(kept, {"seed": secrets.randbits(63)})
    return int(json.loads(kept.read_text())["seed"])


def last_shards(only: Sequence[str] = ()) -> dict[str, tuple[int, dict[str, Any]]]:
    """The scored shards of the last version (of them these, where any is named) with their revealed seeds and
    rows; recordings and answers that are not here are made again from the seed.

    Another processor rounds another way, and then the hash that was sealed is not met; what the laboratory
    says of each recording, as its row has it, must be.

    Raises:
        ParameterError: the laboratory has changed since, and makes others; or there is no such shard.
    """
    rows = {row["shard"]: row for row in book.runs(BOOK)}
    found = {}
    known(only, totals()["shards"], "shard")
    for shard in only or totals()["shards"]:
        seed, size = int(rows[shard]["seed"]), int(rows[shard]["size"])
        write_json(SEALED / shard / "shard.json", {"seed": seed, "size": size})
        make(seed, draw_names(seed, size), RECORDINGS / shard, SEALED / shard)
        scored = json.loads((BOOK / f"{shard}.json").read_text())["recordings"]
        met = book.seal(SEALED / shard) == rows[shard]["answers_sha256"]
        if not met and not all(_as_told(answer_in(shard, name), row) for name, row in scored.items()):
            mend = f"check out {rows[shard]['commit']}, or remove {SEALED / shard} and {RECORDINGS / shard}"
            raise ParameterError("the answers are not those that were sealed", file=SEALED / shard, mend=mend)
        found[shard] = seed, scored
    return found


def _as_told(answer: dict[str, Any], row: dict[str, Any]) -> bool:
    """Whether an answer that was made again is the one that a scored row tells of, but for rounding."""
    again = score(None, answer)
    same = all(again[key] == row[key] for key in ("true", "detectable"))
    return same and math.isclose(again["elastic_gain"], row["elastic_gain"], rel_tol=ROUNDED)


def without(command: str, only: Sequence[str] = ()) -> dict[str, Any]:
    """Diagnose what was found alone once more with that effect taken out of the library.

    What was counted of other shards of this version before stays.
    """
    again = last_shards(only)
    rows = of_others("without.json", again)
    for shard, (_, scored) in again.items():
        found = {name: row for name, row in scored.items() if row["outcome"] in ("right", "tied")}
        alone = {name: row["true"][0] for name, row in found.items() if len(row["detectable"]) == 1}
        alone = {name: effect for name, effect in alone.items() if scored[name]["true"] == [effect]}
        apart = own_folder("without") / shard
        tasks = [
            ((RECORDINGS / shard / name,), apart / name, f"{command} --without {effect}")
            for name, effect in alone.items()
        ]
        together(ThreadPoolExecutor(WORKERS), diagnose, tasks, f"diagnosing {shard} without")
        for name, effect in alone.items():
            row = {"shard": shard, "name": name, "effect": effect}
            rows.append(row | {"owned_up": owns_up(verdict_in(apart / name), effect)})
    return {"owned_up": share(sum(row["owned_up"] for row in rows), len(rows)), "recordings": rows}


def of_others(result: str, again: Collection[str], judged: bool = True) -> list[dict[str, Any]]:
    """The rows that a result of this version has of shards that are not looked at again; not of versions that
    only are judged alike where it counts what is not judged."""
    before = _read(BOOK / result) or {"version": None, "recordings": []}
    own = book.alike(BOOK, book.version()) if judged else {book.version()}
    kept = before["recordings"] if before["version"] in own else []
    return [row for row in kept if row["shard"] not in again]


def calibrate(seed: int) -> None:
    """Nulls and every effect alone at three times the size that is found; answers beside the recordings."""
    names: list[tuple[str, ...]] = [() for _ in range(CALIBRATION_NULLS)] + [(name,) for name in NAMES]
    sizes = [CALIBRATION_SIZE if which else None for which in names]
    folder = CALIBRATION / f"seed_{seed}"
    make(seed, names, folder / "recordings", folder / "answers", sizes)


def verdict_in(folder: Path) -> dict[str, Any] | None:
    """What a diagnosis left; None where it failed."""
    return _read(folder / "verdict.json")


def verdict_sha256(folder: Path) -> str | None:
    """Of a verdict's bytes; None where the diagnosis failed."""
    path = folder / "verdict.json"
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else None


def _read(path: Path) -> dict[str, Any] | None:
    return json.loads(path.read_text()) if path.exists() else None


def answer_in(shard: str, name: str) -> dict[str, Any]:
    """What is true of a recording."""
    return dict(json.loads((SEALED / shard / f"{name}.json").read_text()))


if __name__ == "__main__":
    run(main, *sys.argv[1:])
