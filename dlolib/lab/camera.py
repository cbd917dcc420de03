"""The laboratory's depth camera: an Azure Kinect's view, its noise, its edges, its lost readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter, uniform_filter
from scipy.spatial.transform import Rotation

from dlolib.lab.scene import Scene
from dlolib.o3d import open3d
from dlolib.types import Camera, Floats

WIDTH, HEIGHT, FOCAL_PX, CENTER_PX = 640, 576, 504.0, (320.0, 288.0)
DEPTH_SCALE = 1000.0
NOISE_DISTANCE_M = 0.7
# A pixel gathers 3 x 3 rays half a pixel apart: an edge is mixed over 1.5 px.
RAYS = 3
EDGE_STEP_M = 0.008
BIAS_PX = 100.0
LIGHT = np.array([-0.35, -0.8, 0.5]) / np.linalg.norm([-0.35, -0.8, 0.5])
AMBIENT, COLOR_NOISE = 0.35, 2.0


@dataclass(frozen=True)
class Sensor:
    """What the camera adds to the geometry.

    Args:
        noise_m: deviation of a depth at 0.7 m, growing with the square of the distance [m].
        edge_loss: share of readings lost where near and far mix.
        bias_m: amplitude of a smooth error that does not change from frame to frame [m].
        seed: of all of it.
    """

    noise_m: float = 0.0008
    edge_loss: float = 0.3
    bias_m: float = 0.0
    seed: int = 1


def default_camera() -> Camera:
    """A camera in front of the rope, looking along +y and a little down and aside."""
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    pose = np.eye(4)
    pose[:3, :3] = axes @ Rotation.from_euler("yx", [6.0, -4.0], degrees=True).as_matrix()
    pose[:3, 3] = [0.12, -0.74, 0.08]
    return Camera(pose, WIDTH, HEIGHT, FOCAL_PX, FOCAL_PX, *CENTER_PX, DEPTH_SCALE)


def render(
    scene: Scene, camera: Camera, sensor: Sensor, frame: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """Colour (H, W, 3) in RGB and depth (H, W) in units of 1 / depth_scale, 0 where there is no reading.

    Args:
        scene: what is there.
        camera: where from.
        sensor: with which errors.
        frame: number of the frame, which seeds its noise together with the sensor's seed.
    """
    depth, shade = _cast(scene, camera)
    rng = np.random.default_rng([sensor.seed, frame])
    seen = np.isfinite(depth)
    near = np.where(seen, depth, 0.0)
    share = _gather(seen.astype(float))
    mixed = _gather(near) / np.maximum(share, 1e-9)
    step = _edges(depth)
    noisy = mixed + _bias(camera, sensor) + _noise(mixed, sensor, rng)
    lost = (step > EDGE_STEP_M) & (rng.random(mixed.shape) < sensor.edge_loss)
    units = np.rint(noisy * float(camera.depth_scale or DEPTH_SCALE))
    units[lost | (share < 0.5)] = 0
    bright = 255 * np.stack([_gather(channel) for channel in np.moveaxis(shade, -1, 0)], axis=-1)
    light = 1 - scene.dim * np.linspace(0, 1, mixed.shape[1])[:, None]
    level = light * bright + rng.normal(0, COLOR_NOISE, (*mixed.shape, 3))
    return np.clip(np.rint(level), 0, 255).astype(np.uint8), np.clip(units, 0, 65535).astype(np.uint16)


def _cast(scene: Scene, camera: Camera) -> tuple[Floats, Floats]:
    """Depth [m] (2H + 1, 2W + 1), infinite where nothing is, and brightness (.., 3), half a pixel apart."""
    assert camera.width and camera.height and camera.fx and camera.fy
    columns = np.arange(2 * camera.width + 1) / 2 - 0.5
    rows = np.arange(2 * camera.height + 1) / 2 - 0.5
    x, y = np.meshgrid((columns - (camera.cx or 0)) / camera.fx, (rows - (camera.cy or 0)) / camera.fy)
    pose = camera.world_from_camera
    # Directions have depth 1 along the viewing axis, so the distance along a ray is the depth.
    direction = np.stack([x, y, np.ones_like(x)], axis=-1) @ pose[:3, :3].T
    rays = np.concatenate([np.broadcast_to(pose[:3, 3], direction.shape), direction], axis=-1)
    hit = scene.rays.cast_rays(open3d.core.Tensor.from_numpy(rays.astype(np.float32)))
    depth = hit["t_hit"].numpy().astype(float)
    seen = np.isfinite(depth)
    shade = np.zeros((*depth.shape, 3))
    triangle = scene.first[hit["geometry_ids"].numpy()[seen]] + hit["primitive_ids"].numpy()[seen]
    facing = np.abs(hit["primitive_normals"].numpy()[seen] @ LIGHT)
    shade[seen] = scene.albedo[triangle] * (AMBIENT + (1 - AMBIENT) * facing)[:, None]
    return depth, shade


def _gather(fine: Floats) -> Floats:
    """Each pixel's mean over its 3 x 3 rays, (H, W)."""
    return np.asarray(uniform_filter(fine, RAYS)[1::2, 1::2])


def _edges(fine: Floats) -> Floats:
    """Largest difference of depth within each pixel's rays [m], (H, W); nothing counts as very far."""
    known = np.where(np.isfinite(fine), fine, 100.0)
    return np.asarray((maximum_filter(known, RAYS) - minimum_filter(known, RAYS))[1::2, 1::2])


def _noise(depth: Floats, sensor: Sensor, rng: np.random.Generator) -> Floats:
    return np.asarray(rng.normal(size=depth.shape) * sensor.noise_m * (depth / NOISE_DISTANCE_M) ** 2)


def _bias(camera: Camera, sensor: Sensor) -> Floats | float:
    """A smooth error of this amplitude [m], correlated as exp(-d² / 2 (100 px)²), the same in each frame."""
    if not sensor.bias_m:
        return 0.0
    white = np.random.default_rng([sensor.seed, 2**31]).normal(size=(camera.height or 0, camera.width or 0))
    smooth = gaussian_filter(white, BIAS_PX / np.sqrt(2), mode="wrap")
    return np.asarray(sensor.bias_m * smooth / np.abs(smooth).max())
