"""What `make sweeps` counts."""

import json
from pathlib import Path

import numpy as np
import pytest
from diagnose.test_diagnose import made

from dlolib.types import Points
from stages import sweeps
from stages.sweeps import halved, tip_rmse


def test_a_tip_is_the_furthest_point_of_its_frame() -> None:
    frame = np.array([3, 3, 4, 4, 5])
    s_m = np.array([0.3, 0.6, 0.6, 0.3, 0.3])
    points = Points(frame, 0.1 * frame, s_m, np.zeros((5, 3)))
    assert tip_rmse(points, np.array([9.0, 1.0, 2.0, 9.0, 4.0])) == pytest.approx(np.sqrt(7.0))


def test_the_second_half_is_held_out() -> None:
    recording = made({})
    first, last = halved(recording).heldout_frames
    frames = np.unique(recording.points.frame)
    assert last == frames[-1]
    assert abs(np.sum(frames < first) - np.sum(frames >= first)) <= 1


def test_a_case_by_name_leaves_what_is_known_of_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = {"status": "explained", "named": [], "tip_rmse_m": {}, "foretold_tip_rmse_m": None}
    monkeypatch.setattr(sweeps, "BOOK", tmp_path / "sweeps.json")
    monkeypatch.setattr(sweeps, "_whole", lambda folder: folder.name)
    monkeypatch.setattr(sweeps, "diagnose", lambda recordings, settings: recordings)
    monkeypatch.setattr(sweeps, "_row", lambda recordings: found | {"recordings": recordings})
    sweeps.main("data", "settled")
    sweeps.main("data", "whole")
    cases = json.loads((tmp_path / "sweeps.json").read_text())["cases"]
    assert {name: len(row["recordings"]) for name, row in cases.items()} == {"settled": 4, "whole": 2}
    assert cases["settled"]["command"] == "make sweeps DATA=DIR CASE=settled"
