"""Would the truth itself foretell the held-out frames better? `make proof-heldout`, of the scored shards.

Of every recording in which something was named: whether that foretells the held-out frames better than the
elastic rod, as the proof counts it, and whether the laboratory's own rope does, by the same noise. Where the
truth is no nearer than an elastic rope no name can be better but by chance. What was counted of other shards
before stays.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from typing import Any

from dlolib.errors import SimulationError
from dlolib.files import write_json
from dlolib.progress import track
from dlolib.proof.draw import draw_case
from dlolib.proof.heldout import foretold
from dlolib.proof.score import share
from stages import run
from stages.proof import BOOK, WORKERS, answer_in, last_shards, made_by, of_others


def main(*arguments: str) -> None:
    options = argparse.ArgumentParser(prog="python -m stages.proof_heldout", description=__doc__)
    options.add_argument("--only", nargs="*", default=[], metavar="SHARD", help="all where none is named")
    asked = options.parse_args(arguments)
    shards = last_shards(asked.only)
    told = [
        (seed, shard, name, row["heldout"]["than_elastic"])
        for shard, (seed, rows) in shards.items()
        for name, row in rows.items()
        if row.get("heldout")
    ]
    with ProcessPoolExecutor(WORKERS) as pool:
        jobs = [pool.submit(by_the_truth, *one) for one in told]
        found = of_others("heldout.json", shards) + [job.result() for job in track(jobs, "true ropes")]
    write_json(BOOK / "heldout.json", made_by("make proof-heldout") | shares(found) | {"recordings": found})


def by_the_truth(seed: int, shard: str, name: str, better: bool) -> dict[str, Any]:
    """One row: whether what was named is better, and what the truth gains; nothing of it where no elastic
    rope goes the way."""
    answer = answer_in(shard, name)
    row = {"shard": shard, "name": name, "true": answer["effects"], "named_better": better}
    case = draw_case(seed, int(name), tuple(answer["effects"]), attempt=answer["attempt"])
    try:
        return row | asdict(foretold(case))
    except SimulationError as error:
        return row | {"not_played": error.problem}


def shares(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What was named, and the truth, each better than an elastic rope; what was named where the truth is."""
    played = [row for row in rows if "change" in row]
    true = [row for row in played if row["change"] < 0]
    return {
        "named_better": share(sum(row["named_better"] for row in played), len(played)),
        "truth_better": share(len(true), len(played)),
        "named_better_where_truth_is": share(sum(row["named_better"] for row in true), len(true)),
    }


if __name__ == "__main__":
    run(main, *sys.argv[1:])
