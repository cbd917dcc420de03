"""From any source to a checked capture: this project's own folder as it is, all others converted."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path

from dlolib.captures.base import Source
from dlolib.captures.cloud_folder import CloudFolder
from dlolib.captures.clouds import Clouds
from dlolib.captures.convert import convert
from dlolib.captures.foreign import Asked, Foreign
from dlolib.captures.image_folder import ImageFolder
from dlolib.captures.kinect import AzureKinect
from dlolib.captures.pictures import check_backgrounds
from dlolib.captures.plausible import Doubted, check_inside, check_optics, check_times, doubts
from dlolib.captures.realsense import RealSense
from dlolib.captures.redwood import RedwoodFolder
from dlolib.captures.ros import RosBag
from dlolib.captures.tum import TumFolder
from dlolib.errors import FormatError, ParameterError
from dlolib.files import whole_folder, write_json
from dlolib.formats import read_capture_index, read_given, say
from dlolib.outputs import check_out
from dlolib.progress import track
from dlolib.types import CaptureIndex

# The first that matches is taken; RealSense's bags are ROS 1 bags, too.
FORMATS: tuple[type[Foreign], ...] = (TumFolder, RedwoodFolder, RealSense, RosBag, AzureKinect, Clouds)


def open_capture(folder: Path) -> Source:
    """Open a capture folder (format "dlo-capture/1"); its images stay unread until `frames()`.

    Raises:
        FormatError: names file, place and mend.
    """
    folder = Path(folder)
    if not (folder / "capture.json").is_file() and not (folder / "frames.csv").is_file():
        _name_the_way(folder)
    index = read_capture_index(folder)
    _check(index, index.folder / "motion.csv")
    return Doubted(_source(index))


def _name_the_way(source: Path) -> None:
    """A recording of other software is no capture yet: say which command makes one of it."""
    found = next((kind for kind in FORMATS if kind.matches(source)), None)
    if found is not None:
        mend = f"make one of it: dlo ingest {source.name} --out DIR"
        raise FormatError(f"is a {found.kind}, no capture folder", file=source, mend=mend)


def ingest(
    source: Path,
    out: Path,
    motion_csv: Path | None = None,
    topics: Mapping[str, str] | None = None,
    object_json: Path | None = None,
) -> CaptureIndex:
    """Check every frame of a recording and write it to `out` as a capture (format "dlo-capture/1").

    Args:
        source: a capture folder, which is copied byte for byte, or a recording in one of `FORMATS`.
        out: the capture folder to write, whole or not at all.
        motion_csv: the motion of the ends, where it lies elsewhere; it replaces the source's own.
        topics: of a bag, the topic of each role.
        object_json: what no camera knows, as a capture.json whose camera may be left out; by default the
            capture.json in the source's folder, or the JSON beside the source's file.

    Returns:
        The index of the capture that was written.

    Raises:
        FormatError: names the first file that cannot be used, the place in it, and the mend.
        ParameterError: a topic's role that the format does not know.
    """
    source, out = Path(source), Path(out)
    check_out(out, ("capture.json", "frames.csv"), source)
    if (found := _format(source)) is None:
        return _copied(source, out, motion_csv, topics, object_json)
    _check_roles(found, topics or {})
    if motion_csv is not None and "motion" in (topics or {}):
        raise ParameterError("the motion is given twice", place="--motion, --topic", mend="give one of them")
    check_inside((path for path in source.rglob("*") if path.is_symlink()), source)
    given = read_given(_object(source, object_json))
    foreign = found.open(source, Asked(given, topics or {}))
    return convert(foreign, source, given, out, motion_csv)


def _format(source: Path) -> type[Foreign] | None:
    """The format of a recording made elsewhere; None for a capture folder, also where it is damaged.

    Raises:
        FormatError: a file, or a folder that is no capture, in no known format.
    """
    if source.is_dir() and (source / "frames.csv").is_file():
        return None
    found = next((kind for kind in FORMATS if kind.matches(source)), None)
    if found is None and source.exists() and not (source / "capture.json").is_file():
        known = "; ".join(kind.kind for kind in FORMATS)
        raise FormatError(
            "is in no known format", file=source, mend=f"give a capture folder, or one of: {known}"
        )
    return found


def _check_roles(found: type[Foreign], topics: Mapping[str, str]) -> None:
    for role in topics:
        if role not in found.roles:
            known = f"choose from {', '.join(found.roles)}" if found.roles else "leave it out"
            problem = f"a {found.kind} has no topic of {role!r}"
            raise ParameterError(problem, place=f"--topic {role}", mend=known)


def _object(source: Path, given: Path | None) -> Path:
    beside = source / "capture.json" if source.is_dir() else source.with_suffix(".json")
    if given is None and not beside.is_file():
        mend = f"give --object FILE with object, gravity_m_s2 and ends, or put it into {beside.name}"
        raise FormatError("does not say which object was recorded", file=source, place="object", mend=mend)
    return Path(given or beside)


def _copied(
    source: Path,
    out: Path,
    motion_csv: Path | None,
    topics: Mapping[str, str] | None,
    object_json: Path | None,
) -> CaptureIndex:
    if not source.exists():
        what = "file" if source.suffix else "folder"
        raise FormatError(f"no such {what}", file=source, mend="correct the path")
    for option, value in (("--topic", topics), ("--object", object_json)):
        if value:
            problem = "a capture folder has no topics and says itself what was recorded"
            raise ParameterError(problem, place=option, mend="leave it out")
    index = read_capture_index(source, motion_csv)
    table = Path(motion_csv or index.folder / "motion.csv")
    _check(index, table)
    check_backgrounds(index.background_color, index.background_depth, index.camera)
    for _ in track(_source(index).frames(), "checking frames", len(index.frame)):
        pass
    with whole_folder(out) as temporary:
        for path in _named(index):
            _copy(path, temporary / path.relative_to(index.folder))
        if index.motion is not None:
            _copy(table, temporary / "motion.csv")
        _keep_name(index.name, temporary / "capture.json")
    say(doubts(index, table))
    return read_capture_index(out)


def _check(index: CaptureIndex, motion_csv: Path) -> None:
    """What the form alone does not tell: links that lead outside, clocks and optics that cannot be."""
    own = [motion_csv] if motion_csv.parent == index.folder else []  # what was named may be anywhere
    check_inside([*_named(index), *own], index.folder)
    check_times(index, motion_csv)
    check_optics(index)


def _source(index: CaptureIndex) -> Source:
    return ImageFolder(index) if index.cloud is None else CloudFolder(index)


def _named(index: CaptureIndex) -> list[Path]:
    """The files that make up the capture, without motion.csv; what nothing names stays behind."""
    paths = [index.folder / "capture.json", index.folder / "frames.csv"]
    for column in (index.color, index.depth, index.cloud, index.mask):
        paths.extend(column or ())
    paths.extend(path for path in (index.background_color, index.background_depth) if path is not None)
    return paths


def _keep_name(name: str, path: Path) -> None:
    """Write the capture's name where it was its folder's alone, which now is another."""
    content = json.loads(path.read_text(encoding="utf-8-sig"))
    if "name" not in content:
        write_json(path, {**content, "name": name})


def _copy(origin: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(origin, target)
