"""Does the next motion tell a tie apart? `make proof-next`: that of every tie of the scored shards.

The laboratory goes on from where the recording ended, the motion that its verdict asks for is played, and
both recordings are diagnosed together. Goal: 80 % end in the true set alone.
"""

from __future__ import annotations

import argparse
import json
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

from dlolib.errors import SimulationError
from dlolib.files import write_json
from dlolib.formats import write_recording
from dlolib.formats.motion import read_motion
from dlolib.proof import book
from dlolib.proof.draw import Case, draw_case
from dlolib.proof.noise import draw_noise
from dlolib.proof.play import play
from dlolib.proof.score import named, outcome, share
from dlolib.proof.write import recording
from dlolib.types import Floats, Motion, Recording
from stages import run
from stages.proof import BOOK, COMMAND, RECORDINGS, SEALED, WORK, WORKERS, diagnose, totals

FOLDER = WORK / "next"
FRAMES, SEED = 60, 3
PARTS = ("start_m", "start_q", "end_m", "end_q")


def main(*arguments: str) -> None:
    options = argparse.ArgumentParser(prog="python -m stages.proof_next", description=__doc__)
    options.add_argument("--command", default=COMMAND, help="what diagnoses, as in stages.proof")
    command = options.parse_args(arguments).command
    seeds = {row["shard"]: int(row["seed"]) for row in book.runs(BOOK) if row["seed"]}
    tied = []
    for shard in totals()["shards"]:
        rows = json.loads((BOOK / f"{shard}.json").read_text())["recordings"]
        tied += [(seeds[shard], shard, name) for name, row in rows.items() if row["outcome"] == "tied"]
    with ThreadPoolExecutor(WORKERS) as pool:
        jobs = [pool.submit(told_apart, *one, command) for one in tied]
        found = [row for job in jobs if (row := job.result())]
    right = share(sum(row["outcome"] == "right" for row in found), len(found))
    made = {"command": "make proof-next", "commit": book.commit(), "version": book.version()}
    write_json(BOOK / "next.json", {**made, "goal": 0.8, "told_apart": right, "recordings": found})


def told_apart(seed: int, shard: str, name: str, command: str) -> dict[str, Any]:
    """One row: what the tie was, which motion was asked for, and what both recordings say."""
    first, folder = RECORDINGS / shard / name, FOLDER / shard / name
    diagnose([first], folder / "first", command)
    verdict = json.loads((folder / "first/verdict.json").read_text())
    answer = json.loads((SEALED / shard / f"{name}.json").read_text())
    row = {"shard": shard, "name": name, "true": answer["effects"], "tie": verdict["equivalent"]}
    if verdict["next_motion"] is None:
        return row | {"outcome": "no motion was asked for"}
    case = draw_case(seed, int(name), tuple(answer["effects"]), attempt=answer["attempt"])
    second = folder / f"{name}_next"
    try:
        motion = read_motion(folder / "first/next_motion.csv")
        write_recording(played_on(case, motion, second.name, np.random.default_rng([seed, SEED])), second)
    except SimulationError as error:
        return row | {"outcome": f"not played: {error.problem}"}
    diagnose([first, second], folder / "both", command)
    both = json.loads((folder / "both/verdict.json").read_text())
    said = {"why": verdict["next_motion"]["why"], "status": both["status"], "named": named(both)}
    return row | said | {"outcome": outcome(both, answer)}


def played_on(case: Case, motion: Motion, name: str, rng: np.random.Generator) -> Recording:
    """The rope of a case moved on from its last pose (motion's times from 0), as the same camera sees it."""
    before = case.experiment.motion
    end_s = float(before.t_s[-1])
    way = {part: np.concatenate([getattr(before, part), getattr(motion, part)[1:]]) for part in PARTS}
    whole = Motion(np.concatenate([before.t_s, end_s + motion.t_s[1:]]), **way)
    frame_t_s: Floats = np.linspace(0.0, motion.t_s[-1], FRAMES)
    experiment = replace(case.experiment, motion=whole, frame_t_s=end_s + frame_t_s)
    points = play(experiment, case.effects)
    seen = rng.random(points.shape[:2]) < case.seen.mean()
    noise = draw_noise(rng, case.noise, points.shape)
    made = recording(replace(case, experiment=experiment, points_m=points, noise_m=noise, seen=seen), name)
    shown = replace(made.points, t_s=made.points.t_s - end_s)
    return replace(made, motion=motion, points=shown, static_frames=None, heldout_frames=None)


if __name__ == "__main__":
    run(main, *sys.argv[1:])
