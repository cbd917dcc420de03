"""The laboratory's depth camera: an Azure Kinect's view, its noise, its edges, its lost readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter
from scipy.spatial.transform import Rotation

from dlolib.lab.scene import Scene
from dlolib.o3d import open3d
from dlolib.types import Camera, Floats, Ints

WIDTH, HEIGHT, FOCAL_PX, CENTER_PX = 640, 576, 504.0, (320.0, 288.0)
DEPTH_SCALE = 1000.0
NOISE_DISTANCE_M = 0.7
# A pixel gathers what is there over 1.5 px: 3 x 3 rays where all see the same, 7 x 7 where they do not, each
# of these in a row and a column of its own. Rays half a pixel apart would put an edge along a row of pixels a
# tenth of a pixel wrong, the same in every frame.
SPREAD_PX, RAYS, FINE_RAYS = 1.5, 3, 7
# Light that differs by less than this share among a pixel's rays is even: three rays tell it as well.
SAME = 1e-3
EDGE_STEP_M, FAR_M = 0.008, 100.0
BIAS_PX = 100.0
COLOR_NOISE = 2.0


@dataclass(frozen=True)
class Sensor:
    """What the camera adds to the geometry.

    Args:
        noise_m: deviation of a depth at 0.7 m, growing with the square of the distance [m].
        edge_loss: share of readings lost where near and far mix.
        bias_m: amplitude of a smooth error that does not change from frame to frame [m].
        grain_px: over how many pixels noise goes together, as exp(-d² / 4 grain²): that of a stereo camera,
            which matches patches.
        seed: of all of it.
    """

    noise_m: float = 0.0008
    edge_loss: float = 0.3
    bias_m: float = 0.0
    grain_px: float = 0.0
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
    rng = np.random.default_rng([sensor.seed, frame])
    share, mixed, step, bright = _gathered(scene, camera)
    noisy = mixed + _bias(camera, sensor) + _noise(mixed, sensor, rng)
    lost = (step > EDGE_STEP_M) & (rng.random(mixed.shape) < sensor.edge_loss)
    units = np.rint(noisy * float(camera.depth_scale or DEPTH_SCALE))
    units[lost | (share < 0.5)] = 0
    light = 1 - scene.dim * np.linspace(0, 1, mixed.shape[1])[:, None]
    level = 255 * light * bright + rng.normal(0, COLOR_NOISE, (*mixed.shape, 3))
    return np.clip(np.rint(level), 0, 255).astype(np.uint8), np.clip(units, 0, 65535).astype(np.uint16)


def _gathered(scene: Scene, camera: Camera) -> tuple[Floats, Floats, Floats, Floats]:
    """Of each pixel (H, W): the share that sees something, its mean depth and its largest step of depth [m],
    where nothing counts as very far; and the mean brightness (H, W, 3)."""
    assert camera.width and camera.height
    columns, rows = (np.arange(2 * size + 1) / 2 - 0.5 for size in (camera.width, camera.height))
    depth, shade = _cast(scene, camera, *np.meshgrid(columns, rows))
    seen = np.isfinite(depth)
    share = _mean(seen.astype(float))
    mixed = _mean(np.where(seen, depth, 0.0)) / np.maximum(share, 1e-9)
    step = _range(np.where(seen, depth, FAR_M))
    bright = _mean(scene.shades[shade])
    uneven = maximum_filter((step > EDGE_STEP_M) | (_range(scene.shades.max(axis=1)[shade]) > SAME), RAYS)
    row, column = np.nonzero(uneven)
    x, y = _spread()
    depth, shade = _cast(scene, camera, column[:, None] + x, row[:, None] + y)
    seen = np.isfinite(depth)
    share[uneven], bright[uneven] = seen.mean(axis=1), scene.shades[shade].mean(axis=1)
    mixed[uneven] = np.where(seen, depth, 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    return share, mixed, step, bright


def _spread() -> tuple[Floats, Floats]:
    """Places [px] (49,) about a pixel's middle: a square grid, turned by a step from end to end."""
    grid = np.arange(FINE_RAYS) - (FINE_RAYS - 1) / 2
    x, y = (part.ravel() for part in np.meshgrid(grid, grid))
    step = SPREAD_PX / FINE_RAYS
    return step * (x + y / FINE_RAYS), step * (y - x / FINE_RAYS)


def _cast(scene: Scene, camera: Camera, column: Floats, row: Floats) -> tuple[Floats, Ints]:
    """Depth [m], infinite where nothing is, and the row of the scene's shades, of rays through these places
    [px]."""
    assert camera.fx and camera.fy
    pose = camera.world_from_camera
    rays = np.empty((*column.shape, 6), dtype=np.float32)
    rays[..., :3] = pose[:3, 3]
    # Directions have depth 1 along the viewing axis, so the distance along a ray is the depth.
    x, y = (column - (camera.cx or 0)) / camera.fx, (row - (camera.cy or 0)) / camera.fy
    for axis, (right, down, ahead) in enumerate(pose[:3, :3]):
        rays[..., 3 + axis] = right * x + down * y + ahead
    hit = scene.rays.cast_rays(open3d.core.Tensor.from_numpy(rays))
    depth = hit["t_hit"].numpy().astype(float)
    seen = np.isfinite(depth)
    # The last row of the shades is that of nothing.
    mesh = np.where(seen, hit["geometry_ids"].numpy(), 0)
    return depth, np.where(seen, scene.first[mesh] + hit["primitive_ids"].numpy(), len(scene.shades) - 1)


def _mean(rays: Floats) -> Floats:
    """Each pixel's mean over its 3 x 3 rays, (H, W, ..)."""
    return _over(np.add, rays) / RAYS**2


def _range(rays: Floats) -> Floats:
    """How far each pixel's 3 x 3 rays are apart, (H, W)."""
    return _over(np.maximum, rays) - _over(np.minimum, rays)


def _over(gather: Callable[[Floats, Floats], Floats], rays: Floats) -> Floats:
    """Each pixel's 3 x 3 rays gathered into one, (H, W, ..): neighbouring pixels share a row of rays."""
    height, width = rays.shape[0] - RAYS + 1, rays.shape[1] - RAYS + 1
    rows = reduce(gather, [rays[first : first + height : 2] for first in range(RAYS)])
    return reduce(gather, [rows[:, first : first + width : 2] for first in range(RAYS)])


def _noise(depth: Floats, sensor: Sensor, rng: np.random.Generator) -> Floats:
    noise = rng.normal(size=depth.shape)
    if sensor.grain_px:
        noise = gaussian_filter(noise, sensor.grain_px)
        noise /= noise.std()
    return np.asarray(noise * sensor.noise_m * (depth / NOISE_DISTANCE_M) ** 2)


def _bias(camera: Camera, sensor: Sensor) -> Floats | float:
    """A smooth error of this amplitude [m], correlated as exp(-d² / 2 (100 px)²), the same in each frame."""
    if not sensor.bias_m:
        return 0.0
    white = np.random.default_rng([sensor.seed, 2**31]).normal(size=(camera.height or 0, camera.width or 0))
    smooth = gaussian_filter(white, BIAS_PX / np.sqrt(2), mode="wrap")
    return np.asarray(sensor.bias_m * smooth / np.abs(smooth).max())
