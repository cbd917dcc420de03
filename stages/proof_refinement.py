"""Is the proof's laboratory fine enough? `make proof-refinement`: what more bodies, steps, hardness do.

Recordings with nothing missing come first, then what remembers or touches. Goal: its own discretisation
leaves a gain below 2 in χ², nothing that a diagnosis could take for physics.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from dlolib.files import write_json
from dlolib.progress import track
from dlolib.proof.refine import EFFECTS, refined
from stages import run
from stages.proof import BOOK, WORKERS, made_by

GOAL = 2.0


def main(*arguments: str) -> None:
    options = argparse.ArgumentParser(prog="python -m stages.proof_refinement", description=__doc__)
    options.add_argument("--seed", type=int, default=1, help="of the motions and ropes")
    seed = options.parse_args(arguments).seed
    with ProcessPoolExecutor(WORKERS) as pool:
        rows = pool.map(partial(refined, seed), range(len(EFFECTS)))
        cases = list(track(rows, "refinement", len(EFFECTS)))
    made = made_by("make proof-refinement") | {"seed": seed, "goal": GOAL}
    write_json(BOOK / "refinement.json", made | {"cases": cases})


if __name__ == "__main__":
    run(main, *sys.argv[1:])
