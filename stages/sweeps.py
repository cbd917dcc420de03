"""Recordings of one cable diagnosed together (`make sweeps DATA=DIR [CASE=...]`): reports/sweeps.json.

DIR holds two sweeps of a weighted cable and its settled poses, whose data have no licence: no pipeline
carries them. Diagnosed are the sweeps `whole`; the first and half of the second, of which the other half is
`foretold`; and all four, `settled` poses too. A tip is the point of largest s_m in a frame.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dlolib.diagnose import Diagnosis, diagnose
from dlolib.files import write_json
from dlolib.formats import read_recording
from dlolib.identify.problem import axes
from dlolib.types import Estimate, Floats, Points, Recording
from stages import REPORTS, known, run
from stages.diagnose import settings
from stages.proof import made_by

SWEEPS = ("pac_black_weighted_sweep_cw", "pac_black_weighted_sweep_acw")
SETTLED = ("pac_black_weighted_settled", "pac_black_weighted_settled_0714")
BOOK = REPORTS / "sweeps.json"
# Which recordings are diagnosed together, of the sweeps and the settled poses.
CASES: dict[str, Callable[[list[Recording], list[Recording]], list[Recording]]] = {
    "whole": lambda sweeps, _: sweeps,
    "foretold": lambda sweeps, _: [sweeps[0], halved(sweeps[1])],
    "settled": lambda sweeps, settled: [*sweeps, *settled],
}


def main(data: str, *names: str) -> None:
    """Diagnose all cases, or those named; what is known of the others stays."""
    known(names, list(CASES), "case")
    found = json.loads(BOOK.read_text())["cases"] if BOOK.exists() else {}
    for name in names or CASES:
        recordings = CASES[name](*([_whole(Path(data) / one) for one in some] for some in (SWEEPS, SETTLED)))
        row = _row(diagnose(recordings, replace(settings(), heldout_share=0.0)))
        print(f"{name}: {row['status']}, {' + '.join(row['named']) or 'nothing named'}")
        for one, tip in row["tip_rmse_m"].items():
            print(f"  {one}: tip {1e3 * tip['elastic']:.1f} -> {1e3 * tip['model']:.1f} mm")
        if row["foretold_tip_rmse_m"] is not None:
            print(f"  foretold: tip {1e3 * row['foretold_tip_rmse_m']:.1f} mm")
        # after each, so that nothing is lost where the next is stopped
        found[name] = made_by(f"make sweeps DATA=DIR CASE={name}") | row
        write_json(BOOK, {"cases": found})


def _whole(folder: Path) -> Recording:
    """With no frame held out."""
    return replace(read_recording(folder), heldout_frames=None)


def halved(recording: Recording) -> Recording:
    """The same with the second half of its frames held out."""
    frames = np.unique(recording.points.frame)
    return replace(recording, heldout_frames=(int(frames[len(frames) // 2]), int(frames[-1])))


def _row(diagnosis: Diagnosis) -> dict[str, Any]:
    verdict, found = diagnosis.verdict, diagnosis.found
    tips = {}
    for one, both in zip(found.study.seen, diagnosis.simulated_m, strict=True):
        points = one.recording.points
        off = [np.linalg.norm((xyz - points.xyz_m)[:, axes(one.model)], axis=1) for xyz in both]
        tips[one.recording.name] = dict(
            zip(("elastic", "model"), (tip_rmse(points, distances) for distances in off), strict=True)
        )
    ahead = found.foretold.get(found.decision.winner.effects)
    heldout = [one.recording.points for one in found.study.ahead.values()]
    return {
        "summary": verdict.summary,
        "status": verdict.status,
        "named": [effect.name for effect in verdict.effects],
        "tie": verdict.equivalent,
        "parameters": _values(verdict.augmented.parameters),
        "nuisances": {name: _values(own) for name, own in verdict.nuisances.items()},
        "tip_rmse_m": tips,
        "rmse_m": {"elastic": verdict.baseline.rmse_m, "model": verdict.augmented.rmse_m},
        "foretold_rmse_m": verdict.augmented.heldout_rmse_m,
        "foretold_tip_rmse_m": None if ahead is None else tip_rmse(heldout[0], ahead.distances_m),
    }


def _values(estimates: Mapping[str, Estimate]) -> dict[str, float]:
    return {name: one.value for name, one in estimates.items()}


def tip_rmse(points: Points, distances_m: Floats) -> float:
    """Root mean square distance at the largest s_m of each frame."""
    last = [np.flatnonzero(points.frame == frame) for frame in np.unique(points.frame)]
    tips = [mine[np.argmax(points.s_m[mine])] for mine in last]
    return float(np.sqrt(np.mean(distances_m[tips] ** 2)))


if __name__ == "__main__":
    run(main, *sys.argv[1:])
