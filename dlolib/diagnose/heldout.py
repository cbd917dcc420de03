"""How well models foretell motion that none of them was fitted to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial.transform import Rotation

from dlolib.diagnose.fitting import Fitted, mesh_error
from dlolib.diagnose.study import Seen, Study
from dlolib.errors import SimulationError
from dlolib.formats import interpolate_motion
from dlolib.identify.problem import axes
from dlolib.types import Floats

# Points that the black box learns from; its smoothing is chosen on the last of them.
LEARNT, CHECKED = 900, 0.25
SMOOTHINGS = (1e-2, 1e-1, 1.0, 10.0)
# A model is refuted that foretells the held-out frames worse than the elastic rod by so many standard errors.
WORSE = 3.0


@dataclass(frozen=True)
class Foretold:
    """What is left of the held-out frames: χ² by frame of each recording, and distances (P,) [m]."""

    chi2: Floats
    distances_m: Floats

    @property
    def rmse_m(self) -> float:
        """Root mean square distance."""
        return float(np.sqrt(np.mean(self.distances_m**2)))

    def against(self, other: Foretold) -> tuple[float, float | None]:
        """Change in χ² against another model, and its standard error over the frames; one tells of none."""
        change = self.chi2 - other.chi2
        error = float(np.sqrt(len(change)) * change.std(ddof=1)) if len(change) > 1 else None
        return float(change.sum()), error


def foretell(study: Study, model: Fitted) -> Foretold | None:
    """What a fit leaves of the held-out frames of the same recordings; None: they cannot be simulated."""
    try:
        return _foretold(study, model)
    except SimulationError:
        return None


def refuted(foretold: Mapping[tuple[str, ...], Foretold]) -> set[tuple[str, ...]]:
    """The effects of models that foretell worse than the elastic rod (no effects): they fit what they saw."""
    elastic = foretold.get(())
    changes = {} if elastic is None else {effects: one.against(elastic) for effects, one in foretold.items()}
    known = {effects: (change, error) for effects, (change, error) in changes.items() if error is not None}
    return {effects for effects, (change, error) in known.items() if effects and change > WORSE * error}


def _foretold(study: Study, model: Fitted) -> Foretold:
    heldout = _heldout(study)
    offsets = mesh_error(heldout, model.point)
    lefts = []
    for k, one in enumerate(heldout.seen):
        rod = heldout.rod(k, model.values(heldout.number(k)))
        lefts.append(one.model.predict(rod).xyz_m + offsets[k] - one.recording.points.xyz_m)
    return _left(heldout, lefts)


def _heldout(study: Study) -> Study:
    assert study.heldout is not None, "nothing was held out"
    return study.heldout


def _left(study: Study, lefts: list[Floats]) -> Foretold:
    chi2, distances = [], []
    for one, left in zip(study.seen, lefts, strict=True):
        seen = left[:, axes(one.model)]
        chi2.append(np.sum(one.whitener(seen) ** 2, axis=(1, 2)))
        distances.append(np.linalg.norm(seen, axis=1))
    return Foretold(np.concatenate(chi2), np.concatenate(distances))


def black_box(study: Study, job: tuple[Fitted, int]) -> tuple[Foretold, Foretold] | None:
    """A residual that names nothing: kriging of what the baseline leaves, by arc length and the ends' pose.

    The job is the baseline and a seed. Returns what is left of the fitted frames and of the held-out ones;
    None: these cannot be simulated.
    """
    try:
        return _black_box(study, job)
    except SimulationError:
        return None


def _black_box(study: Study, job: tuple[Fitted, int]) -> tuple[Foretold, Foretold]:
    (base, seed), heldout = job, _heldout(study)
    lefts: tuple[list[Floats], list[Floats]] = ([], [])
    offsets = mesh_error(heldout, base.point)
    for k, one in enumerate(study.seen):
        values = base.values(k)
        inside = one.model.predict(study.rod(k, values)).xyz_m + base.offsets_m[k]
        off = inside - one.recording.points.xyz_m
        surrogate = _surrogate(_features(one), off, seed)
        lefts[0].append(off - surrogate(_features(one)))
        if k in study.ahead:
            place = list(study.ahead).index(k)
            out = heldout.seen[place]
            outside = out.model.predict(heldout.rod(place, values)).xyz_m + offsets[place]
            lefts[1].append(outside - out.recording.points.xyz_m - surrogate(_features(out)))
    return _left(study, lefts[0]), _left(heldout, lefts[1])


def _features(one: Seen) -> Floats:
    """Arc length and the pose of both ends, each over its own size (P, 1 + 12)."""
    points, rope = one.recording.points, one.recording.rope
    motion = interpolate_motion(one.recording.motion, points.t_s)
    columns = [points.s_m[:, None] / rope.length_m]
    for x, q in ((motion.start_m, motion.start_q), (motion.end_m, motion.end_q)):
        free = np.isnan(q).any(axis=1, keepdims=True)
        turn = np.where(free, [[1.0, 0.0, 0.0, 0.0]], q)
        columns += [np.nan_to_num(x) / rope.length_m, Rotation.from_quat(turn, scalar_first=True).as_rotvec()]
    return np.hstack(columns)


def _surrogate(features: Floats, off: Floats, seed: int) -> RBFInterpolator:
    """Gaussian kriging of `off` (P, 3) with the smoothing that foretells a quarter of its points best."""
    rng = np.random.default_rng(seed)
    some = rng.permutation(len(features))[:LEARNT]
    cut = int(len(some) * (1 - CHECKED))

    def made(rows: np.ndarray, smoothing: float) -> RBFInterpolator:
        return RBFInterpolator(
            features[rows], off[rows], kernel="gaussian", epsilon=2.0, smoothing=smoothing, degree=0
        )

    def missed(smoothing: float) -> float:
        told = made(some[:cut], smoothing)(features[some[cut:]])
        return float(np.mean((told - off[some[cut:]]) ** 2))

    return made(some, min(SMOOTHINGS, key=missed))


__all__ = ["Foretold", "black_box", "foretell", "refuted"]
