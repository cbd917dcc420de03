"""The rod with each law against another solver: `make agreement`, reports/agreement.json.

The proof's laboratory plays a rope with one effect, `dlo simulate` the same rope by the same parameters, at
its own number of particles. Laws of another form than ours are given the parameters by which ours comes
nearest to theirs; what is left of their form is part of the distance.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dlolib.files import write_json
from dlolib.formats import read_recording, write_recording
from dlolib.progress import track
from dlolib.proof.answer import answered
from dlolib.proof.draw import Case
from dlolib.proof.sizes import NAMES
from dlolib.proof.world import REMEMBERS
from dlolib.proof.write import recording
from stages import REPORTS, number, run
from stages.proof import WORKERS, made_by

SEED, SIZE = 20241, 3.0
DLO = Path(sys.executable).with_name("dlo")
# Of the rope's length [%], of laws that remember and where it touches.
GOAL, GOAL_REMEMBERED = 0.5, 1.0
# Frames apart by more than this [% of the length] lie in another equilibrium: no error of a law.
ELSEWHERE = 5.0


def main(count: str) -> None:
    many = number(count, "COUNT", 1)
    with ProcessPoolExecutor(WORKERS) as pool:
        jobs = [pool.submit(apart, name, draw) for name in ("", *NAMES) for draw in range(many)]
        rows = [job.result() for job in track(jobs, "both solvers")]
    met = sum(row.get("most_percent", np.inf) <= row["goal_percent"] for row in rows)
    made = made_by("make agreement") | {"seed": SEED, "size": SIZE, "each": many, "met": met}
    write_json(REPORTS / "agreement.json", made | {"of": len(rows), "recordings": rows})
    for row in rows:
        print(f"{row['effect'] or 'elastic'}: {row.get('most_percent', row.get('refused'))}")


def apart(name: str, draw: int) -> dict[str, Any]:
    """One effect ("": none) drawn so often before: largest and mean distance of both ropes' points."""
    case, more = answered(SEED, draw, (name,) if name else (), SIZE)
    row: dict[str, Any] = {"effect": name, "draw": draw}
    row |= {"goal_percent": GOAL_REMEMBERED if name in REMEMBERS or case.experiment.obstacles else GOAL}
    exact = replace(case, noise_m=np.zeros_like(case.noise_m), seen=np.ones_like(case.seen))
    with tempfile.TemporaryDirectory() as folder:
        given, out = Path(folder) / "recording", Path(folder) / "out"
        write_recording(recording(exact, "recording"), given)
        words = [str(DLO), "simulate", str(given), *options(case, more["nearest"]), "--out", str(out)]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if done.returncode:
            return row | {"refused": done.stderr.strip().splitlines()[-1].replace(folder, "")}
        off_m = read_recording(out).points.xyz_m - read_recording(given).points.xyz_m
    shares = np.linalg.norm(off_m, axis=1).reshape(case.seen.shape) / case.experiment.sizes.length_m
    by_frame = 100 * shares.max(axis=1)
    return row | {
        "most_percent": float(by_frame.max()),
        "mean_percent": float(100 * shares.mean()),
        "frames_elsewhere": int(np.sum(by_frame > ELSEWHERE)),
    }


def options(case: Case, nearest: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    """What `dlo simulate` is to know of a case."""
    for name in ("bending_stiffness", "torsional_stiffness"):
        yield from ("--set", f"{name}={getattr(case.experiment, name)!r}")
    for name, values in case.effects.items():
        told = {**values, **nearest.get(name, {})}
        yield from ("--effect", f"{name}:" + ",".join(f"{key}={value!r}" for key, value in told.items()))


if __name__ == "__main__":
    run(main, *sys.argv[1:])
