"""Recordings of one object made ready for many models, and one model's fit to them."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from dlolib.diagnose.noise import Whitener
from dlolib.diagnose.nuisances import begins_unseen
from dlolib.errors import SimulationError
from dlolib.identify import particles_for
from dlolib.identify.parameters import ACTS_M, LOGARITHM_SCALE, Unknown
from dlolib.identify.problem import axes
from dlolib.sim.effects import EFFECTS, parameter
from dlolib.sim.effects.base import Hint, forms
from dlolib.sim.poses import Model, model_of
from dlolib.sim.rod import STIFFNESSES, Rod
from dlolib.types import Floats, Recording

# What a trial that cannot be simulated counts as, in deviations a point.
UNSOLVED = 1e3
# A dynamic roll-out of a quasi-static recording takes no more steps than this.
MOST_STEPS = 1000
# Softest and stiffest rope over its density: a hair, and a rod of steel as thick as an arm.
STIFFNESSES_M4_S2 = (1e-8, 1e6)
# A stiffness whose neutral value is infinite is not sought beyond this times its largest start.
AS_GOOD_AS_RIGID = 1e3
Bools = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
Values = Mapping[str, float]
Point = Mapping[Unknown, float]


@dataclass(frozen=True)
class DiagnoseSettings:
    """How to diagnose.

    Args:
        particles, longest_segment_m, time_step_s: of the rod, as in `IdentifySettings`.
        without: effects taken out of the library.
        chance: how unlikely the gain of an effect must be by chance, for a mismatch to be there or a further
            effect to be worth its place.
        tie: models whose BIC is within this of the best are as good.
        most_effects: no model has more.
        starts: from how many of its starting points a model is fitted in full.
        partners: how many effects are tried beside the best one.
        workers: processes.
        heldout_share: share of the frames, the last ones, held out where the recording does not say which.
        seed: of the bootstraps.
    """

    particles: int = 30
    longest_segment_m: float = 0.016
    time_step_s: float = 0.01
    without: tuple[str, ...] = ()
    chance: float = 5e-5
    tie: float = 6.0
    most_effects: int = 3
    starts: int = 2
    partners: int = 6
    workers: int = 2
    heldout_share: float = 0.25
    seed: int = 0


@dataclass(frozen=True)
class Seen:
    """One recording in a study: a model that predicts the points that count, and their whitening."""

    model: Model
    whitener: Whitener

    @cached_property
    def fine(self) -> Model:
        """The same on a mesh twice as fine."""
        return replace(self.model, particles=2 * (self.model.particles - 1) + 1)

    @property
    def recording(self) -> Recording:
        """As it counts: only the points that are fitted."""
        return self.model.recording

    @property
    def observed_m(self) -> Floats:
        """(P, A) [m]."""
        return np.asarray(self.recording.points.xyz_m[:, axes(self.model)])


def values_of(point: Point, k: int) -> dict[str, float]:
    """By name, for recording k: what it has for itself comes on top of what all share."""
    found: dict[str, float] = {}
    for unknown, value in point.items():
        if unknown.recording in (None, k):
            found[unknown.name] = found.get(unknown.name, 0.0) + value
    return found


@dataclass(frozen=True)
class Study:
    """Recordings of one object with their noise: what every model is fitted to.

    nuisances: what each recording has for itself, with the deviation expected of it (its prior). histories:
    likewise, in models with a law that remembers. stiffnesses: those that act; where the rope is not twisted
    GJ does not, and equals EI. ahead: the held-out frames of those recordings, by number, that have some.
    numbers: of the recordings, where not all are here.
    """

    seen: tuple[Seen, ...]
    nuisances: Mapping[Unknown, float] = field(default_factory=dict)
    histories: Mapping[Unknown, float] = field(default_factory=dict)
    stiffnesses: tuple[str, ...] = tuple(STIFFNESSES)
    ahead: Mapping[int, Seen] = field(default_factory=dict)
    numbers: tuple[int, ...] | None = None

    @property
    def heldout(self) -> Study | None:
        """The held-out frames as a study of their own."""
        if not self.ahead:
            return None
        return replace(self, seen=tuple(self.ahead.values()), ahead={}, numbers=tuple(self.ahead))

    def number(self, k: int) -> int:
        """The number by which parameters know the k-th recording here."""
        return k if self.numbers is None else self.numbers[k]

    @cached_property
    def frames(self) -> int:
        """Frames observed: the independent observations, since the points of one move together."""
        return sum(one.whitener.shape[0] for one in self.seen)

    def rod(self, k: int, values: Values) -> Rod:
        """The rod of recording k."""
        one = self.seen[k]
        both = {"torsional_stiffness": values["bending_stiffness"], **values}
        return Rod.of(one.recording.rope, both, one.model.particles)

    def bounds(self, unknown: Unknown) -> tuple[float, float]:
        """Of the fit's own coordinate: a place is on the rope, a time in the recording."""
        if unknown.stiffness:
            density = self.seen[0].recording.rope.linear_density_kg_m or 1.0
            return unknown.inward(STIFFNESSES_M4_S2[0] * density), unknown.inward(
                STIFFNESSES_M4_S2[1] * density
            )
        low, high = unknown.bounds
        known = parameter(unknown.name)
        rope, (begin, end) = self.seen[0].recording.rope, self.span_s
        if known.along == "motion":
            return begin, end
        if known.along == "rope" or (known.unit == "m" and np.isinf(high)):
            return low, unknown.inward(rope.length_m)
        if np.isinf(high):
            return low, unknown.inward(AS_GOOD_AS_RIGID * max(known.starts))
        return low, high

    @property
    def span_s(self) -> tuple[float, float]:
        """When the first frame was seen, and the last."""
        t = self.seen[0].recording.points.t_s
        return float(t.min()), float(t.max())

    def starts(self, name: str, form: Sequence[str], hints: Sequence[Hint]) -> list[dict[str, float]]:
        """Where fits of an effect may begin: every combination of its parameters' starts.

        An effect whose place no grid can cover begins where the rope is off (its `guess`).
        """
        effect = EFFECTS[name]
        places: list[dict[str, float]] = [{}]
        if hasattr(effect, "guess"):
            radius = self.seen[0].recording.rope.radius_m
            places = [guess for hint in hints for guess in effect.guess(hint, radius)]
        grids = {part: self._grid(f"{name}.{part}") for part in form if part not in places[0]}
        return [
            {
                f"{name}.{part}": value
                for part, value in {**place, **dict(zip(grids, values, strict=True))}.items()
            }
            for place in places
            for values in itertools.product(*grids.values())
        ]

    def middle(self, name: str) -> float:
        """A usual value of a parameter: the middle one of its starts."""
        starts = self._grid(name)
        return starts[len(starts) // 2]

    def _grid(self, name: str) -> list[float]:
        known = parameter(name)
        begin, end = self.span_s
        length = self.seen[0].recording.rope.length_m
        scale, shift = {"rope": (length, 0.0), "motion": (end - begin, begin), "": (1.0, 0.0)}[known.along]
        return [shift + scale * start for start in known.starts]


def seen_as(recording: Recording, used: Bools, whitener: Whitener, settings: DiagnoseSettings) -> Seen:
    """A recording with only some of its points (P,)."""
    points = recording.points
    covariance = None if points.covariance_m2 is None else points.covariance_m2[used]
    some = replace(
        points, frame=points.frame[used], t_s=points.t_s[used], s_m=points.s_m[used],
        xyz_m=points.xyz_m[used], covariance_m2=covariance,
    )  # fmt: skip
    length = recording.rope.length_m
    n = particles_for(length, settings)
    step_s = settings.time_step_s
    if recording.quasi_static:
        step_s = max(step_s, float(np.ptp(points.t_s)) / MOST_STEPS)
    return Seen(model_of(replace(recording, points=some), n, step_s), whitener)


@dataclass(frozen=True)
class Fitted:
    """A model at its best.

    effects: their names. unknowns: what was fitted, the nuisances too; theta and covariance in the fit's
    coordinates. chi2: of the whitened residuals, with the nuisances' priors. residuals: by recording, on its
    grid (F, columns, A). offsets_m: what a finer mesh adds to the points.
    """

    effects: tuple[str, ...]
    unknowns: tuple[Unknown, ...]
    theta: Floats
    chi2: float
    covariance: Floats
    residuals: tuple[Floats, ...]
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


@dataclass
class Hypothesis:
    """A model as least squares takes it: whitened residuals and Jacobian of its unknowns.

    Both come from one simulation; that of the last coordinates asked for is kept.
    """

    study: Study
    effects: tuple[str, ...]
    unknowns: tuple[Unknown, ...]
    offsets_m: tuple[Floats, ...]
    evaluations: int = 0
    _last: tuple[Floats, Floats, Floats] | None = field(default=None, repr=False)

    def at(self, theta: Floats) -> tuple[Floats, Floats]:
        """Residuals (R,) and Jacobian (R, N)."""
        if self._last is None or not np.array_equal(self._last[0], theta):
            self.evaluations += 1
            self._last = (theta.copy(), *self._simulated(theta))
        return self._last[1], self._last[2]

    def residuals(self, theta: Floats) -> Floats:
        """(R,); a trial that cannot be simulated is far off."""
        try:
            return self.at(theta)[0]
        except SimulationError:
            if self._last is None:
                raise
            return np.full_like(self._last[1], UNSOLVED)

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
        expected = {**self.study.nuisances, **self.study.histories}
        held = [n for n, u in enumerate(self.unknowns) if u in expected]
        weights = np.array([1 / expected[self.unknowns[n]] for n in held])
        rows = np.zeros((len(held), len(theta)))
        rows[np.arange(len(held)), held] = weights
        return weights * theta[held], rows


def acting_only(study: Study, ratios_m4_s2: Sequence[float]) -> Study:
    """The study without a torsional stiffness and nuisances that move no point, at the best of some EI over
    density."""
    density = study.seen[0].recording.rope.linear_density_kg_m or 1.0

    def off(ei: float) -> float:
        made = [
            one.model.predict(study.rod(k, {"bending_stiffness": ei})).xyz_m
            for k, one in enumerate(study.seen)
        ]
        seen = zip(study.seen, made, strict=True)
        return sum(float(np.sum((xyz[:, axes(one.model)] - one.observed_m) ** 2)) for one, xyz in seen)

    ei = min((ratio * density for ratio in ratios_m4_s2), key=off)
    twisted = False
    acting: dict[Unknown, float] = {}
    for k, one in enumerate(study.seen):
        own = {u.name: prior for u, prior in study.nuisances.items() if u.recording == k}
        rod = study.rod(k, {"bending_stiffness": ei})
        by = one.model.predict(rod, ["torsional_stiffness", *own]).by_parameter[:, axes(one.model)]
        moves = np.abs(by).max(axis=(0, 1)) * np.array([ei * LOGARITHM_SCALE, *own.values()])
        twisted |= bool(moves[0] > ACTS_M)
        acting |= {
            Unknown(name, k): own[name] for name, move in zip(own, moves[1:], strict=True) if move > ACTS_M
        }
    stiffnesses = tuple(STIFFNESSES) if twisted else ("bending_stiffness",)
    return replace(study, stiffnesses=stiffnesses, nuisances=acting)


def hypothesis(study: Study, terms: Mapping[str, Sequence[str]], offsets_m: Sequence[Floats]) -> Hypothesis:
    """The model with these effects, each with some of its parameters, over both stiffnesses."""
    names = [*study.stiffnesses, *(f"{effect}.{part}" for effect, parts in terms.items() for part in parts)]
    own = (*study.nuisances, *(study.histories if remembers(terms) else ()))
    return Hypothesis(study, tuple(terms), (*map(Unknown, names), *own), tuple(offsets_m))


def remembers(effects: Iterable[str]) -> bool:
    """Whether what happened before a recording shows in one of these laws."""
    return any(getattr(EFFECTS[name], "REMEMBERS", False) for name in effects)


def _point(unknowns: Sequence[Unknown], theta: Floats) -> dict[Unknown, float]:
    return {u: u.outward(float(t)) for u, t in zip(unknowns, theta, strict=True)}


def fit(model: Hypothesis, start: Floats, iterations: int = 30, tolerance: float = 1e-6) -> Fitted:
    """The least χ² near a start, within the parameters' bounds.

    Raises:
        SimulationError: the start itself cannot be simulated.
    """
    low, high = np.array([model.study.bounds(u) for u in model.unknowns]).T
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
    covariance = np.asarray(np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-14, hermitian=True), dtype=float)
    return Fitted(
        model.effects, model.unknowns, theta, float(residuals @ residuals), covariance, tuple(grids),
        model.offsets_m, model.evaluations,
    )  # fmt: skip


def promise(model: Hypothesis, theta: Floats) -> float:
    """The χ² that a linear step from theta would reach."""
    residuals, jacobian = model.at(theta)
    scaled = jacobian * np.array([u.scale for u in model.unknowns])
    step = np.linalg.lstsq(scaled, residuals, rcond=1e-8)[0]
    return float(np.sum((residuals - scaled @ step) ** 2))


def corrected(study: Study, point: Point) -> tuple[Floats, ...]:
    """What the continuous rod adds to each recording's points, (P, 3) [m]: Richardson's extrapolation.

    The mesh's error falls with its square, so that a mesh twice as fine shows three quarters of it.
    """
    offsets = []
    for k, one in enumerate(study.seen):
        rod = study.rod(k, values_of(point, study.number(k)))
        finely = one.fine.predict(rod.with_particles(one.fine.particles))
        offsets.append(4 / 3 * (finely.xyz_m - one.model.predict(rod).xyz_m))
    return tuple(offsets)


def library(
    study: Study, without: Sequence[str], beside: Sequence[str] = ()
) -> list[tuple[str, tuple[str, ...]]]:
    """Every effect that could act here, with each of its forms; `beside` others that act already."""
    contact = any(one.recording.obstacles for one in study.seen)
    unknown = any(begins_unseen(one.recording) for one in study.seen) and not study.histories
    found = []
    for name, effect in EFFECTS.items():
        if name in (*without, *beside) or (name == "contact_friction" and not contact):
            continue
        if name == "prior_history" and not (unknown and remembers(beside)):
            continue
        found += [(name, form) for form in forms(effect)]
    return found
