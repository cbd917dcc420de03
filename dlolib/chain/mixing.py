"""Depth of a rope too narrow for a pixel that sees it alone: what lies behind it is taken out of the mean."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlolib.chain.centre import tangents
from dlolib.chain.view import View
from dlolib.types import Floats

# Behind a rope is what is read this far beside its outline [px], past what the edge mixes.
BESIDE_PX = (1.0, 2.0)
# A reading of which less is rope tells little of it.
LEAST_ROPE = 0.6


def unmixed(
    depth_m: Floats,
    sample: NDArray[np.intp],
    across_px: Floats,
    grid: Floats,
    radius_px: Floats,
    view: View,
    edge_px: float,
) -> tuple[Floats, NDArray[np.bool_]]:
    """Depths of the rope alone, from readings that each are the mean over `edge_px` across the section.

    A reading of which the share f is rope is f of the rope's depth and 1 - f of what is behind, where that is
    read beside it; what no pixel reads mixes into none.

    Args:
        depth_m: readings (R,).
        sample, across_px: which sample of the line each belongs to, and how far beside it lies (R,).
        grid: the line (N, 2).
        radius_px: how large the rope's radius looks at its samples (N,).
        view: with the depth beside the rope.
        edge_px: over how many pixels the camera mixes depth.

    Returns:
        Depths (R,), and which readings (R,) are rope enough.
    """
    radius, away = radius_px[sample], np.abs(across_px)
    if (away + 0.5 * edge_px <= radius).all():
        return depth_m, np.ones_like(away, dtype=np.bool_)
    rope = np.minimum(away + 0.5 * edge_px, radius) - np.maximum(away - 0.5 * edge_px, -radius)
    share = np.clip(rope / edge_px, 0.0, 1.0)
    behind_m = _behind(grid, radius_px, view, edge_px)[sample]
    mixes = (share < 1) & (behind_m > depth_m)
    own = np.where(mixes, share, 1.0)
    rest = np.where(mixes, (1 - own) * behind_m, 0.0)
    return (depth_m - rest) / np.maximum(own, LEAST_ROPE), own >= LEAST_ROPE


def _behind(grid: Floats, radius_px: Floats, view: View, edge_px: float) -> Floats:
    """The mean depth [m] (N,) beside each sample's section, NaN where none is read."""
    along = tangents(grid)
    aside = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    height, width = view.depth_m.shape
    total, count = np.zeros(len(grid)), np.zeros(len(grid))
    for further in BESIDE_PX:
        for side in (-1, 1):
            place = grid + side * (radius_px + 0.5 * edge_px + further)[:, None] * aside
            column, row = np.round(place).astype(int).T
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            at = row[inside], column[inside]
            read = np.where(view.mask[at], 0.0, view.depth_m[at])
            total[inside] += read
            count[inside] += read > 0
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
