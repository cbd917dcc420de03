"""What a lens bends comes straight, and color and depth to one camera."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from captures import foreign_samples as foreign
from captures.foreign_samples import Ros, files
from scipy.spatial.transform import Rotation

from dlolib.captures import ingest
from dlolib.captures.kinect_calibration import Calibration
from dlolib.captures.lens import Lens
from dlolib.captures.ros_images import Spot, lenses
from dlolib.errors import FormatError


def test_a_lens_is_taken_out_where_it_bends(tmp_path: Path) -> None:
    shot = foreign.frames()
    about = foreign.given(tmp_path / "object.json")
    bent = (-0.3, 0.1, 0.0, 0.0, 0.0)
    index = ingest(
        foreign.bag(tmp_path / "source.bag", shot, Ros(distortion=bent)), tmp_path / "out", object_json=about
    )
    assert index.depth is not None
    stored = cv2.imread(str(index.depth[0]), cv2.IMREAD_UNCHANGED)
    fx, fy, cx, cy = foreign.OPTICS.values()
    row, column = 3, 27
    x, y = (column - cx) / fx, (row - cy) / fy
    stretch = 1 + bent[0] * (x * x + y * y) + bent[1] * (x * x + y * y) ** 2
    seen = shot.depth[0, round(cy + fy * y * stretch), round(cx + fx * x * stretch)]
    assert stored[row, column] == seen != shot.depth[0, row, column]


ALIGNED = "/camera/aligned_depth_to_color/image_raw"


@pytest.mark.parametrize(
    ("color", "depth", "raw"),
    [
        ("/kinect2/qhd/image_color_rect", "/kinect2/qhd/image_depth_rect", set()),
        ("/camera/color/image_raw", "/camera/depth_registered/image_rect", {"color"}),
        ("/camera/color/image_raw", ALIGNED, {"color", "depth"}),
        # aligned to image_raw, of which image_rect_color is made
        ("/camera/color/image_rect_color", ALIGNED, {"depth"}),
        ("/camera/color/image_rect_raw", ALIGNED, set()),
        ("/camera/color/image_rectified", "/camera/depth_registered/image_rectified", set()),
    ],
)
def test_a_lens_is_taken_out_of_what_is_not_rectified(
    tmp_path: Path, color: str, depth: str, raw: set[str]
) -> None:
    shot = foreign.frames()
    about = foreign.given(tmp_path / "object.json")
    how = Ros(distortion=(-0.3, 0.1, 0.0, 0.0, 0.0), topics=(color, depth))
    index = ingest(foreign.bag(tmp_path / "source.bag", shot, how), tmp_path / "out", object_json=about)
    assert index.color is not None and index.depth is not None
    stored = {
        "color": cv2.imread(str(index.color[0]))[..., ::-1],
        "depth": cv2.imread(str(index.depth[0]), -1),
    }
    same = {"color": shot.color[0], "depth": shot.depth[0]}
    assert {name for name in stored if not np.array_equal(stored[name], same[name])} == raw


def test_a_raw_image_comes_to_the_pinhole_of_a_rectified_one() -> None:
    """Rectification scales: the raw colour's pixel 8 right of its centre is 4 right of the other's."""
    matrix, flat = np.array([[100.0, 0, 32], [0, 100, 24], [0, 0, 1]]), np.zeros((3, 4))
    flat[:, :3] = [[50, 0, 30], [0, 50, 20], [0, 0, 1]]
    whole = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
    sensor = {"binning_x": 0, "binning_y": 0, "roi": whole, "distortion_model": ""}
    info = SimpleNamespace(k=matrix.ravel(), d=[], p=flat.ravel(), r=np.eye(3).ravel(), **sensor)
    spot = Spot(Path("source.bag"), "/camera_info")
    found = lenses(info, {"color": False, "depth": True}, {}, spot)
    assert found["color"].optics == found["depth"].optics == {"fx": 50, "fy": 50, "cx": 30, "cy": 20}
    picture = np.zeros((48, 64, 3), np.uint8)
    picture[24, 40] = 200
    assert np.argwhere(found["color"].color(picture).any(axis=2)).tolist() == [[20, 34]]
    info.r = Rotation.from_rotvec([0, 0.02, 0]).as_matrix().ravel()
    with pytest.raises(FormatError, match="only one of color and depth is rectified; name the topics of two"):
        lenses(info, {"color": False, "depth": True}, {}, spot)
    assert lenses(info, {"color": True, "depth": True}, {}, spot)["color"].optics["fx"] == 50


def test_a_lens_is_taken_out_where_its_pinhole_is_given(tmp_path: Path) -> None:
    shot = foreign.frames()
    source = foreign.bag(tmp_path / "source.bag", shot, Ros(distortion=(-0.3, 0.1, 0.0, 0.0, 0.0)))
    said = foreign.given(tmp_path / "said.json")
    given = foreign.given(tmp_path / "given.json", camera=foreign.camera_of())
    ingest(source, tmp_path / "expected", object_json=said)
    ingest(source, tmp_path / "out", object_json=given)
    assert files(tmp_path / "out") == files(tmp_path / "expected")


@pytest.mark.parametrize("rect", ["raw", "rect"])
@pytest.mark.parametrize("region", [(0, 0, 0, 0), (6, 4, 64, 48)], ids=["whole", "part"])
def test_a_camera_info_of_the_whole_sensor_is_that_of_its_part_binned(
    tmp_path: Path, rect: str, region: tuple[int, int, int, int]
) -> None:
    shot = foreign.frames()
    about = foreign.given(tmp_path / "object.json")
    topics = (f"/camera/color/image_{rect}", f"/camera/depth/image_{rect}")
    how = Ros(binning=2, region=region, topics=topics)
    ingest(foreign.own(tmp_path / "own", shot), tmp_path / "expected")
    ingest(foreign.bag(tmp_path / "source.bag", shot, how), tmp_path / "out", object_json=about)
    assert files(tmp_path / "out") == files(tmp_path / "expected")


def test_a_camera_without_calibration_is_given_whole(tmp_path: Path) -> None:
    shot = foreign.frames()
    source = foreign.bag(tmp_path / "source.bag", shot, Ros(calibrated=False))
    given = foreign.given(tmp_path / "object.json", camera=foreign.camera_of())
    ingest(foreign.own(tmp_path / "own", shot), tmp_path / "expected")
    ingest(source, tmp_path / "out", object_json=given)
    assert files(tmp_path / "out") == files(tmp_path / "expected")


def test_color_is_brought_to_the_depth_camera() -> None:
    """A wall 0.5 m away, seen by a colour camera 50 mm to the right: fx 0.05 / 0.5 = 10 px."""
    lens = Lens(np.array([[100.0, 0, 31.5], [0, 100.0, 23.5], [0, 0, 1]]), np.zeros(8))
    pose = np.eye(4)
    pose[0, 3] = -0.05
    picture = np.zeros((48, 64, 3), np.uint8)
    picture[20, 30] = (255, 10, 20)
    depth = np.full((48, 64), 500, np.uint16)
    color, same = Calibration(lens, lens, pose).registered(picture, depth)
    assert np.argwhere(color.any(axis=2)).tolist() == [[20, 40]]
    np.testing.assert_array_equal(color[20, 40], (255, 10, 20))
    np.testing.assert_array_equal(same, depth)


@pytest.mark.parametrize(("rope", "wall"), [(225, 12), (30, 200)], ids=["bright", "dark"])
def test_what_the_rope_hides_from_the_color_camera_does_not_get_its_color(rope: int, wall: int) -> None:
    """A rope 0.5 m away before a wall at 1 m; the colour camera sees it 10 px, the wall 5 px further left."""
    lens = Lens(np.array([[100.0, 0, 31.5], [0, 100.0, 23.5], [0, 0, 1]]), np.zeros(8))
    pose = np.eye(4)
    pose[0, 3] = -0.05
    depth = np.full((48, 64), 1000, np.uint16)
    depth[:, 30:35] = 500
    picture = np.full((48, 64, 3), wall, np.uint8)
    picture[:, 20:25] = rope
    color, _ = Calibration(lens, lens, pose).registered(picture, depth)
    inside = color[:, 5:]  # what is further left the colour camera does not see
    np.testing.assert_array_equal(inside, np.where(depth[:, 5:, None] == 500, rope, wall) + np.zeros(3))
