"""ROS 1 bags, ROS 2 bags (sqlite3) and MCAP: colour, depth, calibration and poses by topic."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from dlolib.captures import ros_images, ros_poses
from dlolib.captures.bag import STORED, Bag, stamp_s
from dlolib.captures.clock import Pairs, check_clock, paired, times_of
from dlolib.captures.foreign import Asked, Shot
from dlolib.captures.lens import Lens
from dlolib.captures.plausible import unpaired, untimely
from dlolib.captures.poses import end_motion, one_pose
from dlolib.captures.ros_images import Found, Role, Spot
from dlolib.errors import FormatError
from dlolib.formats import Given
from dlolib.types import Floats, Motion

INFO = "sensor_msgs/msg/CameraInfo"
METADATA = "metadata.yaml"
TRANSPORTS = ("/compressedDepth", "/compressed")
# RealSense's own recorder names each sensor, and aligns none to another.
OF_A_SENSOR = re.compile(r"/device_\d+/(?P<sensor>sensor_\d+)/")
# The driver of RealSense calls aligned depth image_raw, whatever the image is that it is aligned to.
ALIGNED, OF_A_DRIVER = "/aligned_depth_to_color/", "_raw"


@dataclass(frozen=True)
class RosBag:
    """Depth and colour of one viewpoint and size, paired by their stamps."""

    kind: ClassVar[str] = "ROS 1 bag, ROS 2 bag or MCAP"
    roles: ClassVar[tuple[str, ...]] = ("color", "depth", "camera_info", "camera_pose", "motion")

    path: Path
    topics: Mapping[Role, str]
    t_s: Mapping[int, float]
    pairs: Pairs
    optics: Mapping[str, float]
    lenses: Mapping[Role, Lens]
    world_from_camera: Floats | None
    motion: Motion | None
    odd: list[str]

    @classmethod
    def matches(cls, path: Path) -> bool:
        """By the name of the file, or the metadata of a ROS 2 folder."""
        return path.suffix in STORED if path.is_file() else (path / METADATA).is_file() or bool(_parts(path))

    @classmethod
    def open(cls, path: Path, asked: Asked) -> Self:
        """Find out which topic is what, pair the images, read calibration and poses."""
        path = _whole(path)
        with Bag(path) as bag:
            topics = _images(bag, asked.topics)
            lenses, optics = _calibration(bag, topics, asked)
            stamps = _stamps(bag, topics)
            pairs = paired(stamps["depth"], stamps["color"], path)
            view, motion, odd = _poses(bag, topics, asked)
            odd += unpaired(stamps["depth"], len(pairs), path, topics["depth"])
            odd += untimely(stamps["depth"], stamps["color"], pairs, path, topics["depth"])
        return cls(path, topics, times_of(pairs, stamps["color"]), pairs, optics, lenses, view, motion, odd)

    @property
    def count(self) -> int:
        """How many pairs there are."""
        return len(self.pairs)

    @property
    def hint(self) -> str:
        """The topics of poses, and the frames of tf."""
        with Bag(self.path) as bag:
            return ", ".join(ros_poses.choices(bag))

    @property
    def doubts(self) -> list[str]:
        """Depth images that are left out or of other times; a camera's pose whose axes may be others."""
        return self.odd

    def shots(self) -> Iterator[Shot]:
        """Each pair at the stamp of its colour image."""
        for number, depth, color in ros_images.pairs_of(self.path, self.topics, self.pairs):
            yield self._shot(self.t_s[number], depth, color)

    def _shot(self, t_s: float, depth: Found, color: Found) -> Shot:
        units, picture = ros_images.depth(*depth), ros_images.color(*color)
        frames = [message.header.frame_id.lstrip("/") for message, _ in (depth, color)]
        if units.shape != picture.shape[:2] or (all(frames) and frames[0] != frames[1]):
            seen = f"depth is {_size(units)} from {frames[0]!r}, color {_size(picture)} from {frames[1]!r}"
            mend = "name the topic of depth that is registered to color"
            raise depth[1].refusal(f"{seen}: they have different viewpoints", mend)
        if self.lenses:
            picture, units = self.lenses["color"].color(picture), self.lenses["depth"].depth(units)
        return Shot(t_s, self.path, depth[1].place, picture, units)


def _parts(folder: Path) -> list[Path]:
    """The files of a folder that holds a ROS 2 recording and no folders."""
    held = list(folder.glob("*"))
    bags = sorted(path for path in held if path.suffix in STORED[1:] and path.is_file())
    return [] if any(path.is_dir() for path in held) else bags


def _whole(path: Path) -> Path:
    """The bag itself; of a folder whose recording was cut off before its metadata was written, its one file.

    Raises:
        FormatError: there are several.
    """
    if path.is_file() or (path / METADATA).is_file():
        return path
    parts = _parts(path)
    if len(parts) > 1:
        problem = f"has no {METADATA}, and {len(parts)} files"
        raise FormatError(problem, file=path, mend="make one: ros2 bag reindex")
    return parts[0]


def _size(image: Any) -> str:
    return f"{image.shape[1]} x {image.shape[0]}"


def _images(bag: Bag, named: Mapping[str, str]) -> dict[Role, str]:
    """The topics of depth and colour: as named, else the only one that can be it."""
    types = bag.types
    fit: dict[Role, list[str]] = {"color": [], "depth": []}
    for topic, kind in sorted(types.items()):
        if kind in (ros_images.IMAGE, ros_images.COMPRESSED):
            for _, _, _, message in bag.messages([topic]):
                possible = ros_images.role_of(message)
                if possible is not None:
                    fit[possible].append(topic)
                break
    chosen: dict[Role, str] = {}
    for role, topics in fit.items():
        if role in named:
            if named[role] not in topics:
                raise _unknown(bag, role, named[role], topics)
            chosen[role] = named[role]
        elif len(topics) == 1:
            chosen[role] = topics[0]
        else:
            problem = f"{len(topics)} topics can be {role}"
            if not topics:
                problem = f"no topic has images of {role}{_encodings(bag, types)}"
            mend = f"name one: --topic {role}=NAME, of {', '.join(topics)}" if topics else _record(role)
            raise FormatError(problem, file=bag.path, place=role, mend=mend)
    sensors = {found["sensor"] for topic in chosen.values() if (found := OF_A_SENSOR.match(topic))}
    if len(sensors) > 1:
        problem = f"{chosen['depth']} and {chosen['color']} are of two sensors"
        mend = "record depth that is aligned to color (realsense-ros, align_depth)"
        raise FormatError(problem, file=bag.path, place="depth", mend=mend)
    return chosen


def _encodings(bag: Bag, topics: Iterable[str]) -> str:
    """How the images of some topics are stored, to be read after what they are not."""
    kinds = bag.types
    images = [name for name in sorted(topics) if kinds.get(name) in (ros_images.IMAGE, ros_images.COMPRESSED)]
    said = [f"{name} has {ros_images.encoding(bag.first(name))!r}" for name in images if bag.count(name)]
    return f": {', '.join(said)}" if said else ""


def _record(role: Role) -> str:
    kinds = ros_images.COLORS if role == "color" else (*ros_images.MILLIMETRES, ros_images.METRES)
    return f"record one with {', '.join(kinds)}"


def _unknown(bag: Bag, role: str, name: str, topics: list[str]) -> FormatError:
    problem = f"no topic of {role}{_encodings(bag, [name])}"
    mend = f"choose from {', '.join(sorted(topics)) or 'none: the bag has no such topic'}"
    return FormatError(problem, file=bag.path, place=f"--topic {role}={name}", mend=mend)


def _calibration(
    bag: Bag, topics: Mapping[Role, str], asked: Asked
) -> tuple[dict[Role, Lens], dict[str, float]]:
    """Each image's lens, and the optics that the bag says; without CameraInfo only the units of depth."""
    optics = {"depth_scale": _depth_scale(bag, topics, asked.given)}
    name = _info(bag, topics, asked)
    if name is None:
        return {}, optics
    info = bag.first(name)
    rectified = _rectified(topics)
    _check_frame(bag, topics, asked, name, info)
    lenses = ros_images.lenses(info, rectified, asked.given.optics, Spot(bag.path, name))
    width, height = ros_images.size(info)
    optics |= {"width": float(width), "height": float(height)}
    return lenses, optics | lenses["depth"].optics


def _check_frame(bag: Bag, topics: Mapping[Role, str], asked: Asked, name: str, info: Any) -> None:
    """Refuse another camera's calibration where nothing but that there is no other speaks for it."""
    beside = any(_sibling(topic, [name]) for topic in topics.values())
    own = bag.first(topics["depth"])
    of, images = (message.header.frame_id.lstrip("/") for message in (info, own))
    if beside or "camera_info" in asked.topics or not (of and images) or of == images:
        return
    problem = f"is of {of!r}, the images are of {images!r}"
    mend = f"name it if it is right: --topic camera_info={name}"
    raise FormatError(problem, file=bag.path, place=name, mend=mend)


def _rectified(topics: Mapping[Role, str]) -> dict[Role, bool]:
    """Which images have no distortion left, by their names: image_rect, image_color_rect, image_rect_raw."""
    names: dict[Role, str] = {role: _untransported(topic) for role, topic in topics.items()}
    if ALIGNED in names["depth"] and names["color"].endswith(OF_A_DRIVER):
        names["depth"] = names["color"]
    return {role: _says_rectified(name) for role, name in names.items()}


def _says_rectified(name: str) -> bool:
    return any(word.startswith("rect") for word in name.rsplit("/", 1)[-1].split("_"))


def _depth_scale(bag: Bag, topics: Mapping[Role, str], given: Given) -> float:
    """Units per metre [1/m]; those of depth in metres are ours, and not for a person to change."""
    message = bag.first(topics["depth"])
    scale = ros_images.depth_scale(message)
    if ros_images.encoding(message) == ros_images.METRES and given.optics.get("depth_scale", scale) != scale:
        problem = f"{given.optics['depth_scale']:g} units per metre, but this source's depth is in metres"
        raise FormatError(problem, file=given.file, place="camera.depth_scale", mend="leave it out")
    return scale


def _info(bag: Bag, topics: Mapping[Role, str], asked: Asked) -> str | None:
    """The topic of calibration: as named, else the one beside the images, else the only one.

    That beside a raw image comes first: beside a rectified one the distortion may have been left out.
    """
    infos = [topic for topic, kind in sorted(bag.types.items()) if kind == INFO]
    named = asked.topics.get("camera_info")
    if named is not None and named not in infos:
        raise _unknown(bag, "camera_info", named, infos)
    rectified = _rectified(topics)
    roles: list[Role] = ["depth", "color"]
    beside = [_sibling(topics[role], infos) for role in sorted(roles, key=lambda role: rectified[role])]
    name = named or next(filter(None, beside), None)
    if name is None and len(infos) > 1:
        mend = f"name one: --topic camera_info=NAME, of {', '.join(infos)}"
        problem = f"{len(infos)} topics can be camera_info"
        raise FormatError(problem, file=bag.path, place="camera_info", mend=mend)
    return name or next(iter(infos), None)


def _sibling(topic: str, infos: list[str]) -> str | None:
    """The CameraInfo that by ROS' convention lies beside an image."""
    name = f"{_untransported(topic).rsplit('/', 1)[0]}/camera_info"
    return name if name in infos else None


def _untransported(topic: str) -> str:
    for transport in TRANSPORTS:
        topic = topic.removesuffix(transport)
    return topic


def _stamps(bag: Bag, topics: Mapping[Role, str]) -> dict[str, Floats]:
    times: dict[str, list[float]] = {topic: [] for topic in topics.values()}
    for topic, _, logged_ns, message in bag.messages(list(topics.values())):
        times[topic].append(stamp_s(message, logged_ns))
    stamps: dict[str, Floats] = {role: np.array(times[topic]) for role, topic in topics.items()}
    for role, topic in topics.items():
        check_clock(stamps[role], bag.path, topic)
    return stamps


def _poses(
    bag: Bag, topics: Mapping[Role, str], asked: Asked
) -> tuple[Floats | None, Motion | None, list[str]]:
    """The camera's pose and the ends' motion, as far as topics are named, in one frame, and what is odd."""
    named = {role: asked.topics[role] for role in ("camera_pose", "motion") if role in asked.topics}
    images = bag.first(topics["depth"]).header.frame_id.lstrip("/")
    if "camera_pose" in named:
        other = ros_poses.other_frame(bag, named["camera_pose"], images)
        if other is not None:
            problem = f"the images are of the frame {images!r}, which has other axes"
            place = f"--topic camera_pose={named['camera_pose']}"
            raise FormatError(problem, file=bag.path, place=place, mend=f"name {other}")
    logged = {role: ros_poses.poses(bag, name, role) for role, name in named.items()}
    frames = {role: one.frame for role, one in logged.items() if one.frame}
    if len(set(frames.values())) > 1:
        problem = f"the camera's pose is in {frames['camera_pose']!r}, the motion in {frames['motion']!r}"
        place = f"--topic motion={named['motion']}"
        mend = "name poses in one frame, or give camera.world_from_camera in that of the motion"
        raise FormatError(problem, file=bag.path, place=place, mend=mend)
    view, moved = logged.get("camera_pose"), logged.get("motion")
    return (
        None if view is None else one_pose(view.poses, bag.path, named["camera_pose"]),
        None if moved is None else end_motion(moved.t_s, moved.poses, asked.given),
        [] if view is None else _other_axes(bag, images, named["camera_pose"], view.body),
    )


def _other_axes(bag: Bag, images: str, name: str, body: str) -> list[str]:
    """That the camera's pose is one of a frame that is not the images' own."""
    if not body or not images or body == images:
        return []
    problem = f"the images are of {images!r}: its axes are taken to be {body!r}'s"
    mend = "check that these are the camera's optical axes (x right, y down, z forward)"
    return [str(FormatError(problem, file=bag.path, place=f"--topic camera_pose={name}", mend=mend))]
