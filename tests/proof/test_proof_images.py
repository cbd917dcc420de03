"""A case as pictures: what the capture's folder says, and that the pictures show the rope where it is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dlolib.captures import open_capture
from dlolib.chain import extract_chain
from dlolib.lab.camera import Sensor
from dlolib.proof import pictures
from dlolib.proof.draw import Case, draw_case
from dlolib.proof.write import recording
from stages import proof_images

# Of a case's frames, so many: one takes most of a second.
FEW = 3


def shortened(case: Case, first: int = 0) -> Case:
    some = slice(first, first + FEW)
    experiment = replace(case.experiment, frame_t_s=case.experiment.frame_t_s[some])
    return replace(
        case,
        experiment=experiment,
        points_m=case.points_m[some],
        noise_m=case.noise_m[some],
        seen=case.seen[some],
    )


def test_the_chain_finds_the_rope_of_a_photographed_case(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = shortened(draw_case(5, 1, ()))
    given = replace(recording(case, "seen"), static_frames=None, heldout_frames=(2, 2))
    monkeypatch.setattr(pictures, "recording", lambda case, name: given)
    pictures.write_pictures(case, "seen", tmp_path / "capture", Sensor())
    assert sorted(path.name for path in tmp_path.glob("capture/*")) == [
        "capture.json", "color", "depth", "frames.csv", "motion.csv",
    ]  # fmt: skip
    found = extract_chain(open_capture(tmp_path / "capture")).recording
    assert found.heldout_frames == (2, 2) and found.points.covariance_m2 is not None
    assert np.array_equal(np.unique(found.points.t_s), case.experiment.frame_t_s)
    s_m = np.linspace(0, found.rope.length_m, case.points_m.shape[1])
    for frame, shape in enumerate(case.points_m):
        mine = found.points.frame == frame
        true = np.stack([np.interp(found.points.s_m[mine], s_m, axis) for axis in shape.T], axis=1)
        assert np.sqrt(np.mean(np.sum((found.points.xyz_m[mine] - true) ** 2, axis=1))) < 1e-3


def test_a_rope_that_is_moved_towards_the_plate_stays_before_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = draw_case(5, 4, ())
    farthest = int(case.points_m[..., 1].max(axis=1).argmax())
    case = shortened(case, farthest - 1)
    assert case.points_m[..., 1].max() > 0.1
    given = replace(recording(case, "seen"), static_frames=None, heldout_frames=(2, 2))
    monkeypatch.setattr(pictures, "recording", lambda case, name: given)
    pictures.write_pictures(case, "seen", tmp_path / "capture", Sensor())
    found = extract_chain(open_capture(tmp_path / "capture"))
    assert [len(frame.s_m) for frame in found.frames] == [30] * FEW


def test_what_the_camera_adds_is_as_secret_as_the_draw(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was seeded by the recording's number: the same in every run, and known to whoever reads the name."""
    seeds = []

    def photographed(case: object, name: str, capture: Path, sensor: Sensor) -> None:
        seeds.append(sensor.seed)
        raise InterruptedError

    monkeypatch.setattr(proof_images, "answered", lambda *_, **__: (None, {}))
    monkeypatch.setattr(proof_images, "write_case", lambda *_, **__: None)
    monkeypatch.setattr(proof_images, "write_pictures", photographed)
    for seed, index in ((7, 0), (7, 1), (8, 0), (7, 0)):
        with pytest.raises(InterruptedError):
            proof_images.seen(tmp_path, seed, index, ())
    assert len(set(seeds[:3])) == 3 and seeds[3] == seeds[0]
