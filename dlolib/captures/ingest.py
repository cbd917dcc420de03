"""From a source to a checked capture: every frame is read once, then the bytes are copied as they are."""

from __future__ import annotations

import shutil
from pathlib import Path

from dlolib.captures.base import Source
from dlolib.captures.cloud_folder import CloudFolder
from dlolib.captures.image_folder import ImageFolder
from dlolib.captures.pictures import read_color, read_depth
from dlolib.errors import FormatError
from dlolib.files import whole_folder
from dlolib.formats import read_capture_index
from dlolib.progress import track
from dlolib.types import CaptureIndex


def open_capture(folder: Path) -> Source:
    """Open a capture folder (format "dlo-capture/1"); its images stay unread until `frames()`.

    Raises:
        FormatError: names file, place and mend.
    """
    return _source(read_capture_index(Path(folder)))


def ingest(source: Path, out: Path, motion_csv: Path | None = None) -> CaptureIndex:
    """Check every frame of the capture in `source` and write it to `out`, byte for byte.

    Args:
        source: a capture folder, with images or with clouds.
        out: the capture folder to write, whole or not at all.
        motion_csv: the motion of the ends, where it lies elsewhere; it replaces the source's own.

    Returns:
        The index of the capture that was written.

    Raises:
        FormatError: names the first file that cannot be used, the place in it, and the mend.
    """
    source, out = Path(source), Path(out)
    if out.resolve() == source.resolve() or source.resolve().is_relative_to(out.resolve()):
        raise FormatError("is the source itself", file=out, mend="write to another folder")
    index = read_capture_index(source, motion_csv)
    _check_backgrounds(index)
    for _ in track(_source(index).frames(), "checking frames", len(index.frame)):
        pass
    with whole_folder(out) as temporary:
        for path in _named(index):
            _copy(path, temporary / path.relative_to(index.folder))
        if index.motion is not None:
            _copy(Path(motion_csv or index.folder / "motion.csv"), temporary / "motion.csv")
    return read_capture_index(out)


def _check_backgrounds(index: CaptureIndex) -> None:
    if index.background_color is not None:
        read_color(index.background_color, index.camera)
    if index.background_depth is not None:
        read_depth(index.background_depth, index.camera)


def _source(index: CaptureIndex) -> Source:
    return ImageFolder(index) if index.cloud is None else CloudFolder(index)


def _named(index: CaptureIndex) -> list[Path]:
    """The files that make up the capture, without motion.csv; what nothing names stays behind."""
    paths = [index.folder / "capture.json", index.folder / "frames.csv"]
    for column in (index.color, index.depth, index.cloud, index.mask):
        paths.extend(column or ())
    paths.extend(path for path in (index.background_color, index.background_depth) if path is not None)
    return paths


def _copy(origin: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(origin, target)
