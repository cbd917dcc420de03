"""Clouds of a real rope, laid out anew along drawn curves that cross themselves.

What a depth camera does to a rope goes along with it (noise, steps of depth, gaps, an outline that frays),
and its line is known: its readings are moved pixel by pixel from beside the line that was found to beside the
one that was drawn. Where it crosses itself one strand passes over the other and hides it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from dlolib.chain.cloud import view_of_cloud
from dlolib.types import Floats

SAMPLES = 400
# Readings further aside are of something else.
ASIDE_PX = 12.0
# A curve fits into the camera's image, is not bent more than a rope is, and crosses itself at this angle at
# least, away from its tips (a share of its samples); elsewhere its strands are apart.
IMAGE_PX, BEND_PX, CROSSINGS, LEAST_RAD, TIP_SHARE, APART_PX = (1230, 690), 25.0, (1, 3), 0.44, 0.06, 24.0
NEAR_PX, BESIDE_PX = 60.0, 80.0
# One strand passes over another by the rope's diameter, over so much of its length.
OVER_M, OVER_PX = 0.006, 50.0
FINE = 3


@dataclass(frozen=True)
class Strip:
    """A rope's readings by where they lie: along its line and aside of it [px] (N,), and behind it [m] (N,).

    Beside them its length [px], its distance [m] and the focal length [px].
    """

    along_px: Floats
    aside_px: Floats
    behind_m: Floats
    length_px: float
    far_m: float
    focal_px: float


@dataclass(frozen=True)
class Layout:
    """A cloud (N, 3) [m] in camera axes, and the line (SAMPLES, 3) [m] that its readings lie along."""

    cloud_m: Floats
    line_m: Floats


def strip_of(cloud_m: Floats, line_m: Floats) -> Strip:
    """The readings (N, 3) of a rope beside the dense line (K, 3) that was found in them; in camera axes."""
    focal = view_of_cloud(cloud_m).focal
    pixel, place = (focal * points[:, :2] / points[:, 2:] for points in (line_m, cloud_m))
    new = np.r_[True, np.linalg.norm(np.diff(pixel, axis=0), axis=1) > 0]
    pixel, depth = pixel[new], line_m[new, 2]
    knots = _lengths(pixel)
    fine = np.arange(0, knots[-1], 0.25)
    line, way, across = _frame(CubicSpline(knots, pixel), fine)
    off, nearest = cKDTree(line).query(place)
    mine = off < ASIDE_PX
    nearest = np.asarray(nearest)[mine]
    step = place[mine] - line[nearest]
    return Strip(
        fine[nearest] + np.einsum("ij,ij->i", step, way[nearest]),
        np.einsum("ij,ij->i", step, across[nearest]),
        cloud_m[mine, 2] - np.interp(fine[nearest], knots, depth),
        float(knots[-1]),
        float(np.median(cloud_m[:, 2])),
        focal,
    )


def laid_out(strip: Strip, rng: np.random.Generator) -> Layout:
    """A rope along a drawn curve."""
    curve, crossings = _drawn(strip.length_px, rng)
    knots = np.linspace(0, strip.length_px, SAMPLES)
    over = np.zeros(SAMPLES)
    for strands in crossings:
        above = knots[strands[rng.integers(2)]]
        over += OVER_M * np.exp(-0.5 * ((knots - above) / OVER_PX) ** 2)
    # so many readings a pixel that none is left empty where the rope is bent
    part = (np.arange(FINE) - (FINE - 1) / 2) / FINE
    along, aside = (
        np.add.outer(values, shifts).ravel()
        for values, shifts in ((strip.along_px, np.repeat(part, FINE)), (strip.aside_px, np.tile(part, FINE)))
    )
    on = np.clip(along, 0, strip.length_px)
    line, way, across = _frame(CubicSpline(knots, curve), on)
    pixel = np.round(line + (along - on)[:, None] * way + aside[:, None] * across).astype(int)
    depth = strip.far_m + np.repeat(strip.behind_m, FINE**2) - np.interp(on, knots, over)
    corner = pixel.min(axis=0)
    image = np.full(np.ptp(pixel, axis=0) + 1, np.inf)
    np.minimum.at(image, tuple((pixel - corner).T), depth)
    filled = np.argwhere(np.isfinite(image))
    cloud = _space(filled + corner, image[tuple(filled.T)], strip.focal_px)
    return Layout(cloud, _space(curve, strip.far_m - over, strip.focal_px))


def _drawn(length_px: float, rng: np.random.Generator) -> tuple[Floats, list[tuple[int, int]]]:
    """A curve (SAMPLES, 2) [px] that crosses itself, and which samples meet at its crossings."""
    while True:
        angle = _loop(rng) if rng.integers(2) else _winding(rng)
        if np.abs(np.gradient(angle)).max() > length_px / SAMPLES / BEND_PX:
            continue
        curve = np.cumsum(np.stack([np.cos(angle), np.sin(angle)], axis=-1), axis=0) * length_px / SAMPLES
        curve -= 0.5 * (curve.min(axis=0) + curve.max(axis=0))
        if (np.ptp(curve, axis=0) <= IMAGE_PX).all():
            crossings = _crossings(curve)
            if _plain(curve, angle, crossings):
                return curve, crossings


def _loop(rng: np.random.Generator) -> Floats:
    """Directions [rad] (SAMPLES,) of a rope that turns once round over a part of its length."""
    u = np.linspace(0, 1, SAMPLES)
    begin = rng.uniform(0.15, 0.45)
    share = np.clip((u - begin) / rng.uniform(0.35, 0.6), 0, 1)
    turn = rng.choice([-1, 1]) * rng.uniform(1.3, 2.1) * np.pi * share**2 * (3 - 2 * share)
    wave = rng.uniform(-1, 1) * np.sin(2 * np.pi * u + rng.uniform(0, 2 * np.pi))
    return np.asarray(turn + wave + rng.uniform(0, 2 * np.pi))


def _winding(rng: np.random.Generator) -> Floats:
    """Directions [rad] (SAMPLES,) of a rope whose curvature is drawn at eight places."""
    bends = CubicSpline(np.linspace(0, 1, 8), rng.normal(size=8) * rng.uniform(2.5, 5))
    turning = np.cumsum(bends(np.linspace(0, 1, SAMPLES))) * 6 / SAMPLES
    return np.asarray(turning + rng.uniform(0, 2 * np.pi))


def _crossings(curve: Floats) -> list[tuple[int, int]]:
    """Pairs of samples after which a curve (N, 2) crosses itself."""
    step = np.diff(curve, axis=0)
    between = curve[None, :-1] - curve[:-1, None]
    area = _cross(step[:, None], step[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = _cross(between, step[None]) / area, _cross(between, step[:, None]) / area
    met = (first >= 0) & (first < 1) & (second >= 0) & (second < 1)
    one, other = np.nonzero(np.triu(met, 2))
    return list(zip(one.tolist(), other.tolist(), strict=True))


def _plain(curve: Floats, angle: Floats, crossings: list[tuple[int, int]]) -> bool:
    """Whether a person would say of each crossing what goes on where."""
    if not CROSSINGS[0] <= len(crossings) <= CROSSINGS[1]:
        return False
    order = np.arange(SAMPLES) * float(np.linalg.norm(curve[1] - curve[0]))
    beside = np.abs(order[:, None] - order) > BESIDE_PX
    for one, other in crossings:
        slant = abs(np.sin(angle[one] - angle[other]))
        if min(one, SAMPLES - other) < TIP_SHARE * SAMPLES or slant < np.sin(LEAST_RAD):
            return False
        at_one, at_other = (np.abs(order - order[k]) < NEAR_PX / slant for k in (one, other))
        beside &= ~((at_one[:, None] & at_other) | (at_other[:, None] & at_one))
    return bool((cdist(curve, curve)[beside] >= APART_PX).all())


def _frame(curve: CubicSpline, at: Floats) -> tuple[Floats, Floats, Floats]:
    """Places, directions and directions aside (N, 2) of a curve."""
    way = curve(at, 1)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return curve(at), way, np.stack([-way[:, 1], way[:, 0]], axis=-1)


def _space(pixel: Floats, depth_m: Floats, focal_px: float) -> Floats:
    return np.concatenate([pixel / focal_px * depth_m[:, None], depth_m[:, None]], axis=1)


def _lengths(points: Floats) -> Floats:
    return np.asarray(np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def _cross(one: Floats, other: Floats) -> Floats:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
