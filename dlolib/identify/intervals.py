"""95 % intervals scaled to the residual: a jackknife over blocks of frames, or of the rope.

A dozen blocks are too few for a bootstrap, whose percentile intervals are then too narrow.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from dlolib.formats import interpolate_motion
from dlolib.identify.problem import Bools, Problem
from dlolib.sim.poses import Model
from dlolib.types import Floats, Ints, Recording

BLOCKS = 12
# With fewer distinct poses than this, leaving out frames would only tell how well one pose was measured.
FEWEST_POSES = 4
# A pose of an arm that stands still goes to and fro by no more than this.
JITTER_M, JITTER_RAD = 5e-4, 5e-3
# Fewer blocks than this say nothing of how they differ.
FEWEST_BLOCKS = 3
# A parameter of which all blocks but one tell less than this share is told by that one alone.
LEAST_LEFT = 1e-6


def blocks(model: Model, used: Bools) -> Ints:
    """A block number for each used point: runs of consecutive frames, or stretches of the rope where these
    are few or show few poses.

    Residuals of neighbouring frames and points are not independent; whole blocks are.
    """
    points = model.recording.points
    frames = np.unique(points.frame[used])
    at = np.searchsorted(frames, points.frame[used])
    if min(poses(model.recording, points.t_s[used]), len(frames)) >= FEWEST_POSES:
        return np.asarray(at * min(BLOCKS, len(frames)) // len(frames), dtype=np.int64)
    share = points.s_m[used] / model.recording.rope.length_m
    return np.minimum(share * BLOCKS, BLOCKS - 1).astype(np.int64)


def jackknife(problem: Problem, theta: Floats) -> tuple[Floats, Floats]:
    """Ends of the 95 % intervals of theta, each shape (N,): what leaving out one block at a time changes, and
    Student's t of one less than the blocks (Tukey, Annals of Mathematical Statistics 29, 1958).

    Each refit is one Gauss-Newton step from the optimum, which is the refit to first order. An end is NaN
    where the blocks are too few, or where one of them alone tells the parameter.
    """
    normal, pull = _per_block(problem, problem.residuals(theta), problem.jacobian(theta))
    count = len(normal)
    if count < FEWEST_BLOCKS:
        return np.full_like(theta, np.nan), np.full_like(theta, np.nan)
    rest, told = normal.sum(axis=0) - normal, np.diag(normal.sum(axis=0))
    without = zip(rest, pull.sum(axis=0) - pull, strict=True)
    steps = [np.linalg.lstsq(a, b, rcond=1e-12)[0] for a, b in without]
    error = np.sqrt(count - 1) * np.std(steps, axis=0)
    half = stats.t.ppf(0.975, count - 1) * error
    alone = (np.diagonal(rest, axis1=1, axis2=2) < LEAST_LEFT * told).any(axis=0)
    half = np.where(alone, np.nan, half)
    return theta - half, theta + half


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


def poses(recording: Recording, t_s: Floats) -> int:
    """How many poses of the ends that differ by more than an arm's jitter are seen at these times [s]; more
    than `FEWEST_POSES` are not counted. What the ends do between is in the motion, and in no frame."""
    motion = interpolate_motion(recording.motion, np.unique(t_s))
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
