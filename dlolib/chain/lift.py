"""From pixels to space: line 5 of Algorithm 1, `Pixel-to-3d`, on the rope's axis and not on its skin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dlolib.chain.centre import Sections, centred_lines, tangents
from dlolib.chain.hiding import by_free_edge, hidden_by, hidden_sides, unhidden
from dlolib.chain.mixing import unmixed
from dlolib.chain.settings import ChainSettings
from dlolib.chain.shading import LARGEST_ERROR_PX, shaded_middles, stretched
from dlolib.chain.sight import between, both_sides, bridged, contested, whole
from dlolib.chain.smooth import noise_gain, noise_together, smoothed
from dlolib.chain.view import View
from dlolib.types import Floats

PASSES, ROUGH_PASSES = 3, 1
SMALLEST_SIGMA_M = 5e-4
INTERIOR_SHARE = 0.8
# An outline tells a section's middle better than a few depth readings its distance, light better still:
# less smoothing.
BY_OUTLINE, BY_LIGHT = 0.5, 0.35


@dataclass(frozen=True)
class Strand:
    """An unbroken stretch of the rope as it was seen, in camera axes, about one sample a pixel.

    pixel (N, 2); points_m (N, 3), on the axis where the radius is known, else on the skin; seen (N,),
    False where no depth was read nearby; sigma_m, the scatter of single depth readings about it;
    depth_sigma_m (N,), what smoothing leaves of that scatter; across_sigma_m (N,), the standard error of its
    place across the line of sight, by the light. Both are known of what an image shows, not of a cloud.
    """

    pixel: Floats
    points_m: Floats
    seen: NDArray[np.bool_]
    sigma_m: float
    depth_sigma_m: Floats | None = None
    across_sigma_m: Floats | None = None

    def turned(self) -> Strand:
        """The same stretch the other way round."""
        return self.part(slice(None, None, -1))

    def part(self, which: slice) -> Strand:
        """Some of its samples."""
        depth, across = self.depth_sigma_m, self.across_sigma_m
        return replace(
            self,
            pixel=self.pixel[which],
            points_m=self.points_m[which],
            seen=self.seen[which],
            depth_sigma_m=None if depth is None else depth[which],
            across_sigma_m=None if across is None else across[which],
        )


def centred(
    lines: list[Floats], width: float, view: View, radius_m: float, settings: ChainSettings
) -> list[Floats]:
    """Each line (K, 2), pixel by pixel, in the middle of its sections: (N, 2), one sample a pixel.

    Args:
        lines: of the skeleton, or joined.
        width, view, radius_m, settings: as for `lift`.
    """
    if not lines or view.pitch == 0:
        return []
    width = _full_width(width, view, radius_m)
    return centred_lines(lines, width, view, max(BY_OUTLINE * settings.smooth_m / view.pitch, width))


def lift(
    grids: list[Floats],
    width: float,
    view: View,
    radius_m: float,
    settings: ChainSettings,
    fine: bool = True,
) -> list[Strand]:
    """Read the depth of each centred line (N, 2), and carry it into space.

    Args:
        grids: as `centred` gives them.
        width: the rope's typical width [px].
        view: mask, depth and optics.
        radius_m: the rope's radius [m]; 0 leaves the points on the skin.
        settings: edge band, smoothing and the longest stretch to bridge.
        fine: whether light counts, which places a section within a tenth of a pixel but takes most time; and
            whether depth is read again along what it was read to be.
    """
    if not grids:
        return []
    width = _full_width(width, view, radius_m)
    by_light = max(BY_LIGHT * settings.smooth_m / view.pitch, width)
    errors = [np.full(len(grid), LARGEST_ERROR_PX) for grid in grids]
    sections = Sections.of(grids, view.pixels, width)
    depths = _depths(grids, sections.take(view.read), width, view)
    radii = _radii(grids, depths, width, view, radius_m)
    counting = view.read
    hidden = np.zeros_like(view.mask)
    if fine:
        hidden, lit = hidden_by(grids, depths, radii, view), view
        if hidden.any():
            grids = by_free_edge(grids, radii, hidden, view, by_light)
            radii = _stretched(radii, grids)
            lit, counting = unhidden(view, hidden), view.read & ~hidden[view.mask]
        grids, errors = shaded_middles(grids, radii, radius_m > 0, lit, by_light)
        radii = _stretched(radii, grids)
        sections = Sections.of(grids, view.pixels, width)
    readings, cloud_m = sections.take(counting), view.cloud_m[counting[view.read]]
    strands = []
    beside, cut = contested(grids, width), hidden_sides(grids, radii, hidden)
    full = whole(radii, view, sections)
    for number, grid in enumerate(grids):
        mine = readings.line == number
        strand = _read_depth(
            grid,
            readings.take(mine),
            cloud_m[mine],
            radii[number],
            beside[number],
            cut[number],
            view,
            radius_m,
            width,
            settings,
            PASSES if fine else ROUGH_PASSES,
        )
        if strand is not None:
            across = errors[number] * strand.points_m[:, 2] / view.focal
            seen = strand.seen & (full[number] | beside[number])
            strands.append(replace(strand, seen=seen, across_sigma_m=across))
    return strands


def _full_width(width: float, view: View, radius_m: float) -> float:
    """The rope's width [px]: where slivers are most of what is seen, the mask is narrower."""
    return max(width, 2 * radius_m / view.pitch)


def _depths(grids: list[Floats], readings: Sections, width: float, view: View) -> list[Floats]:
    """A first depth [m] of the rope's skin at each sample of each line, (N,) each."""
    cloud = view.cloud_m
    depths = []
    for number, grid in enumerate(grids):
        mine = (readings.line == number) & (np.abs(readings.across) <= 0.5 * INTERIOR_SHARE * width)
        block = max(5 * width, 10.0)
        depth = np.full(len(grid), np.median(cloud[:, 2]))
        if mine.any():
            depth = _medians(readings.sample[mine], cloud[mine, 2], len(grid), block)
        depths.append(depth)
    return depths


def _radii(
    grids: list[Floats], depths_m: list[Floats], width: float, view: View, radius_m: float
) -> list[Floats]:
    """How large the rope's radius looks at each sample of each line, (N,) [px]; from the mask if unknown."""
    radius_m = radius_m or 0.5 * width * view.pitch
    return [
        half_widths(grid, depth_m + radius_m, view, radius_m)
        for grid, depth_m in zip(grids, depths_m, strict=True)
    ]


def _stretched(radii_px: list[Floats], grids: list[Floats]) -> list[Floats]:
    """The radii of lines that have been given other samples."""
    return [stretched(radius, len(grid)) for radius, grid in zip(radii_px, grids, strict=True)]


def half_widths(grid: Floats, depth_m: Floats, view: View, radius_m: float) -> Floats:
    """Half the width [px] (N,) of a round rope's outline across a line (N, 2) at depths (N,).

    Its edges are where rays touch it. Off the image's middle that is more than its radius over its depth.
    """
    axis = view.space(grid, depth_m)
    distance = np.linalg.norm(axis, axis=1)
    ray = axis / distance[:, None]
    aside = np.cross(ray, tangents(axis))
    sine = np.maximum(np.linalg.norm(aside, axis=1), 0.5)
    reach = np.minimum(radius_m / (distance * sine), 0.5)
    edge = view.pixel(ray + (reach / np.sqrt(1 - reach**2))[:, None] * aside)
    along = tangents(grid)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    return np.asarray(np.abs(np.einsum("ij,ij->i", edge - view.pixel(ray), across)))


def _read_depth(
    grid: Floats,
    sections: Sections,
    cloud: Floats,
    radius_px: Floats,
    beside: NDArray[np.bool_],
    cut: NDArray[np.bool_],
    view: View,
    radius_m: float,
    width: float,
    settings: ChainSettings,
    passes: int,
) -> Strand | None:
    """Fit a smooth depth along a line (N, 2) to the readings in the middle of its sections.

    Each reading is carried from the skin to the axis first. Along the viewing ray the axis lies behind
    the skin by √(r² - b²) / sin γ, where b² is the mean square of what the reading sees from the middle of
    the section and γ the angle between ray and rope. γ comes from the curve of the pass before. Where two
    strands meet in the image the readings are those of the nearer one: they count only once a curve without
    them agrees.
    """
    interior = max(min(0.5 * width - settings.edge_px, 0.5 * INTERIOR_SHARE * width), 0.6)
    middle = np.abs(sections.across) <= interior
    sample, across, cloud = sections.sample[middle], sections.across[middle], cloud[middle]
    if len(sample) < 4:
        return None
    ray = np.linalg.norm(cloud / cloud[:, 2:], axis=1)
    depth, mostly = unmixed(cloud[:, 2], sample, across, grid, radius_px, view, settings.edge_px)
    pitch = float(np.median(depth)) / view.focal
    slant = np.ones(len(grid))
    axis = depth
    # At its ends the outline runs across the rope: what hides it there mixes into the last readings, too, and
    # the line ends within a pixel of it.
    end = settings.edge_px + 1
    inner = _enough((sample >= end) & (sample < len(grid) - end) & mostly)
    own = _enough(inner & ~beside[sample])
    curve = _medians(sample[own], depth[own], len(grid), max(settings.smooth_m / pitch, 3.0))
    # a reading is the mean over what mixes in it, and lies behind the skin of a round body in its middle
    blur_m2 = (settings.edge_px * pitch) ** 2 / 12
    for turn in range(passes):
        behind = np.sqrt(np.maximum(radius_m**2 - (across * pitch) ** 2 - blur_m2, 0.0))
        axis = depth + behind / slant[sample] / ray
        counting = own if turn == 0 else inner
        curve, sigma, near = _robust(sample, axis, curve, counting, settings.smooth_m / pitch)
        slant = _slant(view.space(grid, curve))
    reach = max(round(0.5 * settings.bridge_m / pitch), 1)
    count = np.bincount(sample[near], minlength=len(grid))
    unclear = beside & ~both_sides(sample[near], across[near], len(grid))
    count[unclear] = 0
    counted, half_wave = near & inner, settings.smooth_m / pitch
    read = np.bincount(sample[counted], minlength=len(grid)) * ~unclear
    together = noise_together(sample[counted], axis[counted] - curve[sample[counted]], half_wave)
    left = together * sigma * noise_gain(read.astype(np.float64), half_wave)
    seen = bridged(count > 0, beside, reach)
    # what hides a side leaves no reading: across a wave the depth to both sides tells it
    seen |= between(seen, max(round(settings.smooth_m / pitch), 1)) & cut & ~beside
    return Strand(grid, view.space(grid, curve), seen, sigma, left)


def _medians(sample: NDArray[np.intp], depth: Floats, count: int, half_wave: float) -> Floats:
    """A first depth along the line, shape (count,), that single wild readings do not move."""
    block = max(int(half_wave / 2), 1)
    order = np.argsort(sample, kind="stable")
    bounds = np.searchsorted(sample[order], np.arange(0, count + block, block))
    filled = np.flatnonzero(np.diff(bounds))
    values = [_median(depth[order[bounds[k] : bounds[k + 1]]]) for k in filled]
    return np.interp(np.arange(count), filled * block + 0.5 * (block - 1), values)


def _median(values: Floats) -> float:
    """`np.median` without its checks, which take longer than the median of a few."""
    middle = ((len(values) - 1) // 2, len(values) // 2)
    return float(0.5 * np.partition(values, middle)[list(middle)].sum())


def _robust(
    sample: NDArray[np.intp],
    axis: Floats,
    curve: Floats,
    counting: NDArray[np.bool_],
    half_wave: float,
) -> tuple[Floats, float, NDArray[np.bool_]]:
    """Smooth the readings near the last curve (N,) that count: the new curve, their scatter [m], and which of
    all are near."""
    rest = axis - curve[sample]
    rest = rest - _median(rest[counting])
    sigma = max(1.4826 * _median(np.abs(rest[counting])), SMALLEST_SIGMA_M)
    near = np.abs(rest) <= 3 * sigma
    kept = near & counting
    weights = np.bincount(sample[kept], minlength=len(curve)).astype(np.float64)
    sums = np.bincount(sample[kept], axis[kept], minlength=len(curve))
    return smoothed(sums / np.maximum(weights, 1), weights, half_wave), sigma, near


def _enough(some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """These readings if they tell a line, else all of them."""
    return some if np.count_nonzero(some) >= 4 else np.ones_like(some)


def _slant(points: Floats) -> Floats:
    """Sine of the angle between the rope and the ray to it, shape (N,), not below a half."""
    tangent = tangents(points)
    ray = points / np.linalg.norm(points, axis=1, keepdims=True)
    along = np.einsum("ij,ij->i", tangent, ray)
    return np.asarray(np.sqrt(np.maximum(1 - along**2, 0.25)))
