"""What a lit, round section shows, blurred by pixel and lens, and how it is fitted to grey levels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from dlolib.chain.centre import Sections
from dlolib.types import Floats

# Of a section: background on either side, and five ways of light to lie on a round body, even light first.
PARTS, BODY = 7, 2
MARGIN_PX = 2.5
STEP = 0.01
REACH = 4.0
END_RADII = 1.0
# Weak priors towards none of each part. A single distant light that reaches round has no harmonics of second
# order, and little of them is left of one that does not: they are held back more.
WEAK, SECOND_ORDER = 0.02, 0.05
PRIORS = (WEAK, WEAK, WEAK, WEAK, WEAK, SECOND_ORDER, SECOND_ORDER)


@dataclass(frozen=True)
class Line:
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
    ) -> Line:
        """Of all sections those of one line, whose samples have these radii [px] (N,), with the levels of all
        pixels and whether each counts as rope."""
        away = np.abs(sections.across) - radius[np.clip(sections.sample, 0, len(radius) - 1)]
        # What is rope beyond the section's own edge is another strand of it, and no background.
        mine = (sections.line == number) & (away < MARGIN_PX) & ~(inside & (away > 1.0))
        mine &= np.isfinite(levels)
        end = trim(radius)
        mine &= (sections.sample >= end) & (sections.sample < len(radius) - end)
        order = np.flatnonzero(mine)[np.argsort(sections.sample[mine], kind="stable")]
        sample, first, count = np.unique(sections.sample[order], return_index=True, return_counts=True)
        place = np.arange(count.max(initial=1))
        there = place < count[:, None]
        pixel = order[np.minimum(first[:, None] + place, len(order) - 1)]
        return Line(sample, sections.across[pixel], np.where(there, levels[pixel], 0.0), there, radius)

    def thinned(self, every: int) -> Line:
        """The pixels of every so many samples."""
        some = self.sample % every == 0
        return Line(self.sample[some], self.across[some], self.level[some], self.there[some], self.radius)


def trim(radius: Floats) -> float:
    """How many samples to leave out at an end: a section's window holds what hides the rope there."""
    return min(END_RADII * float(np.median(radius)), len(radius) / 4)


@dataclass(frozen=True)
class Profile:
    """The blurred parts of a section (M, PARTS) and their slopes over u = across / radius, at u (M,); and
    what light of fourth order would add, fourth (M, 2)."""

    u: Floats
    parts: Floats
    slopes: Floats
    fourth: Floats
    size: float

    @staticmethod
    def of(blur: float, pixel: float, size: float) -> Profile:
        """Blur as a share of the radius."""
        steps = round(REACH / STEP)
        u: Floats = STEP * np.arange(-steps, steps + 1, dtype=np.float64)
        body = np.abs(u) <= 1
        front = np.sqrt(np.maximum(1 - u**2, 0))
        light = [body, body * u, body * front, body * u * front, body * (2 * u**2 - 1)]
        twice = 1 - 2 * u**2
        fourth = [body * (2 * twice**2 - 1), body * 4 * u * front * twice]
        parts = np.stack([u < -1, u > 1, *light, *fourth]).astype(np.float64)
        # A pixel gathers the light of its whole area, and the lens blurs it before. An even window would lie
        # aside by half a step.
        window = 2 * round(0.5 * pixel / STEP) + 1
        parts = uniform_filter1d(parts, window, axis=1, mode="nearest")
        parts = gaussian_filter1d(parts, blur / STEP, axis=1, mode="nearest")
        slopes = np.gradient(parts[:PARTS], STEP, axis=1)
        tables = parts[:PARTS], slopes, parts[PARTS:]
        known, moving, unknown = (np.ascontiguousarray(table.T) for table in tables)
        return Profile(u, known, moving, unknown, size)

    def at(self, line: Line) -> NDArray[np.intp]:
        """The rows of parts, slopes and fourth for each pixel (S, W) of a line's sections."""
        u = line.across / (self.size * line.radius[line.sample, None])
        rows: NDArray[np.intp] = np.round((u + REACH) / STEP).astype(np.intp)
        return np.clip(rows, 0, len(self.u) - 1)


class Windows:
    """Each sample of a line (N,) with the sections within half a wave of it."""

    def __init__(self, line: Line, half_wave: float) -> None:
        at, half = np.arange(len(line.radius)), int(0.5 * half_wave)
        # Sections are sorted by sample: sums over a window are differences of running sums.
        self.low = np.searchsorted(line.sample, at - half)
        self.high = np.searchsorted(line.sample, at + half + 1)

    def sums(self, sections: Floats) -> Floats:
        """Over each window, of what the sections (S, ...) have: (N, ...)."""
        running = np.zeros((len(sections) + 1, *sections.shape[1:]))
        np.cumsum(sections, axis=0, out=running[1:])
        return np.asarray(running[self.high] - running[self.low])


@dataclass(frozen=True)
class Fit:
    """Of each sample's section (N,): offset of its middle [px], its standard error were the residuals white,
    and their mean square. The fit itself: what each pixel has of the parts and of movement, known (S, W,
    PARTS + 1), how much of them there is, found (N, PARTS + 1), and what moves the middle, lever (N,
    PARTS + 1)."""

    offset: Floats
    error: Floats
    residual: Floats
    known: Floats
    found: Floats
    lever: Floats


def fitted(line: Line, profile: Profile, half_wave: float) -> Fit:
    """Fit the sections (N,), each together with its neighbours within half a wave."""
    count = len(line.radius)
    at = profile.at(line)
    parts, slopes = profile.parts[at], profile.slopes[at]
    summed = Windows(line, half_wave).sums
    pixels = summed(line.there.sum(axis=1))
    known = np.concatenate([parts * line.there[..., None], line.level[..., None]], axis=2)
    # In the order parts, level, movement: the last is known only once the light is.
    both = np.empty((count, PARTS + 2, PARTS + 2))
    both[:, :-1, :-1] = summed(known.transpose(0, 2, 1) @ known)
    prior = np.diag(PRIORS)
    light = np.linalg.solve(both[:, :PARTS, :PARTS] + prior, both[:, :PARTS, PARTS, None])[..., 0]
    # A section moved by d is bright as this one at across - d.
    radius = profile.size * line.radius[line.sample, None]
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
    known = np.concatenate([known[..., :PARTS], moving[..., None]], axis=2)
    return Fit(
        solved[:, PARTS].astype(np.float64), error, rest.astype(np.float64), known, solved, answer[..., 1]
    )
