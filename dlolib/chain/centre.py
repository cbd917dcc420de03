"""The middle of the rope's sections, in pixels finer than one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dlolib.captures.base import Mask
from dlolib.chain.smooth import smoothed
from dlolib.chain.view import View
from dlolib.types import Floats

OWN_WIDTHS = 0.75
UNUSUAL = 0.25
CENTRINGS = 2
FAINT = 0.02


def centred_lines(lines: list[Floats], width: float, view: View, half_wave_px: float) -> list[Floats]:
    """Carry skeleton lines to the middle of the rope and out to the ends of what is seen of it.

    Args:
        lines: skeleton lines, pixel by pixel, each (K, 2), at least one.
        width: the rope's typical width [px].
        view: the mask and the share of each pixel that is rope.
        half_wave_px: half of the shortest wave that the line may show [px].

    Returns:
        Lines (N, 2) with one sample a pixel, in the same order.
    """
    owner = np.repeat(np.arange(len(lines)), [len(line) for line in lines])
    tree = cKDTree(np.concatenate(lines))

    def free(number: int, far: Floats) -> NDArray[np.bool_]:
        """Where a line may go on: on the mask, and not where another line is."""
        distance, nearest = tree.query(far)
        alone: NDArray[np.bool_] = (owner[nearest] == number) | (distance > OWN_WIDTHS * width)
        return on_mask(view.mask, far) & alone

    grids = []
    for number, line in enumerate(lines):
        grid = _even(line, width)
        ends = [_beyond(part, partial(free, number), width) for part in (grid[::-1], grid)]
        grids.append(np.concatenate([ends[0][::-1], grid, ends[1]]))
    for _ in range(CENTRINGS):
        grids = _centred(grids, view.pixels, view.shares, width, half_wave_px)
    return grids


@dataclass(frozen=True)
class Sections:
    """For each pixel: line and sample of the nearest section, offset across it [px]."""

    line: NDArray[np.intp]
    sample: NDArray[np.intp]
    across: Floats

    @staticmethod
    def of(grids: list[Floats], pixels: Floats, width: float) -> Sections:
        """Find the section of each pixel (N, 2) within a width of the lines, each (K, 2); -1 without one."""
        places = np.concatenate(grids)
        distance, nearest = cKDTree(places).query(pixels, distance_upper_bound=width)
        found = np.isfinite(distance)
        nearest = np.where(found, nearest, 0)
        tangent = np.concatenate([tangents(grid) for grid in grids])[nearest]
        offset = pixels - places[nearest]
        across = offset[:, 1] * tangent[:, 0] - offset[:, 0] * tangent[:, 1]
        along = np.einsum("ij,ij->i", offset, tangent)
        number = np.repeat(np.arange(len(grids)), [len(grid) for grid in grids])[nearest]
        first = np.cumsum([0, *(len(grid) for grid in grids)])[number]
        # Beyond its ends a line has no sections.
        number = np.where(found & (np.abs(along) <= 1), number, -1)
        return Sections(number, nearest - first, across)

    def take(self, mine: NDArray[np.bool_]) -> Sections:
        """The same of some of the pixels only."""
        return Sections(self.line[mine], self.sample[mine], self.across[mine])


def tangents(grid: Floats) -> Floats:
    """Unit tangents of a line (N, D) with even samples, N at least 2."""
    step = np.concatenate([grid[1:2] - grid[:1], grid[2:] - grid[:-2], grid[-1:] - grid[-2:-1]])
    unit: Floats = step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12)
    return unit


def _even(line: Floats, width: float) -> Floats:
    """A smooth line with one sample a pixel; its ends, which lean into the outline's corners, cut off."""
    trim = min(int(0.5 * width), (len(line) - 4) // 2)
    line = line[trim : len(line) - trim] if trim > 0 else line
    smooth = smoothed(line, np.ones(len(line)), width)
    return resampled(smooth)


def resampled(line: Floats) -> Floats:
    """The line (K, 2) with one sample a pixel."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, length[-1], max(round(length[-1]) + 1, 4))
    return np.stack([np.interp(at, length, line[:, axis]) for axis in range(2)], axis=-1)


def on_mask(mask: Mask, pixels: Floats) -> NDArray[np.bool_]:
    """Whether places (N, 2) [px] are in the image and on its mask (H, W), shape (N,)."""
    column, row = np.round(pixels).astype(int).T
    inside = (column >= 0) & (row >= 0) & (column < mask.shape[1]) & (row < mask.shape[0])
    on = mask[np.clip(row, 0, mask.shape[0] - 1), np.clip(column, 0, mask.shape[1] - 1)]
    return np.asarray(inside & on, dtype=np.bool_)


def _beyond(grid: Floats, free: Callable[[Floats], NDArray[np.bool_]], width: float) -> Floats:
    """Go straight on at the end as long as it is free: a skeleton stops half a width short of the mask."""
    back = min(len(grid) - 1, max(int(2 * width), 2))
    step = grid[-1] - grid[-1 - back]
    step = step / max(float(np.linalg.norm(step)), 1e-12)
    far = grid[-1] + np.arange(1, int(np.ceil(2 * width)) + 1)[:, None] * step
    open_way = free(far)
    reach = int(np.argmin(open_way)) if not open_way.all() else len(far)
    return np.asarray(far[:reach])


def _centred(
    grids: list[Floats], pixels: Floats, shares: Floats, width: float, half_wave: float
) -> list[Floats]:
    """Move each line to the middle of its sections, each pixel counting by how much of it is rope.

    A section of unusual width is no whole section (something hides a part of it, or the rope crosses
    itself), and is left out.
    """
    sections = Sections.of(grids, pixels, width)
    moved = []
    for number, grid in enumerate(grids):
        mine = sections.line == number
        sample, across, share = sections.sample[mine], sections.across[mine], shares[mine]
        count = np.bincount(sample, share, minlength=len(grid))
        offset = np.bincount(sample, share * across, minlength=len(grid)) / np.maximum(count, 1e-6)
        broad = np.convolve(count, np.full(3, 1 / 3), mode="same")
        typical = np.median(broad)
        usual = np.abs(broad - typical) <= UNUSUAL * typical
        weights = np.where(usual, count, 0.0)
        if weights.any():
            offset = np.clip(np.where(usual, offset, 0.0), -0.5 * width, 0.5 * width)
            grid = beside(grid, offset, weights, half_wave)
        moved.append(resampled(grid))
    return moved


def beside(grid: Floats, offset: Floats, weights: Floats, half_wave: float, tip: float = 0.0) -> Floats:
    """A smooth line (N, 2) through what lies so far beside another, (N,) [px], with weights (N,).

    Where nothing tells, the other line does, faintly; but not at so many samples at its tips, where what
    hides the rope lies in the sections: there it bends on as it did.
    """
    at = np.arange(len(grid))
    inner = (at >= tip) & (at < len(grid) - tip)
    weights = np.where(inner, np.maximum(weights, FAINT * weights.max()), 0.0)
    tangent = tangents(grid)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1)
    return smoothed(grid + offset[:, None] * normal, weights, half_wave, onward=True)
