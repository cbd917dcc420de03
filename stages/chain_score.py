"""How well a chain fits a known axis: by arc length, and not by the nearest point alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlolib.chain import FrameChain
from dlolib.types import Floats

# Where strands come close, a metre of difference in arc length beyond the first 20 mm counts as so many.
ARC_WEIGHT, ARC_FREE_M = 0.1, 0.02
WRONG_ORDER_M = 0.03
COVERED_M, STRAY_M = 0.010, 0.010
HIDDEN_MARGIN_M = 0.003


@dataclass(frozen=True)
class Score:
    """One frame: distances [m] (K,) from the axis, differences in arc length [m] (K,), and so on.

    spacing (K - 1,): distance of neighbours over the true one, less one; ordered; covered: share of the
    visible axis on the chain; stray: points further than 10 mm away; invented: points deeper than 3 mm in a
    hidden stretch; squares (K,): squared length of the error at the point's arc length, in units of its
    covariance; white (points of a chain, 3): these errors made independent of direction, NaN where there is
    no point.
    """

    off_m: Floats
    arc_m: Floats
    spacing: Floats
    ordered: bool
    covered: float
    stray: int
    invented: int
    squares: Floats
    white: Floats


def score(chain: FrameChain, s_m: Floats, axis_m: Floats, visible: np.ndarray, points: int = 30) -> Score:
    """Hold a chain of so many points against the true axis (N, 3) at arc lengths (N,)."""
    apart = np.linalg.norm(chain.xyz_m[:, None] - axis_m, axis=-1)
    elsewhere = np.maximum(np.abs(chain.s_m[:, None] - s_m) - ARC_FREE_M, 0.0)
    foot = np.argmin(apart**2 + (ARC_WEIGHT * elsewhere) ** 2, axis=1)
    true = s_m[foot]
    at = np.stack([np.interp(chain.s_m, s_m, axis_m[:, k]) for k in range(3)], axis=-1)
    step = np.diff(chain.s_m)
    near = step < 1.5 * np.median(step)
    true_step = np.linalg.norm(np.diff(at, axis=0), axis=1)[near]
    spacing = np.linalg.norm(np.diff(chain.xyz_m, axis=0), axis=1)[near] / true_step - 1
    white = np.full((len(chain.s_m), 3), np.nan)
    if chain.covariance_m2 is not None:
        root = np.linalg.cholesky(chain.covariance_m2)
        white = np.linalg.solve(root, (chain.xyz_m - at)[..., None])[..., 0]
    ordered = bool((np.diff(true) > 0).all() and np.abs(true - chain.s_m).max() < WRONG_ORDER_M)
    return Score(
        apart[np.arange(len(foot)), foot],
        true - chain.s_m,
        spacing,
        ordered,
        _covered(chain, near, axis_m, visible),
        int((apart.min(axis=1) > STRAY_M).sum()),
        int(_deep(visible, s_m)[foot].sum()),
        np.sum(white**2, axis=1),
        _in_places(white, chain.s_m, points, float(s_m[-1])),
    )


def _in_places(values: Floats, s_m: Floats, points: int, length_m: float) -> Floats:
    """Values (K, 3) of a chain's points in all its places (points, 3), NaN where there is none."""
    grid = np.full((points, values.shape[1]), np.nan)
    grid[np.clip(np.round(s_m / length_m * (points - 1)).astype(int), 0, points - 1)] = values
    return grid


def _covered(chain: FrameChain, near: np.ndarray, axis_m: Floats, visible: np.ndarray) -> float:
    """Share of the visible axis within 10 mm of the chain, its points joined to their neighbours."""
    joined = [
        np.linspace(a, b, 16)
        for a, b, one in zip(chain.xyz_m[:-1], chain.xyz_m[1:], near, strict=True)
        if one
    ]
    line = np.concatenate([chain.xyz_m, *joined])
    seen = axis_m[visible]
    distance = np.linalg.norm(seen[:, None] - line, axis=-1).min(axis=1)
    return float((distance < COVERED_M).mean())


def _deep(visible: np.ndarray, s_m: Floats) -> np.ndarray:
    """Samples in a hidden stretch and further than 3 mm from any visible one."""
    seen = s_m[visible]
    after = np.clip(np.searchsorted(seen, s_m), 0, len(seen) - 1)
    before = np.clip(after - 1, 0, len(seen) - 1)
    away = np.minimum(np.abs(seen[after] - s_m), np.abs(seen[before] - s_m))
    return np.asarray(~visible & (away > HIDDEN_MARGIN_M))
