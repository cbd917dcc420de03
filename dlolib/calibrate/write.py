"""What a calibration found, as JSON, and into the capture.json of captures that it holds for."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dlolib.calibrate.hand_eye import HandEye
from dlolib.calibrate.standing import FoundObstacle
from dlolib.errors import FormatError
from dlolib.files import write_json
from dlolib.formats import read_capture_index, say
from dlolib.formats._json import read_json
from dlolib.formats.capture import FORM
from dlolib.types import Camera, Floats

CALIBRATION = "dlo-calibration/1"
# What optics of one camera differ by from file to file.
SAME_ANGLE = 0.01


def write_calibration(path: Path, camera: HandEye | None, obstacles: Sequence[FoundObstacle] = ()) -> None:
    """Write what was found, with its residuals (mm, degrees, pixels), as JSON."""
    content: dict[str, Any] = {"format": CALIBRATION, "camera": None, "obstacles": []}
    if camera is not None:
        content["camera"] = _camera(camera)
    content["obstacles"] = [_obstacle(found) for found in obstacles]
    write_json(path, content)


def put_into_capture(
    folder: Path,
    world_from_camera: Floats | None,
    obstacles: Sequence[FoundObstacle] = (),
    seen_by: Camera | None = None,
) -> None:
    """Write the camera's pose (4, 4), and the obstacles where there are any, into a capture's capture.json.

    All else in the file stays as it is; the capture is read back and must be whole. Where it was recorded by
    another camera than `seen_by`, whose pose that is, this is said.

    Raises:
        FormatError: no capture, or its camera is no object.
    """
    path = Path(folder) / "capture.json"
    content = read_json(path, FORM)
    if world_from_camera is not None:
        camera = content.get("camera", {})
        if not isinstance(camera, dict):
            mend = "give width, height, fx, fy, cx, cy and depth_scale"
            raise FormatError(f"is {json.dumps(camera)[:40]}", file=path, place="camera", mend=mend)
        content["camera"] = camera | {"world_from_camera": world_from_camera.tolist()}
    if obstacles:
        content["obstacles"] = [obstacle_json(found) for found in obstacles]
    before = path.read_bytes()
    write_json(path, content)
    try:
        index = read_capture_index(folder)
    except Exception:
        path.write_bytes(before)
        raise
    if world_from_camera is not None and seen_by is not None:
        say(_of_another(seen_by, index.camera, path))


def _of_another(seen_by: Camera, camera: Camera, path: Path) -> list[str]:
    """That the capture's camera sees another angle, both across and down, than the one whose pose was found:
    colour and depth of one device are two cameras, 15 to 60 mm apart. More pixels, or a strip cut off, is the
    same one."""
    ours, theirs = _angles(seen_by), _angles(camera)
    if ours is None or theirs is None or (np.abs(ours / theirs - 1) < SAME_ANGLE).any():
        return []
    problem = (
        f"is {camera.fx:g} of {camera.width} pixels, and {seen_by.fx:g} of {seen_by.width} in the frames "
        "of the calibration: another camera, which stands elsewhere"
    )
    mend = "calibrate the one that recorded the capture"
    return [str(FormatError(problem, file=path, place="camera.fx", mend=mend))]


def _angles(camera: Camera) -> Floats | None:
    """Width and height over the focal lengths (2,); None for a capture of point clouds that says none."""
    if not (camera.width and camera.height and camera.fx and camera.fy):
        return None
    return np.array([camera.width / camera.fx, camera.height / camera.fy])


def obstacle_json(found: FoundObstacle) -> dict[str, Any]:
    """The obstacle as recording.json, capture.json and layout.json have it."""
    values = {n: list(v) if len(v) > 1 else v[0] for n, v in found.obstacle.values.items()}
    return json.loads(json.dumps({"shape": found.obstacle.shape, **values}))  # type: ignore[no-any-return]


def _camera(found: HandEye) -> dict[str, Any]:
    rows = zip(found.frame, found.residual_m, found.residual_rad, found.residual_px, strict=True)
    return {
        "world_from_camera": found.world_from_camera.tolist(),
        "tool_from_board": found.tool_from_board.tolist(),
        "residual": {
            "mm": 1e3 * _rms(found.residual_m),
            "degrees": float(np.degrees(_rms(found.residual_rad))),
            "px": _rms(found.residual_px),
        },
        "standard_deviation": {"mm": 1e3 * found.sd_m, "degrees": float(np.degrees(found.sd_rad))},
        "frames": [
            {"frame": int(f), "mm": 1e3 * float(m), "degrees": float(np.degrees(r)), "px": float(p)}
            for f, m, r, p in rows
        ],
        "doubts": list(found.doubts),
        "frames_without_board": list(found.unseen),
    }


def _obstacle(found: FoundObstacle) -> dict[str, Any]:
    return {
        "marker": found.marker,
        "obstacle": obstacle_json(found),
        "frames": found.frames,
        "residual": {
            "px": found.corner_px,
            "scatter_mm": None if found.scatter_m is None else 1e3 * found.scatter_m,
            "scatter_degrees": None if found.scatter_rad is None else float(np.degrees(found.scatter_rad)),
            "depth_mm": None if found.depth_m is None else 1e3 * found.depth_m,
        },
    }


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
