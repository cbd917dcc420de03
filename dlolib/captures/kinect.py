"""Azure Kinect recordings (.mkv): 16-bit depth, colour of another viewpoint, the calibration attached."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from dlolib.captures.clock import Pairs, check_clock, paired, times_of, together
from dlolib.captures.foreign import Asked, FramesAlone, Shot
from dlolib.captures.kinect_calibration import Calibration, read_calibration
from dlolib.captures.plausible import unpaired, untimely
from dlolib.errors import FormatError
from dlolib.types import Floats

if TYPE_CHECKING:
    from av.container import InputContainer

TRACKS = ("DEPTH", "COLOR")
SEGMENT = b"\x18\x53\x80\x67"
HEAD = 4096


@dataclass(frozen=True)
class AzureKinect(FramesAlone):
    """Colour brought to the depth camera's place; time is the device's clock."""

    kind: ClassVar[str] = "Azure Kinect recording (.mkv)"

    path: Path
    t_s: Mapping[int, float]
    pairs: Pairs
    calibration: Calibration
    optics: Mapping[str, float]
    odd: list[str]

    @classmethod
    def matches(cls, path: Path) -> bool:
        """By the file's name."""
        return path.is_file() and path.suffix.lower() == ".mkv"

    @classmethod
    def open(cls, path: Path, asked: Asked) -> Self:
        """Read the tracks' times and the calibration."""
        _check_whole(path)
        with _opened(path) as container:
            tracks = _tracks(container, path)
            sizes = {name: (s.codec_context.width, s.codec_context.height) for name, s in tracks.items()}
            calibration = read_calibration(
                _attached(container, path), path, sizes["DEPTH"], sizes["COLOR"], asked.given.optics
            )
            stamps = _stamps(container, tracks, path)
        pairs = paired(stamps["DEPTH"], stamps["COLOR"], path)
        width, height = sizes["DEPTH"]
        optics = {"width": float(width), "height": float(height), "depth_scale": 1000.0}
        odd = unpaired(stamps["DEPTH"], len(pairs), path, "DEPTH")
        odd += untimely(stamps["DEPTH"], stamps["COLOR"], pairs, path, "DEPTH")
        t_s = times_of(pairs, stamps["COLOR"])
        return cls(path, t_s, pairs, calibration, optics | calibration.depth.optics, odd)

    @property
    def count(self) -> int:
        """How many pairs there are."""
        return len(self.pairs)

    @property
    def doubts(self) -> list[str]:
        """Depth images that are left out, or of other times."""
        return self.odd

    def shots(self) -> Iterator[Shot]:
        """Each pair at the time of its colour image."""
        with _opened(self.path) as container:
            tracks = _tracks(container, self.path)
            for number, depth, color in together(_frames(container, tracks, self.path), self.pairs):
                picture, units = self.calibration.registered(color, depth)
                place = f"DEPTH, frame {number}"
                yield Shot(self.t_s[number], self.path, place, picture, units)


@contextmanager
def _opened(path: Path) -> Iterator[InputContainer]:
    import av

    with _readable(path):
        container = av.open(str(path))
    with container:
        yield container


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """What FFmpeg says of damaged bytes becomes one line."""
    import av

    try:
        yield
    except (av.error.FFmpegError, ValueError) as error:
        problem = f"cannot be read: {str(error)[:120]}"
        raise FormatError(problem, file=path, place="video", mend="record or copy it again") from error


def _check_whole(path: Path) -> None:
    """Refuse a file shorter than its segment says: FFmpeg plays a truncated one as far as it goes."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    at = head.find(SEGMENT)
    if at < 0 or len(head) < at + 12:
        raise FormatError(
            "is no Matroska file", file=path, place="byte 0", mend="give a recording of k4arecorder"
        )
    first = head[at + 4]
    width = 9 - first.bit_length()
    size = int.from_bytes(head[at + 4 : at + 4 + width]) & ((1 << 7 * width) - 1)
    unknown = size == (1 << 7 * width) - 1
    if unknown or path.stat().st_size < at + 4 + width + size:
        place = f"byte {path.stat().st_size}"
        raise FormatError("is truncated", file=path, place=place, mend="record or copy it again")


def _tracks(container: InputContainer, path: Path) -> dict[str, Any]:
    found = {stream.metadata.get("title", "").upper(): stream for stream in container.streams.video}
    for name in TRACKS:
        if name not in found:
            listed = ", ".join(sorted(found)) or "none"
            problem = f"no track {name}, found {listed}"
            raise FormatError(problem, file=path, place=name, mend="record depth and color with k4arecorder")
        if found[name].codec_context is None:
            problem = "is stored in a form that is not known"
            raise FormatError(
                problem, file=path, place=name, mend="give the recording as k4arecorder wrote it"
            )
    return {name: found[name] for name in TRACKS}


def _attached(container: InputContainer, path: Path) -> bytes:
    for attachment in container.streams.attachments:
        if attachment.name == "calibration.json" and attachment.data:
            return bytes(attachment.data)
    mend = "give a recording of k4arecorder as it was written"
    raise FormatError("no calibration is attached", file=path, place="calibration.json", mend=mend)


def _stamps(container: InputContainer, tracks: dict[str, Any], path: Path) -> dict[str, Floats]:
    """The device's times [s] of each track."""
    offset = container.metadata.get("K4A_START_OFFSET_NS", "0")
    if not offset.isdigit():
        problem = f"{offset!r} is no number"
        raise FormatError(problem, file=path, place="K4A_START_OFFSET_NS", mend="record it again")
    names = {stream.index: name for name, stream in tracks.items()}
    times: dict[str, list[float]] = {name: [] for name in TRACKS}
    with _readable(path):
        for packet in container.demux(list(tracks.values())):
            if packet.pts is not None and packet.size:
                ns = packet.pts * packet.time_base * 10**9
                times[names[packet.stream.index]].append(float((ns + int(offset)) / 10**9))
    stamps: dict[str, Floats] = {name: np.array(listed) for name, listed in times.items()}
    for name in TRACKS:
        check_clock(stamps[name], path, name)
    return stamps


def _frames(container: InputContainer, tracks: dict[str, Any], path: Path) -> Iterator[tuple[str, int, Any]]:
    """ "depth" or "color", the number in its track, and the pixels."""
    counts = dict.fromkeys(TRACKS, 0)
    names = {stream.index: name for name, stream in tracks.items()}
    for packet in _packets(container, tracks, path):
        name = names[packet.stream.index]
        with _readable(path):
            frames = packet.decode()
        for frame in frames:
            kind = "rgb24" if name == "COLOR" else "gray16le"
            with _readable(path):
                pixels = frame.to_ndarray(format=kind)
            yield name.lower(), counts[name], pixels
            counts[name] += 1


def _packets(container: InputContainer, tracks: dict[str, Any], path: Path) -> Iterator[Any]:
    packets = container.demux(list(tracks.values()))
    while True:
        with _readable(path):
            packet = next(packets, None)
        if packet is None:
            return
        yield packet
