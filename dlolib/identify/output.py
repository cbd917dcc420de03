"""What identification leaves behind: fit.json, loss.csv, shapes.csv, summary.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from dlolib.files import whole_folder, write_csv, write_json
from dlolib.formats import write_fit
from dlolib.identify.descent import Descended
from dlolib.identify.identify import Identified
from dlolib.types import Recording


def write_identified(
    identified: Identified, recordings: Sequence[Recording], out: Path, descended: Descended | None = None
) -> None:
    """Write the folder whole; shapes.csv is of the first recording, summary.json of all."""
    loss = [identified.loss.assign(method="least_squares")]
    if descended is not None:
        loss.append(descended.loss.assign(method="gradient_descent"))
    table = pd.concat(loss, ignore_index=True)
    with whole_folder(out) as folder:
        write_fit(identified.fit, folder / "fit.json")
        write_csv(folder / "loss.csv", table[["method", *(c for c in table.columns if c != "method")]])
        write_csv(folder / "shapes.csv", shapes(recordings[0], identified))
        write_json(folder / "summary.json", summary(identified, recordings, descended))


def shapes(recording: Recording, identified: Identified) -> pd.DataFrame:
    """Observed and simulated points of the first recording, a row a point."""
    points, made = recording.points, identified.simulated_m[0]
    columns = {"frame": points.frame, "t_s": points.t_s, "s_m": points.s_m}
    columns |= {f"{axis}_m": points.xyz_m[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"sim_{axis}_m": made[:, k] for k, axis in enumerate("xyz")}
    return pd.DataFrame(columns)


def summary(
    identified: Identified, recordings: Sequence[Recording], descended: Descended | None = None
) -> dict[str, Any]:
    """The figures of a fit, as numbers in SI units."""
    points, made = recordings[0].points, identified.simulated_m[0]
    observed = [0, 2] if recordings[0].planar == "xz" else [0, 1, 2]
    distance = pd.Series(np.linalg.norm((made - points.xyz_m)[:, observed], axis=1))
    return {
        "name": recordings[0].name,
        "recordings": [r.name for r in recordings],
        "rmse_m": identified.fit.rmse_m,
        "rmse_each_m": list(identified.rmse_m),
        "mean_distance_m": float(distance.mean()),
        "loss_paper_m": float(distance.groupby(points.frame).mean().sum()),
        "heldout_rmse_m": identified.heldout_rmse_m,
        "heldout_frames": identified.heldout_frames,
        "frames": identified.fit.frames,
        "points": identified.fit.points,
        "parameters": {name: asdict(value) for name, value in identified.fit.parameters.items()},
        "nuisances": {
            recording: {name: asdict(value) for name, value in own.items()}
            for recording, own in identified.fit.nuisances.items()
        },
        "paper_method": None
        if descended is None
        else {
            "alpha_b": descended.alpha_b,
            "bending_stiffness": descended.bending_stiffness,
            "loss_m": descended.loss_m,
            "iterations": len(descended.loss) - 1,
        },
    }
