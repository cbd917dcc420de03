"""What `make chain-bench` looks at: ropes of the laboratory whose axis is known, in rising difficulty.

Shapes in plain view are those of the laboratory's own arc, two of its frames at a time. Loops are drawn with
the seeds 0, 1, 2, ...; one is left out only where the rope would run through itself or leave the image, never
for its score. In the last case all is drawn, ropes, light and what hides them: nothing is set by it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from dlolib.captures.base import Frame
from dlolib.lab.arc import ALONG_X, arc_motion
from dlolib.lab.camera import DEPTH_SCALE, Sensor, default_camera, render
from dlolib.lab.play import play
from dlolib.lab.rope import LabRope
from dlolib.lab.scene import Look, Scene, build_scene
from dlolib.o3d import open3d
from dlolib.types import Camera, CaptureIndex, Ends, Floats, Motion, Obstacle, Pose, Rope

# Frames of a case, and of the laboratory's default capture over the same arc.
FRAMES, CAPTURED, DRAWN = 12, 40, 40
LENGTH_M = 0.445
STEP_M = 0.0005
TABLE, RED = (0.42, 0.33, 0.24), (0.75, 0.12, 0.1)
RED_HSV = ((0, 130, 40), (10, 255, 255))
# Nearest strands of a loop, in diameters, and how close the image's edge may be [px].
CLEAR_OF_ITSELF, CLEAR_OF_EDGE_PX = 1.1, 12
NEIGHBOUR_M = 0.05
BEFORE_M = -0.06
BISECTIONS, NEAR_SHARE, WIDEST = 12, 0.02, 3.0
# What is drawn: diameters, distances in the laboratory's own, the share that is hidden, the light that a
# white rope lacks at the right; every third rope is a loop.
THICK_M, AWAY, COVERED, DIM, LOOPS = (0.004, 0.016), (0.9, 1.5), (0.1, 0.3), (0.0, 0.6), 3


@dataclass(frozen=True)
class Case:
    """One row: what the rope is, what it looks like, what hides it, from where and with which sensor.

    shapes "arc", "loop" (one self-crossing at least), "drawn" (as is all else); hidden "pillar" or "gripper",
    which stand before the rope over this share of its length; distance of the camera, 1 the laboratory's;
    turn_rad, by which it looks aside, so that the rope's end leaves the image.
    """

    name: str
    diameter_m: float = 0.008
    look: Look = field(default_factory=Look)
    sensor: Sensor = field(default_factory=Sensor)
    shapes: str = "arc"
    hidden: str = ""
    share: float = 0.3
    distance: float = 1.0
    turn_rad: float = 0.0
    hsv: tuple[tuple[int, int, int], tuple[int, int, int]] | None = None


CASES = (
    Case("clear"),
    Case("clear_bias", sensor=Sensor(bias_m=0.002)),
    Case("stereo", sensor=Sensor(grain_px=2.0)),
    Case("thin_4mm", diameter_m=0.004),
    Case("thick_16mm", diameter_m=0.016),
    Case("table", look=Look(plate=TABLE)),
    Case("far", distance=1.5),
    Case("coloured", look=Look(rope=RED), hsv=RED_HSV),
    Case("coloured_on_table", look=Look(rope=RED, plate=TABLE), hsv=RED_HSV),
    Case("uneven_light", look=Look(dim=0.7)),
    Case("uneven_on_table", look=Look(plate=TABLE, dim=0.5)),
    Case("pillar", hidden="pillar"),
    Case("gripper", hidden="gripper"),
    Case("crossing", shapes="loop"),
    Case("start_out_of_frame", turn_rad=-0.4),
    Case("end_out_of_frame", turn_rad=0.5),
    Case("drawn", shapes="drawn"),
)


@dataclass(frozen=True)
class Take:
    """One frame and its truth: s_m (N,), axis_m (N, 3) in world axes, visible (N,) from the camera."""

    frame: Frame
    index: CaptureIndex
    s_m: Floats
    axis_m: Floats
    visible: np.ndarray


def takes(case: Case, frames: int = FRAMES) -> Iterator[Take]:
    """Render a case frame by frame."""
    if case.shapes == "drawn":
        for number in range(DRAWN):
            one, shape = drawn(number)
            yield photograph(one, shape, _camera(one), number)
        return
    shapes = arcs(frames) if case.shapes == "arc" else loops(frames, case.diameter_m)
    camera = _camera(case)
    for number, shape in enumerate(shapes):
        yield photograph(case, shape, camera, number)


def drawn(number: int) -> tuple[Case, Floats]:
    """A rope of which all is drawn, and its shape (N, 3) [m]."""
    rng = np.random.default_rng([13, number])
    diameter_m = float(np.exp(rng.uniform(*np.log(THICK_M))))
    red, plate = bool(rng.integers(2)), (None, TABLE)[rng.integers(2)]
    look = Look() if plate is None else Look(plate=plate)
    look = replace(look, rope=RED) if red else replace(look, dim=float(rng.uniform(*DIM)))
    case = Case(
        f"drawn_{number}",
        diameter_m=diameter_m,
        look=look,
        sensor=Sensor(seed=number),
        hidden=str(rng.choice(["", "pillar", "gripper"])),
        share=float(rng.uniform(*COVERED)),
        distance=float(rng.uniform(*AWAY)),
        hsv=RED_HSV if red else None,
    )
    if number % LOOPS == 0:
        return case, list(loops(number // LOOPS + 1, diameter_m))[-1]
    return case, arcs(FRAMES)[rng.integers(FRAMES)]


@cache
def arcs(frames: int) -> Floats:
    """Shapes (frames, 61, 3) [m] of the laboratory's plastic rope, evenly over its arc: pairs of frames that
    follow each other in its default capture."""
    motion, pairs = arc_motion(), frames // 2
    first = np.floor((np.arange(pairs) + 0.5) * CAPTURED / pairs)
    places = np.stack([first, first + 1], axis=-1).ravel()
    return play(LabRope(), motion, (), sample_times_s=motion.t_s[-1] * places / CAPTURED).xyz_m


def loops(frames: int, diameter_m: float) -> Iterator[Floats]:
    """Smooth curves (N, 3) [m] with a full turn, tangent +x at both ends: they cross themselves."""
    seed = found = 0
    while found < frames:
        rng = np.random.default_rng([7, seed])
        seed += 1
        shape = _loop(rng)
        pixel = _pixels(shape, default_camera())
        inside = (pixel > CLEAR_OF_EDGE_PX).all() and (pixel < np.array([640, 576]) - CLEAR_OF_EDGE_PX).all()
        apart = cdist(shape, shape)
        order = np.arange(len(shape)) * LENGTH_M / (len(shape) - 1)
        far = np.abs(order[:, None] - order) > NEIGHBOUR_M
        if inside and apart[far].min() > CLEAR_OF_ITSELF * diameter_m and shape[:, 1].max() < 0.025:
            found += 1
            yield shape


def _loop(rng: np.random.Generator) -> Floats:
    """The tangent turns by a full turn over a part of the length; one strand passes before the other."""
    u = np.linspace(0, 1, 241)
    middle, wide = rng.uniform(0.4, 0.6), rng.uniform(0.7, 0.95)
    share = np.clip((u - middle) / wide + 0.5, 0, 1)
    angle = rng.choice([-1, 1]) * 2 * np.pi * share**2 * (3 - 2 * share)
    angle += rng.uniform(-0.5, 0.5) * np.sin(np.pi * u) * np.sin(2 * np.pi * u)
    angle += rng.uniform(-0.4, 0.4) * np.sin(np.pi * u) ** 2
    depth = rng.choice([-1, 1]) * rng.uniform(0.1, 0.3) * np.sin(2 * np.pi * u)
    way = np.stack([np.cos(angle), depth, np.sin(angle)], axis=-1)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    steps = 0.5 * (way[1:] + way[:-1]) * LENGTH_M / (len(u) - 1)
    shape = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return shape


def photograph(case: Case, shape: Floats, camera: Camera, number: int) -> Take:
    """Render one shape (N, 3) and tell what of its axis is to be seen."""
    knots = np.r_[0, np.cumsum(np.linalg.norm(np.diff(shape, axis=0), axis=1))]
    spline = CubicSpline(knots, shape)
    fine = spline(np.arange(0, knots[-1] + STEP_M / 2, STEP_M))
    s = np.r_[0, np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))]
    start, end = Pose(shape[0], np.array(ALONG_X)), Pose(shape[-1], np.array(ALONG_X))
    scene, obstacles = _hiding(case, shape, fine, camera, start, end)
    color, units = render(scene, camera, case.sensor, number)
    depth_m = (units / float(camera.depth_scale or DEPTH_SCALE)).astype(np.float32)
    poses = [np.tile(value, (2, 1)) for value in (shape[0], ALONG_X, shape[-1], ALONG_X)]
    index = CaptureIndex(
        name=case.name,
        folder=Path(case.name),
        rope=Rope("laboratory rope", float(s[-1]), case.diameter_m, 0.04),
        gravity_m_s2=np.array([0.0, 0.0, -9.81]),
        ends=Ends(),
        camera=camera,
        frame=np.array([number]),
        t_s=np.array([float(number)]),
        motion=Motion(np.array([number - 0.5, number + 0.5]), *poses),
        obstacles=obstacles,
        rope_color_hsv=case.hsv,
    )
    seen = Frame(number, float(number), Path(case.name), color, depth_m)
    return Take(seen, index, s, fine, _visible(scene, camera, fine, case.diameter_m))


def _camera(case: Case) -> Camera:
    camera = default_camera()
    pose = camera.world_from_camera.copy()
    pose[:3, :3] = Rotation.from_rotvec([0, 0, case.turn_rad]).as_matrix() @ pose[:3, :3]
    pose[1, 3] *= case.distance
    return replace(camera, world_from_camera=pose)


def _hiding(
    case: Case, shape: Floats, axis: Floats, camera: Camera, start: Pose, end: Pose
) -> tuple[Scene, tuple[Obstacle, ...]]:
    """The scene with something before the rope that hides the asked share of its length, by bisection."""
    low, high, size = 0.0, WIDEST, 1.0
    for _ in range(BISECTIONS if case.hidden else 1):
        obstacles = _obstacles(case, axis, camera, size)
        scene = build_scene(shape, case.diameter_m / 2, start, end, obstacles, case.look)
        hidden = 1 - _visible(scene, camera, axis, case.diameter_m).mean()
        if abs(hidden - case.share) < NEAR_SHARE:
            break
        low, high = (low, size) if hidden > case.share else (size, high)
        size = 0.5 * (low + high)
    return scene, obstacles


def _obstacles(case: Case, axis: Floats, camera: Camera, size: float) -> tuple[Obstacle, ...]:
    """A pillar before the middle, or a gripper's arm over the last third; `size` times as wide as that."""
    if not case.hidden:
        return ()
    middle, half = (
        (0.5, case.share / 2) if case.hidden == "pillar" else (0.9 - case.share / 2, case.share / 2)
    )
    count = len(axis)
    stretch = axis[int((middle - half) * count) : int((middle + half) * count)]
    eye = camera.world_from_camera[:3, 3]
    # What stands nearer is as wide as what it hides, seen from the camera.
    nearer = (BEFORE_M - eye[1]) / (stretch[:, 1] - eye[1])
    place = eye + nearer[:, None] * (stretch - eye)
    low, high = place.min(axis=0), place.max(axis=0)
    centre, wide = 0.5 * (low + high), size * (high - low)
    if case.hidden == "pillar":
        values = {"center_m": (centre[0], BEFORE_M, 0.0), "axis": (0.0, 0.0, 1.0)}
        return (
            Obstacle("cylinder", {**values, "radius_m": (max(0.5 * wide[0], 0.002),), "height_m": (0.9,)}),
        )
    box = (max(wide[0], 0.03), 0.03, max(wide[2], 0.03))
    placed = {"center_m": (centre[0], BEFORE_M, centre[2]), "quaternion": (1.0, 0.0, 0.0, 0.0)}
    return (Obstacle("box", {**placed, "size_m": box}),)


def _pixels(points: Floats, camera: Camera) -> Floats:
    assert camera.fx and camera.fy and camera.cx and camera.cy
    pose = camera.world_from_camera
    own = (points - pose[:3, 3]) @ pose[:3, :3]
    return np.asarray(own[:, :2] / own[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy])


def _visible(scene: Scene, camera: Camera, axis: Floats, diameter_m: float) -> np.ndarray:
    """Whether the ray to each point of the axis (N, 3) meets the rope's own skin there first."""
    eye = camera.world_from_camera[:3, 3]
    way = axis - eye
    distance = np.linalg.norm(way, axis=1)
    rays = np.concatenate([np.broadcast_to(eye, way.shape), way / distance[:, None]], axis=1)
    hit = scene.rays.cast_rays(open3d.core.Tensor.from_numpy(rays.astype(np.float32)))
    skin = distance - hit["t_hit"].numpy()
    pixel = _pixels(axis, camera)
    inside = ((pixel > 0) & (pixel < np.array([639, 575]))).all(axis=1)
    # The clamp's box touches the very ends.
    return np.asarray(inside & (hit["geometry_ids"].numpy() == 0) & (skin < 1.05 * diameter_m))
