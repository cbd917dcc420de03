"""What `make deform` counts, where its rods start, and that it finds a material again."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dlolib.errors import ParameterError
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.types import Ends, Motion, Points, Recording, Rope
from stages import deform
from stages.deform import KINDS, fit, free, read, scores, simulated, until

TRUE = {"bending_stiffness": 0.03, "torsional_stiffness": 0.03, "inertia_drag.drag": 0.8}
ROPE = Rope("made up", 0.6)
MARKERS = np.array([0.0, 0.02, 0.15, 0.3, 0.45, 0.58, 0.6])
SHAKEN_FRAMES, RATE_HZ = 60, 100.0
HALF = np.sqrt(0.5)


def shaken(frames: int = SHAKEN_FRAMES, first: int = 0) -> Recording:
    """A rope between two clamps that point along x, one of which goes to and fro along y, from its `first`
    frame on: at that of 0 it hangs at rest."""
    t = np.arange(first + frames) / RATE_HZ
    x, q = np.zeros((len(t), 3)), np.tile([HALF, 0.0, HALF, 0.0], (len(t), 1))
    end = x + np.array([0.45, 0.0, 0.0])
    end[:, 1] = 0.04 * (1 - np.cos(2 * np.pi * 2.0 * t))
    frame = np.repeat(np.arange(len(t)), len(MARKERS))
    s_m = np.tile(MARKERS, len(t))
    points = Points(frame, t[frame], s_m, np.zeros((len(frame), 3)))
    motion = Motion(t, x, q, end, q)
    gravity = np.array([0.0, 0.0, -9.81])
    ends = Ends(start_roll_known=False, end_roll_known=False)
    blank = Recording("shaken", ROPE, gravity, ends, motion, points, quasi_static=False)
    xyz = simulated(blank, KINDS["elastic"], TRUE, rest=True)
    seen = frame >= first
    points = Points(frame[seen] - first, t[frame[seen]], s_m[seen], xyz[seen])
    held = (part[first:] for part in (t, x, q, end, q))
    return replace(blank, motion=Motion(*held), points=points)


def test_an_error_is_counted_per_coordinate_and_apart_from_the_held_ends() -> None:
    recording = shaken(2)
    off = np.zeros_like(recording.points.xyz_m)
    inner = free(recording.points)
    assert inner.reshape(2, -1).tolist() == [[False, True, True, True, True, True, False]] * 2
    off[inner] = [0.003, 0.0, -0.006]
    found = scores(recording, recording.points.xyz_m + off)
    assert found["free"] == pytest.approx(3.0)
    assert found["all"] == pytest.approx(3.0 * 5 / 7)
    assert found["by_marker"] == pytest.approx([0, 3, 3, 3, 3, 3, 0])
    assert found["over_time"] == pytest.approx([3.0 * 5 / 7])


def test_a_rope_that_swings_goes_on_as_it_was_seen_and_not_from_rest() -> None:
    swinging = shaken(first=12)
    seen, rest = (
        scores(swinging, simulated(swinging, KINDS["elastic"], TRUE, rest=rest))["free"]
        for rest in (False, True)
    )
    assert seen < 0.5
    assert rest > 4 * seen


def test_a_material_is_found_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deform, "HORIZONS", (20, SHAKEN_FRAMES))
    start = {"bending_stiffness": 0.01, "torsional_stiffness": 0.01, "inertia_drag.drag": 0.1}
    found = fit([shaken()], KINDS["elastic"], [start], deform.HORIZONS)
    assert found["bending_stiffness"] == pytest.approx(TRUE["bending_stiffness"], rel=0.05)
    assert found["inertia_drag.drag"] == pytest.approx(TRUE["inertia_drag.drag"], rel=0.1)


def test_a_fit_sees_the_first_frames_and_every_fourth_until_its_horizon() -> None:
    assert np.unique(until(shaken(20), 10).points.frame).tolist() == [0, 1, 2, 4, 8]


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"holds no deform_dlo1_train_\*; say where"):
        read(tmp_path, "deform_dlo1_train_")


def test_eval_has_no_part_in_the_choice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The kind that does best on what is left out of `train` is chosen, though another does so on `eval`."""
    train = [replace(shaken(4), name=name) for name in ("one", "two")]
    test = [replace(shaken(4), name="eval")]
    kinds = list(KINDS)

    def off(recording: Recording, kind: deform.Kind, values: dict[str, float], **_: object) -> np.ndarray:
        best = kinds[0] if recording.name == "eval" else kinds[1]
        return recording.points.xyz_m + (1e-3 if kind == KINDS[best] else 2e-3)

    monkeypatch.setattr(deform, "fits", lambda recordings: dict.fromkeys(KINDS, TRUE))
    monkeypatch.setattr(deform, "simulated", off)
    monkeypatch.setattr(deform, "read", lambda folder, prefix: train if "train" in prefix else test)
    monkeypatch.setattr(deform, "BOOK", tmp_path / "deform.json")
    deform.main("data", "dlo3")
    book = json.loads((tmp_path / "deform.json").read_text())
    row = book["cables"]["dlo3"]
    assert row["chosen"] == kinds[1] and row["command"] == "make deform DATA=DIR CASE=dlo3"
    assert row["kinds"][kinds[0]]["eval_mean_mm"] == pytest.approx({"all": 1.0, "free": 1.0})
    assert row["kinds"][kinds[1]]["left_out_mean_mm"] == pytest.approx({"all": 1.0, "free": 1.0})


def test_the_rod_that_starts_as_seen_has_the_derivatives_of_differences() -> None:
    model = deform.model_of(shaken(25, first=12), KINDS["elastic"])
    assert isinstance(model, RecordingModel)
    rod = Rod(ROPE, 1.0, 1.0, {}, model.particles).with_values(TRUE)
    by = model.predict(rod, list(TRUE)).by_parameter
    for column, (name, value) in enumerate(TRUE.items()):
        sides = (model.predict(rod.with_values({name: value * (1 + h)})).xyz_m for h in (1e-3, -1e-3))
        ahead, behind = sides
        expected = (ahead - behind) / (2e-3 * value)
        assert np.abs(by[:, :, column] - expected).max() < 1e-2 * np.abs(expected).max()
