"""What a depth camera would have seen of a case: a capture, in place of a tracker's points."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dlolib.files import whole_folder
from dlolib.formats import interpolate_motion
from dlolib.formats.capture import write_capture_index
from dlolib.lab.camera import Sensor, default_camera
from dlolib.lab.record import photographs
from dlolib.lab.scene import PLATE_Y_M, Look
from dlolib.proof.draw import Case
from dlolib.proof.write import recording
from dlolib.types import CaptureIndex

CLEAR_M = 0.03


def write_pictures(case: Case, name: str, capture: Path, sensor: Sensor) -> None:
    """Render every frame of a case as the laboratory's camera sees it; no truth lies beside it."""
    given, camera = recording(case, name), default_camera()
    experiment = case.experiment
    radius = experiment.sizes.diameter_m / 2
    # these ropes are moved in space: the plate stands clear of all of it
    reach = float((case.points_m[..., 1] - experiment.motion.start_m[0, 1]).max()) + radius
    look = Look(plate_y_m=max(PLATE_Y_M, reach + CLEAR_M))
    poses = interpolate_motion(experiment.motion, experiment.frame_t_s)
    with whole_folder(capture) as folder:
        color, depth = photographs(
            case.points_m,
            radius,
            poses,
            experiment.obstacles,
            camera,
            sensor,
            folder,
            look,
        )
        index = CaptureIndex(
            name=name,
            folder=folder,
            rope=given.rope,
            gravity_m_s2=given.gravity_m_s2,
            ends=given.ends,
            camera=camera,
            frame=np.arange(len(experiment.frame_t_s)),
            t_s=experiment.frame_t_s,
            color=color,
            depth=depth,
            motion=given.motion,
            obstacles=given.obstacles,
            source=given.source,
            note=given.note,
            static_frames=given.static_frames,
            heldout_frames=given.heldout_frames,
        )
        write_capture_index(index, folder)
