"""95 % intervals scaled to the residual: a bootstrap over blocks of frames, or of the rope."""

from __future__ import annotations

import numpy as np
from scipy import stats

from dlolib.identify.problem import Bools, Problem
from dlolib.sim.poses import Model
from dlolib.types import Floats, Ints

BLOCKS = 12
# With fewer distinct poses than this, resampling frames would only tell how well one pose was measured.
FEWEST_POSES = 4
# A pose of an arm that stands still goes to and fro by no more than this.
JITTER_M, JITTER_RAD = 5e-4, 5e-3
# Fewer blocks than this say nothing of how they differ.
FEWEST_BLOCKS = 3


def blocks(model: Model, used: Bools) -> Ints:
    """A block number for each used point: runs of consecutive frames, or stretches of the rope where these
    are few or show few poses.

    Residuals of neighbouring frames and points are not independent; whole blocks are.
    """
    points = model.recording.points
    frames = np.unique(points.frame[used])
    at = np.searchsorted(frames, points.frame[used])
    if min(poses(model), len(frames)) >= FEWEST_POSES:
        return np.asarray(at * min(BLOCKS, len(frames)) // len(frames), dtype=np.int64)
    share = points.s_m[used] / model.recording.rope.length_m
    return np.minimum(share * BLOCKS, BLOCKS - 1).astype(np.int64)


def bootstrap(problem: Problem, theta: Floats, resamples: int, seed: int) -> tuple[Floats, Floats]:
    """Ends of the 95 % percentile intervals of theta, each shape (N,); NaN where too little was seen to tell.

    Each resample draws blocks with replacement and takes one Gauss-Newton step from the optimum, which is
    the refit to first order.
    """
    residuals, jacobian = problem.residuals(theta), problem.jacobian(theta)
    normal, pull = _per_block(problem, residuals, jacobian)
    if len(normal) < FEWEST_BLOCKS:
        return np.full_like(theta, np.nan), np.full_like(theta, np.nan)
    numbers = np.arange(len(normal))

    def refit(drawn: Floats) -> Floats:
        counts = np.bincount(drawn.astype(int), minlength=len(normal))
        a = np.tensordot(counts, normal, axes=1)
        b = np.tensordot(counts, pull, axes=1)
        return np.asarray(theta - np.linalg.lstsq(a, b, rcond=1e-12)[0])

    drawn = stats.bootstrap(
        (numbers,),
        refit,
        n_resamples=resamples,
        vectorized=False,
        method="percentile",
        rng=np.random.default_rng(seed),
    )
    return np.atleast_1d(drawn.confidence_interval.low), np.atleast_1d(drawn.confidence_interval.high)


def _per_block(problem: Problem, residuals: Floats, jacobian: Floats) -> tuple[Floats, Floats]:
    """J^T J and J^T r of each block, (K, N, N) and (K, N)."""
    labels, first = [], 0
    for model, used in zip(problem.models, problem.used, strict=True):
        # a stretch in which nothing was seen is no block
        label = np.unique(blocks(model, used), return_inverse=True)[1]
        per_point = 2 if model.recording.planar else 3
        labels.append(np.repeat(label + first, per_point))
        first += int(label.max()) + 1
    rows = np.concatenate(labels)
    normal = np.stack([jacobian[rows == k].T @ jacobian[rows == k] for k in range(first)])
    pull = np.stack([jacobian[rows == k].T @ residuals[rows == k] for k in range(first)])
    return normal, pull


def poses(model: Model) -> int:
    """How many poses of the ends the recording shows that differ by more than an arm's jitter; more than
    `FEWEST_POSES` are not counted."""
    motion = model.recording.motion
    parts = [motion.start_m / JITTER_M, motion.end_m / JITTER_M]
    parts += [2 * q / JITTER_RAD for q in (motion.start_q, motion.end_q)]
    rows = np.nan_to_num(np.hstack(parts))
    # the one that is furthest from all before it, again and again
    away = np.linalg.norm(rows - rows[0], axis=1)
    count = 1
    while count < FEWEST_POSES and away.max() > 1.0:
        away = np.minimum(away, np.linalg.norm(rows - rows[away.argmax()], axis=1))
        count += 1
    return count
