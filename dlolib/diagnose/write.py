"""What a diagnosis leaves behind: verdict.json, next_motion.csv, and the tables of its figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from dlolib.diagnose.diagnose import Diagnosis
from dlolib.diagnose.locate import Scan
from dlolib.diagnose.probes import PROBES
from dlolib.diagnose.verdict import NEXT
from dlolib.files import write_csv, write_json
from dlolib.formats import write_motion, write_verdict
from dlolib.identify.problem import axes
from dlolib.sim.moments import moments
from dlolib.sim.recording import RecordingModel
from dlolib.types import Floats


def write_diagnosis(diagnosis: Diagnosis, folder: Path) -> None:
    """Write all files into an existing folder.

    shapes.csv: observed points, those of the elastic rod and of the winner, and how many deviations of the
    noise the elastic rod is off at each. scan.csv: gain of the local probes. moments.csv: of the winner,
    where it bends most. tests.json: the path-reversal test, and how likely noise alone gives the scan's gain.
    """
    write_verdict(diagnosis.verdict, folder)
    if diagnosis.found.asked is not None:
        write_motion(diagnosis.found.asked.motion, folder / NEXT)
    write_csv(folder / "shapes.csv", _shapes(diagnosis))
    write_csv(
        folder / "scan.csv", pd.concat([_scan(one) for one in diagnosis.found.scans], ignore_index=True), 6
    )
    write_csv(folder / "moments.csv", _moments(diagnosis))
    test = diagnosis.reversal
    content = {"pairs": test.pairs, "statistic": test.statistic, "p_value": test.p_value}
    scans = {one.recording: one.p_value for one in diagnosis.found.scans}
    write_json(folder / "tests.json", {"reversal": content, "scan": {"p_value": scans}})


def _shapes(diagnosis: Diagnosis) -> pd.DataFrame:
    tables = []
    for k, one in enumerate(diagnosis.found.study.seen):
        points = one.recording.points
        base, best = diagnosis.simulated_m[k]
        columns: dict[str, object] = {
            "recording": one.recording.name,
            "frame": points.frame,
            "t_s": points.t_s,
        }
        columns |= {"s_m": points.s_m}
        columns |= {f"{axis}_m": points.xyz_m[:, a] for a, axis in enumerate("xyz")}
        columns |= {f"elastic_{axis}_m": base[:, a] for a, axis in enumerate("xyz")}
        columns |= {f"model_{axis}_m": best[:, a] for a, axis in enumerate("xyz")}
        seen = axes(one.model)
        columns |= {"off": _off((base - points.xyz_m)[:, seen], one.whitener.noise.sigma_m)}
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)


def _off(difference_m: Floats, sigma_m: float) -> Floats:
    """By how many deviations points (P, A) are off, root mean square over the axes that were seen."""
    return np.asarray(np.sqrt(np.mean(difference_m**2, axis=1)) / sigma_m)


def _scan(scan: Scan) -> pd.DataFrame:
    """A row a probe, place and frame."""
    probes = list(PROBES)
    grid = np.indices(scan.gain.shape).reshape(3, -1)
    return pd.DataFrame(
        {
            "recording": scan.recording,
            "probe": np.array(probes)[grid[0]],
            "s_m": scan.arc_m[grid[1]],
            "frame": scan.frames[grid[2]],
            "gain": scan.gain.ravel(),
            "threshold": scan.threshold,
        }
    )


def _moments(diagnosis: Diagnosis) -> pd.DataFrame:
    """Moment against curvature of the winner's most bent joints, over the first recording's motion."""
    study, winner = diagnosis.found.study, diagnosis.found.decision.winner
    model = study.seen[0].model
    columns = ["s_m", "t_s", "curvature_1_m", "moment_n_m"]
    if not isinstance(model, RecordingModel):
        return pd.DataFrame(columns=columns)
    rod = study.rod(0, winner.values(0))
    rollout, times = model.timed(rod)
    bent, moment = (part[0] for part in moments(rollout))
    size = np.linalg.norm(bent[:, :, :2], axis=2)
    inner = size[:, 1:-1].max(axis=0)
    order = 1 + np.argsort(-inner)[:1]
    arc = np.mean(model.setup(rod).joint_arc_m(), axis=0)
    rows = []
    for joint in order:
        axis = bent[np.argmax(size[:, joint]), joint, :2]
        axis = axis / np.linalg.norm(axis)
        rows.append(
            pd.DataFrame(
                {
                    "s_m": arc[joint],
                    "t_s": times,
                    "curvature_1_m": bent[:, joint, :2] @ axis,
                    "moment_n_m": moment[:, joint, :2] @ axis,
                }
            )
        )
    return pd.concat(rows, ignore_index=True)[columns]


__all__ = ["write_diagnosis"]
