"""RealSense recordings: their own times, colours in any order, depth brought to the colour camera."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from captures import foreign_samples as foreign
from captures.foreign_samples import Ros
from captures.realsense_samples import COLOR, DEPTH, UNITS, realsense
from captures.refusals import Refusals
from scipy.spatial.transform import Rotation

from dlolib.captures import ingest
from dlolib.captures.aligned import aligned
from dlolib.captures.lens import Lens
from dlolib.captures.realsense import RealSense

MATRIX = np.array([[600.0, 0, 320], [0, 600.0, 240], [0, 0, 1]])


def contents(folder: Path) -> dict[str, bytes]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


@pytest.mark.parametrize("color", ["rgb8", "bgr8", "rgba8", "bgra8"])
@pytest.mark.parametrize("scale", [1000.0, 4000.0])
def test_the_same_frames_give_the_same_capture(tmp_path: Path, color: str, scale: float) -> None:
    shot = replace(foreign.frames(), scale=scale)
    about = foreign.given(tmp_path / "object.json")
    source = realsense(tmp_path / "source.bag", shot, Ros(color=color))
    assert RealSense.matches(source)
    ingest(foreign.own(tmp_path / "own", shot), tmp_path / "expected")
    ingest(source, tmp_path / "out", object_json=about)
    assert contents(tmp_path / "out") == contents(tmp_path / "expected")


def test_depth_is_brought_to_the_color_camera(tmp_path: Path) -> None:
    """It stands 40 mm to the right: what is 0.6 m away moves by 2 pixels, what is 0.4 m away by 3."""
    shot = foreign.frames(1)
    shot.depth[:] = 600
    shot.depth[:, 10:14, 20:24] = 400
    beside = np.eye(4)
    beside[0, 3] = -0.04
    about = foreign.given(tmp_path / "object.json")
    source = realsense(tmp_path / "source.bag", shot, color_from_depth=beside)
    index = ingest(source, tmp_path / "out", object_json=about)
    assert index.depth is not None
    expected = np.full((foreign.HEIGHT, foreign.WIDTH), 600)
    expected[:, -2:] = 0
    # beside the nearer one is what it hides from the depth camera
    expected[10:14, 17:21], expected[10:14, 21:22] = 400, 0
    np.testing.assert_array_equal(cv2.imread(str(index.depth[0]), cv2.IMREAD_UNCHANGED), expected)


def test_a_turned_camera_leaves_no_gaps_and_reads_along_its_own_axis() -> None:
    """A plane 1 m before the one camera, seen by another that is turned by 3 degrees about two axes."""
    turned = np.eye(4)
    turned[:3, :3] = Rotation.from_rotvec([0.0, 0.05, 0.05]).as_matrix()
    turned[:3, 3] = 0.015, 0.002, -0.003
    depth = np.full((480, 640), 1000, np.uint16)
    seen = aligned(depth, 1000.0, MATRIX, MATRIX, turned, (480, 640))[40:-40, 60:-60]
    row, column = np.mgrid[40:440, 60:580]
    rays = np.stack([(column - 320) / 600, (row - 240) / 600, np.ones_like(row)], axis=-1)
    normal = turned[:3, 2]
    expected = 1000 * (1 + normal @ turned[:3, 3]) / (rays @ normal)
    assert np.abs(seen - expected).max() < 1.0


def test_what_is_nearer_hides_what_lies_behind_it() -> None:
    depth = np.full((480, 640), 1000, np.uint16)
    depth[:, 300:340] = 500
    beside = np.eye(4)
    beside[0, 3] = -0.05
    seen = aligned(depth, 1000.0, MATRIX, MATRIX, beside, (480, 640))
    np.testing.assert_array_equal(seen[:, 240:280], np.full((480, 40), 500))
    np.testing.assert_array_equal(seen[:, 280:310], np.zeros((480, 30)))
    assert (seen[:, 100:240] == 1000).all()
    assert not aligned(np.zeros((3, 3), np.uint16), 1000.0, MATRIX, MATRIX, beside, (480, 640)).any()


def test_the_lens_of_color_is_taken_out(tmp_path: Path) -> None:
    shot = foreign.frames(1)
    bent = (-0.055, 0.065, 0.001, -0.002, -0.02)
    about = foreign.given(tmp_path / "object.json")
    how = Ros(distortion=bent, model="Inverse Brown Conrady")
    index = ingest(realsense(tmp_path / "source.bag", shot, how), tmp_path / "out", object_json=about)
    matrix = np.eye(3)
    matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2] = foreign.OPTICS.values()
    flat = Lens(matrix, np.array(bent)).color(shot.color[0])
    assert index.color is not None and index.depth is not None
    np.testing.assert_array_equal(cv2.imread(str(index.color[0]))[..., ::-1], flat)
    np.testing.assert_array_equal(cv2.imread(str(index.depth[0]), cv2.IMREAD_UNCHANGED), shot.depth[0])


def test_what_cannot_be_used_is_refused(tmp_path: Path, refused: Refusals) -> None:
    path, shot = tmp_path / "source.bag", foreign.frames()
    foreign.given(refused.about)
    for how, lacking, says in (
        (Ros(color="mono8"), "none", f"{COLOR}/image/data: its encoding is 'mono8'; record color as RGB8"),
        (Ros(), COLOR, "color: holds no stream of color; record color as RGB8"),
        (Ros(), f"{DEPTH}/info", f"{DEPTH}/info/camera_info: has no message"),
        (Ros(), f"{COLOR}/tf", "does not say how the cameras of color and depth stand to each other"),
        (Ros(), UNITS, "camera.depth_scale: the recording does not say depth_scale"),
        (Ros(calibrated=False), "none", "the camera is not calibrated"),
        (Ros(model="Ftheta", distortion=(0.1,) * 5), "none", "its lens is 'Ftheta' with 5 numbers"),
    ):
        path.unlink(missing_ok=True)
        refused(realsense(path, shot, how, lacking=[lacking]), says)
    whole = realsense(tmp_path / "whole.bag", shot).read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    refused(path, "source.bag: the bag: cannot be read")


def test_a_person_s_word_on_the_units_counts(tmp_path: Path) -> None:
    shot = foreign.frames(1)
    about = foreign.given(
        tmp_path / "object.json", camera={"world_from_camera": foreign.VIEW.tolist(), "depth_scale": 2000.0}
    )
    beside = np.eye(4)
    beside[0, 3] = -0.04
    shot.depth[:] = 1200
    source = realsense(tmp_path / "source.bag", shot, color_from_depth=beside, lacking=[UNITS])
    index = ingest(source, tmp_path / "out", object_json=about)
    assert index.depth is not None and index.camera.depth_scale == 2000.0
    seen = cv2.imread(str(index.depth[0]), cv2.IMREAD_UNCHANGED)
    assert (seen[:, :-2] == 1200).all() and not seen[:, -2:].any()
