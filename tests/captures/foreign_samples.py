"""The same few frames, written as each format that `dlo ingest` reads."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import cycle
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from formats import samples
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from dlolib.formats import write_capture_index, write_motion
from dlolib.types import Camera, CaptureIndex, Ends, Motion

WIDTH, HEIGHT = 32, 24
VIEW = np.array([[1.0, 0, 0, 0.1], [0, 0, 1, -0.7], [0, -1, 0, 0.2], [0, 0, 0, 1]])
OPTICS = {"fx": 30.0, "fy": 31.0, "cx": 15.5, "cy": 11.25}
COLOR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
INFO, TOOL, TF = "/camera/color/camera_info", "/tcp_pose", "tf2_msgs/msg/TFMessage"
BODY, EYE = "/mocap", "/camera_pose"
# Depth images are taken so much before their colour images, where a format has two times.
EARLY_NS = 4_000_000


@dataclass(frozen=True)
class Frames:
    """Times [ns], colour (F, H, W, 3) in RGB, depth (F, H, W) in units of 1 / scale metres."""

    ns: list[int]
    color: NDArray[np.uint8]
    depth: NDArray[np.uint16]
    scale: float = 1000.0


def frames(count: int = 3, width: int = WIDTH, height: int = HEIGHT) -> Frames:
    """Noise in colour and in depth, about 0.7 m away; the clock counts from 1970, as a robot's does."""
    rng = np.random.default_rng(7)
    color = rng.integers(0, 256, (count, height, width, 3), dtype=np.uint8)
    depth = rng.integers(600, 800, (count, height, width), dtype=np.uint16)
    depth[:, 0, 0] = 0
    return Frames([1_700_000_000_123_000_000 + 100_000_000 * row for row in range(count)], color, depth)


def motion(shot: Frames) -> Motion:
    """The end goes 10 mm along x within the recording, a little before it and a little after."""
    poses = samples.motion()
    span = np.linspace(-0.1, 0.4, len(poses.t_s))
    return replace(poses, t_s=np.array([(shot.ns[0] + round(s * 1e9)) / 10**9 for s in span]))


def given(path: Path, **changes: Any) -> Path:
    """What no camera knows, with both ends free unless the changes say otherwise."""
    content = {
        "format": "dlo-capture/1",
        "name": "tiny",
        "object": {"name": "rope", "length_m": 0.445, "diameter_m": 0.008, "linear_density_kg_m": 0.04},
        "gravity_m_s2": [0, 0, -9.81],
        "ends": {"start": "free", "end": "free"},
        "camera": {"world_from_camera": VIEW.tolist()},
    }
    path.write_text(json.dumps(content | changes))
    return path


def camera_of(scale: float = 1000.0, **optics: float) -> dict[str, Any]:
    """The key `camera` in full."""
    sizes = {"width": WIDTH, "height": HEIGHT}
    return {**sizes, **OPTICS, "depth_scale": scale, "world_from_camera": VIEW.tolist()} | optics


def own(folder: Path, shot: Frames, camera: Camera | None = None, moved: Motion | None = None) -> Path:
    """This project's own folder: what every other format must come to."""
    (folder / "color").mkdir(parents=True)
    (folder / "depth").mkdir()
    names = [f"{row:06d}.png" for row in range(len(shot.ns))]
    for row, name in enumerate(names):
        cv2.imwrite(str(folder / "color" / name), shot.color[row, ..., ::-1])
        cv2.imwrite(str(folder / "depth" / name), shot.depth[row])
    held = "free" if moved is None else "clamped"
    index = CaptureIndex(
        name="tiny",
        folder=folder,
        rope=samples.ROPE,
        gravity_m_s2=samples.GRAVITY,
        ends=Ends(held, held),
        camera=camera or Camera(VIEW, WIDTH, HEIGHT, *OPTICS.values(), shot.scale),
        frame=np.arange(len(names)),
        t_s=np.array([ns / 10**9 for ns in shot.ns]),
        color=tuple(folder / "color" / name for name in names),
        depth=tuple(folder / "depth" / name for name in names),
        motion=moved,
    )
    write_capture_index(index, folder)
    return folder


def tum(folder: Path, shot: Frames) -> Path:
    """TUM RGB-D; depth is 4 ms early."""
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    lists: dict[str, list[str]] = {"rgb": ["# color images"], "depth": ["# depth images"]}
    for row, ns in enumerate(shot.ns):
        for name, early, image in (
            ("rgb", 0, shot.color[row, ..., ::-1]),
            ("depth", EARLY_NS, shot.depth[row]),
        ):
            at = f"{(ns - early) // 10**9}.{(ns - early) % 10**9 // 1000:06d}"
            cv2.imwrite(str(folder / name / f"{at}.png"), image)
            lists[name].append(f"{at} {name}/{at}.png")
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return folder


def ground_truth(folder: Path, shot: Frames, drift_m: float = 0.0) -> None:
    """groundtruth.txt of a camera at VIEW."""
    turn = Rotation.from_matrix(VIEW[:3, :3]).as_quat()
    lines = ["# timestamp tx ty tz qx qy qz qw"]
    for row, ns in enumerate(shot.ns):
        place = VIEW[:3, 3] + [drift_m * row, 0, 0]
        lines.append(" ".join(repr(float(value)) for value in (ns / 1e9, *place, *turn)))
    (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")


def redwood(folder: Path, shot: Frames, **calibration: Any) -> Path:
    """Open3D's folder with Redwood's names."""
    (folder / "color").mkdir(parents=True)
    (folder / "depth").mkdir()
    for row, ns in enumerate(shot.ns):
        name = f"{row + 1:07d}-{ns // 1000:012d}.png"
        cv2.imwrite(str(folder / "color" / name), shot.color[row, ..., ::-1])
        cv2.imwrite(str(folder / "depth" / name), shot.depth[row])
    matrix = [OPTICS["fx"], 0, 0, 0, OPTICS["fy"], 0, OPTICS["cx"], OPTICS["cy"], 1]
    content = {"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": matrix} | calibration
    (folder / "camera_intrinsic.json").write_text(json.dumps(content))
    return folder


@dataclass(frozen=True)
class Ros:
    """How a bag is written: "ros1", "ros2" or "mcap", and what may be wrong with it."""

    kind: str = "ros1"
    color: str = "rgb8"
    depth: str = "16UC1"
    info: bool = True
    calibrated: bool = True
    second_depth: bool = False
    distortion: tuple[float, ...] = (0.0,) * 5
    model: str = "plumb_bob"
    binning: int = 0
    region: tuple[int, int, int, int] = (0, 0, 0, 0)
    backwards: bool = False
    padding: int = 0
    root: str = ""
    topics: tuple[str, str] = (COLOR, DEPTH)
    depth_frame: str = "camera"
    tool_frames: tuple[str, ...] = ("world",)
    tool_links: tuple[str, ...] = ("base",)
    bases_link: str = "world"
    info_frame: str = "camera"
    info_topic: str = INFO
    eye: str = "eye"
    bodies: tuple[str, ...] = ()
    """Of whom transforms are logged on a topic of their own, in turn, and the camera's on another."""

    @property
    def store(self) -> Any:
        store = get_typestore(Stores.ROS1_NOETIC if self.kind == "ros1" else Stores.ROS2_HUMBLE)
        if TF not in store.types:
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
        return store


def bag(path: Path, shot: Frames, how: Ros, moved: Motion | None = None) -> Path:
    """A bag with colour, depth, calibration, a tool's pose, and tf of that tool and of the camera."""
    make = Messages(how)
    rows: list[tuple[int, str, Any]] = []
    stamps = shot.ns[::-1] if how.backwards else shot.ns
    color, depth = (how.root + topic for topic in how.topics)
    for row, ns in enumerate(shot.ns):
        rows.append((ns + 2, depth, make.depth(shot.depth[row], stamps[row] - EARLY_NS, shot.scale)))
        rows.append((ns + 1, color, make.color(shot.color[row], stamps[row])))
        if how.second_depth:
            rows.append((ns + 3, "/other/depth", make.depth(shot.depth[row], stamps[row], shot.scale)))
    if how.info:
        rows.append((shot.ns[0], how.info_topic, make.info(shot.ns[0])))
    rows += make.static(shot.ns[0])
    if moved is not None:
        rows += [
            row for pose in zip(moved.t_s, moved.end_m, moved.end_q, strict=True) for row in make.moved(*pose)
        ]
    _write(path, sorted(rows, key=lambda row: row[:2]), how)
    return path


def _write(path: Path, rows: list[tuple[int, str, Any]], how: Ros) -> None:
    store, topics = how.store, {}
    plugin = StoragePlugin.MCAP if how.kind == "mcap" else StoragePlugin.SQLITE3
    first = how.kind == "ros1"
    with Writer1(path) if first else Writer2(path, version=9, storage_plugin=plugin) as writer:
        for ns, topic, message in rows:
            kind = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            data = store.serialize_ros1(message, kind) if first else store.serialize_cdr(message, kind)
            writer.write(topics[topic], ns, data)


class Messages:
    """ROS messages of both generations."""

    def __init__(self, how: Ros) -> None:
        self.how, self.types, self.frames = how, how.store.types, cycle(how.tool_frames)
        self.bodies = cycle(how.bodies)

    def header(self, ns: int, frame: str = "camera") -> Any:
        time = self.types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        more = {"seq": 0} if self.how.kind == "ros1" else {}
        return self.types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **more)

    def image(self, pixels: NDArray[Any], encoding: str, ns: int, frame: str = "camera") -> Any:
        height, width = pixels.shape[:2]
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(height, -1)
        rows = np.pad(rows, ((0, 0), (0, self.how.padding)), constant_values=255)
        return self.types["sensor_msgs/msg/Image"](
            header=self.header(ns, frame),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=int(pixels.dtype.byteorder == ">"),
            step=rows.shape[1],
            data=rows.ravel(),
        )

    def compressed(self, data: bytes, form: str, ns: int) -> Any:
        kind = self.types["sensor_msgs/msg/CompressedImage"]
        return kind(header=self.header(ns), format=form, data=np.frombuffer(data, np.uint8))

    def color(self, image: NDArray[np.uint8], ns: int) -> Any:
        kind = self.how.color
        if kind in ("png", "jpeg"):
            data = cv2.imencode(f".{kind}", image[..., ::-1])[1].tobytes()
            return self.compressed(data, f"rgb8; {kind} compressed bgr8", ns)
        orders = {
            "rgb8": [0, 1, 2],
            "bgr8": [2, 1, 0],
            "bgra8": [2, 1, 0, 0],
            "rgba8": [0, 1, 2, 0],
            "mono8": [0],
        }
        return self.image(image[..., orders[kind]], kind, ns)

    def depth(self, image: NDArray[np.uint16], ns: int, scale: float) -> Any:
        kind = self.how.depth
        if kind == "compressedDepth":
            data = struct.pack("<iff", 0, 0.0, 0.0) + cv2.imencode(".png", image)[1].tobytes()
            return self.compressed(data, "16UC1; compressedDepth png", ns)
        if kind == "png":
            return self.compressed(cv2.imencode(".png", image)[1].tobytes(), "16UC1; png compressed ", ns)
        if kind == "inverse":
            a, b = 10100.0, 1 - 10100.0 / 10.0
            stored = np.where(image > 0, np.rint(a / np.maximum(image, 1) * scale + b), 0).astype(np.uint16)
            data = struct.pack("<iff", 0, a, b) + cv2.imencode(".png", stored)[1].tobytes()
            return self.compressed(data, "32FC1; compressedDepth png", ns)
        if kind == "32FC1":
            metres = np.where(image > 0, image / np.float32(scale), np.nan)
            return self.image(metres.astype(np.float32), kind, ns)
        return self.image(image.astype(">u2") if kind == "big" else image, "16UC1", ns, self.how.depth_frame)

    def info(self, ns: int) -> Any:
        """For the whole sensor, of which the images are the region (left, top, width, height), binned."""
        fx, fy, cx, cy = OPTICS.values()
        times, (left, top, wide, high) = max(self.how.binning, 1), self.how.region
        cx, cy = (cx + 0.5) * times - 0.5 + left, (cy + 0.5) * times - 0.5 + top
        matrix = np.array([times * fx, 0, cx, 0, times * fy, cy, 0, 0, 1]) * self.how.calibrated
        projection = np.insert(matrix, (3, 6, 9), 0.0)
        bent = np.array(self.how.distortion)
        region = self.types["sensor_msgs/msg/RegionOfInterest"]
        roi = region(x_offset=left, y_offset=top, height=high, width=wide, do_rectify=False)
        values = {"D": bent, "K": matrix, "R": np.eye(3).ravel(), "P": projection}
        named = values if self.how.kind == "ros1" else {name.lower(): value for name, value in values.items()}
        sizes = {"height": HEIGHT * times + 2 * top, "width": WIDTH * times + 2 * left, "roi": roi}
        binned = {"binning_x": self.how.binning, "binning_y": self.how.binning}
        kind = self.types["sensor_msgs/msg/CameraInfo"]
        return kind(
            header=self.header(ns, self.how.info_frame),
            distortion_model=self.how.model,
            **named,
            **sizes,
            **binned,
        )

    def pose(self, place: NDArray[Any], turn: NDArray[Any]) -> tuple[Any, Any]:
        point = dict(zip("xyz", (float(v) for v in place), strict=True))
        return point, self.types["geometry_msgs/msg/Quaternion"](
            **dict(zip("wxyz", (float(v) for v in turn), strict=True))
        )

    def link(self, ns: int, parent: str, child: str, place: Any, turn: Any) -> Any:
        point, rotation = self.pose(place, turn)
        moved = self.types["geometry_msgs/msg/Transform"](
            translation=self.types["geometry_msgs/msg/Vector3"](**point), rotation=rotation
        )
        kind = self.types["geometry_msgs/msg/TransformStamped"]
        stamped = kind(header=self.header(ns, parent), child_frame_id=child, transform=moved)
        return self.types[TF](transforms=[stamped])

    def static(self, ns: int) -> list[tuple[int, str, Any]]:
        """A base 1 m above the world's origin, and the camera in the world."""
        turn = Rotation.from_matrix(VIEW[:3, :3]).as_quat(scalar_first=True)
        base = self.link(ns, self.how.bases_link, "base", np.array([0, 0, 1.0]), np.array([1.0, 0, 0, 0]))
        eye = self.link(ns, "world", self.how.eye, VIEW[:3, 3], turn)
        alone = [(ns, EYE, eye.transforms[0])] if self.how.bodies else []
        return [(ns, "/tf_static", base), (ns, "/tf_static", eye), *alone]

    def moved(self, t_s: float, place: NDArray[Any], turn: NDArray[Any]) -> list[tuple[int, str, Any]]:
        """The tool in the world, by topic and as a frame below the base."""
        ns = round(Fraction(t_s) * 10**9)
        point, rotation = self.pose(place, turn)
        pose = self.types["geometry_msgs/msg/Pose"](
            position=self.types["geometry_msgs/msg/Point"](**point), orientation=rotation
        )
        stamped = self.types["geometry_msgs/msg/PoseStamped"](
            header=self.header(ns, next(self.frames)), pose=pose
        )
        below = place - [0, 0, 1.0]
        links = [(ns, "/tf", self.link(ns, parent, "tool", below, turn)) for parent in self.how.tool_links]
        if self.how.bodies:
            body = self.link(ns, "world", next(self.bodies), place, turn).transforms[0]
            links.append((ns, BODY, body))
        return [(ns, TOOL, stamped), *links]


# The depth camera of a binned narrow view, and a colour camera in the same place with twice its focal length,
# whose pixels 2u + 320.5 and 2v + 72.5 the depth camera's u and v fall on.
KINECT_WIDTH, KINECT_HEIGHT = 320, 288
KINECT = {"fx": 252.0, "fy": 252.0, "cx": 159.5, "cy": 143.5}
# Of Matroska's element that holds a BITMAPINFOHEADER of 40 bytes.
HEADER = b"\x63\xa2\xa8"


def calibration(shift_m: float = 0.0) -> dict[str, Any]:
    """What an Azure Kinect attaches, without distortion; the colour camera sits `shift_m` along x."""

    def camera(where: str, size: tuple[int, int], matrix: list[float], shift: float) -> dict[str, Any]:
        lens = {"ModelParameterCount": 14, "ModelParameters": matrix + [0.0] * 10}
        lens["ModelType"] = "CALIBRATION_LensDistortionModelBrownConrady"
        pose = {"Rotation": np.eye(3).ravel().tolist(), "Translation": [-shift, 0.0, 0.0]}
        sizes = {"SensorWidth": size[0], "SensorHeight": size[1]}
        return {"Location": f"CALIBRATION_CameraLocation{where}", "Intrinsics": lens, "Rt": pose, **sizes}

    fx, fy, cx, cy = KINECT.values()
    near = [(cx + 96 + 0.5) / 512, (cy + 90 + 0.5) / 512, fx / 512, fy / 512]
    far = [(2 * cx + 321) / 1280, (2 * cy + 73 + 120) / 960, 2 * fx / 1280, 2 * fy / 960]
    cameras = [camera("D0", (1024, 1024), near, 0.0), camera("PV0", (4096, 3072), far, shift_m)]
    return {"CalibrationInformation": {"Cameras": cameras}}


def kinect(
    path: Path,
    shot: Frames,
    attached: dict[str, Any] | None = None,
    tracks: str = "DEPTH",
    color: tuple[str, str] = ("rawvideo", "bgra"),
) -> Path:
    """An Azure Kinect's .mkv, its colour not compressed unless asked; FFmpeg counts milliseconds."""
    millisecond = Fraction(1, 1000)
    with av.open(str(path), "w", format="matroska", options={"allow_raw_vfw": "1"}) as file:
        streams = []
        raw = ("rawvideo", "gray16be")
        for title, form, size in (("COLOR", color, (1280, 720)), (tracks, raw, shot.depth.shape[:0:-1])):
            stream = file.add_stream(form[0], rate=10)
            stream.width, stream.height, stream.pix_fmt = int(size[0]), int(size[1]), form[1]
            stream.metadata["title"] = title
            stream.codec_context.time_base = millisecond
            streams.append(stream)
        file.metadata["K4A_START_OFFSET_NS"] = str(shot.ns[0])
        if attached is not None:
            data = json.dumps(attached).encode() + b"\0"
            file.add_attachment("calibration.json", "application/octet-stream", data)
        for row, ns in enumerate(shot.ns):
            large = np.zeros((720, 1280, 3), np.uint8)
            large[72 : 72 + 2 * KINECT_HEIGHT, 320:960] = shot.color[row].repeat(2, 0).repeat(2, 1)
            images = (
                av.VideoFrame.from_ndarray(large, format="rgb24").reformat(format=color[1]),
                av.VideoFrame.from_ndarray(shot.depth[row], format="gray16be"),
            )
            for stream, image in zip(streams, images, strict=True):
                image.pts, image.time_base = (ns - shot.ns[0]) // 10**6, millisecond
                file.mux(stream.encode(image))
    # FFmpeg's muxer leaves the device's name of 16-bit grey out of the header.
    content = bytearray(path.read_bytes())
    at = content.index(HEADER, content.index(tracks.encode())) + len(HEADER) + 16
    content[at : at + 4] = b"b16g"
    path.write_bytes(bytes(content))
    return path


def elsewhere(folder: Path, moved: Motion) -> Path:
    """motion.csv outside of any capture."""
    write_motion(moved, folder / "robot.csv")
    return folder / "robot.csv"


def files(folder: Path) -> dict[str, bytes]:
    """What lies in a folder, by its path there."""
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }
