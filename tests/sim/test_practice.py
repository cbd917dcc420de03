"""The laws against another solver's: recordings whose missing effects are known, simulated with them in."""

import json
from pathlib import Path

import numpy as np
import pytest

from dlolib.formats import read_recording
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod

PRACTICE = Path("../shared/data/practice")
NAMES = (
    "practice_none",
    "practice_none_correlated",
    "practice_none_hold",
    "practice_none_roll",
    "practice_friction",
    "practice_lump_and_clamp",
    "practice_plastic",
    "practice_soft_spot",
)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_left_is_the_noise(name: str) -> None:
    folder = PRACTICE / name
    if not folder.is_dir():
        pytest.skip(f"{folder} is not here: its data have no licence and are not in the repository")
    recording, truth = read_recording(folder), json.loads((folder / "truth.json").read_text("utf-8"))
    effects = {f"{e}.{p}": value for e, own in truth["parameters"].items() for p, value in own.items()}
    rod = Rod(recording.rope, truth["bending_stiffness"], truth["torsional_stiffness"], effects)
    xyz = RecordingModel(recording, rod.particles, 0.01).predict(rod).xyz_m
    square, sigma = np.mean((xyz - recording.points.xyz_m) ** 2), truth["noise"]["sigma_m"]
    # what is systematic, beside the noise: 0.2 % of the length a coordinate
    assert np.sqrt(max(square - sigma**2, 0.0)) < 0.002 * recording.rope.length_m
    assert np.sqrt(square) < 1.1 * sigma
