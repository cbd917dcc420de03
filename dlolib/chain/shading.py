"""The middle of a lit, round section: one side may lie in the shade and still be as wide as the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from dlolib.chain.centre import Sections, beside, resampled
from dlolib.chain.view import View, places_of
from dlolib.types import Floats

# Of a section: background on either side, and five ways of light to lie on a round body.
PARTS = 7
BLURS_PX = (0.1, 0.2, 0.3, 0.4, 0.55, 0.7, 0.9, 1.2, 1.6)
FIRST_BLUR, SEARCH_EVERY = 3, 2
# A round that moves nine in ten samples by less is the last.
ENOUGH_PX, MOST = 0.05, 0.9
# Where the diameter is unknown: how wide the rope may be against its mask.
SIZES = (0.8, 0.87, 0.94, 1.0, 1.07, 1.14)
MARGIN_PX = 2.5
ROUNDS = 4
STEP = 0.01
REACH = 4.0
END_RADII = 1.0
# Weak priors towards none of each part. A single distant light that reaches round has no harmonics of second
# order, and little of them is left of one that does not: they are held back more.
WEAK, SECOND_ORDER = 0.02, 0.05
PRIORS = (WEAK, WEAK, WEAK, WEAK, WEAK, SECOND_ORDER, SECOND_ORDER)
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
        Lines (N, 2) with one sample a pixel, in the same order; the standard error [px] (N,) of the middle
        at each of their samples, a constant where light does not tell.
    """
    errors = [np.full(len(grid), LARGEST_ERROR_PX) for grid in grids]
    if view.levels is None or not grids:
        return grids, errors
    pixels, levels, inside = _around(view, max(float(r.max()) for r in radii_px))
    profile: _Profile | None = None
    for _ in range(ROUNDS):
        bound = max(float(r.max()) for r in radii_px) * max(SIZES) + MARGIN_PX
        sections = Sections.of(grids, pixels, bound)
        lines = [_Line.of(sections, number, radii_px[number], levels, inside) for number in range(len(grids))]
        if profile is None:
            profile = _best_profile(lines, half_wave_px, (1.0,) if known else SIZES)
        found = [_moved(grid, line, profile, half_wave_px) for grid, line in zip(grids, lines, strict=True)]
        grids = [grid for grid, _, _ in found]
        radii_px = [stretched(old, len(new)) for new, old in zip(grids, radii_px, strict=True)]
        errors = [stretched(error, len(grid)) for grid, error, _ in found]
        if max(step for _, _, step in found) < ENOUGH_PX:
            break
    return grids, errors


def stretched(values: Floats, count: int) -> Floats:
    """Values along a line that has been given other samples."""
    return np.interp(np.linspace(0, 1, count), np.linspace(0, 1, len(values)), values)


def _around(view: View, radius: float) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Pixels (N, 2) of the rope and beside it, their grey levels, and whether each counts as rope."""
    assert view.levels is not None
    size = 2 * int(np.ceil(radius + MARGIN_PX)) + 1
    near = cv2.dilate(view.mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    pixels = places_of(near)
    return pixels, view.levels[near].astype(np.float64), view.mask[near]


@dataclass(frozen=True)
class _Line:
    """The pixels of one line's sections, a row each (S, W), up to the widest: which sample of the line (S,),
    offset across [px], level, and whether there is a pixel; the radii (N,) [px] of all samples."""

    sample: NDArray[np.intp]
    across: Floats
    level: Floats
    there: NDArray[np.bool_]
    radius: Floats

    @staticmethod
    def of(
        sections: Sections, number: int, radius: Floats, levels: Floats, inside: NDArray[np.bool_]
    ) -> _Line:
        away = np.abs(sections.across) - radius[np.clip(sections.sample, 0, len(radius) - 1)]
        # What is rope beyond the section's own edge is another strand of it, and no background.
        mine = (sections.line == number) & (away < MARGIN_PX) & ~(inside & (away > 1.0))
        mine &= np.isfinite(levels)
        trim = _trim(radius)
        mine &= (sections.sample >= trim) & (sections.sample < len(radius) - trim)
        order = np.flatnonzero(mine)[np.argsort(sections.sample[mine], kind="stable")]
        sample, first, count = np.unique(sections.sample[order], return_index=True, return_counts=True)
        place = np.arange(count.max(initial=1))
        there = place < count[:, None]
        pixel = order[np.minimum(first[:, None] + place, len(order) - 1)]
        return _Line(sample, sections.across[pixel], np.where(there, levels[pixel], 0.0), there, radius)

    def thinned(self, every: int) -> _Line:
        """The pixels of every so many samples."""
        some = self.sample % every == 0
        return _Line(self.sample[some], self.across[some], self.level[some], self.there[some], self.radius)


def _trim(radius: Floats) -> float:
    """How many samples to leave out at an end: a section's window holds what hides the rope there."""
    return min(END_RADII * float(np.median(radius)), len(radius) / 4)


@dataclass(frozen=True)
class _Profile:
    """The blurred parts of a section (M, PARTS) and their slopes over u = across / radius, at u (M,)."""

    u: Floats
    parts: Floats
    slopes: Floats
    size: float

    @staticmethod
    def of(blur: float, pixel: float, size: float) -> _Profile:
        """Blur as a share of the radius."""
        steps = round(REACH / STEP)
        u: Floats = STEP * np.arange(-steps, steps + 1, dtype=np.float64)
        body = np.abs(u) <= 1
        front = np.sqrt(np.maximum(1 - u**2, 0))
        light = [body, body * u, body * front, body * u * front, body * (2 * u**2 - 1)]
        parts = np.stack([u < -1, u > 1, *light]).astype(np.float64)
        # A pixel gathers the light of its whole area, and the lens blurs it before. An even window would lie
        # aside by half a step.
        window = 2 * round(0.5 * pixel / STEP) + 1
        parts = uniform_filter1d(parts, window, axis=1, mode="nearest")
        parts = gaussian_filter1d(parts, blur / STEP, axis=1, mode="nearest")
        slopes = np.gradient(parts, STEP, axis=1)
        return _Profile(u, np.ascontiguousarray(parts.T), np.ascontiguousarray(slopes.T), size)

    def at(self, u: Floats) -> tuple[Floats, Floats]:
        """Parts and slopes at u (...), (..., PARTS) each."""
        place = np.clip(np.round((u + REACH) / STEP).astype(int), 0, len(self.u) - 1)
        return self.parts[place], self.slopes[place]


@dataclass(frozen=True)
class _Fit:
    """Of each sample's section: offset of its middle [px], its standard error, and the residuals' mean."""

    offset: Floats
    error: Floats
    residual: Floats


def _fit(line: _Line, profile: _Profile, half_wave: float) -> _Fit:
    """Fit the sections (N,), each together with its neighbours within half a wave."""
    count = len(line.radius)
    radius = profile.size * line.radius[line.sample, None]
    parts, slopes = profile.at(line.across / radius)
    half = int(0.5 * half_wave)
    # Sections are sorted by sample: sums over a window are differences of running sums.
    low = np.searchsorted(line.sample, np.arange(count) - half)
    high = np.searchsorted(line.sample, np.arange(count) + half + 1)

    def summed(sections: Floats) -> Floats:
        """Sums over each sample's window of what the sections (S, ...) have: (N, ...)."""
        running = np.zeros((len(sections) + 1, *sections.shape[1:]))
        np.cumsum(sections, axis=0, out=running[1:])
        return np.asarray(running[high] - running[low])

    pixels = summed(line.there.sum(axis=1))
    known = np.concatenate([parts * line.there[..., None], line.level[..., None]], axis=2)
    # In the order parts, level, movement: the last is known only once the light is.
    both = np.empty((count, PARTS + 2, PARTS + 2))
    both[:, :-1, :-1] = summed(known.transpose(0, 2, 1) @ known)
    prior = np.diag(PRIORS)
    light = np.linalg.solve(both[:, :PARTS, :PARTS] + prior, both[:, :PARTS, PARTS, None])[..., 0]
    # A section moved by d is bright as this one at across - d.
    moving = (-(slopes @ light[line.sample, :, None])[..., 0] / radius) * line.there
    both[:, :-1, -1] = both[:, -1, :-1] = summed((moving[:, None] @ known)[:, 0])
    both[:, -1, -1] = summed((moving**2).sum(axis=1))
    unknown = [*range(PARTS), PARTS + 1]
    system = both[:, unknown][:, :, unknown] + np.pad(prior, ((0, 1), (0, 1))) + 1e-6 * np.eye(PARTS + 1)
    right = np.zeros((count, PARTS + 1, 2))
    right[..., 0] = both[:, unknown, PARTS]
    right[:, -1, 1] = 1
    answer = np.linalg.solve(system, right)
    solved, inverse = answer[..., 0], answer[:, -1, 1]
    explained = np.einsum("nk,nk->n", solved, right[..., 0])
    rest = np.maximum(both[:, PARTS, PARTS] - explained, 0) / np.maximum(pixels - PARTS - 1, 1)
    # Levels are whole numbers at best: nothing fits better than that.
    rest = np.maximum(rest, 1 / 12)
    rest = np.where(pixels > 3 * PARTS, rest, np.inf)
    error: Floats = np.sqrt(np.maximum(rest * inverse, 0)).astype(np.float64)
    return _Fit(solved[:, PARTS].astype(np.float64), error, rest.astype(np.float64))


def _best_profile(lines: list[_Line], half_wave: float, sizes: tuple[float, ...]) -> _Profile:
    """The blur and the size under which the sections fit best, each sought with the other kept, downhill."""
    typical = float(np.median(np.concatenate([line.radius for line in lines])))
    # All sections show the same camera: every other one tells its sharpness.
    lines = [line.thinned(SEARCH_EVERY) for line in lines]
    tried: dict[tuple[int, int], tuple[float, _Profile]] = {}

    def misfit(size: int, blur: int) -> float:
        if (size, blur) not in tried:
            radius = sizes[size] * typical
            profile = _Profile.of(BLURS_PX[blur] / radius, 1 / radius, sizes[size])
            residual = np.concatenate([_fit(line, profile, half_wave).residual for line in lines])
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
    return _Profile.of(
        _between(partial(misfit, size), blur) / typical_radius, 1 / typical_radius, sizes[size]
    )


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


def _moved(grid: Floats, line: _Line, profile: _Profile, half_wave: float) -> tuple[Floats, Floats, float]:
    """The line anew, its standard error, and what most of its samples moved less than [px]."""
    fit = _fit(line, profile, half_wave)
    usable = (fit.error < LARGEST_ERROR_PX) & (np.abs(fit.offset) < LARGEST_SHIFT * 2 * line.radius)
    usable[[0, -1]] = False
    if usable.mean() < LEAST_SHARE:
        return grid, np.full(len(grid), LARGEST_ERROR_PX), 0.0
    weights = np.where(usable, 1 / np.maximum(fit.error, 0.01) ** 2, 0.0)
    weights = np.minimum(weights, 4 * np.median(weights[usable]))
    farthest = 0.5 * line.radius
    offset = np.where(usable, np.clip(fit.offset, -farthest, farthest), 0.0)
    moved = beside(grid, offset, weights, half_wave, _trim(line.radius))
    error = np.interp(np.arange(len(grid)), np.flatnonzero(usable), fit.error[usable])
    step = float(np.quantile(np.linalg.norm(moved - grid, axis=1), MOST))
    return resampled(moved), error, step
