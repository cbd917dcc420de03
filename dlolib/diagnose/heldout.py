"""How well models foretell motion that none of them was fitted to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial.transform import Rotation

from dlolib.diagnose.fitting import Fitted, mesh_error
from dlolib.diagnose.residuals import tested
from dlolib.diagnose.study import Seen, Study
from dlolib.diagnose.whitening import MODES
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
        return float(change.sum()), _error_of_sum(change) if len(change) > 1 else None


def _error_of_sum(values: Floats) -> float:
    """Standard error of the sum of values (F,) that resemble their neighbours; no less than if they did not.

    Newey and West, Econometrica 55, 1987; as many neighbours as in Review of Economic Studies 61, 1994.
    """
    count, off = len(values), values - values.mean()
    most = min(int(4 * (count / 100) ** (2 / 9)), count - 1)
    alike = [(1 - lag / (most + 1)) * float(off[lag:] @ off[: count - lag]) for lag in range(most + 1)]
    return float(np.sqrt(max(2 * sum(alike) - alike[0], alike[0]) * count / (count - 1)))


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


@dataclass(frozen=True)
class BlackBox:
    """A residual that names nothing: what it leaves of the fitted frames and of the held-out ones.

    energy: of the slow modes of what it leaves of the fitted frames, over its expectation, less the
    baseline's parameters. parameters: the baseline's and its own effective ones, the trace of what takes data
    to fitted values (Hastie and Tibshirani, Generalized Additive Models, 1990).
    """

    fitted: Foretold
    heldout: Foretold
    energy: float
    parameters: float

    def bic(self, frames: int) -> float:
        """Schwarz's criterion, as that of a model that was fitted."""
        return float(self.fitted.chi2.sum() + self.parameters * np.log(frames))


def black_box(study: Study, job: tuple[Fitted, int]) -> BlackBox | None:
    """Kriging of what the baseline leaves, by arc length and the ends' pose.

    The job is the baseline and a seed. None: the held-out frames cannot be simulated.
    """
    try:
        return _black_box(study, job)
    except SimulationError:
        return None


def _black_box(study: Study, job: tuple[Fitted, int]) -> BlackBox:
    (base, seed), heldout = job, _heldout(study)
    lefts: tuple[list[Floats], list[Floats]] = ([], [])
    parameters = float(base.parameters)
    offsets = mesh_error(heldout, base.point)
    for k, one in enumerate(study.seen):
        values = base.values(k)
        inside = one.model.predict(study.rod(k, values)).xyz_m + base.offsets_m[k]
        off = inside - one.recording.points.xyz_m
        surrogate, own = _surrogate(_features(one), off, seed)
        parameters += own * one.observed_m.shape[1]
        lefts[0].append(off - surrogate(_features(one)))
        if k in study.ahead:
            place = list(study.ahead).index(k)
            out = heldout.seen[place]
            outside = out.model.predict(heldout.rod(place, values)).xyz_m + offsets[place]
            lefts[1].append(outside - out.recording.points.xyz_m - surrogate(_features(out)))
    pairs = zip(study.seen, lefts[0], strict=True)
    grids = [one.whitener(left[:, axes(one.model)]) for one, left in pairs]
    energy = tested(grids, base.noise, base.taken[MODES]).energy
    return BlackBox(_left(study, lefts[0]), _left(heldout, lefts[1]), energy, parameters)


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


def _surrogate(features: Floats, off: Floats, seed: int) -> tuple[RBFInterpolator, float]:
    """Gaussian kriging of `off` (P, 3) with the smoothing that foretells a quarter of its points best, and
    its effective parameters an axis."""
    rng = np.random.default_rng(seed)
    some = rng.permutation(len(features))[:LEARNT]
    cut = int(len(some) * (1 - CHECKED))

    def made(rows: np.ndarray, smoothing: float, data: Floats) -> RBFInterpolator:
        return RBFInterpolator(
            features[rows], data, kernel="gaussian", epsilon=2.0, smoothing=smoothing, degree=0
        )

    def missed(smoothing: float) -> float:
        told = made(some[:cut], smoothing, off[some[:cut]])(features[some[cut:]])
        return float(np.mean((told - off[some[cut:]]) ** 2))

    best = min(SMOOTHINGS, key=missed)
    fits = made(some, best, np.eye(len(some)))(features[some])
    return made(some, best, off[some]), float(np.trace(fits))


__all__ = ["BlackBox", "Foretold", "black_box", "foretell", "refuted"]
