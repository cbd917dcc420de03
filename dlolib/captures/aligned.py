"""Depth as another camera beside it sees it."""

from __future__ import annotations

from itertools import product

import numpy as np

from dlolib.captures.foreign import Units
from dlolib.types import Floats

# A reading covers its pixel, and so much of the next [px]: turned pixels would leave gaps between them.
OVERLAP_PX = 0.1
# Nearer than this no camera reads a depth.
NEAREST_M = 0.02


def aligned(
    depth: Units, scale: float, own: Floats, other: Floats, other_from_own: Floats, size: tuple[int, ...]
) -> Units:
    """Carry a depth image to where another camera stands; the nearer hides what lies behind it.

    Args:
        depth: (H, W) in units of 1 / scale, 0 where there is no reading.
        scale: units per metre [1/m].
        own, other: the matrices (3, 3) [px] of the two pinholes.
        other_from_own: the way from one's axes to the other's (4, 4) [m].
        size: height and width of the other's images (H', W') [px].

    Returns:
        Depth along the other's axis (H', W') in the same units; 0 where nothing is read.
    """
    row, column = np.nonzero(depth)
    away: Floats = depth[row, column] / scale
    pixel = np.stack([column, row], axis=-1).astype(np.float64)
    middle, *corners = (_carried(pixel + aside, away, own, other_from_own) for aside in (0.0, -0.5, 0.5))
    there = np.min([point[:, 2] for point in (middle, *corners)], axis=0) > NEAREST_M
    pixels = [_pixel(corner[there], other) for corner in corners]
    first = np.ceil(np.minimum(*pixels) - OVERLAP_PX).astype(np.int64)
    last = np.floor(np.maximum(*pixels) + OVERLAP_PX).astype(np.int64)
    first, last = np.maximum(first, 0), np.minimum(last, np.array(size[::-1]) - 1)
    units = np.rint(middle[there, 2] * scale)
    nearest = np.full(size, np.inf)
    widest = (last - first).max(axis=0, initial=-1) + 1
    for aside in product(*(range(int(count)) for count in widest)):
        at = first + aside
        covers = (at <= last).all(axis=1)
        np.minimum.at(nearest, (at[covers, 1], at[covers, 0]), units[covers])
    read = nearest <= np.iinfo(np.uint16).max
    return np.where(read, nearest, 0).astype(np.uint16)


def _carried(pixel: Floats, away: Floats, own: Floats, other_from_own: Floats) -> Floats:
    """Points (N, 3) [m] in the other's axes of places (N, 2) [px] in the own image."""
    aside = (pixel - own[:2, 2]) / np.diag(own)[:2]
    points = np.concatenate([aside, np.ones((len(aside), 1))], axis=1) * away[:, None]
    moved: Floats = points @ other_from_own[:3, :3].T + other_from_own[:3, 3]
    return moved


def _pixel(points: Floats, matrix: Floats) -> Floats:
    """Column and row (N, 2) [px] of points (N, 3)."""
    return points[:, :2] / points[:, 2:] * np.diag(matrix)[:2] + matrix[:2, 2]
