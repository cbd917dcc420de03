"""RealSense recordings (.bag): a ROS 1 bag by topics of librealsense's own, which aligns nothing.

Open3D plays such a bag, but at times of its own, and of a slow reader it loses the last frame.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.captures import ros_images
from dlolib.captures.aligned import aligned
from dlolib.captures.bag import Bag, stamp_s
from dlolib.captures.clock import Pairs, check_clock, paired, times_of
from dlolib.captures.foreign import Asked, FramesAlone, Shot
from dlolib.captures.lens import Lens
from dlolib.captures.plausible import unpaired, untimely
from dlolib.captures.ros_images import Found, Role, Spot
from dlolib.errors import FormatError
from dlolib.formats import Given
from dlolib.types import Floats

# Of the file's first bytes: librealsense names its topics by device.
MAGIC, TOPIC, HEAD = b"#ROSBAG V2.0", b"/device_0/", 1 << 20
STREAMS: Mapping[Role, str] = {"color": "Color", "depth": "Depth"}
# Newer versions write an underscore for the space.
UNITS = re.compile(r"option/Depth[ _]Units/value")
AGAIN = "record color as RGB8 and depth as Z16, or copy it again"


@dataclass(frozen=True)
class RealSense(FramesAlone):
    """The first stream of colour, and the first of depth brought to the colour camera's place; time is the
    images' own."""

    kind: ClassVar[str] = "RealSense recording (.bag)"

    path: Path
    streams: Mapping[Role, str]
    t_s: Mapping[int, float]
    pairs: Pairs
    optics: Mapping[str, float]
    lenses: Mapping[Role, Lens]
    sizes: Mapping[Role, tuple[int, int]]
    color_from_depth: Floats
    odd: list[str]

    @classmethod
    def matches(cls, path: Path) -> bool:
        """A ROS 1 bag whose topics are librealsense's."""
        if not path.is_file() or path.suffix != ".bag":
            return False
        with path.open("rb") as file:
            head = file.read(HEAD)
        return head.startswith(MAGIC) and TOPIC in head

    @classmethod
    def open(cls, path: Path, asked: Asked) -> Self:
        """Read the times of the images, and what librealsense says of the two cameras."""
        with Bag(path) as bag:
            streams: dict[Role, str] = {role: _stream(bag, role) for role in STREAMS}
            given: dict[Role, Mapping[str, float]] = {"color": asked.given.optics, "depth": {}}
            infos = {role: bag.first(f"{stream}/info/camera_info") for role, stream in streams.items()}
            lenses: dict[Role, Lens] = {
                role: ros_images.lenses(info, {role: False}, given[role], Spot(path, streams[role]))[role]
                for role, info in infos.items()
            }
            sizes = {role: ros_images.size(info) for role, info in infos.items()}
            optics = dict(zip(("width", "height"), map(float, sizes["color"]), strict=True))
            optics |= lenses["color"].optics
            optics["depth_scale"] = _scale(bag, streams["depth"], asked.given)
            beside = _color_from_depth(bag, streams)
            stamps = _stamps(bag, streams)
        pairs = paired(stamps["depth"], stamps["color"], path)
        odd = unpaired(stamps["depth"], len(pairs), path, streams["depth"])
        odd += untimely(stamps["depth"], stamps["color"], pairs, path, streams["depth"])
        t_s = times_of(pairs, stamps["color"])
        return cls(path, streams, t_s, pairs, optics, lenses, sizes, beside, odd)

    @property
    def count(self) -> int:
        """How many pairs there are."""
        return len(self.pairs)

    @property
    def doubts(self) -> list[str]:
        """Depth images that are left out, or of other times."""
        return self.odd

    def shots(self) -> Iterator[Shot]:
        """Each pair at the stamp of its colour image."""
        topics = {role: _images(stream) for role, stream in self.streams.items()}
        for number, depth, color in ros_images.pairs_of(self.path, topics, self.pairs):
            yield self._shot(self.t_s[number], depth, color)

    def _shot(self, t_s: float, depth: Found, color: Found) -> Shot:
        picture, units = ros_images.color(*color), ros_images.depth(*depth)
        _check_size(picture, self.sizes["color"], color[1])
        _check_size(units, self.sizes["depth"], depth[1])
        picture = self.lenses["color"].color(picture)
        moved = aligned(
            self.lenses["depth"].depth(units),
            self.optics["depth_scale"],
            self.lenses["depth"].matrix,
            self.lenses["color"].straight,
            self.color_from_depth,
            picture.shape[:2],
        )
        return Shot(t_s, self.path, depth[1].place, picture, moved)


def _check_size(image: Any, size: tuple[int, int], spot: Spot) -> None:
    if image.shape[1::-1] != size:
        seen, said = (" x ".join(map(str, one)) for one in (image.shape[1::-1], size))
        raise spot.refusal(f"has {seen} pixels, its camera {said}", AGAIN)


def _images(stream: str) -> str:
    return f"{stream}/image/data"


def _stream(bag: Bag, role: Role) -> str:
    """Where the topics of the first stream of colour or depth begin."""
    name = re.compile(rf"(?P<stream>/device_\d+/sensor_\d+/{STREAMS[role]}_\d+)/image/data")
    for topic in sorted(bag.types):
        if (found := name.fullmatch(topic)) is not None:
            kind = ros_images.encoding(bag.first(topic))
            if ros_images.role_of(bag.first(topic)) != role:
                problem = f"its encoding is {kind!r}"
                raise FormatError(problem, file=bag.path, place=topic, mend=AGAIN)
            return found["stream"]
    raise FormatError(f"holds no stream of {role}", file=bag.path, place=role, mend=AGAIN)


def _scale(bag: Bag, stream: str, given: Given) -> float:
    """Units per metre [1/m]: as a person says, else as the depth sensor was set."""
    if "depth_scale" in given.optics:
        return given.optics["depth_scale"]
    sensor = stream.rsplit("/", 1)[0]
    for topic in sorted(bag.types):
        if topic.startswith(sensor) and UNITS.fullmatch(topic.removeprefix(f"{sensor}/")):
            metres = float(bag.first(topic).data)
            if not 0 < metres < 1:
                problem = f"a unit of depth is {metres:g} m"
                raise FormatError(problem, file=bag.path, place=topic, mend="give camera.depth_scale")
            # stored with seven digits
            return float(f"{1 / metres:.6g}")
    problem, mend = "the recording does not say depth_scale", "add it, in units per metre"
    raise FormatError(problem, file=given.file, place="camera.depth_scale", mend=mend)


def _color_from_depth(bag: Bag, streams: Mapping[Role, str]) -> Floats:
    """The way from the depth camera's axes to the colour camera's (4, 4) [m], by those that both share."""
    groups = {
        role: {topic.rsplit("/", 1)[1]: topic for topic in bag.types if topic.startswith(f"{stream}/tf/")}
        for role, stream in streams.items()
    }
    shared = sorted(groups["color"].keys() & groups["depth"].keys())
    if not shared:
        problem = "does not say how the cameras of color and depth stand to each other"
        raise FormatError(problem, file=bag.path, place=f"{streams['depth']}/tf", mend="record it again")
    poses = {role: _pose(bag, topics[shared[0]]) for role, topics in groups.items()}
    color_from_depth: Floats = poses["color"] @ np.linalg.inv(poses["depth"])
    return color_from_depth


def _pose(bag: Bag, topic: str) -> Floats:
    """The way from the axes that all streams share to a stream's own (4, 4) [m]."""
    said = bag.first(topic)
    turn = [getattr(said.rotation, name) for name in "xyzw"]
    place = [getattr(said.translation, name) for name in "xyz"]
    if not (np.isfinite([*turn, *place]).all() and np.linalg.norm(turn) > 0):
        raise FormatError("is no pose", file=bag.path, place=topic, mend="record it again")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_quat(turn).as_matrix(), place
    return pose


def _stamps(bag: Bag, streams: Mapping[Role, str]) -> dict[Role, Floats]:
    times: dict[str, list[float]] = {_images(stream): [] for stream in streams.values()}
    for topic, _, logged_ns, message in bag.messages(list(times)):
        times[topic].append(stamp_s(message, logged_ns))
    stamps: dict[Role, Floats] = {role: np.array(times[_images(stream)]) for role, stream in streams.items()}
    for role, stream in streams.items():
        check_clock(stamps[role], bag.path, _images(stream))
    return stamps
