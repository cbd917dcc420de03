"""The same few frames as librealsense's recorder writes them, after a bag of its version 2.54."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from captures import foreign_samples as foreign
from captures.foreign_samples import Frames, Ros
from rosbags.rosbag1 import Writer
from scipy.spatial.transform import Rotation

from dlolib.types import Floats

COLOR, DEPTH = "/device_0/sensor_1/Color_0", "/device_0/sensor_0/Depth_0"
UNITS = "/device_0/sensor_0/option/Depth_Units/value"


def realsense(
    path: Path,
    shot: Frames,
    how: Ros = Ros(model="Brown Conrady"),  # noqa: B008, frozen
    color_from_depth: Floats | None = None,
    lacking: Sequence[str] = (),
) -> Path:
    """Depth some ms before colour; what lacks begins with one of these topics. The lens is that of colour."""
    make = foreign.Messages(how)
    straight = foreign.Messages(replace(how, distortion=(0.0,) * 5, model="None"))
    types = how.store.types
    rows: list[tuple[int, str, Any]] = [
        (0, f"{DEPTH}/info/camera_info", straight.info(0)),
        (0, f"{COLOR}/info/camera_info", make.info(0)),
        (0, UNITS, types["std_msgs/msg/Float32"](data=float(np.float32(1 / shot.scale)))),
        (0, f"{DEPTH}/tf/1", _transform(types, np.eye(4))),
        (0, f"{COLOR}/tf/1", _transform(types, np.eye(4) if color_from_depth is None else color_from_depth)),
    ]
    for row, ns in enumerate(shot.ns):
        at = ns - shot.ns[0] + 1
        rows.append((at, f"{DEPTH}/image/data", make.image(shot.depth[row], "mono16", ns - foreign.EARLY_NS)))
        rows.append((at + 1, f"{COLOR}/image/data", make.color(shot.color[row], ns)))
    topics = {}
    with Writer(path) as writer:
        for at, topic, message in rows:
            if topic.startswith(tuple(lacking)):
                continue
            kind = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=how.store)
            data = bytes(how.store.serialize_ros1(message, kind))
            writer.write(topics[topic], at, data + bytes(4) if topic.endswith("image/data") else data)
    return path


def _transform(types: dict[str, Any], pose: Floats) -> Any:
    place = types["geometry_msgs/msg/Vector3"](**dict(zip("xyz", map(float, pose[:3, 3]), strict=True)))
    turn = Rotation.from_matrix(pose[:3, :3]).as_quat()
    rotation = types["geometry_msgs/msg/Quaternion"](**dict(zip("xyzw", map(float, turn), strict=True)))
    return types["geometry_msgs/msg/Transform"](translation=place, rotation=rotation)
