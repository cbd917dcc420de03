"""A folder of Open3D or of the Redwood data set: color/, depth/ and the camera's intrinsic JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from dlolib.captures.clock import check_clock, paired
from dlolib.captures.foreign import Asked, FramesAlone, Shot
from dlolib.captures.pictures import decode_color, decode_depth
from dlolib.captures.plausible import unpaired, untimely
from dlolib.errors import FormatError

DEPTH_SCALE, HUGE = 1000.0, 1e300
# Weeks at any rate.
MOST_IMAGES = 10**8
IMAGES = (".png", ".jpg", ".jpeg")
COLOR = ("color", "rgb", "image")
INTRINSICS = ("intrinsic.json", "camera_intrinsic.json", "intrinsics.json", "camera_intrinsics.json")
# Redwood's names: the image's number, and its time in microseconds.
NAME = re.compile(r"(?P<number>\d+)(-(?P<time_us>\d+))?")


@dataclass(frozen=True)
class RedwoodFolder(FramesAlone):
    """Images paired by the times in their names; without these by number, which over the rate is the time."""

    kind: ClassVar[str] = "Open3D or Redwood folder (color/, depth/, intrinsic.json)"

    color: tuple[Path, ...]
    depth: tuple[Path, ...]
    t_s: tuple[float, ...]
    optics: Mapping[str, float]
    odd: list[str]

    @classmethod
    def matches(cls, path: Path) -> bool:
        """Whether depth/ lies beside color/; with capture.json alone it is a capture without frames.csv."""
        folders = (path / "depth").is_dir() and any((path / name).is_dir() for name in COLOR)
        calibrated = any((path / name).is_file() for name in INTRINSICS)
        return folders and (calibrated or not (path / "capture.json").is_file())

    @classmethod
    def open(cls, path: Path, asked: Asked) -> Self:
        """Pair the images and read the calibration."""
        folder = next(path / name for name in COLOR if (path / name).is_dir())
        color, depth = _images(folder), _images(path / "depth")
        timed = all(_stamp_s(image) is not None for image in (*color.values(), *depth.values()))
        odd: list[str] = []
        if timed:
            color, depth, odd = _by_time(color, depth, path)
        else:
            _check_numbers(color, depth, folder, path / "depth")
        odd += [line for one in (folder, path / "depth") for line in unnumbered(one, IMAGES)]
        content, optics = _intrinsics(path)
        times = _times(color, depth, asked.given.rate_hz or content.get("fps"), asked.given.file)
        return cls(
            tuple(color[n] for n in sorted(depth)), tuple(depth[n] for n in sorted(depth)), times, optics, odd
        )

    @property
    def count(self) -> int:
        """How many pairs there are."""
        return len(self.t_s)

    @property
    def doubts(self) -> list[str]:
        """What is left out: images that have no number, or no fellow at their time, or one some way off."""
        return self.odd

    def shots(self) -> Iterator[Shot]:
        """One pair after the other."""
        for color, depth, t_s in zip(self.color, self.depth, self.t_s, strict=True):
            picture = decode_color(color.read_bytes(), color)
            yield Shot(t_s, depth, color=picture, depth=decode_depth(depth.read_bytes(), depth))


def numbered(folder: Path, ends: tuple[str, ...]) -> dict[int, Path]:
    """The files of a folder by the number that their names begin with.

    Raises:
        FormatError: there is none, or two have one number.
    """
    found: dict[int, Path] = {}
    for path in _of_kind(folder, ends):
        name = NAME.fullmatch(path.stem)
        if name is None:
            continue
        number = int(name["number"])
        if number in found:
            problem = f"{found[number].name} and {path.name} have one number"
            raise FormatError(problem, file=folder, mend="remove one of them")
        found[number] = path
    if not found:
        problem = f"holds no numbered {' or '.join(ends)}"
        raise FormatError(problem, file=folder, mend="name the files 000000, 000001, ...")
    return found


def unnumbered(folder: Path, ends: tuple[str, ...]) -> list[str]:
    """That files of a folder are left out because their names begin with no number."""
    left = [path.name for path in _of_kind(folder, ends) if not NAME.fullmatch(path.stem)]
    problem = f"{len(left)} files without a number are left out, the first {left[0]}" if left else ""
    mend = "name them as the others, or remove them"
    return [str(FormatError(problem, file=folder, mend=mend))] if left else []


def _of_kind(folder: Path, ends: tuple[str, ...]) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in ends)


def at_rate(number: int, rate_hz: float | None, asked_in: Path, what: Path) -> float:
    """The time [s] of the image of this number.

    Raises:
        FormatError: the rate is not known, or the number is none of an image but a time.
    """
    if number > MOST_IMAGES:
        problem = f"its name looks like a time, and not like the number {number} of an image"
        mend = "name images as 0000001-000000033333.png, by number and microseconds"
        raise FormatError(problem, file=what, mend=mend)
    if rate_hz is None:
        problem = f"when {what.name} was taken is not recorded"
        raise FormatError(problem, file=asked_in, place="rate_hz", mend="add the frames per second")
    return number / rate_hz


def _images(folder: Path) -> dict[int, Path]:
    return numbered(folder, IMAGES)


def _stamp_s(image: Path) -> float | None:
    name = NAME.fullmatch(image.stem)
    return int(name["time_us"]) / 10**6 if name and name["time_us"] else None


def _times(
    color: dict[int, Path], depth: dict[int, Path], rate_hz: float | None, asked_in: Path
) -> tuple[float, ...]:
    """The pairs' times [s]: of their colour images as the other sources', else of their depth images."""
    times = []
    for number in sorted(depth):
        own = _stamp_s(color[number])
        stamp_s = _stamp_s(depth[number]) if own is None else own
        times.append(at_rate(number, rate_hz, asked_in, depth[number]) if stamp_s is None else stamp_s)
    return tuple(times)


def _check_numbers(color: dict[int, Path], depth: dict[int, Path], colors: Path, depths: Path) -> None:
    for one, other, where in ((color, depth, depths), (depth, color, colors)):
        lonely = sorted(set(one) - set(other))
        if lonely:
            problem = f"no image with the number of {one[lonely[0]].name}"
            raise FormatError(problem, file=where, mend="add it, or remove the other")


def _by_time(
    color: dict[int, Path], depth: dict[int, Path], path: Path
) -> tuple[dict[int, Path], dict[int, Path], list[str]]:
    """Colour and depth by the depth image's number, where both were taken at one time; who is left out."""
    kinds = {"depth": [depth[n] for n in sorted(depth)], "color": [color[n] for n in sorted(color)]}
    stamps = {kind: np.array([_stamp_s(image) for image in images]) for kind, images in kinds.items()}
    for kind, t_s in stamps.items():
        check_clock(t_s, path, kind)
    pairs = paired(stamps["depth"], stamps["color"], path)
    odd = [line for kind, t_s in stamps.items() for line in unpaired(t_s, len(pairs), path, kind, kind)]
    odd += untimely(stamps["depth"], stamps["color"], pairs, path, "depth")
    numbers = sorted(depth)
    near = {numbers[row]: kinds["color"][other] for row, other in pairs}
    return near, {number: depth[number] for number in near}, odd


def _intrinsics(folder: Path) -> tuple[dict[str, Any], dict[str, float]]:
    """The calibration's JSON, empty where there is none, and the camera in it."""
    path = next((folder / name for name in INTRINSICS if (folder / name).is_file()), None)
    if path is None:
        return {}, {"depth_scale": DEPTH_SCALE}
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
        matrix = np.array(content["intrinsic_matrix"], dtype=np.float64).reshape(3, 3, order="F")
        optics = {"width": float(content["width"]), "height": float(content["height"])}
        optics |= {"fx": matrix[0, 0], "fy": matrix[1, 1], "cx": matrix[0, 2], "cy": matrix[1, 2]}
        optics["depth_scale"] = float(content.get("depth_scale", DEPTH_SCALE))
        rate = content.get("fps")
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        mend = "give width, height and intrinsic_matrix (9 numbers, column by column)"
        raise FormatError("is no camera of Open3D", file=path, mend=mend) from error
    if not np.array_equal(matrix[2], [0, 0, 1]):
        problem = f"the last row of the camera's matrix is {matrix[2].tolist()}, not [0, 0, 1]"
        raise FormatError(problem, file=path, place="intrinsic_matrix", mend="give it column by column")
    numbers = [*optics.values(), *([] if rate is None else [rate])]
    # JSON's whole numbers may be too large for a float
    plausible = all(isinstance(n, int | float) and abs(n) < HUGE for n in numbers)
    if not plausible or min(optics["fx"], optics["fy"], optics["depth_scale"], rate or 1) <= 0:
        raise FormatError("a number in it is none, or not positive", file=path, mend="correct it")
    return content, {name: float(value) for name, value in optics.items()}
