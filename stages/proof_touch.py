"""Is a hidden obstacle found, and what is one worth by chance? `make proof-touch COUNT=20 NULLS=60`.

Recordings of the proof's laboratory, of a seed that no proof has, are diagnosed with no other effect in the
library: some with a hidden obstacle alone, others with nothing missing. Of the former is told what the
obstacle that was found takes from χ², beside what the true one takes free of noise, and how far its surface
is from where the rope touches it; of the latter what the best one takes by chance. That is more than one
obstacle at a given place would: `dlolib.diagnose.decide.ANYWHERE` allows for it.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from loky import ProcessPoolExecutor

from dlolib.diagnose import DiagnoseSettings, diagnose
from dlolib.diagnose.decide import ANYWHERE
from dlolib.files import write_json
from dlolib.formats import read_recording
from dlolib.progress import track
from dlolib.proof.score import PLACE_M, share
from dlolib.sim.effects import EFFECTS
from stages import number, run
from stages.proof import BOOK, WORK, WORKERS, called, made_by, make

EFFECT = "hidden_obstacle"
ONLY = DiagnoseSettings(without=tuple(sorted(EFFECTS.keys() - {EFFECT})), workers=1)


def main(*arguments: str) -> None:
    options = argparse.ArgumentParser(prog="python -m stages.proof_touch", description=__doc__)
    options.add_argument("--seed", type=int, default=1, help="of both, and of no shard")
    options.add_argument("--count", type=int, default=20, help="recordings with a hidden obstacle alone")
    options.add_argument("--nulls", type=int, default=60, help="recordings with nothing missing")
    asked = options.parse_args(arguments)
    number(str(asked.count), "COUNT", 1)
    number(str(asked.nulls), "NULLS", 1)
    touched = _diagnosed("touched", asked.seed, [(EFFECT,)] * asked.count)
    free = _diagnosed("free", asked.seed, [()] * asked.nulls)
    made = made_by(f"make proof-touch SEED={asked.seed} COUNT={asked.count} NULLS={asked.nulls}")
    write_json(BOOK / "touch.json", made | {"seed": asked.seed} | summarise(touched, free))


def summarise(touched: list[dict[str, Any]], free: list[dict[str, Any]]) -> dict[str, Any]:
    """The rows, and what they come to."""
    seen = [row for row in touched if row["detectable"]]
    # of so many places the best is as unlikely as that, were they as good as each other
    rarely = [-np.log1p(-min(row["by_chance"], 1 - 1e-12)) for row in free]
    places = len(free) / sum(rarely) if free else None
    return {
        "named": share(sum(row["named"] for row in seen), len(seen)),
        "place": share(sum(row.get("off_m", np.inf) <= PLACE_M for row in seen), len(seen)),
        "alarms": share(sum(row["named"] for row in free), len(free)),
        "alarms_at_one_place": share(sum(row["by_chance"] < ONLY.chance for row in free), len(free)),
        "places": places,
        "allowed_places": ANYWHERE,
        "touched": touched,
        "free": free,
    }


def _diagnosed(kind: str, seed: int, names: list[tuple[str, ...]]) -> list[dict[str, Any]]:
    folder = WORK / "touch" / f"seed_{seed}" / kind
    # one seed would draw the same motions for both
    make(2 * seed + (kind == "free"), names, folder / "recordings", folder / "answers")
    # a process forked from this one would wait for the simulator's threads
    with ProcessPoolExecutor(WORKERS) as pool:
        rows = pool.map(_row, [folder] * len(names), map(called, range(len(names))))
        return list(track(rows, kind, len(names)))


def _row(folder: Path, name: str) -> dict[str, Any]:
    """What the best hidden obstacle takes from χ² of one recording, how likely chance does that at one place,
    and how far its surface is from where the rope is touched."""
    answer = json.loads((folder / "answers" / f"{name}.json").read_text())
    diagnosis = diagnose([read_recording(folder / "recordings" / name)], ONLY)
    base = diagnosis.found.searched.baseline
    best = next((one for one in diagnosis.found.searched.models if one.effects == (EFFECT,)), base)
    row = {"name": name, "named": bool(diagnosis.verdict.effects), "detectable": bool(answer["detectable"])}
    row |= {"gain": base.chi2 - best.chi2, "by_chance": best.by_chance(base)}
    if answer["effects"] and best is not base:
        at = {unknown.name.partition(".")[2]: value for unknown, value in best.point.items()}
        off = np.linalg.norm(np.subtract(answer["touch_m"], [at[axis] for axis in "xyz"])) - at["radius"]
        row |= {"true_gain": answer["gains"][EFFECT], "off_m": abs(float(off))}
    return row


if __name__ == "__main__":
    run(main, *sys.argv[1:])
