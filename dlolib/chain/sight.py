"""What of a line was really seen: not under another strand, no sliver, no long stretch unread."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_opening, maximum_filter1d, uniform_filter1d
from scipy.spatial import cKDTree

from dlolib.chain.centre import Sections
from dlolib.chain.view import View
from dlolib.types import Floats

APART_WIDTHS = 3.0
SLIVER_SAMPLES = 5
# How well a section's width is known.
WIDTH_PX = 0.2
# Up to three quarters of what is seen may be slivers.
WHOLE_QUANTILE = 0.75


def contested(grids: list[Floats], width: float) -> list[NDArray[np.bool_]]:
    """Samples (N,) of each line that lie beside another strand: whose readings are there is not yet clear."""
    places = np.concatenate(grids)
    line = np.repeat(np.arange(len(grids)), [len(grid) for grid in grids])
    close = cKDTree(places).query_pairs(width, output_type="ndarray")
    first, second = close[:, 0], close[:, 1]
    # Along one line samples are a pixel apart: only a loop brings distant ones together.
    other = (line[first] != line[second]) | (np.abs(first - second) > APART_WIDTHS * width)
    beside = np.zeros(len(places), dtype=np.bool_)
    beside[close[other].ravel()] = True
    return np.split(beside, np.cumsum([len(grid) for grid in grids])[:-1])


def whole(radii_px: list[Floats], view: View, sections: Sections) -> list[NDArray[np.bool_]]:
    """Samples (N,) of each line whose section is not just a sliver that something leaves to be seen.

    Where no more than half of the width shows, the rope's middle is hidden, and nothing tells where it is.
    How much a section should show, its radius [px] tells, (N,) each, up to what the mask leaves of all.
    `sections` are those of the view's pixels.
    """
    widths = []
    for number, radius in enumerate(radii_px):
        mine = sections.line == number
        across = np.bincount(sections.sample[mine], view.shares[mine], minlength=len(radius))
        widths.append(uniform_filter1d(across, SLIVER_SAMPLES, mode="nearest") / radius)
    typical = float(np.quantile(np.concatenate(widths), WHOLE_QUANTILE))
    pairs = zip(widths, radii_px, strict=True)
    slivers = [across < 0.5 * typical + WIDTH_PX / radius for across, radius in pairs]
    # A tip is round, and its corners are cut: only what is longer is a sliver.
    return [
        ~np.asarray(binary_opening(sliver, np.ones(SLIVER_SAMPLES, dtype=np.bool_))) for sliver in slivers
    ]


def both_sides(sample: NDArray[np.intp], across: Floats, count: int) -> NDArray[np.bool_]:
    """Samples (count,) with readings on both sides of the line: half under another, a strand has not."""
    near = []
    for side in (across < 0, across > 0):
        read = np.bincount(sample[side], minlength=count) > 0
        near.append(maximum_filter1d(read, SLIVER_SAMPLES, mode="constant"))
    return np.asarray(near[0] & near[1], dtype=np.bool_)


def between(some: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Samples (N,) that are some of these, or lie in a stretch of up to twice `reach` between two of them."""
    padded = binary_closing(np.pad(some, 2 * reach), np.ones(2 * reach + 1, dtype=np.bool_))
    return np.asarray(padded[2 * reach : -2 * reach], dtype=np.bool_)


def bridged(read: NDArray[np.bool_], contested: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Samples (N,) with readings, or in a stretch of up to twice `reach` without; a wider one stays whole.

    The outermost readings of a strand lie in the band that is left out: its tips may reach out as far,
    unless another strand lies over them.
    """
    closed = between(read, reach)
    tips = np.zeros(len(read), dtype=np.bool_)
    tips[:reach] = tips[-reach:] = True
    near = maximum_filter1d(read, 2 * reach + 1, mode="constant")
    return np.asarray(closed | (tips & near & ~contested), dtype=np.bool_)
