"""A camera that looks at a tube whose axis is known exactly: a yardstick of the tests' own.

World axes: z up, the camera looks along +y. Optics and noise are those of the laboratory, in a plainer
form: 640 x 576, f = 504 px, depth in whole millimetres, noise 0.8 mm (z / 0.7 m)², mixed and lost
readings in the outline's pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from dlolib.captures.base import Frame
from dlolib.formats import write_capture_index
from dlolib.o3d import open3d
from dlolib.types import Camera, CaptureIndex, Ends, Floats, Motion, Rope

WIDTH, HEIGHT, FOCAL = 640, 576, 504.0
FORWARD = np.array([0.5, 0.5, 0.5, 0.5])
NOWHERE = Path("tube")
# A pillar before the middle, a gripper before the end.
PILLAR = ((0.15, -0.05, -0.3), (0.04, 0.02, 0.6))
SIDES = 32
FINE, AMBIENT = 4, 0.3


@dataclass(frozen=True)
class Scene:
    """A rope before a dark plate, and black boxes (corner, size) that hide parts of it.

    Without a direction towards a light the rope is evenly bright; with a grain the noise of depth goes
    together over so many pixels.
    """

    diameter_m: float = 0.008
    boxes: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...] = ()
    plate_y_m: float = 0.1
    camera_m: tuple[float, float, float] = (0.2, -0.75, -0.02)
    rope_level: int = 225
    noisy: bool = True
    light: tuple[float, float, float] | None = None
    grain_px: float = 0.0

    def camera(self) -> Camera:
        view = np.eye(4)
        view[:3, :3] = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
        view[:3, 3] = self.camera_m
        return Camera(view, WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2 - 0.5, HEIGHT / 2 - 0.5, 1000.0)


def wave(swing: float, depth: float = 0.0, length_m: float = 0.445, count: int = 600) -> Floats:
    """An axis (count, 3) [m] from the origin, tangent +x at both ends, swinging in z and in y."""
    u = np.linspace(0, 1, count)
    angle = -swing * np.sin(2 * np.pi * u)
    way = np.stack([np.cos(angle), depth * np.sin(2 * np.pi * u), np.sin(angle)], axis=-1)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    steps = 0.5 * (way[1:] + way[:-1]) * length_m / (count - 1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def photograph(axis: Floats, scene: Scene, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Color (H, W, 3) 8-bit RGB and depth (H, W) 16-bit in millimetres."""
    rng = np.random.default_rng(seed)
    world = open3d.t.geometry.RaycastingScene()
    vertices, faces = _tube(axis, scene.diameter_m / 2)
    rope = world.add_triangles(
        open3d.core.Tensor(vertices.astype(np.float32)), open3d.core.Tensor(faces.astype(np.uint32))
    )
    for corner, size in (*scene.boxes, ((-3.0, scene.plate_y_m, -3.0), (6.0, 0.01, 6.0))):
        box = open3d.geometry.TriangleMesh.create_box(*size).translate(corner)
        world.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(box))
    camera = scene.camera()
    # Open3D puts the centre of the first pixel at (0.5, 0.5), OpenCV and the formats at (0, 0).
    optics = np.array([[FOCAL, 0, camera.cx + 0.5], [0, FOCAL, camera.cy + 0.5], [0, 0, 1]])
    camera_from_world = np.linalg.inv(camera.world_from_camera)
    rays = open3d.t.geometry.RaycastingScene.create_rays_pinhole(
        open3d.core.Tensor(optics), open3d.core.Tensor(camera_from_world), WIDTH, HEIGHT
    )
    hit = world.cast_rays(rays)
    depth = hit["t_hit"].numpy().astype(float) * (rays.numpy()[..., 3:] @ camera.world_from_camera[:3, 2])
    on_rope = hit["geometry_ids"].numpy() == rope
    color = np.where(on_rope, scene.rope_level, 12)[..., None] * np.ones(3)
    if scene.light is not None:
        color = _lit(world, rope, optics, camera_from_world, scene)[..., None] * np.ones(3)
    if scene.noisy:
        depth, color = _noisy(depth, color, on_rope, rng, scene.grain_px)
    return np.clip(color, 0, 255).astype(np.uint8), np.round(depth * 1000).astype(np.uint16)


def write_capture(
    folder: Path, axes: list[Floats], scene: Scene, clamped: bool = True, seed: int = 0
) -> CaptureIndex:
    """Write a capture of these shapes, a second apart; both ends are held (tangent +x), or both free."""
    (folder / "color").mkdir(parents=True)
    (folder / "depth").mkdir()
    for number, axis in enumerate(axes):
        color, depth = photograph(axis, scene, seed + number)
        cv2.imwrite(str(folder / f"color/{number:06d}.png"), cv2.cvtColor(color, cv2.COLOR_RGB2BGR))
        cv2.imwrite(str(folder / f"depth/{number:06d}.png"), depth)
    index = index_of(folder, axes, scene, clamped)
    write_capture_index(index, folder)
    return index


def index_of(folder: Path, axes: list[Floats], scene: Scene, clamped: bool = True) -> CaptureIndex:
    """What capture.json says about such a capture."""
    count = len(axes)
    times = np.arange(float(count))
    turn = np.tile(FORWARD, (count, 1))
    motion = Motion(times, np.array([a[0] for a in axes]), turn, np.array([a[-1] for a in axes]), turn)
    length = float(np.linalg.norm(np.diff(axes[0], axis=0), axis=1).sum())
    kind = "clamped" if clamped else "free"
    return CaptureIndex(
        name="tube",
        folder=folder,
        rope=Rope("tube", length, scene.diameter_m, 0.04),
        gravity_m_s2=np.array([0, 0, -9.81]),
        ends=Ends(kind, kind),
        camera=scene.camera(),
        frame=np.arange(count),
        t_s=times,
        color=tuple(folder / f"color/{number:06d}.png" for number in range(count)),
        depth=tuple(folder / f"depth/{number:06d}.png" for number in range(count)),
        motion=motion if clamped else None,
    )


def without_diameter(index: CaptureIndex) -> CaptureIndex:
    """The same capture of a rope whose diameter nobody measured."""
    return replace(index, rope=replace(index.rope, diameter_m=None))


def along(axis: Floats, s_m: Floats) -> Floats:
    """Points (K, 3) of an axis at arc lengths (K,) from its start."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(axis, axis=0), axis=1))])
    return np.stack([np.interp(s_m, s, axis[:, k]) for k in range(3)], axis=-1)


def _tube(axis: Floats, radius_m: float) -> tuple[Floats, np.ndarray]:
    """Vertices and triangles of a tube with flat caps."""
    tangent = np.gradient(axis, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, (0.0, 1.0, 0.0))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    angle = np.arange(SIDES) * 2 * np.pi / SIDES
    ring = (
        np.cos(angle)[None, :, None] * side[:, None]
        + np.sin(angle)[None, :, None] * np.cross(tangent, side)[:, None]
    )
    vertices = np.concatenate([(axis[:, None] + radius_m * ring).reshape(-1, 3), axis[[0, -1]]])
    row, column = np.arange(len(axis) - 1)[:, None] * SIDES, np.arange(SIDES)[None]
    turn = (column + 1) % SIDES
    faces = [np.stack([row + column, row + turn, row + SIDES + column], -1)]
    faces += [np.stack([row + turn, row + SIDES + turn, row + SIDES + column], -1)]
    last = (len(axis) - 1) * SIDES
    caps = [
        np.stack([first + column[0], first + turn[0], np.full(SIDES, centre)], -1)
        for first, centre in ((0, len(vertices) - 2), (last, len(vertices) - 1))
    ]
    return vertices, np.concatenate([*(face.reshape(-1, 3) for face in faces), *caps])


def _lit(world: Any, rope: int, optics: Floats, camera_from_world: Floats, scene: Scene) -> Floats:
    """Grey levels (H, W) of a matt rope with shadows on itself: each pixel the mean over its own area."""
    fine = optics * np.array([[FINE], [FINE], [1]])
    rays = open3d.t.geometry.RaycastingScene.create_rays_pinhole(
        open3d.core.Tensor(fine), open3d.core.Tensor(camera_from_world), FINE * WIDTH, FINE * HEIGHT
    )
    hit = world.cast_rays(rays)
    normal, way = hit["primitive_normals"].numpy(), rays.numpy()[..., 3:]
    # The tube's triangles are wound one way or the other: what is seen faces the camera.
    normal = -normal * np.sign(np.einsum("ijk,ijk->ij", normal, way))[..., None]
    towards = np.array(scene.light) / np.linalg.norm(np.array(scene.light))
    shade = AMBIENT + (1 - AMBIENT) * np.maximum(normal @ towards, 0)
    level = np.where(hit["geometry_ids"].numpy() == rope, scene.rope_level * shade, 12)
    return np.asarray(level.reshape(HEIGHT, FINE, WIDTH, FINE).mean(axis=(1, 3)))


def _noisy(
    depth: Floats, color: Floats, on_rope: np.ndarray, rng: np.random.Generator, grain_px: float
) -> tuple[Floats, Floats]:
    back = cv2.dilate(depth, np.ones((5, 5)))
    edge = on_rope & (cv2.distanceTransform(on_rope.astype(np.uint8), cv2.DIST_L2, 5) <= 1.0)
    mixed = np.where(edge, depth + 0.6 * rng.uniform(size=depth.shape) * (back - depth), depth)
    noise = rng.normal(size=depth.shape)
    if grain_px:
        noise = cv2.GaussianBlur(noise, (0, 0), grain_px)
        noise /= noise.std()
    mixed += noise * 8e-4 * (depth / 0.7) ** 2
    mixed[edge & (rng.uniform(size=depth.shape) < 0.3)] = 0
    return mixed, color + rng.normal(0, 6, color.shape)


def seen_by(axis: Floats, scene: Scene, clamped: bool = True, seed: int = 0) -> tuple[Frame, CaptureIndex]:
    color, depth = photograph(axis, scene, seed)
    frame = Frame(0, 0.0, NOWHERE, color=color, depth_m=depth.astype(np.float32) / 1000)
    return frame, index_of(NOWHERE, [axis], scene, clamped)


def errors(axis: Floats, s_m: Floats, xyz_m: Floats) -> Floats:
    """Distance [m] (K,) from where the rope is at these arc lengths."""
    return np.linalg.norm(xyz_m - along(axis, s_m), axis=1)


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
