"""What the laboratory's camera sees: rope, plate, clamp, gripper and obstacles as triangle meshes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from dlolib.lab.turn import from_z
from dlolib.o3d import open3d
from dlolib.types import Floats, Ints, Obstacle, Pose

Values = Mapping[str, Floats]

SIDES, RINGS_PER_BODY = 32, 4
# Reflectances: white rope with darker strands, black plate, the rest dark grey.
ROPE, STRAND, PLATE, CLAMP, GRIPPER, OBSTACLE = 0.9, 0.08, 0.04, 0.12, 0.16, 0.22
STRAND_PITCH_M, STRANDS = 0.02, 3
LIGHT = np.array([-0.35, -0.8, 0.5]) / np.linalg.norm([-0.35, -0.8, 0.5])
AMBIENT = 0.35
PLATE_Y_M = 0.03
# Boxes: from, to along the tangent (third axis), full sizes along the first and second.
CLAMP_BOX_M = ((-0.03, 0.0), 0.03, 0.03)
JAW_BOX_M = ((0.0, 0.05), 0.03, 0.03)
WRIST_BOX_M = ((0.05, 0.22), 0.05, 0.06)
FAR_M = 0.5


@dataclass(frozen=True)
class Look:
    """What the rope and what is behind it look like: reflectances in red, green and blue.

    rope, plate; dim: the share of light that is missing at the right edge of the image; plate_y_m: how far
    behind the wall's clamp the plate stands [m].
    """

    rope: tuple[float, float, float] = (ROPE, ROPE, ROPE)
    plate: tuple[float, float, float] = (PLATE, PLATE, PLATE)
    dim: float = 0.0
    plate_y_m: float = PLATE_Y_M


@dataclass(frozen=True)
class Scene:
    """Open3D's RaycastingScene; first (G,) triangle of each mesh; how bright each triangle is in red, green
    and blue, shades (triangles + 1, 3), where the last is nothing, which is black."""

    rays: Any
    first: Ints
    shades: Floats
    dim: float


def build_scene(
    xyz_m: Floats,
    radius_m: float,
    start: Pose,
    end: Pose,
    obstacles: tuple[Obstacle, ...] = (),
    look: Look | None = None,
) -> Scene:
    """Meshes of one moment.

    Args:
        xyz_m: points of the rope's axis [m], shape (M, 3).
        radius_m: of the rope [m].
        start: where the wall's clamp holds the rope.
        end: where the gripper holds it; jaw and wrist reach away along the tangent.
        obstacles: planes among them stay unseen, for they have no end.
        look: None for a white rope before a black plate.
    """
    look = look or Look()
    tube, strands = _tube(xyz_m, radius_m)
    meshes = [(tube, strands[:, None] * look.rope), (_plate(start.position_m, look.plate_y_m), look.plate)]
    meshes += [(_held(start, CLAMP_BOX_M), CLAMP)]
    meshes += [(_held(end, box), GRIPPER) for box in (JAW_BOX_M, WRIST_BOX_M)]
    meshes += [(_obstacle(one), OBSTACLE) for one in obstacles if one.shape in MESHES]
    scene = open3d.t.geometry.RaycastingScene()
    shades, first = [], [0]
    for mesh, albedo in meshes:
        scene.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(mesh))
        shades.append(_lit(mesh)[:, None] * np.ones(3) * np.asarray(albedo))
        first.append(first[-1] + len(mesh.triangles))
    return Scene(scene, np.array(first[:-1]), np.concatenate([*shades, np.zeros((1, 3))]), look.dim)


def _lit(mesh: Any) -> Floats:
    """The share of the light that falls on each triangle, from either side, (triangles,)."""
    facing = np.asarray(mesh.compute_triangle_normals().triangle_normals) @ LIGHT
    return np.asarray(AMBIENT + (1 - AMBIENT) * np.abs(facing))


def _tube(xyz: Floats, radius: float) -> tuple[Any, Floats]:
    """A round tube around a spline through the points, and how bright each triangle's strand is."""
    s = np.r_[0, np.cumsum(np.linalg.norm(np.diff(xyz, axis=0), axis=1))]
    spline = CubicSpline(s, xyz)
    along = np.linspace(0, s[-1], RINGS_PER_BODY * (len(xyz) - 1) + 1)
    points, tangents = spline(along), spline(along, 1)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    around = 2 * np.pi * np.arange(SIDES) / SIDES
    first, second = _frames(tangents)
    rings = (
        points[:, None]
        + radius * np.cos(around)[:, None] * first[:, None]
        + radius * np.sin(around)[:, None] * second[:, None]
    )
    ring, side = np.meshgrid(np.arange(len(points) - 1), np.arange(SIDES), indexing="ij")
    a, b = ring * SIDES + side, ring * SIDES + (side + 1) % SIDES
    faces = np.stack([a, b, a + SIDES, b, b + SIDES, a + SIDES], axis=-1).reshape(-1, 3)
    phase = 2 * np.pi * along[ring] / STRAND_PITCH_M + STRANDS * around[side]
    darker = 1 - STRAND * (0.5 + 0.5 * np.sin(phase))
    return _mesh(rings.reshape(-1, 3), faces), np.repeat(darker.ravel(), 2)


def _frames(tangents: Floats) -> tuple[Floats, Floats]:
    """Two normals to each tangent, (N, 3) each, carried along without twist."""
    first = np.empty_like(tangents)
    seed = np.eye(3)[np.argmin(np.abs(tangents[0]))]
    for index, tangent in enumerate(tangents):
        seed = seed - (seed @ tangent) * tangent
        seed = seed / np.linalg.norm(seed)
        first[index] = seed
    return first, np.cross(tangents, first)


def _plate(origin: Floats, behind: float) -> Any:
    """The wall's black plate behind the rope."""
    box = open3d.geometry.TriangleMesh.create_box(2 * FAR_M, 0.01, 2 * FAR_M)
    return box.translate(origin + np.array([0.2 - FAR_M, behind, -FAR_M]))


def _held(pose: Pose, box: tuple[tuple[float, float], float, float]) -> Any:
    """A box at a pose, its extent given in the pose's axes."""
    (low, high), wide, tall = box
    mesh = open3d.geometry.TriangleMesh.create_box(wide, tall, high - low)
    mesh.translate([-wide / 2, -tall / 2, low])
    turn = Rotation.from_quat(pose.quaternion, scalar_first=True).as_matrix()
    return mesh.rotate(turn, center=(0, 0, 0)).translate(pose.position_m)


def _obstacle(obstacle: Obstacle) -> Any:
    values = {name: np.array(value, dtype=float) for name, value in obstacle.values.items()}
    mesh, turn = MESHES[obstacle.shape](values)
    return mesh.rotate(turn, center=(0, 0, 0)).translate(values["center_m"])


def _cylinder(values: Values) -> tuple[Any, Floats]:
    radius, height = float(values["radius_m"][0]), float(values["height_m"][0])
    turn = from_z(values["axis"]).as_matrix()
    return open3d.geometry.TriangleMesh.create_cylinder(radius, height, 64), turn


def _sphere(values: Values) -> tuple[Any, Floats]:
    return open3d.geometry.TriangleMesh.create_sphere(float(values["radius_m"][0]), 32), np.eye(3)


def _capsule(values: Values) -> tuple[Any, Floats]:
    mesh, turn = _cylinder(values)
    half = np.array([0.0, 0.0, values["height_m"][0] / 2])
    for side in (-1, 1):
        mesh += _sphere(values)[0].translate(side * half)
    return mesh, turn


def _box(values: Values) -> tuple[Any, Floats]:
    mesh = open3d.geometry.TriangleMesh.create_box(*values["size_m"]).translate(-values["size_m"] / 2)
    return mesh, Rotation.from_quat(values["quaternion"], scalar_first=True).as_matrix()


MESHES: dict[str, Callable[[Values], tuple[Any, Floats]]] = {
    "cylinder": _cylinder,
    "sphere": _sphere,
    "box": _box,
    "capsule": _capsule,
}
"""Each shape's mesh about the origin, and the turn (3, 3) that brings it to its place."""


def _mesh(vertices: Floats, faces: Ints) -> Any:
    return open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(faces)
    )
