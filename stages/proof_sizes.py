"""Is `detectable` right? `make proof-sizes COUNT=100`: effects planted at exactly the size that was named.

A recording of the proof's laboratory with nothing missing is diagnosed; one of the effects that it says it
would have shown is planted in the same motion, at that size, and the new recording, with noise of its own, is
diagnosed in turn. Found is what an explained or ambiguous verdict names, alone or in a tie. Goal: 85 to 99 %.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dlolib.errors import SimulationError
from dlolib.files import write_json
from dlolib.proof.answer import REDRAWS
from dlolib.proof.draw import SIGMA_M, Case, draw_case
from dlolib.proof.motions import HELDOUT_FRAMES
from dlolib.proof.noise import draw_noise
from dlolib.proof.play import settled
from dlolib.proof.score import named, share
from dlolib.proof.sizes import NAMES
from dlolib.proof.write import write_case
from dlolib.sim.effects import EFFECTS, parameter
from dlolib.sim.effects.base import forms, sizes
from stages import number, run
from stages.proof import BOOK, COMMAND, WORKERS, diagnose, made_by, own_folder, seed_of, verdict_in


def main(*arguments: str) -> None:
    options = argparse.ArgumentParser(prog="python -m stages.proof_sizes", description=__doc__)
    options.add_argument("--count", type=int, default=100, help="recordings")
    options.add_argument("--command", default=COMMAND, help="what diagnoses, as in stages.proof")
    asked = options.parse_args(arguments)
    number(str(asked.count), "COUNT", 1)
    folder = own_folder("sizes")
    seed = seed_of(folder)
    with ThreadPoolExecutor(WORKERS) as pool:
        rows = list(pool.map(lambda k: planted(folder, seed, k, asked.command), range(asked.count)))
    rows = [row for row in rows if row]
    found = share(sum(row["found"] for row in rows), len(rows))
    made = made_by("make proof-sizes") | {"seed": seed, "goal": [0.85, 0.99]}
    write_json(BOOK / "sizes.json", made | {"found": found, "recordings": rows})


def planted(folder: Path, seed: int, index: int, command: str) -> dict[str, Any]:
    """One row: what was planted, at which size, and what the verdict says; empty where nothing could be."""
    case, name = _drawn(seed, index), f"{index:03d}"
    before = _diagnosed(case, name, folder / "nulls", command)
    if before is None:
        return {"found": False, "said": "the recording with nothing missing was not diagnosed"}
    rng = np.random.default_rng([seed, 2, index])
    seen = [one for one in before["detectable"] if one["value"] is not None and one["name"] in NAMES]
    for one in rng.permutation(np.array(seen, dtype=object)):
        try:
            case = with_effect(case, one["name"], one["parameter"], one["value"], rng)
        except SimulationError:
            continue
        row = {key: one[key] for key in ("name", "parameter", "value")}
        return row | found_in(_diagnosed(case, name, folder / "planted", command), one["name"])
    return {}


def found_in(verdict: dict[str, Any] | None, name: str) -> dict[str, Any]:
    """Whether a verdict names an effect, and what it says."""
    if verdict is None:
        return {"found": False, "said": "not diagnosed"}
    ties = [set(tie) for tie in verdict["equivalent"]] or [set(named(verdict))]
    sure = verdict["status"] in ("explained", "ambiguous")
    said = {"status": verdict["status"], "said": [sorted(tie) for tie in ties]}
    return {"found": sure and any(name in tie for tie in ties)} | said


def _drawn(seed: int, index: int) -> Case:
    """A motion with nothing missing; one that throws the rope over its obstacle is drawn anew."""
    for attempt in range(REDRAWS - 1):
        try:
            return draw_case(seed, index, (), attempt=attempt)
        except SimulationError:
            continue
    return draw_case(seed, index, (), attempt=REDRAWS - 1)


def with_effect(case: Case, name: str, part: str, value: float, rng: np.random.Generator) -> Case:
    """The same motion and camera with an effect of this size, where and when `detectable` looks for it."""
    form = min((form for form in forms(EFFECTS[name]) if part in form), key=len)
    values = {other: _usual(case, f"{name}.{other}") for other in form if other not in sizes(EFFECTS[name])}
    whole = {
        **{one.name: one.neutral for one in EFFECTS[name].PARAMETERS},
        **getattr(EFFECTS[name], "NAMED", {}),
    }
    absent = {other: size for other, size in whole.items() if np.isfinite(size)}
    effects = {name: {**absent, **values, part: value}}
    points, bodies = settled(case.experiment, effects, SIGMA_M)
    noise = draw_noise(rng, case.noise, points.shape)
    return replace(case, effects=effects, points_m=points, bodies=bodies, noise_m=noise)


def _usual(case: Case, name: str) -> float:
    """A parameter that is no size: the middle of its starts, as the diagnosis takes it."""
    known = parameter(name)
    t_s = case.experiment.frame_t_s[:-HELDOUT_FRAMES]
    first, span = (t_s[0], np.ptp(t_s)) if known.along == "motion" else (0.0, 1.0)
    scale = case.experiment.sizes.length_m if known.along == "rope" else span
    return float(first + scale * known.starts[len(known.starts) // 2])


def _diagnosed(case: Case, name: str, folder: Path, command: str) -> dict[str, Any] | None:
    if not (folder / "answers" / f"{name}.json").exists():
        write_case(case, name, folder / "recordings", folder / "answers")
    diagnose([folder / "recordings" / name], folder / "verdicts" / name, command)
    return verdict_in(folder / "verdicts" / name)


if __name__ == "__main__":
    run(main, *sys.argv[1:])
