"""Folders of images that cannot be used: status 2, one line with file, place and mend, nothing written."""

from __future__ import annotations

import itertools
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from captures import foreign_samples as foreign
from captures.refusals import Refusals, told

Spoil = Callable[[Path], object]
ROS = ("ros1", "ros2", "mcap")


def cut(name: str, share: float = 0.5) -> Spoil:
    def spoil(folder: Path) -> None:
        path = sorted(folder.glob(name))[1] if "*" in name else folder / name
        path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])

    return spoil


def line(name: str, row: int, text: str) -> Spoil:
    def spoil(folder: Path) -> None:
        lines = (folder / name).read_text().splitlines()
        lines[row] = text
        (folder / name).write_text("\n".join(lines) + "\n")

    return spoil


def missing(name: str) -> Spoil:
    return lambda folder: (folder / name).unlink()


def small(name: str) -> Spoil:
    return lambda folder: cv2.imwrite(str(sorted(folder.glob(name))[1]), np.full((12, 16), 700, np.uint16))


def dark(name: str) -> Spoil:
    return lambda folder: cv2.imwrite(str(sorted(folder.glob(name))[1]), np.zeros((24, 32), np.uint16))


def swapped(first: str, second: str) -> Spoil:
    def spoil(folder: Path) -> None:
        (folder / first).rename(folder / "between")
        (folder / second).rename(folder / first)
        (folder / "between").rename(folder / second)

    return spoil


def outside(name: str) -> Spoil:
    """A list that names a picture beside its folder, which exists."""

    def spoil(folder: Path) -> None:
        shutil.copyfile(next(folder.glob("depth/*.png")), folder.parent / "secret.png")
        line(name, 1, "1700000000.123000 ../secret.png")(folder)

    return spoil


def drifting(folder: Path) -> None:
    foreign.ground_truth(folder, foreign.frames(), drift_m=0.02)


TUM: list[tuple[Spoil, str]] = [
    (cut("depth/*.png"), "is truncated"),
    (cut("rgb/*.png"), "is truncated"),
    (missing("rgb.txt"), "rgb.txt: no such file"),
    (missing("depth.txt"), "depth.txt: no such file"),
    (outside("depth.txt"), "depth.txt: line 2: '../secret.png' is no path within the folder"),
    (line("rgb.txt", 2, "1700000000.227 /etc/hostname"), "rgb.txt: line 3: '/etc/hostname' is no path"),
    (line("rgb.txt", 2, "1700000000.227 rgb/none.png"), "rgb.txt: line 3: no such file: rgb/none.png"),
    (line("rgb.txt", 2, "1700000000.227"), "rgb.txt: line 3: '' is no path within the folder"),
    (line("rgb.txt", 2, "soon rgb/a.png"), "rgb.txt: line 3: 'soon' is no time"),
    (line("depth.txt", 2, "1600000000.0 depth/a.png"), "depth.txt: line 3: time goes back from 17"),
    (
        small("depth/*.png"),
        "the camera 32 x 24; give the camera's width, height, fx, fy, cx and cy of this size, or correct",
    ),
    (dark("depth/*.png"), "depth is zero everywhere"),
    (swapped("rgb.txt", "depth.txt"), "is depth named as color?"),
    (lambda folder: (folder / "rgb.txt").write_text("# nothing\n"), "rgb.txt: has no rows"),
    (lambda folder: (folder / "rgb.txt").write_bytes(b"\xff\xfe\x00"), "rgb.txt: is not text in UTF-8"),
]


@pytest.mark.parametrize(("spoil", "says"), TUM, ids=told)
def test_tum(tmp_path: Path, refused: Refusals, spoil: Spoil, says: str) -> None:
    spoil(foreign.tum(tmp_path / "source", foreign.frames()))
    refused(tmp_path / "source", says)


def test_a_camera_that_moves(tmp_path: Path, refused: Refusals) -> None:
    folder = foreign.tum(tmp_path / "source", foreign.frames())
    optics = {name: value for name, value in foreign.camera_of().items() if name != "world_from_camera"}
    foreign.given(refused.about, camera=optics)
    refused(folder, "camera.world_from_camera: the recording does not say where the camera stands; add it")
    drifting(folder)
    refused(folder, "groundtruth.txt: poses: the camera moves by 0.02 m")
    line("groundtruth.txt", 2, "1700000000.2 2.0 3.0")(folder)
    refused(folder, "groundtruth.txt: line 3: is no pose")


def test_color_and_depth_of_two_clocks(tmp_path: Path, refused: Refusals) -> None:
    folder = foreign.tum(tmp_path / "source", foreign.frames())
    text = (folder / "rgb.txt").read_text()
    (folder / "rgb.txt").write_text(text.replace("\n170", "\n180"))
    refused(folder, "the nearest color and depth images are 1e+08 s apart; bring both to one clock")


@pytest.mark.parametrize("write", [foreign.tum, foreign.redwood])
def test_a_missing_calibration(tmp_path: Path, refused: Refusals, write: Callable[..., Path]) -> None:
    folder = write(tmp_path / "source", foreign.frames())
    for path in folder.glob("*.json"):
        path.unlink()
    foreign.given(refused.about)
    refused(
        folder, "object.json: camera.width: the recording does not say width, height, fx, fy, cx, cy; add"
    )


def intrinsics(**changes: Any) -> Spoil:
    def spoil(folder: Path) -> None:
        path = folder / "camera_intrinsic.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | changes))

    return spoil


def unnamed(folder: Path) -> None:
    for path in [*folder.glob("*/*.png")]:
        path.rename(path.with_name(f"{path.stem[:7]}.png"))


def unnumbered(folder: Path) -> None:
    unnamed(folder)
    (folder / "color/0000002.png").unlink()


def late(folder: Path) -> None:
    """The colour images are of half a second later."""
    for path in [*folder.glob("color/*.png")]:
        path.rename(path.with_name(f"{path.stem[:8]}{int(path.stem[8:]) + 500_000}.png"))


def truncated_jpeg(folder: Path) -> None:
    path = sorted(folder.glob("color/*.png"))[1]
    data = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (24, 32, 3), np.uint8))[1].tobytes()
    path.with_suffix(".jpg").write_bytes(data[:-20])
    path.unlink()


REDWOOD: list[tuple[Spoil, str]] = [
    (cut("color/*.png"), "is truncated"),
    (truncated_jpeg, "is a damaged JPEG"),
    (swapped("color", "depth"), "is depth named as color?"),
    (small("depth/*.png"), "is 16 x 12 pixels, the camera 32 x 24"),
    (intrinsics(width=31), "is 32 x 24 pixels, the camera 31 x 24"),
    (intrinsics(intrinsic_matrix=[1, 2, 3]), "camera_intrinsic.json: is no camera of Open3D"),
    (
        intrinsics(intrinsic_matrix=[0] * 8 + [1]),
        "camera_intrinsic.json: a number in it is none, or not posi",
    ),
    (
        intrinsics(intrinsic_matrix=[30, 0, 15.5, 0, 31, 11.25, 0, 0, 1]),
        "intrinsic_matrix: the last row of the camera's matrix is [15.5, 11.25, 1.0], not [0, 0, 1]; give",
    ),
    (intrinsics(fps="fast"), "camera_intrinsic.json: a number in it is none, or not positive"),
    (cut("camera_intrinsic.json"), "camera_intrinsic.json: is no camera of Open3D"),
    (
        lambda folder: (folder / "camera_intrinsic.json").write_text("[" * 200000),
        "camera_intrinsic.json: is no camera of Open3D",
    ),
    (intrinsics(depth_scale=1.0), "with depth_scale 1; correct camera.depth_scale"),
    (unnumbered, "color: no image with the number of 0000002.png"),
    (late, "source: the nearest color and depth images are 0.3 s apart; bring both to one clock"),
    (unnamed, "object.json: rate_hz: when 0000001.png was taken is not recorded"),
]


@pytest.mark.parametrize(("spoil", "says"), REDWOOD, ids=told)
def test_redwood(tmp_path: Path, refused: Refusals, spoil: Spoil, says: str) -> None:
    foreign.given(refused.about)
    spoil(foreign.redwood(tmp_path / "source", foreign.frames()))
    refused(tmp_path / "source", says)


def test_a_size_without_its_focal_length(tmp_path: Path, refused: Refusals) -> None:
    camera = foreign.camera_of()
    wrong = intrinsics(width=64, height=48)
    wrong(foreign.redwood(tmp_path / "source", foreign.frames()))
    foreign.given(refused.about, camera={name: camera[name] for name in camera if name not in foreign.OPTICS})
    says = "object.json: camera.fx: is the recording's, which is of another width and height than those given"
    refused(tmp_path / "source", says)
    foreign.given(refused.about, camera=camera)
    assert refused.status(tmp_path / "source")[0] == 0


def test_times_in_names_that_go_back(tmp_path: Path, refused: Refusals) -> None:
    shot = foreign.frames()
    refused(foreign.redwood(tmp_path / "source", replace(shot, ns=shot.ns[::-1])), "time goes back from 17")


def test_names_that_are_times_and_no_numbers(tmp_path: Path, refused: Refusals) -> None:
    foreign.given(refused.about, rate_hz=30.0)
    source = foreign.redwood(tmp_path / "source", foreign.frames())
    for row, folder in itertools.product(range(3), ("color", "depth")):
        (path,) = (source / folder).glob(f"{row + 1:07d}-*.png")
        path.rename(path.with_name(f"{1_700_000_000_123 + 33 * row}.png"))
    refused(source, "1700000000123.png: its name looks like a time, and not like the number")
