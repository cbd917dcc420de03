"""What does the screen of pairs miss? `make proof-screen SEED=1 COUNT=12`.

Recordings of the calibration, every effect alone, are diagnosed as ever and in full, with every pair fitted.
Missed is a model that is better by more than a tie and has other effects; and it matters where another
verdict follows. Calibration has seeds of its own: no shard is touched.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ThreadPoolExecutor
from statistics import median
from typing import Any

from dlolib.errors import ParameterError
from dlolib.files import write_json
from dlolib.proof.score import share
from dlolib.proof.sizes import NAMES
from stages import run
from stages.proof import (
    BOOK,
    CALIBRATION,
    CALIBRATION_NULLS,
    COMMAND,
    WORKERS,
    calibrate,
    called,
    diagnose,
    made_by,
    own_folder,
    together,
    verdict_in,
)

TIE = 6.0


def main(*arguments: str) -> None:
    options = argparse.ArgumentParser(prog="python -m stages.proof_screen", description=__doc__)
    options.add_argument("--seed", type=int, default=1, help="of the calibration")
    options.add_argument("--count", type=int, default=12, help="how many of its recordings with an effect")
    asked = options.parse_args(arguments)
    calibrate(asked.seed)
    recordings = CALIBRATION / f"seed_{asked.seed}" / "recordings"
    names = [called(CALIBRATION_NULLS + index) for index in range(len(NAMES))][: asked.count]
    if not names:
        raise ParameterError(f"COUNT = {asked.count}", mend="give 1 or more")
    apart = own_folder("screen") / f"seed_{asked.seed}"
    tasks = [
        ((recordings / name,), apart / kind / name, f"{COMMAND}{more}")
        for name in names
        for kind, more in (("screened", ""), ("full", " --full"))
    ]
    together(ThreadPoolExecutor(WORKERS), diagnose, tasks, "screened and in full")
    rows = [_row(name, *(verdict_in(apart / kind / name) for kind in ("screened", "full"))) for name in names]
    told = [row for row in rows if row["gain"] is not None]
    made = made_by(f"make proof-screen SEED={asked.seed} COUNT={asked.count}") | {"seed": asked.seed}
    missed = share(sum(row["missed"] for row in told), len(told))
    otherwise = share(sum(row["otherwise"] for row in told), len(told))
    write_json(BOOK / "screen.json", made | {"missed": missed, "otherwise": otherwise, "recordings": rows})


def _row(name: str, screened: dict[str, Any] | None, full: dict[str, Any] | None) -> dict[str, Any]:
    """By how much in BIC the best of all pairs is better than the best of those that were screened."""
    if screened is None or full is None:
        return {"name": name, "gain": None, "missed": False, "otherwise": False}
    one, other = _models(screened), _models(full)
    # the same model stands in both
    common = [other[effects] - one[effects] for effects in one.keys() & other.keys()]
    gain = median(common) if common else None
    best = [min(models, key=models.__getitem__) for models in (one, other)]
    return {
        "name": name,
        "screened": best[0],
        "full": best[1],
        "gain": gain,
        "missed": gain is not None and gain > TIE and best[0] != best[1],
        "otherwise": _said(screened) != _said(full),
    }


def _models(verdict: dict[str, Any]) -> dict[tuple[str, ...], float]:
    listed = [one for one in verdict["candidates"] if one["kind"] == "library"]
    return {tuple(sorted(one["effects"])): float(one["delta_bic"]) for one in listed}


def _said(verdict: dict[str, Any]) -> tuple[str, list[list[str]]]:
    return verdict["status"], sorted(sorted(one) for one in verdict["equivalent"])


if __name__ == "__main__":
    run(main, *sys.argv[1:])
