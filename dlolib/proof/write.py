"""The recording that the diagnosis gets, and the answer that it does not."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from dlolib.files import write_json
from dlolib.formats import write_recording
from dlolib.proof.draw import Case
from dlolib.proof.motions import HELDOUT_FRAMES, STATIC_FRAMES
from dlolib.proof.world import GRAVITY_M_S2, POINTS
from dlolib.types import Ends, Points, Recording, Rope

SOURCE = "virtual laboratory, for evaluation"


def recording(case: Case, name: str) -> Recording:
    """The case as it was observed: noise, lost points, nothing of the truth."""
    experiment = case.experiment
    sizes, frames = experiment.sizes, len(experiment.frame_t_s)
    frame, point = np.nonzero(case.seen)
    return Recording(
        name=name,
        rope=Rope("rope", sizes.length_m, sizes.diameter_m, sizes.linear_density_kg_m),
        gravity_m_s2=np.array(GRAVITY_M_S2),
        ends=Ends(),
        motion=experiment.motion,
        points=Points(
            frame=frame,
            t_s=experiment.frame_t_s[frame],
            s_m=point * sizes.length_m / (POINTS - 1),
            xyz_m=(case.points_m + case.noise_m)[frame, point],
        ),
        obstacles=experiment.obstacles,
        source=SOURCE,
        note="wall clamp at the start, gripper at the end",
        static_frames=(0, STATIC_FRAMES - 1),
        heldout_frames=(frames - HELDOUT_FRAMES, frames - 1),
    )


def truth(case: Case) -> dict[str, Any]:
    """What is true, in the form of data/practice/*/truth.json."""
    return {
        "effects": sorted(case.effects),
        "parameters": {name: dict(values) for name, values in case.effects.items()},
        "bending_stiffness": case.experiment.bending_stiffness,
        "torsional_stiffness": case.experiment.torsional_stiffness,
        "noise": vars(case.noise),
        "obstacles": len(case.experiment.obstacles),
        "bodies": case.bodies,
    }


def write_case(case: Case, name: str, recordings: Path, answers: Path, **more: Any) -> None:
    """Write recordings/<name>/ and answers/<name>.json, where `more` joins the answer.

    The answer tells which points belong to it: they are not to be made anew by another laboratory.
    """
    write_recording(recording(case, name), recordings / name)
    sha256 = hashlib.sha256((recordings / name / "points.csv").read_bytes()).hexdigest()
    write_json(answers / f"{name}.json", truth(case) | {"points_sha256": sha256} | more)
