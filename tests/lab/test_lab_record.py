"""The capture that the laboratory writes, and its truth."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from dlolib.errors import DloError, ParameterError
from dlolib.formats.capture import read_capture_index
from dlolib.lab.camera import Sensor
from dlolib.lab.record import Experiment, record
from dlolib.lab.rope import LabRope

SMALL = Experiment(rope=LabRope(bodies=20), waypoints=20, frame_every=10)


def digest(folder: Path) -> dict[str, str]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lab")
    record(SMALL, folder / "capture", folder / "truth")
    return folder


def test_the_capture_is_readable_and_as_the_paper_has_it(recorded: Path) -> None:
    index = read_capture_index(recorded / "capture")
    assert index.motion is not None and len(index.motion.t_s) == 20
    assert np.allclose(index.t_s, index.motion.t_s[[9, 19]])
    assert index.rope.length_m == 0.445 and index.rope.diameter_m == 0.008
    assert index.camera.width == 640 and index.camera.depth_scale == 1000
    assert index.color is not None and index.depth is not None
    depth = cv2.imread(str(index.depth[1]), cv2.IMREAD_UNCHANGED)
    assert depth.shape == (576, 640) and depth.dtype == np.uint16
    assert cv2.imread(str(index.color[1])).shape == (576, 640, 3)


def test_nothing_in_the_capture_tells_the_truth(recorded: Path) -> None:
    text = (recorded / "capture" / "capture.json").read_text()
    assert "stiffness" not in text and "yield" not in text


def test_the_truth_has_law_and_shapes(recorded: Path) -> None:
    truth = json.loads((recorded / "truth" / "truth.json").read_text())
    assert truth["law"] == "plastic" and truth["bending_stiffness_n_m2"] == 3e-4
    with np.load(recorded / "truth" / "shapes.npz") as shapes:
        assert shapes["xyz_m"].shape == (2, 21, 3)
        assert np.allclose(shapes["xyz_m"][:, 0], 0, atol=1e-6)
        assert shapes["s_m"][-1] == pytest.approx(0.445)


def test_same_settings_same_bytes_and_another_seed_other_images(recorded: Path, tmp_path: Path) -> None:
    for name in ("capture", "truth"):
        assert not list(recorded.glob(f".{name}*"))
    record(SMALL, tmp_path / "capture", tmp_path / "truth")
    assert digest(tmp_path) == digest(recorded)
    record(replace(SMALL, sensor=Sensor(seed=2)), tmp_path / "capture", tmp_path / "truth")
    changed = {name for name, value in digest(tmp_path).items() if digest(recorded)[name] != value}
    assert changed and all(name.startswith(("capture/color", "capture/depth")) for name in changed)


def test_an_impossible_rope_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(DloError, match="apart"):
        record(replace(SMALL, rope=LabRope(length_m=0.3)), tmp_path / "capture", tmp_path / "truth")
    assert not list(tmp_path.iterdir())


def test_an_experiment_has_a_frame() -> None:
    assert replace(SMALL, frame_every=20).frame_every == 20
    with pytest.raises(ParameterError, match=r"^lab\.frame_every: 21 leaves no frame of 20 waypoints; give"):
        replace(SMALL, frame_every=21)
