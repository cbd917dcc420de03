"""Record the laboratory's experiment: a capture as a camera and an arm would leave it, and the truth."""

from __future__ import annotations

import zipfile
from dataclasses import asdict, dataclass, field
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np

from dlolib.errors import ParameterError
from dlolib.files import whole_folder, write_json
from dlolib.formats.capture import write_capture_index
from dlolib.formats.motion import interpolate_motion
from dlolib.lab.arc import arc_motion
from dlolib.lab.camera import Sensor, default_camera, render
from dlolib.lab.play import LabRun, play
from dlolib.lab.rope import LabRope
from dlolib.lab.scene import Look, build_scene
from dlolib.progress import track
from dlolib.types import Camera, CaptureIndex, Ends, Floats, Motion, Obstacle, Pose, Rope

GRAVITY_M_S2 = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Experiment:
    """The paper's experiment VI.A: an arc of waypoints, a frame at every so many.

    Args:
        rope, sensor: what is moved and what looks.
        waypoints, waypoint_interval_s: of the arc.
        frame_every: a frame at every so many waypoints, at most all of them.
        obstacles: in the way or in the view.

    Raises:
        ParameterError: there would be no frame.
    """

    rope: LabRope = field(default_factory=LabRope)
    sensor: Sensor = field(default_factory=Sensor)
    waypoints: int = 400
    waypoint_interval_s: float = 0.05
    frame_every: int = 10
    obstacles: tuple[Obstacle, ...] = ()

    def __post_init__(self) -> None:
        if self.frame_every > self.waypoints:
            problem = f"{self.frame_every} leaves no frame of {self.waypoints} waypoints"
            mend = f"give {self.waypoints} or less, or more lab.waypoints"
            raise ParameterError(problem, place="lab.frame_every", mend=mend)


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


def photographs(
    shapes_m: Floats,
    radius_m: float,
    poses: Motion,
    obstacles: tuple[Obstacle, ...],
    camera: Camera,
    sensor: Sensor,
    folder: Path,
    look: Look | None = None,
) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Render a rope of this radius in every frame and write the pictures: the files in colour, and of depth.

    Args:
        shapes_m: points of the axis (F, M, 3).
        poses: of both ends in every frame, (F,) rows.
        look: None for a white rope before a black plate.
    """
    paths: dict[str, list[Path]] = {"color": [], "depth": []}
    for name in paths:
        (folder / name).mkdir()
    for frame, xyz in enumerate(track(shapes_m, "camera", len(shapes_m))):
        start = Pose(poses.start_m[frame], poses.start_q[frame])
        end = Pose(poses.end_m[frame], poses.end_q[frame])
        scene = build_scene(xyz, radius_m, start, end, obstacles, look)
        color, depth = render(scene, camera, sensor, frame)
        for name, picture in (("color", color[..., ::-1]), ("depth", depth)):
            path = folder / name / f"{frame:06d}.png"
            cv2.imwrite(str(path), picture)
            paths[name].append(path)
    return tuple(paths["color"]), tuple(paths["depth"])


def _write_capture(experiment: Experiment, motion: Motion, run: LabRun, folder: Path) -> None:
    camera, rope = default_camera(), experiment.rope
    color, depth = photographs(
        run.xyz_m,
        rope.diameter_m / 2,
        interpolate_motion(motion, run.t_s),
        experiment.obstacles,
        camera,
        experiment.sensor,
        folder,
    )
    index = CaptureIndex(
        name="captured",
        folder=folder,
        rope=Rope("laboratory rope", rope.length_m, rope.diameter_m, rope.linear_density_kg_m),
        gravity_m_s2=np.array(GRAVITY_M_S2),
        ends=Ends(),
        camera=camera,
        frame=np.arange(len(run.t_s)),
        t_s=run.t_s,
        color=color,
        depth=depth,
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
