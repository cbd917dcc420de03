"""Record the laboratory's experiment: a capture as a camera and an arm would leave it, and the truth."""

from __future__ import annotations

import zipfile
from dataclasses import asdict, dataclass, field
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np

from dlolib.files import whole_folder, write_json
from dlolib.formats.capture import write_capture_index
from dlolib.lab.arc import arc_motion
from dlolib.lab.camera import Sensor, default_camera, render
from dlolib.lab.play import LabRun, play
from dlolib.lab.rope import LabRope
from dlolib.lab.scene import build_scene
from dlolib.progress import track
from dlolib.types import CaptureIndex, Ends, Floats, Motion, Obstacle, Pose, Rope

GRAVITY_M_S2 = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Experiment:
    """The paper's experiment VI.A: an arc of waypoints, a frame at every so many.

    Args:
        rope, sensor: what is moved and what looks.
        waypoints, waypoint_interval_s: of the arc.
        frame_every: a frame at every so many waypoints.
        obstacles: in the way or in the view.
    """

    rope: LabRope = field(default_factory=LabRope)
    sensor: Sensor = field(default_factory=Sensor)
    waypoints: int = 400
    waypoint_interval_s: float = 0.05
    frame_every: int = 10
    obstacles: tuple[Obstacle, ...] = ()


def record(experiment: Experiment, capture: Path, truth: Path) -> LabRun:
    """Play the arc, look at it, and write the capture's folder and the truth's.

    The truth is `truth.json` (the rope's law and values, the smallest clearance) and `shapes.npz` (t_s
    (F,), s_m (M,), xyz_m (F, M, 3), plastic_1_m (F, M, 2)), which only the report may read.

    Raises:
        ParameterError: settings that no rope can follow.
        SimulationError: the rope became unstable.
    """
    motion = arc_motion(experiment.waypoints, experiment.waypoint_interval_s)
    frames = np.arange(experiment.frame_every, experiment.waypoints + 1, experiment.frame_every) - 1
    run = play(experiment.rope, motion, experiment.obstacles, GRAVITY_M_S2, motion.t_s[frames])
    with whole_folder(capture) as folder:
        _write_capture(experiment, motion, run, folder)
    with whole_folder(truth) as folder:
        _write_truth(experiment, run, folder)
    return run


def _write_capture(experiment: Experiment, motion: Motion, run: LabRun, folder: Path) -> None:
    camera, rope = default_camera(), experiment.rope
    start = Pose(motion.start_m[0], motion.start_q[0])
    ends = [np.interp(run.t_s, motion.t_s, column) for column in motion.end_m.T]
    paths: dict[str, list[Path]] = {"color": [], "depth": []}
    for name in paths:
        (folder / name).mkdir()
    for frame, xyz in enumerate(track(run.xyz_m, "camera", len(run.t_s))):
        end = Pose(np.array([column[frame] for column in ends]), motion.end_q[0])
        scene = build_scene(xyz, rope.diameter_m / 2, start, end, experiment.obstacles)
        color, depth = render(scene, camera, experiment.sensor, frame)
        for name, picture in (("color", color[..., ::-1]), ("depth", depth)):
            path = folder / name / f"{frame:06d}.png"
            cv2.imwrite(str(path), picture)
            paths[name].append(path)
    index = CaptureIndex(
        name="captured",
        folder=folder,
        rope=Rope("laboratory rope", rope.length_m, rope.diameter_m, rope.linear_density_kg_m),
        gravity_m_s2=np.array(GRAVITY_M_S2),
        ends=Ends(),
        camera=camera,
        frame=np.arange(len(run.t_s)),
        t_s=run.t_s,
        color=tuple(paths["color"]),
        depth=tuple(paths["depth"]),
        motion=motion,
        obstacles=experiment.obstacles,
        source="virtual laboratory",
        note=f"{experiment.waypoints} waypoints out and back, a frame at every {experiment.frame_every}",
    )
    write_capture_index(index, folder)


def _write_truth(experiment: Experiment, run: LabRun, folder: Path) -> None:
    rope = asdict(experiment.rope)
    clearance = run.min_clearance_m if np.isfinite(run.min_clearance_m) else None
    content = {"format": "dlo-truth/1", **rope, "torsional_stiffness_n_m2": rope["bending_stiffness_n_m2"]}
    write_json(folder / "truth.json", content | {"min_clearance_m": clearance})
    _write_arrays(
        folder / "shapes.npz", t_s=run.t_s, s_m=run.s_m, xyz_m=run.xyz_m, plastic_1_m=run.plastic_1_m
    )


def _write_arrays(path: Path, **arrays: Floats) -> None:
    """As `numpy.savez` does, but with headers that do not depend on Python's own version."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, values in arrays.items():
            buffer = BytesIO()
            np.lib.format.write_array(buffer, np.asarray(values), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), buffer.getvalue())
