"""A folder of the TUM RGB-D benchmark: rgb.txt, depth.txt and, of a tracked camera, groundtruth.txt."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import ClassVar, Self

import numpy as np

from dlolib.captures.clock import Pairs, falls, paired, times_of
from dlolib.captures.foreign import Asked, FramesAlone, Shot
from dlolib.captures.pictures import decode_color, decode_depth
from dlolib.captures.plausible import unnamed, unpaired, untimely
from dlolib.captures.poses import one_pose, transforms
from dlolib.errors import FormatError
from dlolib.types import Floats

DEPTH_SCALE = 5000.0
POSE = 7


@dataclass(frozen=True)
class _List:
    """The rows of a list: times (N,) [s], what follows them, and their lines in the file."""

    path: Path
    t_s: Floats
    words: list[list[str]]
    lines: list[int]

    def refusal(self, row: int, problem: str, mend: str) -> FormatError:
        return FormatError(problem, file=self.path, place=f"line {self.lines[row]}", mend=mend)


@dataclass(frozen=True)
class TumFolder(FramesAlone):
    """Images paired by time; depth in units of 0.2 mm."""

    kind: ClassVar[str] = "TUM RGB-D folder (rgb.txt, depth.txt)"
    optics: ClassVar[Mapping[str, float]] = {"depth_scale": DEPTH_SCALE}

    color: tuple[Path, ...]
    depth: tuple[Path, ...]
    t_s: Mapping[int, float]
    pairs: Pairs
    pose: Floats | None
    odd: list[str]

    @classmethod
    def matches(cls, path: Path) -> bool:
        """Whether one of the two lists is there."""
        return (path / "rgb.txt").is_file() or (path / "depth.txt").is_file()

    @classmethod
    def open(cls, path: Path, asked: Asked) -> Self:
        """Read the lists; every image that they name is there afterwards."""
        color, depth = _list(path / "rgb.txt"), _list(path / "depth.txt")
        pairs = paired(depth.t_s, color.t_s, path)
        pose = None
        if asked.given.world_from_camera is None and (path / "groundtruth.txt").exists():
            pose = _pose(_list(path / "groundtruth.txt"))
        images = _images(color), _images(depth)
        odd = unpaired(depth.t_s, len(pairs), depth.path, "rows")
        odd += untimely(depth.t_s, color.t_s, pairs, depth.path, "rows")
        for listed, found in zip((color, depth), images, strict=True):
            odd += unnamed(found, listed.path)
        return cls(*images, times_of(pairs, color.t_s), pairs, pose, odd)

    @property
    def count(self) -> int:
        """How many pairs there are."""
        return len(self.pairs)

    @property
    def world_from_camera(self) -> Floats | None:
        """That of groundtruth.txt, where there is one."""
        return self.pose

    @property
    def doubts(self) -> list[str]:
        """Images that are left out, as no row names them or no colour image is near; those at other times."""
        return self.odd

    def shots(self) -> Iterator[Shot]:
        """Each pair at the time of its colour image."""
        for depth, color in self.pairs:
            picture = decode_color(self.color[color].read_bytes(), self.color[color])
            units = decode_depth(self.depth[depth].read_bytes(), self.depth[depth])
            yield Shot(self.t_s[depth], self.depth[depth], color=picture, depth=units)


def _list(path: Path) -> _List:
    """The rows of a list, `#` lines left out, times rising."""
    if not path.is_file():
        raise FormatError("no such file", file=path, mend="add the list of times and names")
    try:
        text = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise FormatError("is not text in UTF-8", file=path, mend="copy it again") from error
    rows = [(number, line.split()) for number, line in enumerate(text, 1) if line.strip()]
    rows = [(number, words) for number, words in rows if not words[0].startswith("#")]
    if not rows:
        raise FormatError("has no rows", file=path, mend="give at least one: time, name")
    found = _List(
        path, np.array([_number(w[0]) for _, w in rows]), [w[1:] for _, w in rows], [n for n, _ in rows]
    )
    for row in range(len(rows)):
        if not np.isfinite(found.t_s[row]):
            raise found.refusal(row, f"{rows[row][1][0][:40]!r} is no time", "give seconds")
        if row and (problem := falls(float(found.t_s[row - 1]), float(found.t_s[row]))):
            raise found.refusal(row, problem, "sort the rows by time")
    return found


def _images(listed: _List) -> tuple[Path, ...]:
    """The file of each row, within the folder of the list."""
    paths = []
    for row, words in enumerate(listed.words):
        name = PurePosixPath(words[0] if words else "")
        if not words or name.is_absolute() or ".." in name.parts:
            problem = f"{' '.join(words)!r} is no path within the folder"
            raise listed.refusal(row, problem, "give one relative to it")
        paths.append(listed.path.parent / name)
        if not paths[-1].is_file():
            raise listed.refusal(row, f"no such file: {name}", "add it or remove the row")
    return tuple(paths)


def _pose(listed: _List) -> Floats:
    """The camera's one pose from rows tx ty tz qx qy qz qw."""
    numbers = np.full((len(listed.words), POSE), np.nan)
    for row, words in enumerate(listed.words):
        if len(words) == POSE:
            numbers[row] = [_number(word) for word in words]
        if not np.isfinite(numbers[row]).all():
            raise listed.refusal(row, "is no pose", "give time tx ty tz qx qy qz qw, or leave the file out")
    poses = transforms(numbers[:, :3], numbers[:, [6, 3, 4, 5]], listed.path, "poses")
    return one_pose(poses, listed.path, "poses")


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return float("nan")
