"""Every kind of recording, a pristine one of each, and what may befall it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from captures import foreign_samples as foreign
from captures.foreign_samples import Ros
from captures.harm import (
    Damage,
    bag_metadata,
    dark,
    enormous,
    exchanged,
    flipped,
    linked_outside,
    no_such_topic,
    outside_key,
    removed,
    resized,
    rewritten,
    swapped_lines,
    truncated,
    without_key,
)
from captures.harm_written import written_bag, written_kinect, written_realsense
from captures.realsense_samples import realsense
from chain.tubes import Scene, wave, write_capture

from dlolib.o3d import open3d

FREE = {"start": "free", "end": "free"}


@dataclass(frozen=True)
class Kind:
    """How a recording is written into a folder, what in it is the source, what may befall it."""

    source: str
    write: Callable[[Path], object]
    damages: tuple[Damage, ...]
    commands: tuple[str, ...] = ("ingest",)


def _own(place: Path) -> None:
    write_capture(place / "source", [wave(0.5), wave(0.6), wave(0.7)], Scene())


def _masked(place: Path) -> None:
    """A capture with masks, and images of the empty scene."""
    folder = place / "source"
    foreign.own(folder, foreign.frames())
    (folder / "mask").mkdir()
    lines = (folder / "frames.csv").read_text().splitlines()
    for row in range(3):
        cv2.imwrite(
            str(folder / f"mask/{row:06d}.png"), np.full((foreign.HEIGHT, foreign.WIDTH), 255, np.uint8)
        )
        lines[row + 1] += f",mask/{row:06d}.png"
    (folder / "frames.csv").write_text("\n".join([lines[0] + ",mask", *lines[1:], ""]))
    content = json.loads((folder / "capture.json").read_text())
    for kind in ("color", "depth"):
        shutil.copyfile(folder / f"{kind}/000000.png", folder / f"empty_{kind}.png")
        content[f"background_{kind}"] = f"empty_{kind}.png"
    (folder / "capture.json").write_text(json.dumps(content))


def _about(place: Path, **changes: Any) -> None:
    foreign.given(place / "object.json", ends=FREE, **changes)


def _tum(place: Path) -> None:
    _about(place, camera=foreign.camera_of())
    foreign.tum(place / "source", foreign.frames())


def _redwood(place: Path) -> None:
    _about(place)
    foreign.redwood(place / "source", foreign.frames())


def _bag(kind: str) -> Callable[[Path], None]:
    def write(place: Path) -> None:
        _about(place)
        foreign.bag(place / KINDS[kind].source, foreign.frames(), Ros(kind))

    return write


def _kinect(place: Path) -> None:
    _about(place)
    shot = foreign.frames(2, foreign.KINECT_WIDTH, foreign.KINECT_HEIGHT)
    foreign.kinect(place / "source.mkv", shot, foreign.calibration())


def _realsense(place: Path) -> None:
    _about(place)
    realsense(place / "source.bag", foreign.frames())


def _clouds(place: Path) -> None:
    _about(place, rate_hz=4.0)
    (place / "source").mkdir()
    for row in range(3):
        points = np.random.default_rng(row).uniform(0.4, 0.5, (200, 3))
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
        ascii_ply = bool(row % 2)
        open3d.io.write_point_cloud(str(place / f"source/{row:06d}.ply"), cloud, write_ascii=ascii_ply)


PICTURES = ("source/color/*", "source/depth/*")
RGB = ("source/rgb/*", "source/depth/*")
OPTICS = tuple(
    f"camera.{name}" for name in ("width", "height", "fx", "fy", "depth_scale", "world_from_camera")
)
# of TUM the units of depth are known
GIVEN_OPTICS = tuple(name for name in OPTICS if name != "camera.depth_scale")
SCENE = ("object", "object.length_m", "gravity_m_s2", "ends", "ends.start", "format")
# a motion may begin before the frames, as early as it likes
LATER = ["1e99", "nan", "soon", ""]
TIMES = ["-1", "0", "0.0", "1e99", "nan", "soon", ""]
OUTSIDE = [
    "../secret.png",
    "../../secret.png",
    "PLACE/secret.png",
    "/etc/hostname",
    "color/../../../secret.png",
    "",
]
ABOUT = (truncated("object.json"), without_key("object.json", *SCENE))
IN_BAG = (no_such_topic, no_such_topic, *ABOUT)

KINDS: dict[str, Kind] = {
    "capture": Kind(
        "source",
        _own,
        (
            truncated(*PICTURES),
            truncated("source/frames.csv"),
            truncated("source/motion.csv"),
            truncated("source/capture.json"),
            removed(*PICTURES, "source/*.csv", "source/*.json"),
            resized(*PICTURES),
            enormous(*PICTURES),
            exchanged(*PICTURES),
            dark("source/depth/*"),
            flipped(*PICTURES),
            without_key("source/capture.json", "camera", *OPTICS, *SCENE),
            swapped_lines("source/frames.csv"),
            swapped_lines("source/motion.csv"),
            rewritten("source/frames.csv", 1, TIMES),
            rewritten("source/motion.csv", 0, LATER),
            rewritten("source/frames.csv", 2, OUTSIDE),
            rewritten("source/frames.csv", 3, OUTSIDE),
            linked_outside(*PICTURES),
        ),
        ("ingest", "chain"),
    ),
    "masked": Kind(
        "source",
        _masked,
        (
            truncated("source/mask/*", "source/empty*"),
            removed("source/mask/*", "source/empty*"),
            resized("source/mask/*", "source/empty*"),
            enormous("source/mask/*", "source/empty*"),
            dark("source/empty_depth*"),
            rewritten("source/frames.csv", 4, OUTSIDE),
            outside_key("source/capture.json", "background_color", "background_depth"),
            linked_outside("source/mask/*", "source/empty*"),
        ),
    ),
    "tum": Kind(
        "source",
        _tum,
        (
            truncated(*RGB),
            truncated("source/*.txt"),
            removed(*RGB, "source/*.txt"),
            resized(*RGB),
            enormous(*RGB),
            exchanged(*RGB),
            dark("source/depth/*"),
            flipped(*RGB),
            swapped_lines("source/*.txt"),
            rewritten("source/*.txt", 0, ["-1", "nan", "soon", "1e99"], " "),
            rewritten("source/*.txt", 1, OUTSIDE, " "),
            without_key("object.json", *GIVEN_OPTICS),
            linked_outside(*RGB),
            *ABOUT,
        ),
    ),
    "redwood": Kind(
        "source",
        _redwood,
        (
            truncated(*PICTURES),
            truncated("source/camera_intrinsic.json"),
            removed(*PICTURES, "source/camera_intrinsic.json"),
            resized(*PICTURES),
            exchanged(*PICTURES),
            dark("source/depth/*"),
            flipped(*PICTURES),
            without_key("source/camera_intrinsic.json", "width", "height", "intrinsic_matrix"),
            linked_outside(*PICTURES),
            *ABOUT,
        ),
    ),
    "ros1": Kind(
        "source.bag", _bag("ros1"), (truncated("source.bag"), written_bag("ros1", "source.bag"), *IN_BAG)
    ),
    "ros2": Kind(
        "source", _bag("ros2"), (truncated("source/*"), written_bag("ros2", "source"), bag_metadata, *IN_BAG)
    ),
    "mcap": Kind(
        "source", _bag("mcap"), (truncated("source/*"), written_bag("mcap", "source"), bag_metadata, *IN_BAG)
    ),
    "kinect": Kind("source.mkv", _kinect, (truncated("source.mkv"), written_kinect, *ABOUT)),
    "realsense": Kind("source.bag", _realsense, (truncated("source.bag"), written_realsense, *ABOUT)),
    "clouds": Kind(
        "source",
        _clouds,
        (
            truncated("source/*"),
            linked_outside("source/*"),
            without_key("object.json", "rate_hz", "camera"),
            *ABOUT,
        ),
    ),
}


def draw(count: int, seed: int) -> Iterator[tuple[str, Damage, str, int]]:
    """Kind, damage, command and seed of `count` cases; each damage of each kind comes first, then chance."""
    rng = np.random.default_rng(seed)
    every = [(k, d, c) for k, kind in KINDS.items() for d in kind.damages for c in kind.commands]
    order = [*rng.permutation(len(every)), *rng.integers(len(every), size=max(count - len(every), 0))]
    for number, which in enumerate(order[:count]):
        kind, damage, command = every[int(which)]
        yield kind, damage, command, seed * 100_000 + number
