"""Where the camera stands and what stands around: `make calibrate DATA=DIR [CAPTURE=DIR]`.

DIR holds frames with robot_poses.csv and board.json, or markers.json, or all of them. What is found goes to
reports/calibration/<name of DIR>, and into the capture.json of CAPTURE where one is named.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from dlolib.calibrate import (
    calibrate_hand_eye,
    draw_hand_eye,
    draw_obstacles,
    find_obstacles,
    put_into_capture,
    write_calibration,
)
from dlolib.calibrate.folder import read_shots
from dlolib.calibrate.standing import MARKERS
from dlolib.errors import FormatError
from dlolib.files import whole_folder
from dlolib.formats._json import read_json
from dlolib.formats.capture import FORM
from stages import REPORTS, run


def main(data: str, capture: str = "") -> None:
    folder = Path(data)
    moved, marked = (folder / "robot_poses.csv").is_file(), (folder / MARKERS).is_file()
    if not moved and not marked:
        mend = f"add robot_poses.csv and board.json for the camera, {MARKERS} for the obstacles"
        raise FormatError("holds nothing to calibrate by", file=folder, mend=mend)
    camera = calibrate_hand_eye(folder) if moved else None
    view = None if camera is None else camera.world_from_camera
    obstacles = find_obstacles(folder, view) if marked else ()
    if capture:
        read_json(Path(capture) / "capture.json", FORM)
    with whole_folder(REPORTS / "calibration" / folder.resolve().name) as out:
        write_calibration(out / "calibration.json", camera, obstacles)
        if camera is not None:
            draw_hand_eye(camera, out / "camera.png")
        if obstacles:
            shots = read_shots(folder)
            draw_obstacles(
                obstacles,
                shots,
                shots.camera.world_from_camera if view is None else view,
                out / "obstacles.png",
            )
        if capture:
            seen_by = None if camera is None else camera.shots.camera
            put_into_capture(Path(capture), view, obstacles, seen_by)
    if camera is not None:
        apart, turned = (
            float(np.sqrt(np.mean(values**2))) for values in (camera.residual_m, camera.residual_rad)
        )
        print(
            f"camera: {len(camera.frame)} frames agree to {1e3 * apart:.2f} mm and {np.degrees(turned):.2f}°"
        )
    for one in obstacles:
        print(f"marker {one.marker}: {one.obstacle.shape}, corners to {one.corner_px:.2f} px")


if __name__ == "__main__":
    run(main, *sys.argv[1:])
