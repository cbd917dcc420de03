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
from dlolib.formats import read_capture_index
from dlolib.formats._json import read_json
from dlolib.formats.capture import FORM
from dlolib.types import Floats

CALIBRATION = "dlo-calibration/1"


def write_calibration(path: Path, camera: HandEye | None, obstacles: Sequence[FoundObstacle] = ()) -> None:
    """Write what was found, with its residuals (mm, degrees, pixels), as JSON."""
    content: dict[str, Any] = {"format": CALIBRATION, "camera": None, "obstacles": []}
    if camera is not None:
        content["camera"] = _camera(camera)
    content["obstacles"] = [_obstacle(found) for found in obstacles]
    write_json(path, content)


def put_into_capture(
    folder: Path, world_from_camera: Floats | None, obstacles: Sequence[FoundObstacle] = ()
) -> None:
    """Write the camera's pose (4, 4), and the obstacles where there are any, into a capture's capture.json.

    All else in the file stays as it is; the capture is read back and must be whole.

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
        read_capture_index(folder)
    except Exception:
        path.write_bytes(before)
        raise


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
