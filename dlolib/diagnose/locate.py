"""Where a rod is wrong, before anything is named: the way back against the way out, and a scan.

The gain in χ² of a local probe (`dlolib.diagnose.probes`) over a window of frames, with the baseline's own
parameters projected out, is a scan statistic (Kulldorff, Communications in Statistics 26, 1997); what noise
alone makes of the largest of them is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.fft import dct
from scipy.spatial.transform import Rotation

from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.meshes import left_by_meshes
from dlolib.diagnose.probes import PLACES, PROBES, places, probe
from dlolib.diagnose.study import Seen, Study
from dlolib.formats import interpolate_motion
from dlolib.identify.problem import axes
from dlolib.types import Floats, Ints, Motion, Place, Recording

DRAWS, LEVEL = 300, 0.99
MOST_PLACES = 4
# Frames at the same pose, between which the rope was elsewhere: [m], [rad], and how far away [m].
SAME_M, SAME_RAD, AWAY_M = 2e-3, 0.02, 0.01
# Slow modes along the rope in which a way back differs.
MODES = 8


@dataclass(frozen=True)
class Reversal:
    """Shape on the way back less that on the way out at the same poses: 0 for all that is reversible.

    pairs: of frames. statistic: χ² over its expectation. p_value: None without pairs.
    """

    pairs: int
    statistic: float
    p_value: float | None


@dataclass(frozen=True)
class Scan:
    """The scan of one recording.

    frames (F,), arc_m (PLACES,). gain (probes, PLACES, F): in χ², the largest over the short windows around a
    frame. threshold: what noise alone exceeds once in a hundred recordings. p_value: how likely noise alone
    gains as much anywhere, over what the mesh may have added. places: the strongest.
    """

    recording: str
    frames: Ints
    arc_m: Floats
    gain: Floats
    threshold: float
    p_value: float
    places: tuple[Place, ...]


def reversal(study: Study, base: Fitted) -> Reversal:
    """The path-reversal test over all recordings, on what the baseline leaves."""
    total, degrees, count = 0.0, 0, 0
    for one, grid in zip(study.seen, base.residuals, strict=True):
        slow = dct(grid, axis=1, norm="ortho")[:, :MODES]
        for out, back in _pairs(one.recording):
            difference = (slow[back] - slow[out]) / np.sqrt(2)
            total += float(np.sum(difference**2))
            degrees += difference.size
            count += 1
    if not count:
        return Reversal(0, 1.0, None)
    return Reversal(count, total / degrees, float(stats.chi2.sf(total, degrees)))


def _pairs(recording: Recording) -> list[tuple[int, int]]:
    """Frames of one pose each, the later one the nearest to it of the way back; every frame once."""
    motion = _at_frames(recording)
    x = np.nan_to_num(np.hstack([motion.start_m, motion.end_m]))
    q = np.stack([motion.start_q, motion.end_q], axis=1)
    # a free end turns as it likes
    q[np.isnan(q).any(axis=2)] = (1.0, 0.0, 0.0, 0.0)
    found, used = [], set()
    for a in range(len(x)):
        if a in used:
            continue
        away = np.linalg.norm(x - x[a], axis=1)
        turn = 2 * np.arccos(np.clip(np.abs(np.einsum("ek,fek->fe", q[a], q)), 0, 1)).max(axis=1)
        left = np.maximum.accumulate(np.where(np.arange(len(x)) > a, away + 0.1 * turn, 0.0)) > AWAY_M
        there = np.flatnonzero((away < SAME_M) & (turn < SAME_RAD) & left & (np.arange(len(x)) > a))
        same = [int(b) for b in there if b not in used]
        if same:
            best = min(same, key=lambda b: away[b] + 0.1 * turn[b])
            used |= {a, best}
            found.append((a, best))
    return found


def _at_frames(recording: Recording) -> Motion:
    points = recording.points
    _, first = np.unique(points.frame, return_index=True)
    return interpolate_motion(recording.motion, points.t_s[first])


def scan(study: Study, job: tuple[Fitted, int, int]) -> Scan:
    """Probe a recording with what the baseline leaves of it; the job: the baseline, which one, a seed."""
    base, k, seed = job
    one, residual = study.seen[k], base.residuals[k]
    rod = study.rod(k, base.values(k))
    made = one.model.setup(rod)
    arc = places(one.recording.rope.length_m)
    sides = [probe(made, name, s, arc[1] - arc[0]) for name in PROBES for s in arc]
    names = [u.name for u in base.unknowns if u.recording in (None, k)]
    seen = axes(one.model)
    columns = one.whitener(one.model.respond(rod, sides).by_parameter[:, seen])
    own = one.whitener(one.model.predict(rod, names).by_parameter[:, seen])
    windows = _windows(len(residual))
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(DRAWS, *residual.shape))
    gains, sizes = _gains(columns, own, np.concatenate([residual[None], noise]), windows)
    largest = gains.max(axis=(1, 2))
    threshold = float(np.quantile(largest[1:], LEVEL))
    most = float(largest[0])
    if most > threshold:
        unsure = left_by_meshes(one, rod, base.offsets_m[k])
        most = max(_beyond(gains[0, :, w], unsure[a:b].sum()) for w, (a, b) in enumerate(windows))
    # the largest of many are distributed as Gumbel says, beyond as many draws as there are, too
    p_value = float(stats.gumbel_r.sf(most, *stats.gumbel_r.fit(largest[1:])))
    by_frame = _by_frame(gains[0], windows, len(residual)).reshape(len(PROBES), PLACES, -1)
    strongest = _strongest(one, gains[0], sizes, windows, arc, threshold)
    frames = np.unique(one.recording.points.frame)
    return Scan(one.recording.name, frames, arc, by_frame, threshold, p_value, strongest)


def _beyond(gains: Floats, unsure: float) -> float:
    """The largest of the gains in χ² over what an error of that χ² may have added to it."""
    return max(float(np.sqrt(gains.max()) - np.sqrt(unsure)), 0.0) ** 2


def _windows(frames: int) -> list[tuple[int, int]]:
    """All frames, halves, quarters, eighths and sixteenths, each of them also shifted by half its length."""
    found = {(0, frames)}
    for parts in (2, 4, 8, 16):
        length = frames / parts
        if length < 2:
            break
        for start in np.arange(0, frames - length + 1e-9, length / 2):
            found.add((round(start), round(start + length)))
    return sorted(found)


def _gains(
    columns: Floats, own: Floats, residuals: Floats, windows: Sequence[tuple[int, int]]
) -> tuple[Floats, Floats]:
    """Gains in χ² (D, probes, windows) of every probe over every window, and the probes' sizes there.

    columns (F, C, A, probes), own (F, C, A, N) of the baseline's parameters, residuals (D, F, C, A).
    """
    frames, probes = columns.shape[0], columns.shape[-1]
    flat = columns.reshape(frames, -1, probes)
    basis = np.linalg.qr(own.reshape(-1, own.shape[-1]))[0].reshape(frames, flat.shape[1], -1)
    drawn = residuals.reshape(len(residuals), -1)
    # what the baseline's parameters take up is not there to be found
    drawn = drawn - (drawn @ basis.reshape(-1, basis.shape[-1])) @ basis.reshape(-1, basis.shape[-1]).T
    along = np.einsum("fip,dfi->dpf", flat, drawn.reshape(len(residuals), frames, -1), optimize=True)
    square = np.einsum("fip,fip->pf", flat, flat)
    shared = np.einsum("fip,fin->pfn", flat, basis, optimize=True)
    gains, sizes = [], []
    for a, b in windows:
        rest = square[:, a:b].sum(axis=1) - np.sum(shared[:, a:b].sum(axis=1) ** 2, axis=1)
        rest = np.where(rest > 1e-6 * square[:, a:b].sum(axis=1).max(), rest, np.inf)
        pull = along[:, :, a:b].sum(axis=2)
        gains.append(pull**2 / rest)
        sizes.append(-pull[0] / rest)
    return np.stack(gains, axis=2), np.stack(sizes, axis=1)


def _by_frame(gains: Floats, windows: Sequence[tuple[int, int]], frames: int) -> Floats:
    """For every probe and frame the largest gain of the windows around it, (probes, F)."""
    best = np.zeros((len(gains), frames))
    shortest = min(b - a for a, b in windows)
    for w, (a, b) in enumerate(windows):
        if b - a <= 2 * shortest + 1:
            best[:, a:b] = np.maximum(best[:, a:b], gains[:, w : w + 1])
    return best


def _strongest(
    one: Seen, gains: Floats, sizes: Floats, windows: Sequence[tuple[int, int]], arc: Floats, threshold: float
) -> tuple[Place, ...]:
    """The strongest probes above the threshold, no two on one stretch of rope and frames."""
    frames = np.unique(one.recording.points.frame)
    half = (arc[1] - arc[0]) / 2
    found: list[tuple[int, int]] = []
    chosen: list[Place] = []
    for index in np.argsort(-gains, axis=None):
        p, w = np.unravel_index(index, gains.shape)
        if gains[p, w] < threshold or len(chosen) == MOST_PLACES:
            break
        name, at = list(PROBES)[p // PLACES], int(p % PLACES)
        near = [abs(at - a) <= 1 and _overlap(windows[w], windows[v]) for a, v in found]
        if any(near):
            continue
        found.append((at, int(w)))
        first, last = windows[w]
        # rounding leaves the outermost a hair beyond the rope
        lo, hi = np.clip((arc[at] - half, arc[at] + half), 0.0, one.recording.rope.length_m)
        place = Place(
            one.recording.name,
            (float(lo), float(hi)),
            (int(frames[first]), int(frames[last - 1])),
            _phase(one.recording, first, last),
            float(gains[p, w]),
            name,
            (float(sizes[p, w]),),
            PROBES[name],
        )
        chosen.append(place)
    return tuple(chosen)


def _overlap(one: tuple[int, int], other: tuple[int, int]) -> bool:
    return max(one[0], other[0]) < min(one[1], other[1])


def _phase(recording: Recording, first: int, last: int) -> str:
    """What the ends do in these frames: "all", "rest", "turn", "out" or "back"."""
    motion = _at_frames(recording)
    frames = len(motion.t_s)
    if last - first > frames // 2:
        return "all"
    x = np.nan_to_num(np.hstack([motion.start_m, motion.end_m]))
    way = float(np.linalg.norm(np.diff(x[first:last], axis=0), axis=1).sum())
    turn = max(_turned(q[first:last]) for q in (motion.start_q, motion.end_q))
    if way < SAME_M:
        return "turn" if turn > SAME_RAD else "rest"
    gone = np.linalg.norm(x - x[0], axis=1)
    return "out" if gone[last - 1] > gone[first] else "back"


def _turned(q: Floats) -> float:
    """How far an end of these frames (T, 4) turns [rad]; one that is free does not."""
    if len(q) < 2 or np.isnan(q).any():
        return 0.0
    turns = Rotation.from_quat(q, scalar_first=True)
    return float((turns[:-1].inv() * turns[1:]).magnitude().sum())


__all__ = ["Reversal", "Scan", "reversal", "scan"]
