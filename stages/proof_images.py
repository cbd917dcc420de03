"""The blind proof from depth images: `make proof-images COUNT=40`.

Recordings drawn from a secret seed as those of `make proof`, but photographed by the laboratory's depth
camera: the chain makes the points and says how sure they are, and the diagnosis takes its word. Goal: at most
one alarm in 40 with nothing missing; right or tied within 5 points of the proof's own figure.
"""

from __future__ import annotations

import argparse
import json
import secrets
import shutil
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

from dlolib.captures import open_capture
from dlolib.chain import ChainSettings, extract_chain
from dlolib.errors import ChainError
from dlolib.files import write_json
from dlolib.formats import write_recording
from dlolib.lab.camera import Sensor
from dlolib.proof import book
from dlolib.proof.answer import make_recording
from dlolib.proof.draw import draw_case, draw_names
from dlolib.proof.pictures import write_pictures
from dlolib.proof.score import score, summarise
from stages import run
from stages.proof import BOOK, COMMAND, WORK, WORKERS, diagnose, together

FOLDER = WORK / "images"
CHAIN = replace(ChainSettings(), covariance=True)


def main(*arguments: str) -> None:
    options = argparse.ArgumentParser(prog="python -m stages.proof_images", description=__doc__)
    options.add_argument(
        "--count", type=int, default=40, help="recordings, half of them with nothing missing"
    )
    options.add_argument("--command", default=COMMAND, help="what diagnoses, as in stages.proof")
    asked = options.parse_args(arguments)
    seed = _seed()
    drawn = list(enumerate(draw_names(seed, asked.count)))
    together(ProcessPoolExecutor(WORKERS), seen, [(seed, *one) for one in drawn], "laboratory and chain")
    names = [f"{index:03d}" for index, _ in drawn]
    tasks = [((FOLDER / "chains" / name,), FOLDER / "verdicts" / name, asked.command) for name in names]
    tasks = [task for task in tasks if task[0][0].exists()]
    together(ThreadPoolExecutor(WORKERS), diagnose, tasks, "diagnosing")
    rows = {name: score(_json(FOLDER / "verdicts" / name / "verdict.json"), _answer(name)) for name in names}
    made = {"command": "make proof-images", "commit": book.commit(), "version": book.version(), "seed": seed}
    write_json(BOOK / "images.json", {**made, "summary": summarise(list(rows.values())), "recordings": rows})


def _seed() -> int:
    """Of this run; an interrupted one is taken up again."""
    kept = FOLDER / "seed.json"
    if not kept.exists():
        write_json(kept, {"seed": secrets.randbits(63)})
    return int(json.loads(kept.read_text())["seed"])


def seen(seed: int, index: int, names: tuple[str, ...]) -> None:
    """Draw a case, photograph it, and leave what the chain makes of the pictures."""
    name = f"{index:03d}"
    chain = FOLDER / "chains" / name
    if chain.exists():
        return
    make_recording(seed, index, names, name, FOLDER / "points", FOLDER / "answers")
    case = draw_case(seed, index, names, attempt=_answer(name)["attempt"])
    capture = FOLDER / "captures" / name
    shutil.rmtree(capture, ignore_errors=True)
    write_pictures(case, name, capture, Sensor(seed=index))
    try:
        write_recording(extract_chain(open_capture(capture), CHAIN).recording, chain)
    except ChainError as error:
        # no chain, no verdict: counted as failed
        print(error, file=sys.stderr)
    shutil.rmtree(capture)


def _answer(name: str) -> dict[str, Any]:
    return dict(json.loads((FOLDER / "answers" / f"{name}.json").read_text()))


def _json(path: Path) -> dict[str, Any] | None:
    return json.loads(path.read_text()) if path.exists() else None


if __name__ == "__main__":
    run(main, *sys.argv[1:])
