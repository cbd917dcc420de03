"""A verdict as the diagnosis writes it, from invented numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from dlolib.files import write_csv
from dlolib.formats import write_verdict
from dlolib.types import (
    Candidate,
    Detectable,
    Estimate,
    Floats,
    Named,
    NextMotion,
    Place,
    Quality,
    SeenNoise,
    Verdict,
)

YIELD = Estimate(7.6, 7.4, 7.8, "1/m")


def _quality(rmse_m: float, **more: Estimate) -> Quality:
    ei = {"bending_stiffness": Estimate(3e-4, 2.9e-4, 3.1e-4, "N m^2")}
    return Quality({**ei, **more}, rmse_m, rmse_m, 1.1, 0.2)


def verdict() -> Verdict:
    """A tie of two models, with a motion that would separate them."""
    named = Named("plastic_bending", 0.7, {"yield_curvature": YIELD}, None, "the rope stays bent")
    models = (
        Candidate(("plastic_bending",), "library", 0.0, -900.0, 60.0, 1.1, 1.5e-3, 1.6e-3),
        Candidate(("internal_friction",), "library", 3.0, -880.0, 61.0, 1.2, 1.5e-3, 1.6e-3),
        Candidate(("internal_friction",), "wrong_same_size", 3.0, -880.0, 61.0, 1.2, 1.5e-3, 1.6e-3),
        Candidate((), "black_box", 40.0, -500.0, 70.0, 1.4, 1.8e-3, 2.1e-3),
        Candidate((), "library", 800.0, 0.0, 0.0, 9.0, 3.0e-3, 3.1e-3),
    )
    tie = (("plastic_bending",), ("internal_friction",))
    return Verdict(
        summary="What an elastic rod leaves out: the rope stays bent.",
        recordings=("captured",),
        status="ambiguous",
        noise=SeenNoise(1e-3, 0.0, 0.0, "frames 0 to 9, which stand still"),
        baseline=_quality(3e-3),
        nuisances={"captured": {}},
        where=(Place("captured", (0.1, 0.14), (4, 9), "out", 500.0, "stiffness", (-0.4,), ""),),
        effects=(named,),
        candidates=models,
        equivalent=tie,
        augmented=_quality(1.5e-3, **{"plastic_bending.yield_curvature": YIELD}),
        detectable=(
            Detectable("plastic_bending", "yield_curvature", 20.0, "1/m"),
            Detectable("rest_curvature", "kappa_1", None, "1/m"),
        ),
        next_motion=NextMotion("next_motion.csv", "roll the wrist", tie, 395.0),
    )


def write_diagnosed(folder: Path, shapes: list[Floats], length_m: float) -> None:
    """The folder of one recording whose frames look like `shapes`, each (P, 3) [m]."""
    folder.mkdir(parents=True)
    write_verdict(verdict(), folder)
    s_m = np.linspace(0, length_m, len(shapes[0]))
    parts = []
    for frame, shape in enumerate(shapes):
        columns = {"recording": "captured", "frame": frame, "t_s": 0.2 * frame, "s_m": s_m}
        for prefix in ("", "elastic_", "model_"):
            columns |= {f"{prefix}{axis}_m": shape[:, k] for k, axis in enumerate("xyz")}
        parts.append(pd.DataFrame({**columns, "off": 1.0 + frame + 3 * s_m}))
    write_csv(folder / "shapes.csv", pd.concat(parts))
    places, frames = (part.ravel() for part in np.meshgrid([0.1, 0.2, 0.3], np.arange(len(shapes))))
    gains = pd.DataFrame({"recording": "captured", "probe": "stiffness", "s_m": places, "frame": frames})
    write_csv(folder / "scan.csv", gains.assign(gain=10.0 + 40 * places * frames, threshold=19.0))
    bent = np.linspace(0, 9, 20)
    moment = 3e-4 * np.minimum(bent, 7.6)
    loop = {"s_m": 0.2, "t_s": np.arange(20.0), "curvature_1_m": bent, "moment_n_m": moment}
    write_csv(folder / "moments.csv", pd.DataFrame(loop))
