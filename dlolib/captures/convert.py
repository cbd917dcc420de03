"""From a recording made elsewhere to a capture: what it does not say is asked for, the rest is checked."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dlolib.captures.clock import falls
from dlolib.captures.cloud_folder import read_cloud
from dlolib.captures.foreign import Foreign, Shot
from dlolib.captures.lens import PINHOLE
from dlolib.captures.pictures import check_backgrounds, check_color, check_depth
from dlolib.captures.plausible import check_inside, check_optics, check_times, cut_off
from dlolib.errors import FormatError
from dlolib.files import whole_folder
from dlolib.formats import (
    Given,
    motion_doubts,
    read_capture_index,
    read_given_motion,
    say,
    write_capture_index,
)
from dlolib.formats.capture import OPTICS
from dlolib.progress import track
from dlolib.types import Camera, CaptureIndex, Floats, Motion


@dataclass
class _Kept:
    """What was written of the shots so far."""

    t_s: list[float] = field(default_factory=list)
    color: list[Path] = field(default_factory=list)
    depth: list[Path] = field(default_factory=list)
    cloud: list[Path] = field(default_factory=list)


def convert(foreign: Foreign, path: Path, given: Given, out: Path, motion_csv: Path | None) -> CaptureIndex:
    """Write the capture of a recording made elsewhere, whole or not at all; times stay as recorded.

    Args:
        foreign: the recording, opened.
        path: where it lies, for messages.
        given: what no camera knows.
        out: the capture folder to write.
        motion_csv: the motion of the ends; None where the recording says it or both ends are free.

    Raises:
        FormatError: names the file, the place in it, and the mend.
    """
    motion = _motion(foreign, path, given, motion_csv)
    view = given.world_from_camera if given.world_from_camera is not None else foreign.world_from_camera
    if view is None:
        hint = foreign.hint
        mend = f"add it, 4 x 4, row major{hint and ', or --topic camera_pose=NAME: ' + hint}"
        problem = "the recording does not say where the camera stands"
        raise FormatError(problem, file=given.file, place="camera.world_from_camera", mend=mend)
    with whole_folder(out) as folder:
        kept = _Kept()
        camera: Camera | None = None
        for shot in track(_rising(foreign.shots()), "converting frames", foreign.count):
            camera = camera or _camera(foreign, given, view, images=shot.cloud is None)
            _keep(shot, camera, folder, kept)
        if camera is None:
            raise FormatError("holds no frame with color and depth", file=path, mend="record it again")
        index = _index(given, path, camera, kept, motion, folder)
        write_capture_index(_with_backgrounds(index, given), folder)
        if motion_csv is not None:
            shutil.copyfile(motion_csv, folder / "motion.csv")
        odd = _check_written(folder, path, motion_csv)
    say([*foreign.doubts, *odd])
    return read_capture_index(out)


def _check_written(folder: Path, path: Path, motion_csv: Path | None) -> list[str]:
    """Read the capture before it appears: what is wrong with it is wrong with the recording, or with the
    table of the motion, of which is said what is odd."""
    try:
        index = read_capture_index(folder)
        check_times(index, motion_csv or folder / "motion.csv")
        check_optics(index)
        if index.motion is None:
            return []
        cut = [] if motion_csv is None else cut_off(motion_csv)
        return [*cut, *motion_doubts(index.motion, index.t_s, motion_csv or path)]
    except FormatError as error:
        if motion_csv is not None and error.file == motion_csv:
            raise
        name = error.file.name if error.file else ""
        place = ", ".join(part for part in (f"as {name}", error.place) if part)
        raise FormatError(error.problem, file=path, place=place, mend=error.mend) from error


def _motion(foreign: Foreign, path: Path, given: Given, motion_csv: Path | None) -> Motion | None:
    if motion_csv is not None:
        if not np.array_equal(given.tool_from_grasp, np.eye(4)):
            problem = f"counts with --topic motion=NAME alone: {motion_csv.name} holds the poses of the ends"
            mend = "leave it out, or write the poses of the rope's ends into the table"
            raise FormatError(problem, file=given.file, place="tool_from_grasp", mend=mend)
        return read_given_motion(motion_csv, given)
    if foreign.motion is not None:
        return foreign.motion
    if given.ends.start == given.ends.end == "free":
        return None
    hint = foreign.hint
    mend = f"give --motion CSV{hint and ', or --topic motion=NAME: ' + hint}"
    mend += f', or call both ends "free" in {given.file.name}'
    raise FormatError("does not say how the held ends move", file=path, place="motion", mend=mend)


def _camera(foreign: Foreign, given: Given, view: Floats, images: bool) -> Camera:
    """The person's word before the recording's; images, those of the empty scene too, need all of it."""
    known = {**foreign.optics, **given.optics}
    lacking = [name for name in OPTICS if name not in known]
    if lacking and (images or given.background_color or given.background_depth):
        problem = f"the recording does not say {', '.join(lacking)}"
        mend = f'add "camera": {{"{lacking[0]}": ...}}, pixels; depth_scale in units per metre'
        raise FormatError(problem, file=given.file, place=f"camera.{lacking[0]}", mend=mend)
    _check_resized(foreign, given)
    numbers = {name: float(known[name]) for name in OPTICS[2:] if name in known}
    width, height = (None if known.get(name) is None else int(known[name]) for name in OPTICS[:2])
    return Camera(view, width, height, **numbers)


def _check_resized(foreign: Foreign, given: Given) -> None:
    """Refuse a size that a person gives beside a focal length or centre of the recording's own size."""
    theirs, ours = foreign.optics, given.optics
    resized = any(name in theirs and ours.get(name, theirs[name]) != theirs[name] for name in OPTICS[:2])
    left = [name for name in PINHOLE if name not in ours]
    if resized and left:
        problem = "is the recording's, which is of another width and height than those given"
        mend = f"give {', '.join(left)} of that size, too"
        raise FormatError(problem, file=given.file, place=f"camera.{left[0]}", mend=mend)


def _rising(shots: Iterator[Shot]) -> Iterator[Shot]:
    """Refuse a clock that stands still or goes back."""
    before: float | None = None
    for shot in shots:
        if not np.isfinite(shot.t_s):
            raise FormatError("its time is no number", file=shot.file, place=shot.place, mend="correct it")
        if before is not None and (problem := falls(before, shot.t_s)):
            raise FormatError(problem, file=shot.file, place=shot.place, mend="mend the clock or the order")
        before = shot.t_s
        yield shot


def _keep(shot: Shot, camera: Camera, folder: Path, kept: _Kept) -> None:
    """Check one shot and write its files."""
    name = f"{len(kept.t_s):06d}"
    kept.t_s.append(shot.t_s)
    if shot.cloud is not None:
        read_cloud(shot.cloud)
        kept.cloud.append(folder / "cloud" / f"{name}.ply")
        kept.cloud[-1].parent.mkdir(exist_ok=True)
        shutil.copyfile(shot.cloud, kept.cloud[-1])
        return
    assert shot.color is not None and shot.depth is not None
    check_color(shot.color, camera, shot.file, shot.place)
    check_depth(shot.depth, camera, shot.file, shot.place)
    kept.color.append(folder / "color" / f"{name}.png")
    kept.depth.append(folder / "depth" / f"{name}.png")
    _write(kept.color[-1], cv2.cvtColor(shot.color, cv2.COLOR_RGB2BGR))
    _write(kept.depth[-1], shot.depth)


def _with_backgrounds(index: CaptureIndex, given: Given) -> CaptureIndex:
    """The index with the images of the empty scene, checked and copied byte for byte."""
    color, depth = given.background_color, given.background_depth
    check_inside([image for image in (color, depth) if image is not None], given.file.parent)
    check_backgrounds(color, depth, index.camera)
    return replace(
        index,
        background_color=_copied(color, index.folder / "background_color.png"),
        background_depth=_copied(depth, index.folder / "background_depth.png"),
    )


def _copied(image: Path | None, target: Path) -> Path | None:
    return None if image is None else Path(shutil.copyfile(image, target))


def _write(path: Path, image: NDArray[Any]) -> None:
    path.parent.mkdir(exist_ok=True)
    _, data = cv2.imencode(".png", image)
    path.write_bytes(data.tobytes())


def _index(
    given: Given, path: Path, camera: Camera, kept: _Kept, motion: Motion | None, folder: Path
) -> CaptureIndex:
    return CaptureIndex(
        name=given.name or path.stem,
        folder=folder,
        rope=given.rope,
        gravity_m_s2=given.gravity_m_s2,
        ends=given.ends,
        camera=camera,
        frame=np.arange(len(kept.t_s)),
        t_s=np.array(kept.t_s),
        color=tuple(kept.color) or None,
        depth=tuple(kept.depth) or None,
        cloud=tuple(kept.cloud) or None,
        motion=motion,
        obstacles=given.obstacles,
        rope_color_hsv=given.rope_color_hsv,
        source=given.source,
        note=given.note,
        quasi_static=given.quasi_static,
        rate_hz=given.rate_hz,
        static_frames=given.static_frames,
        heldout_frames=given.heldout_frames,
    )
