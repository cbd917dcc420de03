"""What is refused of a capture beside its form, and what is odd and yet may be meant: a warning says so."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dlolib.captures.base import Frame, Source
from dlolib.captures.clock import Pairs
from dlolib.errors import FormatError
from dlolib.formats import motion_doubts, moves, say
from dlolib.types import CaptureIndex, Floats

# No clock counts so far: 3000 years of seconds.
LATEST_S = 1e11
# A focal length over the image's size is that of a fisheye of 157 degrees at least, of a telescope of half a
# degree at most; a cut image's centre may lie so many sizes outside of it.
FOCAL_SIZES, CENTRE_SIZES = (0.1, 100.0), 2.0
# A rope at 60 mm/s goes a third of a millimetre in it, about what a chain is off by itself.
APART_S = 0.005
# Where DVC keeps files and may link to: <cache>/files/md5/ab/cdef...
DVC_CACHE = ("files", "md5")


def check_inside(paths: Iterable[Path], folder: Path) -> None:
    """Refuse a link that leads out of the recording's folder: an archive could name any file of the machine.
    And one that leads to itself.

    Raises:
        FormatError: names the link.
    """
    root = folder.resolve()
    for path in paths:
        try:
            target = path.resolve()
        except (OSError, RuntimeError) as error:
            problem = "is a link that leads to itself"
            raise FormatError(problem, file=path, mend="put the file itself there") from error
        if not target.is_relative_to(root) and target.parts[-4:-2] != DVC_CACHE:
            problem = "is a link that leads out of the folder"
            raise FormatError(problem, file=path, mend="put the file itself there")


def check_times(index: CaptureIndex, motion_csv: Path) -> None:
    """Refuse times that no clock shows, and a motion, from that table, that shares no time with the frames.

    Raises:
        FormatError: names the table.
    """
    motion, frames_csv = index.motion, index.folder / "frames.csv"
    for table, t_s in ((frames_csv, index.t_s), (motion_csv, None if motion is None else motion.t_s)):
        if t_s is not None and np.abs(t_s).max() > LATEST_S:
            problem = f"a time of {np.abs(t_s).max():.4g} s"
            raise FormatError(problem, file=table, place="column t_s", mend="give seconds; correct that row")
    if motion is None or not moves(motion):
        return
    if motion.t_s[0] > index.t_s[-1] or motion.t_s[-1] < index.t_s[0]:
        problem = (
            f"goes from {motion.t_s[0]:.10g} to {motion.t_s[-1]:.10g} s, the frames from "
            f"{index.t_s[0]:.10g} to {index.t_s[-1]:.10g} s: they share no time"
        )
        raise FormatError(problem, file=motion_csv, place="column t_s", mend="bring both to one clock")


def check_optics(index: CaptureIndex) -> None:
    """Refuse a focal length or a centre that no camera with so many pixels has: most often it is in
    millimetres, or a share of the image.

    Raises:
        FormatError: names the key of capture.json.
    """
    camera = index.camera
    sizes = (("fx", camera.fx, camera.width), ("fy", camera.fy, camera.height))
    for name, focal, size in sizes:
        if focal and size and not FOCAL_SIZES[0] <= focal / size <= FOCAL_SIZES[1]:
            angle = np.degrees(2 * np.arctan(0.5 * size / focal))
            raise _no_optics(
                index, name, f"{focal:g} for {size} pixels would be a view of {angle:.3g} degrees"
            )
    for name, centre, size in (("cx", camera.cx, camera.width), ("cy", camera.cy, camera.height)):
        if centre is not None and size and abs(centre - 0.5 * size) > CENTRE_SIZES * size:
            raise _no_optics(index, name, f"{centre:g} is far outside of {size} pixels")


def _no_optics(index: CaptureIndex, name: str, problem: str) -> FormatError:
    file, mend = index.folder / "capture.json", "give it in pixels, as the camera's calibration has it"
    return FormatError(problem, file=file, place=f"camera.{name}", mend=mend)


def doubts(index: CaptureIndex, motion_csv: Path) -> list[str]:
    """What may be the trace of a table that was cut off, one line each."""
    found = []
    for paths in (index.color, index.depth, index.cloud):
        found += unnamed(paths or (), index.folder / "frames.csv")
    if index.motion is not None:
        found += [*cut_off(motion_csv), *motion_doubts(index.motion, index.t_s, motion_csv)]
    return found


def cut_off(table: Path) -> list[str]:
    """That a table ends within a line: its last number may be half of one."""
    if table.read_bytes().endswith(b"\n"):
        return []
    problem, mend = "does not end with a line break", "check that it is whole"
    return [str(FormatError(problem, file=table, place="last line", mend=mend))]


def unnamed(paths: Iterable[Path], table: Path) -> list[str]:
    """Images of the kind and in the folders of `paths` that `table` does not name, one line a folder."""
    named: dict[Path, set[Path]] = {}
    for path in paths:
        named.setdefault(path.parent, set()).add(path)
    found = []
    for folder, own in named.items():
        kinds = {path.suffix for path in own}
        left = sorted(path for path in folder.iterdir() if path.suffix in kinds and path not in own)
        if left:
            problem = f"{len(left)} files in {folder.name} are in no row, the first {left[0].name}"
            mend = "check that it is whole"
            found.append(str(FormatError(problem, file=table, place="rows", mend=mend)))
    return found


def unpaired(t_s: Floats, pairs: int, path: Path, what: str, kind: str = "depth") -> list[str]:
    """That depth images were left out because no colour image is near, or colour images likewise."""
    left, other = len(t_s) - pairs, "color" if kind == "depth" else "depth"
    problem = f"{left} of {len(t_s)} {kind} images have no {other} image at their time and are left out"
    mend = "check that both are whole and of one clock"
    return [str(FormatError(problem, file=path, place=what, mend=mend))] if left else []


def untimely(depth_s: Floats, color_s: Floats, pairs: Pairs, path: Path, what: str) -> list[str]:
    """That the two images of a pair were taken at times (N,) and (M,) [s] that are apart."""
    depth, color = np.array(pairs).T
    apart_s = np.abs(color_s[color] - depth_s[depth])
    if apart_s.max() <= APART_S:
        return []
    far = f"{1e3 * np.median(apart_s):.3g} ms (median) and up to {1e3 * apart_s.max():.3g} ms"
    problem = f"color and depth were taken {far} apart: depth of a moving rope is not of the color's time"
    mend = "let the camera take both at once, or move the rope slowly"
    return [str(FormatError(problem, file=path, place=what, mend=mend))]


@dataclass
class Doubted:
    """A source that says its doubts once, when all frames were read: a refusal stays a single line."""

    inner: Source
    said: bool = False

    @property
    def index(self) -> CaptureIndex:
        """What the capture says about itself."""
        return self.inner.index

    def frames(self) -> Iterator[Frame]:
        """Read one frame after the other."""
        yield from self.inner.frames()
        if not self.said:
            self.said = True
            say(doubts(self.index, self.index.folder / "motion.csv"))
