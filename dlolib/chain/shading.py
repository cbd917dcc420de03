"""The middle of a lit, round section: one side may lie in the shade and still be as wide as the other."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from dlolib.chain.centre import Sections, beside, resampled
from dlolib.chain.section import BODY, MARGIN_PX, Fit, Line, Profile, Windows, fitted, trim
from dlolib.chain.view import View
from dlolib.types import Floats

BLURS_PX = (0.1, 0.2, 0.3, 0.4, 0.55, 0.7, 0.9, 1.2, 1.6)
FIRST_BLUR, SEARCH_EVERY = 3, 2
# A round that moves nine in ten samples by less is the last.
ENOUGH_PX, MOST = 0.05, 0.9
# Where the diameter is unknown: how wide the rope may be against its mask.
SIZES = (0.8, 0.87, 0.94, 1.0, 1.07, 1.14)
ROUNDS = 4
# Light of fourth order is in the edge of every shadow; of a Lambertian body about so large a share of the
# level goes with cos 4φ, and with sin 4φ. The fit has no parts for it, and is drawn aside by it.
FOURTH_ORDER = 0.03
LARGEST_ERROR_PX, LARGEST_SHIFT = 0.15, 0.2
LEAST_SHARE = 0.3


def shaded_middles(
    grids: list[Floats], radii_px: list[Floats], known: bool, view: View, half_wave_px: float
) -> tuple[list[Floats], list[Floats]]:
    """Move lines that lie near the middle of the rope to where its outline, not its light, is in the middle.

    How bright a matt body is under any distant lights, shadows on itself included, depends on its normal
    as harmonics up to the second do (Basri and Jacobs, IEEE PAMI 25, 2003). Across a round section the
    normal is (u, √(1 - u²)), u from -1 to 1: five parts. Beyond lies background, which may differ from
    side to side. Blurred by pixel and lens, these seven are fitted to the grey levels around each
    section: the light may be any, and what places the section is where its two edges are. How sharp the
    camera is, and how wide a rope of unknown diameter looks, the picture tells itself.

    Args:
        grids: lines (N, 2), one sample a pixel, within a fraction of the width of the middle.
        radii_px: how large the rope's radius looks at each of their samples, (N,) each.
        known: whether these radii come from a known diameter.
        view: with levels; without them the lines stay as they are.
        half_wave_px: half of the shortest wave that the line may show [px].

    Returns:
        Lines (N, 2) with one sample a pixel, in the same order; how far [px] (N, 2) the middle may be off at
        each of their samples: by noise, and by light that the fit does not know, which is the same in frame
        after frame. Constants where light does not tell.
    """
    errors = [np.full((len(grid), 2), LARGEST_ERROR_PX) for grid in grids]
    if view.levels is None or not grids:
        return grids, errors
    pixels, levels, inside = _around(view, max(float(r.max()) for r in radii_px))
    profile: Profile | None = None
    for _ in range(ROUNDS):
        bound = max(float(r.max()) for r in radii_px) * max(SIZES) + MARGIN_PX
        sections = Sections.of(grids, pixels, bound)
        lines = [Line.of(sections, number, radii_px[number], levels, inside) for number in range(len(grids))]
        if profile is None:
            profile = _best_profile(lines, half_wave_px, (1.0,) if known else SIZES)
        found = [_moved(grid, line, profile, half_wave_px) for grid, line in zip(grids, lines, strict=True)]
        grids = [grid for grid, _, _ in found]
        radii_px = [stretched(old, len(new)) for new, old in zip(grids, radii_px, strict=True)]
        if max(step for _, _, step in found) < ENOUGH_PX:
            break
    assert profile is not None
    doubts = [
        _doubts(line, profile, half_wave_px, fit) for line, (_, fit, _) in zip(lines, found, strict=True)
    ]
    return grids, [stretched(doubt, len(grid)) for doubt, grid in zip(doubts, grids, strict=True)]


def stretched(values: Floats, count: int) -> Floats:
    """Values (N,) or (N, K) along a line that has been given other samples, (count,) or (count, K)."""
    at, old = np.linspace(0, 1, count), np.linspace(0, 1, len(values))
    if values.ndim > 1:
        return np.stack([np.interp(at, old, column) for column in values.T], axis=-1)
    return np.interp(at, old, values)


def _around(view: View, radius: float) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Pixels (N, 2) of the rope and beside it, their grey levels, and whether each counts as rope."""
    assert view.levels is not None
    size = 2 * int(np.ceil(radius + MARGIN_PX)) + 1
    near = cv2.dilate(view.mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    rows, columns = np.nonzero(near)
    pixels = np.stack([columns, rows], axis=-1).astype(np.float64)
    return pixels, view.levels[near].astype(np.float64), view.mask[near]


def _doubts(line: Line, profile: Profile, half_wave: float, fit: Fit) -> Floats:
    """How far [px] (N, 2) the middle may be off: by what the fit leaves, and by light of fourth order.

    What it leaves counts where it moves the middle (White, Econometrica 48, 1980): a strand's pattern amid
    the rope moves it less than an edge that single pixels cut into steps.
    """
    usable = _usable(line, fit)
    if usable.mean() < LEAST_SHARE:
        return np.full((len(usable), 2), LARGEST_ERROR_PX)
    windows = Windows(line, half_wave)
    left = (line.level - (fit.known @ fit.found[line.sample, :, None])[..., 0]) * line.there
    weighted = fit.known * left[..., None]
    spread = windows.sums(weighted.transpose(0, 2, 1) @ weighted)
    noise = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", fit.lever, spread, fit.lever), 0.0))
    fourth = profile.fourth[profile.at(line)] * line.there[..., None]
    aside = np.einsum("ni,nij->nj", fit.lever, windows.sums(fit.known.transpose(0, 2, 1) @ fourth))
    body = windows.sums((fit.known[..., BODY] * np.stack([line.level, fit.known[..., BODY]])).sum(axis=2).T)
    level = body[:, 0] / np.maximum(body[:, 1], 1e-12)
    doubt = np.stack([noise, FOURTH_ORDER * level * np.linalg.norm(aside, axis=1)], axis=-1)
    at = np.arange(len(doubt))
    return np.stack([np.interp(at, at[usable], column[usable]) for column in doubt.T], axis=-1)


def _usable(line: Line, fit: Fit) -> NDArray[np.bool_]:
    """Which samples' sections (N,) tell their middle."""
    usable = (fit.error < LARGEST_ERROR_PX) & (np.abs(fit.offset) < LARGEST_SHIFT * 2 * line.radius)
    usable[[0, -1]] = False
    return np.asarray(usable)


def _best_profile(lines: list[Line], half_wave: float, sizes: tuple[float, ...]) -> Profile:
    """The blur and the size under which the sections fit best, each sought with the other kept, downhill."""
    typical = float(np.median(np.concatenate([line.radius for line in lines])))
    # All sections show the same camera: every other one tells its sharpness.
    lines = [line.thinned(SEARCH_EVERY) for line in lines]
    tried: dict[tuple[int, int], tuple[float, Profile]] = {}

    def misfit(size: int, blur: int) -> float:
        if (size, blur) not in tried:
            radius = sizes[size] * typical
            profile = Profile.of(BLURS_PX[blur] / radius, 1 / radius, sizes[size])
            residual = np.concatenate([fitted(line, profile, half_wave).residual for line in lines])
            tried[size, blur] = float(np.median(residual)), profile
        return tried[size, blur][0]

    size, blur = len(sizes) // 2, FIRST_BLUR
    for _ in range(ROUNDS):
        blur = _downhill(partial(misfit, size), blur, len(BLURS_PX))
        before = size
        size = _downhill(partial(_swapped, misfit, blur), size, len(sizes))
        if size == before:
            break
    typical_radius = sizes[size] * typical
    return Profile.of(_between(partial(misfit, size), blur) / typical_radius, 1 / typical_radius, sizes[size])


def _between(misfit: Callable[[int], float], blur: int) -> float:
    """The blur [px] at the lowest point of a parabola through the best one and those beside it.

    One of a coarse row would jump from frame to frame, and a lit rope's middle with it, by 0.05 px.
    """
    aside = 0.0
    if 0 < blur < len(BLURS_PX) - 1:
        left, here, right = (misfit(blur + step) for step in (-1, 0, 1))
        # where no section tells they are infinite
        if here < min(left, right) < np.inf:
            aside = 0.5 * (left - right) / (left - 2 * here + right)
    return float(np.exp(np.interp(blur + aside, np.arange(len(BLURS_PX)), np.log(BLURS_PX))))


def _swapped(misfit: Callable[[int, int], float], blur: int, size: int) -> float:
    return misfit(size, blur)


def _downhill(misfit: Callable[[int], float], at: int, count: int) -> int:
    """The place of the nearest minimum among 0 to count - 1, from `at`."""
    for step in (-1, 1):
        while 0 <= at + step < count and misfit(at + step) < misfit(at):
            at += step
    return at


def _moved(grid: Floats, line: Line, profile: Profile, half_wave: float) -> tuple[Floats, Fit, float]:
    """The line anew, the fit that moved it, and what most of its samples moved less than [px]."""
    fit = fitted(line, profile, half_wave)
    usable = _usable(line, fit)
    if usable.mean() < LEAST_SHARE:
        return grid, fit, 0.0
    weights = np.where(usable, 1 / np.maximum(fit.error, 0.01) ** 2, 0.0)
    weights = np.minimum(weights, 4 * np.median(weights[usable]))
    farthest = 0.5 * line.radius
    offset = np.where(usable, np.clip(fit.offset, -farthest, farthest), 0.0)
    moved = beside(grid, offset, weights, half_wave, trim(line.radius))
    step = float(np.quantile(np.linalg.norm(moved - grid, axis=1), MOST))
    return resampled(moved), fit, step
