"""The blind proof from depth images: `make proof-images COUNT=40`.

Recordings drawn from a secret seed as those of `make proof`, but photographed by the laboratory's depth
camera: the chain makes the points and says how sure they are, and the diagnosis takes its word. Goal: at most
one alarm in 40 with nothing missing; right or tied within 5 points of the proof's own figure.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from dlolib.captures import open_capture
from dlolib.chain import extract_chain
from dlolib.errors import ChainError
from dlolib.files import write_json
from dlolib.formats import write_recording
from dlolib.lab.camera import Sensor
from dlolib.proof.answer import answered
from dlolib.proof.draw import draw_names
from dlolib.proof.pictures import write_pictures
from dlolib.proof.score import score, summarise
from dlolib.proof.write import write_case
from stages import number, run
from stages.proof import (
    BOOK,
    COMMAND,
    WORKERS,
    called,
    diagnose,
    made_by,
    own_folder,
    seed_of,
    together,
    verdict_in,
)

# What a chain from these pictures is off [m]: its own recording.json says 0.12 mm and more.
NOISE_M = 1e-4
# What a verdict from pictures depends on beside what diagnoses.
EYES = ("dlolib/captures", "dlolib/chain", "dlolib/lab", "dlolib/o3d.py")


def main(*arguments: str) -> None:
    options = argparse.ArgumentParser(prog="python -m stages.proof_images", description=__doc__)
    options.add_argument(
        "--count", type=int, default=40, help="recordings, half of them with nothing missing"
    )
    options.add_argument("--command", default=COMMAND, help="what diagnoses, as in stages.proof")
    asked = options.parse_args(arguments)
    number(str(asked.count), "COUNT", 1)
    # what is drawn depends on the count
    folder = own_folder("images", *EYES) / str(asked.count)
    seed = seed_of(folder)
    drawn = list(enumerate(draw_names(seed, asked.count)))
    together(
        ProcessPoolExecutor(WORKERS), seen, [(folder, seed, *one) for one in drawn], "laboratory and chain"
    )
    names = [called(index) for index, _ in drawn]
    tasks = [((folder / "chains" / name,), folder / "verdicts" / name, asked.command) for name in names]
    tasks = [task for task in tasks if task[0][0].exists()]
    together(ThreadPoolExecutor(WORKERS), diagnose, tasks, "diagnosing")
    rows = {name: score(verdict_in(folder / "verdicts" / name), _answer(folder, name)) for name in names}
    made = made_by("make proof-images") | {"seed": seed, "summary": summarise(list(rows.values()))}
    write_json(BOOK / "images.json", made | {"recordings": rows})


def seen(folder: Path, seed: int, index: int, names: tuple[str, ...]) -> None:
    """Draw a case, photograph it, and leave what the chain makes of the pictures."""
    name = called(index)
    chain = folder / "chains" / name
    if chain.exists():
        return
    case, more = answered(seed, index, names, settled_m=NOISE_M)
    write_case(case, name, folder / "points", folder / "answers", **more)
    capture = folder / "captures" / name
    shutil.rmtree(capture, ignore_errors=True)
    write_pictures(case, name, capture, Sensor(seed=sensor_seed(seed, index)))
    try:
        write_recording(extract_chain(open_capture(capture)).recording, chain)
    except ChainError as error:
        # no chain, no verdict: counted as failed
        print(error, file=sys.stderr)
    shutil.rmtree(capture)


def sensor_seed(seed: int, index: int) -> int:
    """Of a camera's noise: as secret as the draw, and independent of it."""
    return int(np.random.SeedSequence(seed, spawn_key=(index,)).generate_state(1, np.uint64)[0])


def _answer(folder: Path, name: str) -> dict[str, Any]:
    return dict(json.loads((folder / "answers" / f"{name}.json").read_text()))


if __name__ == "__main__":
    run(main, *sys.argv[1:])
