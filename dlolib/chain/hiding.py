"""What stands before the rope: it hides a part of some sections, and their middle is not the rope's."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from dlolib.captures.base import Mask
from dlolib.chain.centre import Sections, beside, resampled
from dlolib.chain.shading import MARGIN_PX
from dlolib.chain.view import View, places_of
from dlolib.types import Floats

# What is nearer by more hides the rope; what is nearer by less may be the rope itself, or hold it.
BEFORE_M = 0.02
# A single wild reading hides nothing; a pixel beside what does is a mixture, in which levels and depth count
# for nothing.
SMALLEST_PX, MIXED_PX = 3, 1
# Over so many samples along the line sections are taken together.
SAMPLES = 5
# By how much more than that a section is narrower than the rope something hides its side [px].
NARROWER_PX = 0.3


def hidden_by(grids: list[Floats], depths_m: list[Floats], radii_px: list[Floats], view: View) -> Mask:
    """Pixels (H, W) of what stands before the rope, close to its lines, and those beside that mix with it.

    Args:
        grids: lines (N, 2), one sample a pixel, at least one.
        depths_m: of the rope's skin at each of their samples, (N,) each.
        radii_px: how large the rope's radius looks there, (N,) each.
        view: what the camera saw.
    """
    close = _close(radii_px)
    places = np.concatenate(grids)
    left, top = np.maximum(np.floor(places.min(axis=0) - close), 0).astype(int)
    right, low = np.ceil(places.max(axis=0) + close).astype(int) + 1
    found = np.zeros(view.mask.shape, dtype=np.uint8)
    read = view.depth_m[top:low, left:right]
    nearer = (read > 0) & (read < max(float(depth.max()) for depth in depths_m) - BEFORE_M)
    if nearer.any():
        pixels = places_of(nearer) + np.array([left, top])
        distance, nearest = cKDTree(places).query(pixels, distance_upper_bound=close)
        beside_rope = np.isfinite(distance)
        rope_m = np.concatenate(depths_m)[np.where(beside_rope, nearest, 0)]
        found[top:low, left:right][nearer] = beside_rope & (read[nearer] < rope_m - BEFORE_M)
    large = cv2.morphologyEx(found, cv2.MORPH_OPEN, np.ones((SMALLEST_PX,) * 2, np.uint8))
    return np.asarray(cv2.dilate(large, np.ones((2 * MIXED_PX + 1,) * 2, np.uint8)) > 0)


def unhidden(view: View, hidden: Mask) -> View:
    """The same view without levels where something hides the rope (H, W)."""
    levels = None if view.levels is None else np.where(hidden, np.float32(np.inf), view.levels)
    return replace(view, levels=levels)


def hidden_sides(grids: list[Floats], radii_px: list[Floats], hidden: Mask) -> list[NDArray[np.bool_]]:
    """Samples (N,) of each line where `hidden` (H, W) lies in the rope's section: something hides a side."""
    found = [np.zeros(len(grid), dtype=np.bool_) for grid in grids]
    if hidden.any():
        sections = Sections.of(grids, places_of(hidden), max(float(radius.max()) for radius in radii_px))
        for number, radius in enumerate(radii_px):
            mine = sections.line == number
            sample, across = sections.sample[mine], sections.across[mine]
            found[number][sample[np.abs(across) < radius[sample]]] = True
    return found


def by_free_edge(
    grids: list[Floats], radii_px: list[Floats], hidden: Mask, view: View, half_wave_px: float
) -> list[Floats]:
    """Lines (N, 2), carried from the middle of what shows to the rope's where something hides one side of it.

    There one edge is the rope's own, and its middle lies a radius inside of it.

    Args:
        grids, radii_px: as for `hidden_by`.
        hidden: what `hidden_by` found.
        view: the mask and the share of each pixel that is rope.
        half_wave_px: half of the shortest wave that a line may show [px].
    """
    either = hidden | view.mask
    sections = Sections.of(grids, places_of(either), _close(radii_px))
    share, hides = np.where(view.mask, view.coverage, 0)[either], hidden[either]
    moved = []
    for number, (grid, radius) in enumerate(zip(grids, radii_px, strict=True)):
        mine = sections.line == number
        sample, across = sections.sample[mine], sections.across[mine]
        width = _along(sample, share[mine], len(grid))
        middle = _along(sample, share[mine] * across, len(grid)) / np.maximum(width, 0.1)
        side = np.sign(_along(sample, hides[mine] * np.sign(across), len(grid)).round())
        narrower = np.where(side != 0, np.clip(2 * radius - width, 0, 2 * radius), 0.0)
        cut = narrower > NARROWER_PX
        offset = np.where(cut, middle + 0.5 * side * narrower, 0.0)
        moved.append(resampled(beside(grid, offset, np.ones(len(grid)), half_wave_px)) if cut.any() else grid)
    return moved


def _close(radii_px: list[Floats]) -> float:
    """How far from a line its sections reach [px]."""
    return max(float(radius.max()) for radius in radii_px) + MARGIN_PX


def _along(sample: NDArray[np.intp], values: Floats, count: int) -> Floats:
    """Sums of the values of each sample's pixels (count,), the mean of some samples along the line."""
    summed = np.bincount(sample, values, minlength=count).astype(np.float64)
    return np.asarray(uniform_filter1d(summed, SAMPLES, mode="nearest"))
