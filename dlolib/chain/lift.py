"""From pixels to space: line 5 of Algorithm 1, `Pixel-to-3d`, on the rope's axis and not on its skin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from dlolib.chain.centre import Sections, centred_lines, tangents
from dlolib.chain.settings import ChainSettings
from dlolib.chain.shading import shaded_middles
from dlolib.chain.smooth import whittaker
from dlolib.chain.view import View
from dlolib.o3d import open3d
from dlolib.types import Floats

NEIGHBOURS, OUTLIER_RATIO = 12, 3.0
PASSES = 3
SMALLEST_SIGMA_M = 5e-4
INTERIOR_SHARE = 0.8
# An outline tells a section's middle better than a few depth readings its distance: less smoothing.
LATERAL = 0.5


@dataclass(frozen=True)
class Strand:
    """An unbroken stretch of the rope as it was seen, in camera axes, about one sample a pixel.

    pixel (N, 2); points_m (N, 3), on the axis where the radius is known, else on the skin; seen (N,),
    False where no depth was read nearby; sigma_m, the scatter of single depth readings about it.
    """

    pixel: Floats
    points_m: Floats
    seen: NDArray[np.bool_]
    sigma_m: float

    def turned(self) -> Strand:
        """The same stretch the other way round."""
        return replace(self, pixel=self.pixel[::-1], points_m=self.points_m[::-1], seen=self.seen[::-1])


def lift(
    lines: list[Floats], width: float, view: View, radius_m: float, settings: ChainSettings
) -> list[Strand]:
    """Centre each skeleton line (K, 2) in its section, read its depth, and carry it into space.

    Args:
        lines: centre lines, pixel by pixel.
        width: the rope's typical width [px].
        view: mask, depth and optics.
        radius_m: the rope's radius [m]; 0 leaves the points on the skin.
        settings: edge band, smoothing and the longest stretch to bridge.
    """
    pitch = view.pitch()
    if not lines or pitch == 0:
        return []
    half_wave = max(LATERAL * settings.smooth_m / pitch, width)
    grids = centred_lines(lines, width, view, half_wave)
    cloud = _cloud(view)
    radii = _radii(grids, cloud, width, view, radius_m)
    grids = shaded_middles(grids, radii, radius_m > 0, view, half_wave)
    readings = Sections.of(grids, view.pixel(cloud), width)
    strands = []
    for number, grid in enumerate(grids):
        mine = readings.line == number
        strand = _read_depth(grid, readings.take(mine), cloud[mine], view, radius_m, width, settings)
        if strand is not None:
            strands.append(strand)
    return strands


def _radii(grids: list[Floats], cloud: Floats, width: float, view: View, radius_m: float) -> list[Floats]:
    """How large the rope's radius looks at each sample of each line, (N,) [px]; from the mask if unknown."""
    if radius_m == 0:
        return [np.full(len(grid), 0.5 * width) for grid in grids]
    readings = Sections.of(grids, view.pixel(cloud), width)
    radii = []
    for number, grid in enumerate(grids):
        mine = (readings.line == number) & (np.abs(readings.across) <= 0.5 * INTERIOR_SHARE * width)
        block = max(5 * width, 10.0)
        depth = np.full(len(grid), np.median(cloud[:, 2]))
        if mine.any():
            depth = _medians(readings.sample[mine], cloud[mine, 2], len(grid), block)
        radii.append(radius_m * view.focal / (depth + radius_m))
    return radii


def _cloud(view: View) -> Floats:
    """The rope's pixels with depth as points [m] (N, 3) in camera axes, statistical outliers removed."""
    height, width = view.depth_m.shape
    intrinsic = open3d.camera.PinholeCameraIntrinsic(width, height, view.fx, view.fy, view.cx, view.cy)
    depth = open3d.geometry.Image(np.where(view.mask, view.depth_m, np.float32(0)))  # type: ignore[call-overload]
    cloud = open3d.geometry.PointCloud.create_from_depth_image(
        depth, intrinsic, depth_scale=1.0, depth_trunc=1e6, project_valid_depth_only=True
    )
    if len(cloud.points) > NEIGHBOURS:
        cloud, _ = cloud.remove_statistical_outlier(NEIGHBOURS, OUTLIER_RATIO)
    return np.asarray(cloud.points, dtype=np.float64).reshape(-1, 3)


def _read_depth(
    grid: Floats,
    sections: Sections,
    cloud: Floats,
    view: View,
    radius_m: float,
    width: float,
    settings: ChainSettings,
) -> Strand | None:
    """Fit a smooth depth along a line (N, 2) to the readings in the middle of its sections.

    Each reading is carried from the skin to the axis first. Along the viewing ray the axis lies behind
    the skin by √(r² - b²) / sin γ, where b is the reading's distance from the middle of the section and
    γ the angle between ray and rope. γ comes from the curve of the pass before.
    """
    interior = max(min(0.5 * width - settings.edge_px, 0.5 * INTERIOR_SHARE * width), 0.6)
    middle = np.abs(sections.across) <= interior
    sample, across, cloud = sections.sample[middle], sections.across[middle], cloud[middle]
    if len(sample) < 4:
        return None
    depth = cloud[:, 2]
    pitch = float(np.median(depth)) / view.focal
    slant = np.ones(len(grid))
    axis = depth
    curve = _medians(sample, depth, len(grid), max(settings.smooth_m / pitch, 3.0))
    for _ in range(PASSES):
        behind = np.sqrt(np.maximum(radius_m**2 - (across * pitch) ** 2, 0.0))
        ray = np.linalg.norm(cloud / depth[:, None], axis=1)
        axis = depth + behind / slant[sample] / ray
        curve, sigma, kept = _robust(sample, axis, curve, settings.smooth_m / pitch)
        slant = _slant(view.space(grid, curve))
    reach = max(round(0.5 * settings.bridge_m / pitch), 1)
    count = np.bincount(sample[kept], minlength=len(grid))
    seen = maximum_filter1d(count, 2 * reach + 1, mode="constant") > 0
    return Strand(grid, view.space(grid, curve), np.asarray(seen), sigma)


def _medians(sample: NDArray[np.intp], depth: Floats, count: int, half_wave: float) -> Floats:
    """A first depth along the line, shape (count,), that single wild readings do not move."""
    block = max(int(half_wave / 2), 1)
    centres, values = [], []
    for first in range(0, count, block):
        inside = (sample >= first) & (sample < first + block)
        if inside.any():
            centres.append(first + 0.5 * (block - 1))
            values.append(float(np.median(depth[inside])))
    return np.interp(np.arange(count), centres, values)


def _robust(
    sample: NDArray[np.intp], axis: Floats, curve: Floats, half_wave: float
) -> tuple[Floats, float, NDArray[np.bool_]]:
    """Smooth the readings near the last curve (N,): the new curve, their scatter [m], which they were."""
    rest = axis - curve[sample]
    rest = rest - np.median(rest)
    sigma = max(1.4826 * float(np.median(np.abs(rest))), SMALLEST_SIGMA_M)
    kept = np.abs(rest) <= 3 * sigma
    weights = np.bincount(sample[kept], minlength=len(curve)).astype(np.float64)
    sums = np.bincount(sample[kept], axis[kept], minlength=len(curve))
    return whittaker(sums / np.maximum(weights, 1), weights, half_wave), sigma, kept


def _slant(points: Floats) -> Floats:
    """Sine of the angle between the rope and the ray to it, shape (N,), not below a half."""
    tangent = tangents(points)
    ray = points / np.linalg.norm(points, axis=1, keepdims=True)
    along = np.einsum("ij,ij->i", tangent, ray)
    return np.asarray(np.sqrt(np.maximum(1 - along**2, 0.25)))
