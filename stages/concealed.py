"""Recordings in which others concealed what is missing.

`make practice DATA=DIR`: those whose answer lies beside them (truth.json), diagnosed without it and scored:
reports/practice.json. `make sealed DATA=DIR`: those whose answers are kept elsewhere; each verdict is made
once, reports/sealed/<name>/verdict.json, with the commit that made it beside it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dlolib.errors import ParameterError
from dlolib.files import whole_folder, write_json
from dlolib.proof import book
from dlolib.proof.score import named
from stages import REPORTS, run
from stages.proof import diagnose, made_by, own_folder

COMMAND = "dlo diagnose {recording} --out {out}"
NEAR = 0.1


def main(kind: str, data: str) -> None:
    folders = sorted(path.parent for path in Path(data).glob("*/recording.json"))
    if not folders:
        raise ParameterError("no recordings", file=data, mend="say where the recordings lie: DATA=DIR")
    if kind == "sealed":
        sealed(folders)
    else:
        write_json(REPORTS / "practice.json", made_by("make practice DATA=DIR") | practice(folders))


def practice(folders: list[Path]) -> dict[str, Any]:
    """Diagnose, then compare with each truth.json."""
    rows = {}
    for folder in folders:
        verdict, seconds = _verdict(folder)
        truth = json.loads((folder / "truth.json").read_text())
        rows[folder.name] = {"seconds": seconds, **held(verdict, truth)}
    right = sum(row["names_right"] for row in rows.values())
    inside = [one["inside"] for row in rows.values() for one in row["parameters"].values()]
    counts = {"names_right": right, "of": len(rows), "inside": sum(inside), "planted": len(inside)}
    return counts | {"recordings": rows}


def held(verdict: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, Any]:
    """A verdict beside the truth: each planted parameter inside its 95 % interval or within a tenth."""
    planted = {"bending_stiffness": truth["bending_stiffness"]}
    planted |= {f"{name}.{key}": v for name, parts in truth["parameters"].items() for key, v in parts.items()}
    fitted = verdict["augmented" if verdict["effects"] else "baseline"]["parameters"]
    said, true = named(verdict), sorted(truth["effects"])
    return {
        "status": verdict["status"],
        "named": said,
        "true": true,
        "names_right": verdict["status"] in ("explained", "no_mismatch") and said == true,
        "parameters": {key: _inside(fitted.get(key), value) for key, value in planted.items()},
    }


def _inside(estimate: Mapping[str, Any] | None, true: float) -> dict[str, Any]:
    if estimate is None:
        return {"true": true, "value": None, "low": None, "high": None, "inside": False}
    value, low, high = estimate["value"], estimate["low"], estimate["high"]
    covered = (low is None or low <= true) and (high is None or true <= high)
    near = abs(value - true) <= NEAR * abs(true)
    return {"true": true, "value": value, "low": low, "high": high, "inside": covered or near}


def sealed(folders: list[Path]) -> None:
    """Make the verdicts that are not made yet, from a tree without changes."""
    book.committed()
    for folder in folders:
        out = REPORTS / "sealed" / folder.name
        if out.exists():
            continue
        verdict, _ = _verdict(folder)
        with whole_folder(out) as temporary:
            write_json(temporary / "verdict.json", verdict)
            write_json(temporary / "made.json", made_by("make sealed DATA=DIR"))


def _verdict(folder: Path) -> tuple[dict[str, Any], float]:
    """The verdict on a copy in a folder of its own, far from any answer, and the seconds that it took; once
    for each version of what diagnoses."""
    out = own_folder("concealed") / folder.name
    diagnose([folder], out, COMMAND)
    done = json.loads((out / "done.json").read_text())
    if done["exit_status"] != 0:
        raise ParameterError(f"the diagnosis ended with {done['exit_status']}: {done['stderr']}", file=folder)
    return json.loads((out / "verdict.json").read_text()), done["seconds"]


if __name__ == "__main__":
    run(main, *sys.argv[1:])
