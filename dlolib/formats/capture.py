"""Captures: capture.json, frames.csv and motion.csv (format "dlo-capture/1"); images stay unread."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Annotated, Any

import pandas as pd
from pydantic import AfterValidator, Field, field_validator

from dlolib.errors import FormatError
from dlolib.files import write_csv, write_json
from dlolib.formats._json import checked, existing, read_json
from dlolib.formats._plausible import check_clear, check_ends, check_ranges
from dlolib.formats._schema import FrameRange, Scene, Strict, scene_json
from dlolib.formats._table import Table, check_rising, check_whole, read_table
from dlolib.formats.motion import read_motion, write_motion
from dlolib.formats.recording import parse_view
from dlolib.types import Camera, CaptureIndex, Motion

FORM = "dlo-capture/1"
PICTURES = ("color", "depth", "cloud", "mask")
OPTICS = ("width", "height", "fx", "fy", "cx", "cy", "depth_scale")
MOST_PIXELS = 100_000
# OpenCV counts hue in steps of two degrees.
LAST_HUE = 179
Hue = Annotated[int, Field(ge=0, le=LAST_HUE)]
Level = Annotated[int, Field(ge=0, le=255)]
Hsv = Annotated[tuple[Hue, Level, Level], Field(strict=False)]


def _upwards(value: tuple[Hsv, Hsv]) -> tuple[Hsv, Hsv]:
    """Hue is a circle and may go through red; no saturation or value is from a low above the high one."""
    low, high = value
    for name, least, most in zip(("saturation", "value"), low[1:], high[1:], strict=True):
        if least > most:
            raise ValueError(f"the low {name} is above the high one: give [low, high]")
    return value


class Pinhole(Strict):
    """The only camera model that formats.md has: with another every point would be off."""

    distortion: list[float] | dict[str, float] | None = None

    @field_validator("distortion")
    @classmethod
    def _none(cls, value: list[float] | dict[str, float] | None) -> None:
        if value and any(value.values() if isinstance(value, dict) else value):
            raise ValueError("a capture's camera is a pinhole: undistort the images and leave this out")


class CameraModel(Pinhole):
    """The key `camera`; the optics may be null where the capture holds clouds."""

    width: int | None = Field(default=None, gt=0, le=MOST_PIXELS)
    height: int | None = Field(default=None, gt=0, le=MOST_PIXELS)
    fx: float | None = Field(default=None, gt=0)
    fy: float | None = Field(default=None, gt=0)
    cx: float | None = None
    cy: float | None = None
    depth_scale: float | None = Field(default=None, gt=0)
    world_from_camera: list[list[float]]


class CaptureScene(Scene):
    """capture.json without the camera."""

    rope_color_hsv: Annotated[tuple[Hsv, Hsv], Field(strict=False), AfterValidator(_upwards)] | None = None
    background_color: str | None = None
    background_depth: str | None = None
    static_frames: FrameRange | None = None
    heldout_frames: FrameRange | None = None
    quasi_static: bool = True
    rate_hz: float | None = Field(default=None, gt=0)


class CaptureModel(CaptureScene):
    """capture.json."""

    camera: CameraModel


def read_capture_index(folder: Path, motion_csv: Path | None = None) -> CaptureIndex:
    """Read and check what a capture says about itself; every file that it names exists afterwards.

    Args:
        folder: the capture.
        motion_csv: the motion of the ends, where it lies outside the capture.

    Raises:
        FormatError: names the file, its line and column or its key, and the mend.
    """
    folder = Path(folder)
    path = folder / "capture.json"
    model = checked(CaptureModel, read_json(path, FORM), path)
    table = read_table(folder / "frames.csv", ["frame", "t_s"], texts=PICTURES, optional=PICTURES)
    frame, times = check_whole(table, "frame"), check_rising(table, "t_s")
    check_rising(table, "frame")
    check_ranges(model.static_frames, model.heldout_frames, frame, "frames.csv", path)
    pictures = {name: _paths(table, name, folder) for name in PICTURES}
    _check_kinds(pictures, table.path)
    camera = _camera(model.camera, clouds=pictures["cloud"] is not None, path=path)
    return CaptureIndex(
        name=model.name or folder.resolve().name,
        folder=folder,
        rope=model.object.rope(),
        gravity_m_s2=model.gravity(),
        ends=model.parsed_ends(),
        camera=camera,
        frame=frame,
        t_s=times,
        **pictures,
        motion=_motion(Path(motion_csv or folder / "motion.csv"), model, motion_csv is not None),
        obstacles=model.parsed_obstacles(),
        rope_color_hsv=model.rope_color_hsv,
        background_color=background(path, model.background_color, "background_color"),
        background_depth=background(path, model.background_depth, "background_depth"),
        source=model.source or "",
        note=model.note or "",
        quasi_static=model.quasi_static,
        rate_hz=model.rate_hz,
        static_frames=model.static_frames,
        heldout_frames=model.heldout_frames,
    )


def write_capture_json(index: CaptureIndex, folder: Path) -> None:
    """Write capture.json into `folder`; paths under `index.folder` are written relative to it."""
    camera = index.camera
    content: dict[str, Any] = {
        "format": FORM,
        "name": index.name,
        "source": index.source,
        "note": index.note,
        **scene_json(index.rope, index.gravity_m_s2, index.ends, index.obstacles),
        "camera": {name: getattr(camera, name) for name in OPTICS}
        | {"world_from_camera": camera.world_from_camera.tolist()},
        "rope_color_hsv": index.rope_color_hsv,
        "background_color": _relative(index.background_color, index.folder),
        "background_depth": _relative(index.background_depth, index.folder),
        "static_frames": index.static_frames,
        "heldout_frames": index.heldout_frames,
        "quasi_static": index.quasi_static,
        "rate_hz": index.rate_hz,
    }
    write_json(Path(folder) / "capture.json", content)


def write_capture_index(index: CaptureIndex, folder: Path) -> None:
    """Write capture.json, frames.csv and (where there is one) motion.csv; the pictures are the caller's."""
    write_capture_json(index, folder)
    columns: dict[str, Any] = {"frame": index.frame, "t_s": index.t_s}
    for name in PICTURES:
        paths = getattr(index, name)
        if paths is not None:
            columns[name] = [_relative(path, index.folder) for path in paths]
    write_csv(Path(folder) / "frames.csv", pd.DataFrame(columns))
    if index.motion is not None:
        write_motion(index.motion, Path(folder) / "motion.csv")


def background(path: Path, name: str | None, key: str) -> Path | None:
    """The image of the empty scene that the JSON at `path` names under this key, in its own folder.

    Raises:
        FormatError: it lies elsewhere, or is not there.
    """
    if name is None:
        return None
    if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
        problem = f"{name!r} is no path within its folder"
        raise FormatError(problem, file=path, place=key, mend="give one relative to it")
    return existing(path.parent / name, f"{key} of {path.name}")


def _paths(table: Table, name: str, folder: Path) -> tuple[Path, ...] | None:
    """One existing file a frame, or None where the column is absent or empty throughout."""
    cells = table.texts.get(name)
    if cells is None or not any(cells):
        return None
    paths = []
    for row, cell in enumerate(cells):
        if not cell:
            raise table.refusal(row, name, "names no file", "give one in every row, or in none")
        if PurePosixPath(cell).is_absolute() or ".." in PurePosixPath(cell).parts:
            raise table.refusal(
                row, name, f"{cell!r} is no path within the capture", "give one relative to it"
            )
        if not (folder / cell).is_file():
            raise table.refusal(row, name, f"no such file: {cell}", "add it or remove the row")
        paths.append(folder / cell)
    return tuple(paths)


def _check_kinds(pictures: dict[str, tuple[Path, ...] | None], path: Path) -> None:
    """A capture has color and depth, or clouds."""
    if pictures["cloud"] is not None:
        return
    for name in ("color", "depth"):
        if pictures[name] is None:
            mend = "give the columns color and depth, or cloud"
            raise FormatError(f"no column {name}", file=path, place="line 1", mend=mend)


def _camera(model: CameraModel, clouds: bool, path: Path) -> Camera:
    view = parse_view(model.world_from_camera, path)
    for name in OPTICS:
        if getattr(model, name) is None and not clouds:
            raise FormatError("null", file=path, place=f"camera.{name}", mend="images need it: give a number")
    if model.depth_scale is not None and model.depth_scale < 1:
        problem = f"{model.depth_scale:g} units per metre"
        mend = f"looks like metres per unit; give {1 / model.depth_scale:g}"
        raise FormatError(problem, file=path, place="camera.depth_scale", mend=mend)
    return Camera(world_from_camera=view, **{name: getattr(model, name) for name in OPTICS})


def _motion(path: Path, model: CaptureModel, asked: bool) -> Motion | None:
    ends = model.parsed_ends()
    if not asked and not path.exists() and ends.start == ends.end == "free":
        return None
    motion = read_motion(path)
    check_ends(motion, ends, model.object.rope(), path)
    check_clear(motion, model.parsed_obstacles(), path)
    return motion


def _relative(path: Path | None, folder: Path) -> str | None:
    return None if path is None else path.relative_to(folder).as_posix()
