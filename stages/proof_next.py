"""Does the next motion tell a tie apart? `make proof-next`: that of every tie of the scored shards.

The laboratory goes on from where the recording ended, the motion that its verdict asks for is played, and
both recordings are diagnosed together. Goal: 80 % end in the true set alone, of the ties for which a motion
is asked for and can be played; how many these are is told. What was counted of other shards before stays.
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
from dlolib.proof.draw import SIGMA_M, Case, draw_case
from dlolib.proof.noise import draw_noise
from dlolib.proof.play import settled
from dlolib.proof.score import named, outcome, share
from dlolib.proof.write import recording
from dlolib.types import Floats, Motion, Recording
from stages import run
from stages.proof import (
    BOOK,
    COMMAND,
    RECORDINGS,
    SEALED,
    WORKERS,
    diagnose,
    last_shards,
    made_by,
    of_others,
    own_folder,
    verdict_in,
)

SEED = 3
PARTS = ("start_m", "start_q", "end_m", "end_q")


def main(*arguments: str) -> None:
    options = argparse.ArgumentParser(prog="python -m stages.proof_next", description=__doc__)
    options.add_argument("--command", default=COMMAND, help="what diagnoses, as in stages.proof")
    options.add_argument("--only", nargs="*", default=[], metavar="SHARD", help="all where none is named")
    asked = options.parse_args(arguments)
    shards = last_shards(asked.only)
    tied = [
        (seed, shard, name)
        for shard, (seed, rows) in shards.items()
        for name, row in rows.items()
        if row["outcome"] == "tied"
    ]
    with ThreadPoolExecutor(WORKERS) as pool:
        jobs = [pool.submit(told_apart, *one, asked.command) for one in tied]
        found = of_others("next.json", shards, judged=False) + [job.result() for job in jobs]
    played = [row for row in found if row["outcome"] is not None]
    right = share(sum(row["outcome"] == "right" for row in played), len(played))
    made = made_by("make proof-next") | {"goal": 0.8, "asked": share(len(played), len(found))}
    write_json(BOOK / "next.json", made | {"told_apart": right, "recordings": found})


def told_apart(seed: int, shard: str, name: str, command: str) -> dict[str, Any]:
    """One row: what the tie was, which motion was asked for, and what both recordings say; no outcome where
    none was played."""
    first, folder = RECORDINGS / shard / name, own_folder("next") / shard / name
    diagnose([first], folder / "first", command)
    verdict = verdict_in(folder / "first")
    answer = json.loads((SEALED / shard / f"{name}.json").read_text())
    row = {"shard": shard, "name": name, "true": answer["effects"], "outcome": None}
    if verdict is None or verdict["next_motion"] is None:
        return row | {"why": "no motion was asked for" if verdict else "no verdict"}
    row |= {"tie": verdict["equivalent"], "why": verdict["next_motion"]["why"]}
    case = draw_case(seed, int(name), tuple(answer["effects"]), attempt=answer["attempt"])
    second = folder / f"{name}_next"
    try:
        motion = read_motion(folder / "first/next_motion.csv")
        # of its own: the noise of one tie tells nothing of another's
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(SEED, int(name))))
        write_recording(played_on(case, motion, second.name, rng), second)
    except SimulationError as error:
        return row | {"not_played": error.problem}
    diagnose([first, second], folder / "both", command)
    both = verdict_in(folder / "both")
    said = (
        {} if both is None else {"status": both["status"], "named": named(both), "tied": both["equivalent"]}
    )
    return row | said | {"outcome": outcome(both, answer)}


def played_on(case: Case, motion: Motion, name: str, rng: np.random.Generator) -> Recording:
    """The rope of a case moved on from its last pose (motion's times from 0), as the same camera sees it."""
    before = case.experiment.motion
    end_s = float(before.t_s[-1])
    way = {part: np.concatenate([getattr(before, part), getattr(motion, part)[1:]]) for part in PARTS}
    whole = Motion(np.concatenate([before.t_s, end_s + motion.t_s[1:]]), **way)
    # as often as before
    every_s = float(np.median(np.diff(case.experiment.frame_t_s)))
    frame_t_s: Floats = np.linspace(0.0, motion.t_s[-1], max(int(motion.t_s[-1] / every_s), 1) + 1)
    experiment = replace(case.experiment, motion=whole, frame_t_s=end_s + frame_t_s)
    points, bodies = settled(experiment, case.effects, SIGMA_M)
    seen = rng.random(points.shape[:2]) < case.seen.mean()
    noise = draw_noise(rng, case.noise, points.shape)
    made = recording(
        replace(case, experiment=experiment, points_m=points, bodies=bodies, noise_m=noise, seen=seen), name
    )
    shown = replace(made.points, t_s=made.points.t_s - end_s)
    return replace(made, motion=motion, points=shown, static_frames=None, heldout_frames=None)


if __name__ == "__main__":
    run(main, *sys.argv[1:])
