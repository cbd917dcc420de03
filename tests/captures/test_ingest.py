"""Ingest: frames are checked and copied byte for byte; what cannot be used is refused in one line."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from chain.tubes import Scene, wave, write_capture

from dlolib.captures import ingest, open_capture
from dlolib.errors import DloError, FormatError
from dlolib.formats import read_capture_index
from dlolib.o3d import open3d

Spoil = Callable[[Path], None]


@pytest.fixture(scope="module")
def pristine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("captures") / "tube"
    write_capture(folder, [wave(0.5), wave(0.7)], Scene())
    return folder


@pytest.fixture
def capture(pristine: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(pristine, tmp_path / "source"))


def files(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


def test_every_byte_survives(capture: Path, tmp_path: Path) -> None:
    ingest(capture, tmp_path / "out")
    assert files(tmp_path / "out") == files(capture)


def test_a_capture_keeps_the_name_of_its_folder(capture: Path, tmp_path: Path) -> None:
    about = json.loads((capture / "capture.json").read_text())
    about.pop("name", None)
    (capture / "capture.json").write_text(json.dumps(about))
    named = read_capture_index(capture).name
    assert ingest(capture, tmp_path / "another").name == named == capture.name


def test_what_nothing_names_stays_behind(capture: Path, tmp_path: Path) -> None:
    (capture / "notes.txt").write_text("private")
    ingest(capture, tmp_path / "out")
    assert not (tmp_path / "out" / "notes.txt").exists()


def test_motion_from_elsewhere(capture: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "robot.csv"
    shutil.move(capture / "motion.csv", elsewhere)
    with pytest.raises(FormatError, match=r"motion\.csv"):
        ingest(capture, tmp_path / "out")
    index = ingest(capture, tmp_path / "out", elsewhere)
    assert index.motion is not None and (tmp_path / "out/motion.csv").read_bytes() == elsewhere.read_bytes()


def test_frames_are_metres_and_rgb(capture: Path) -> None:
    frames = list(open_capture(capture).frames())
    assert [frame.frame for frame in frames] == [0, 1]
    first = frames[0]
    assert first.color is not None and first.depth_m is not None
    raw = cv2.imread(str(capture / "depth/000000.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_allclose(first.depth_m, raw / 1000, rtol=1e-6)
    np.testing.assert_array_equal(first.color, cv2.imread(str(capture / "color/000000.png"))[..., ::-1])


def truncate(folder: Path) -> None:
    picture = folder / "depth/000001.png"
    picture.write_bytes(picture.read_bytes()[:-3000])


def truncate_before_the_end_mark(folder: Path) -> None:
    picture = folder / "color/000001.png"
    picture.write_bytes(picture.read_bytes()[:-12])


def flip_a_bit(folder: Path) -> None:
    picture = folder / "color/000000.png"
    content = bytearray(picture.read_bytes())
    content[len(content) // 2] ^= 1
    picture.write_bytes(bytes(content))


def swap_color_and_depth(folder: Path) -> None:
    table = (folder / "frames.csv").read_text()
    (folder / "frames.csv").write_text(table.replace("color,depth", "depth,color"))


def darken(folder: Path) -> None:
    cv2.imwrite(str(folder / "depth/000000.png"), np.zeros((576, 640), np.uint16))


def shrink(folder: Path) -> None:
    cv2.imwrite(str(folder / "depth/000001.png"), np.full((288, 320), 700, np.uint16))


def misstate_the_scale(folder: Path) -> None:
    text = json.loads((folder / "capture.json").read_text())
    text["camera"]["depth_scale"] = 5.0
    (folder / "capture.json").write_text(json.dumps(text))


def no_picture(folder: Path) -> None:
    (folder / "color/000000.png").write_text("hello")


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (truncate, r"depth/000001\.png.*truncated"),
        (truncate_before_the_end_mark, r"color/000001\.png.*truncated"),
        (flip_a_bit, r"color/000000\.png.*checksum"),
        (swap_color_and_depth, r"not 8-bit RGB"),
        (darken, r"depth/000000\.png.*zero everywhere"),
        (shrink, r"depth/000001\.png.*320 x 288 pixels.*640 x 576"),
        (misstate_the_scale, r"depth_scale"),
        (no_picture, r"color/000000\.png.*no PNG"),
    ],
)
def test_damage_is_refused_and_nothing_is_written(
    capture: Path, tmp_path: Path, spoil: Spoil, says: str
) -> None:
    spoil(capture)
    with pytest.raises(DloError, match=says) as refusal:
        ingest(capture, tmp_path / "out")
    assert "\n" not in str(refusal.value) and ";" in str(refusal.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["source"]


def test_never_over_the_source(capture: Path) -> None:
    before = files(capture)
    for out in (capture, capture.parent):
        with pytest.raises(FormatError, match="is or holds the input"):
            ingest(capture, out)
    assert files(capture) == before


def clouds(folder: Path, points: np.ndarray) -> Path:
    (folder / "cloud").mkdir(parents=True)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    open3d.io.write_point_cloud(str(folder / "cloud/000000.ply"), cloud)
    (folder / "frames.csv").write_text("frame,t_s,cloud\n0,0.0,cloud/000000.ply\n")
    optics = dict.fromkeys(("width", "height", "fx", "fy", "cx", "cy", "depth_scale"))
    content = {
        "format": "dlo-capture/1",
        "name": "clouds",
        "object": {"name": "rope", "length_m": 1.0, "diameter_m": None},
        "gravity_m_s2": [0, 0, -9.81],
        "ends": {"start": "free", "end": "free"},
        "obstacles": [],
        "camera": {**optics, "world_from_camera": np.eye(4).tolist()},
    }
    (folder / "capture.json").write_text(json.dumps(content))
    return folder


def test_a_cloud_survives_and_points_that_are_not_finite_are_left_out(tmp_path: Path) -> None:
    points = np.array([[0.0, 0.0, 0.5], [0.1, 0.0, 0.5], [np.nan, 0, 0.5]])
    source = clouds(tmp_path / "source", points)
    ingest(source, tmp_path / "out")
    assert files(tmp_path / "out") == files(source)
    (frame,) = open_capture(tmp_path / "out").frames()
    np.testing.assert_array_equal(frame.cloud_m, points[:2])


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (np.array([[0.0, 0, 500.0], [1, 0, 510]]), "millimetres"),
        (np.array([[0.0, 0, -0.5], [0.1, 0, -0.5]]), "behind the camera"),
        (np.full((3, 3), np.nan), "no finite point"),
    ],
)
def test_clouds_that_cannot_be_used(tmp_path: Path, points: np.ndarray, says: str) -> None:
    with pytest.raises(FormatError, match=says):
        ingest(clouds(tmp_path / "source", points), tmp_path / "out")


def test_a_truncated_cloud(tmp_path: Path) -> None:
    source = clouds(tmp_path / "source", np.random.default_rng(0).uniform(0.4, 0.5, (200, 3)))
    ply = source / "cloud/000000.ply"
    ply.write_bytes(ply.read_bytes()[:-500])
    with pytest.raises(FormatError, match=r"000000\.ply.*promises 200"):
        ingest(source, tmp_path / "out")
