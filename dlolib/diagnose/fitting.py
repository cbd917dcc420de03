"""One model of the study, as least squares takes it, and its fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from dlolib.diagnose.modes import taken
from dlolib.diagnose.nuisances import swung
from dlolib.diagnose.study import Point, Seen, Study, remembers
from dlolib.diagnose.whitening import ModesOfNoise
from dlolib.errors import SimulationError
from dlolib.identify.parameters import Unknown
from dlolib.identify.problem import axes
from dlolib.sim import continuum
from dlolib.sim.rod import Rod
from dlolib.types import Floats

# What a trial that cannot be simulated counts as, in deviations a point.
UNSOLVED = 1e3
# A parameter whose scale moves no whitened point by more is silent; so many scales wake it.
SILENT, NUDGE = 1e-6, 10.0
# A combination of parameters, each over what it tells alone, that tells less than rounding errors.
LEAST_KNOWN = 1e-14


@dataclass(frozen=True)
class Fitted:
    """A model at its best.

    effects: their names. unknowns: what was fitted, the nuisances too; theta and covariance in the fit's
    coordinates. chi2: of the whitened residuals, with the nuisances' priors. residuals: by recording, on its
    grid (F, columns, A), which may have places where nothing was seen; noise: how noise alone would lie in
    them. coordinates: how many were seen. taken: by how many modes are slow, what of their degrees of freedom
    the fit took. offsets_m: what a finer mesh adds to the points.
    """

    effects: tuple[str, ...]
    unknowns: tuple[Unknown, ...]
    theta: Floats
    chi2: float
    covariance: Floats
    residuals: tuple[Floats, ...]
    noise: tuple[ModesOfNoise, ...]
    coordinates: int
    taken: Mapping[int, float]
    offsets_m: tuple[Floats, ...]
    evaluations: int

    @property
    def parameters(self) -> int:
        """How many were fitted for all recordings, nuisances left out."""
        return sum(u.recording is None for u in self.unknowns)

    @property
    def point(self) -> dict[Unknown, float]:
        """The value of each unknown."""
        return _point(self.unknowns, self.theta)

    def values(self, k: int) -> dict[str, float]:
        """By name, for recording k."""
        return values_of(self.point, k)

    def bic(self, frames: int) -> float:
        """Schwarz's criterion, with the frames as the observations."""
        return self.chi2 + self.parameters * float(np.log(frames))

    def by_chance(self, fewer: Fitted) -> float:
        """How likely chance gains as much over a model with fewer effects (Wilks' test)."""
        more = max(self.parameters - fewer.parameters, 1)
        return float(stats.chi2.sf(fewer.chi2 - self.chi2, more))


@dataclass
class Hypothesis:
    """A model as least squares takes it: whitened residuals and Jacobian of its unknowns.

    Both come from one simulation; that of the last coordinates asked for is kept. expected: what a recording
    has for itself, in the fit's coordinates, where that is not 0.
    """

    study: Study
    effects: tuple[str, ...]
    unknowns: tuple[Unknown, ...]
    offsets_m: tuple[Floats, ...]
    evaluations: int = 0
    expected: Mapping[Unknown, float] = field(default_factory=dict)
    _last: tuple[Floats, Floats, Floats] | None = field(default=None, repr=False)
    _acting: frozenset[str] | None = field(default=None, repr=False)

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest coordinates (N,) each."""
        low, high = np.array([self.study.bounds(u) for u in self.unknowns]).T
        return low, high

    def at(self, theta: Floats) -> tuple[Floats, Floats]:
        """Residuals (R,) and Jacobian (R, N)."""
        if self._last is None or not np.array_equal(self._last[0], theta):
            self.evaluations += 1
            self._last = (theta.copy(), *self._simulated(theta))
        return self._last[1], self._last[2]

    def residuals(self, theta: Floats) -> Floats:
        """(R,); a trial that cannot be simulated is far off, and one that an effect has no part in any more:
        no derivative leads back from an obstacle that the rope does not touch.
        """
        try:
            residuals, jacobian = self.at(theta)
        except SimulationError:
            if self._last is None:
                raise
            return np.full_like(self._last[1], UNSOLVED)
        acting = self._moving(jacobian)
        if self._acting is None:
            self._acting = acting
        return residuals if self._acting <= acting else np.full_like(residuals, UNSOLVED)

    def _moving(self, jacobian: Floats) -> frozenset[str]:
        """The effects that have a parameter which moves any point."""
        moves = np.abs(jacobian * [u.scale for u in self.unknowns]).max(axis=0) >= SILENT
        pairs = zip(self.unknowns, moves, strict=True)
        names = {u.name.partition(".")[0] for u, moved in pairs if moved and u.recording is None}
        return frozenset(names & set(self.effects))

    def jacobian(self, theta: Floats) -> Floats:
        """(R, N)."""
        return self.at(theta)[1]

    def _simulated(self, theta: Floats) -> tuple[Floats, Floats]:
        residuals, blocks = [], []
        point = _point(self.unknowns, theta)
        for k, one in enumerate(self.study.seen):
            mine = [n for n, u in enumerate(self.unknowns) if u.recording in (None, k)]
            names = [self.unknowns[n].name for n in mine]
            predicted = one.model.predict(self.study.rod(k, values_of(point, k)), names)
            seen = axes(one.model)
            left = (predicted.xyz_m + self.offsets_m[k])[:, seen] - one.observed_m
            both = one.whitener(np.concatenate([left[:, :, None], predicted.by_parameter[:, seen]], axis=2))
            both = both.reshape(-1, 1 + len(mine))
            block = np.zeros((len(both), len(self.unknowns)))
            block[:, mine] = both[:, 1:]
            residuals.append(both[:, 0])
            blocks.append(block)
        chain = [
            u.outward(float(t)) if u.logarithmic else 1.0 for u, t in zip(self.unknowns, theta, strict=True)
        ]
        jacobian = np.concatenate(blocks) * np.array(chain)
        prior, by_prior = self._priors(theta)
        return np.concatenate([*residuals, prior]), np.concatenate([jacobian, by_prior])

    def _priors(self, theta: Floats) -> tuple[Floats, Floats]:
        deviations = {**self.study.nuisances, **self.study.histories}
        held = [n for n, u in enumerate(self.unknowns) if u in deviations]
        rows = np.zeros((len(held), len(theta)))
        for row, n in enumerate(held):
            unknown = self.unknowns[n]
            arms = swung(unknown, self.study.pivot_m(unknown.recording))
            for u, arm in {unknown: 1.0, **arms}.items():
                if u in self.unknowns:
                    rows[row, self.unknowns.index(u)] = arm / deviations[unknown]
        means = np.array([self.expected.get(u, 0.0) if u in deviations else 0.0 for u in self.unknowns])
        return rows @ (theta - means), rows


def values_of(point: Point, k: int) -> dict[str, float]:
    """By name, for recording k: what it has for itself comes on top of what all share."""
    found: dict[str, float] = {}
    for unknown, value in point.items():
        if unknown.recording in (None, k):
            found[unknown.name] = found.get(unknown.name, 0.0) + value
    return found


def hypothesis(study: Study, terms: Mapping[str, Sequence[str]], offsets_m: Sequence[Floats]) -> Hypothesis:
    """The model with these effects, each with some of its parameters, over both stiffnesses and the roll."""
    names = [*study.stiffnesses, *study.rolls]
    names += [f"{effect}.{part}" for effect, parts in terms.items() for part in parts]
    own = (*study.nuisances, *(study.histories if remembers(terms) else ()))
    return Hypothesis(study, tuple(terms), (*map(Unknown, names), *own), tuple(offsets_m))


def _point(unknowns: Sequence[Unknown], theta: Floats) -> dict[Unknown, float]:
    return {u: u.outward(float(t)) for u, t in zip(unknowns, theta, strict=True)}


def fit(model: Hypothesis, start: Floats, iterations: int = 30, tolerance: float = 1e-6) -> Fitted:
    """The least χ² near a start, within the parameters' bounds.

    Raises:
        SimulationError: the start itself cannot be simulated.
    """
    low, high = model.bounds
    found = least_squares(
        model.residuals, np.clip(start, low, high), model.jacobian, bounds=(low, high),
        x_scale=np.array([u.scale for u in model.unknowns]), max_nfev=iterations,
        ftol=tolerance, xtol=tolerance, gtol=1e-12,
    )  # fmt: skip
    return fitted(model, found.x)


def fitted(model: Hypothesis, theta: Floats) -> Fitted:
    """The model as it stands at theta."""
    residuals, jacobian = model.at(theta)
    grids, first = [], 0
    for one in model.study.seen:
        shape = (*one.whitener.shape, one.observed_m.shape[1])
        grids.append(residuals[first : first + int(np.prod(shape))].reshape(shape))
        first += int(np.prod(shape))
    covariance = covariance_of(jacobian)
    return Fitted(
        model.effects, model.unknowns, theta, float(residuals @ residuals), covariance, tuple(grids),
        tuple(one.whitener.noise_modes for one in model.study.seen),
        sum(one.observed_m.size for one in model.study.seen),
        taken(jacobian, covariance, [grid.shape for grid in grids]), model.offsets_m, model.evaluations,
    )  # fmt: skip


def covariance_of(jacobian: Floats) -> Floats:
    """Of the N parameters, (N, N), from the whitened residuals' derivatives (R, N).

    What moves nothing is not known at all, and a combination that moves nothing all but not.
    """
    sizes = np.linalg.norm(jacobian, axis=0)
    tell = sizes > 0.0
    some = jacobian[:, tell] / sizes[tell]
    values, vectors = np.linalg.eigh(some.T @ some)
    found = np.diag(np.where(tell, 0.0, np.inf))
    known = vectors / np.maximum(values, LEAST_KNOWN) @ vectors.T
    found[np.ix_(tell, tell)] = known / np.outer(sizes[tell], sizes[tell])
    return found


def promise(model: Hypothesis, theta: Floats) -> float:
    """The χ² that a linear step from theta would reach."""
    residuals, jacobian = model.at(theta)
    scaled = jacobian * np.array([u.scale for u in model.unknowns])
    step = np.linalg.lstsq(scaled, residuals, rcond=1e-8)[0]
    return float(np.sum((residuals - scaled @ step) ** 2))


def awake(model: Hypothesis, theta: Floats) -> Floats | None:
    """A start at which the sizes of effects that move nothing at theta do, or None where all do.

    A rope in a plane that is seen in that plane has no derivative by what bends it out of it.
    """
    jacobian = model.at(theta)[1]
    scales = np.array([u.scale for u in model.unknowns])
    shared = np.array([u.recording is None and u.size for u in model.unknowns])
    silent = shared & (np.abs(jacobian * scales).max(axis=0) < SILENT)
    low, high = model.bounds
    return np.clip(np.where(silent, theta + NUDGE * scales, theta), low, high) if silent.any() else None


def mesh_error(study: Study, point: Point, known_m: Sequence[Floats] | None = None) -> tuple[Floats, ...]:
    """What the continuous rod adds to each recording's points, (P, 3) [m].

    Where the finer rope rests elsewhere, or has no equilibrium at all, it tells nothing: what is known stays.
    """
    found = []
    for k, one in enumerate(study.seen):
        otherwise = np.zeros_like(one.recording.points.xyz_m) if known_m is None else known_m[k]
        new = _extrapolated(one, study.rod(k, values_of(point, study.number(k))))
        found.append(otherwise if new is None else new)
    return tuple(found)


def _extrapolated(one: Seen, rod: Rod) -> Floats | None:
    try:
        return continuum.known_mesh_error(one.model, one.fine, rod)
    except SimulationError:
        return None
