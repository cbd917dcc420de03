"""Recordings of one object made ready for many models."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dlolib.diagnose.nuisances import FARTHEST, begins_unseen, bounded, held, swung
from dlolib.diagnose.whitening import Whitener
from dlolib.errors import ParameterError, SimulationError
from dlolib.identify.intervals import FEWEST_POSES, poses
from dlolib.identify.parameters import ACTS_M, LOGARITHM_SCALE, UNBENT, Unknown, within
from dlolib.identify.problem import axes
from dlolib.sim.begun import STANDARD_GRAVITY_M_S2
from dlolib.sim.continuum import refined
from dlolib.sim.effects import EFFECTS, parameter
from dlolib.sim.effects.base import Touch, forms, sizes
from dlolib.sim.mesh import Mesh
from dlolib.sim.moments import moments
from dlolib.sim.poses import Model, model_of, near
from dlolib.sim.recording import RecordingModel, first_points
from dlolib.sim.rod import STIFFNESSES, Rod
from dlolib.sim.steps import dynamic_step
from dlolib.sim.upright import ROLL, ROLLS
from dlolib.types import Floats, Recording

# A dynamic roll-out of a quasi-static recording takes no more steps than this.
MOST_STEPS = 1000
# EI / L² over the weight of ropes that it bends.
BENT_BY_WEIGHT = (0.1, 0.01)
# GJ over EI of a rope that is neither limp in twist nor rigid; a solid round one has 0.67 to 1.
USUAL_TWIST = (0.1, 10.0)
# A stiffness whose neutral value is infinite is not sought beyond this times its largest start.
AS_GOOD_AS_RIGID = 1e3
# What one pose can tell of, at most.
MOST_OF_ONE_POSE = 6
Bools = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
Values = Mapping[str, float]
Point = Mapping[Unknown, float]


@dataclass(frozen=True)
class DiagnoseSettings(Mesh):
    """How to diagnose, on which mesh.

    Args:
        without: effects taken out of the library.
        chance: how unlikely the gain of an effect must be by chance, for a mismatch to be there or a further
            effect to be worth its place.
        tie: models whose BIC is within this of the best are as good.
        most_effects: no model has more.
        starts: from how many of its starting points a model is fitted in full.
        partners: how many effects are tried beside the best one.
        full: every pair is fitted, and not only those that promise something.
        workers: processes.
        heldout_share: share of the frames, the last ones, held out where the recording does not say which.
        most_frames: of a recording with more only every second, third or later one is looked at.
        seed: of the bootstraps.
    """

    without: tuple[str, ...] = ()
    chance: float = 5e-5
    tie: float = 6.0
    most_effects: int = 4
    starts: int = 2
    partners: int = 6
    full: bool = False
    workers: int = 2
    heldout_share: float = 0.25
    most_frames: int = 200
    seed: int = 0


@dataclass(frozen=True)
class Seen:
    """One recording in a study: a model that predicts the points that count, and their whitening."""

    model: Model
    whitener: Whitener

    @cached_property
    def fine(self) -> Model:
        """The same on a mesh twice as fine."""
        return refined(self.model, 2)

    @property
    def recording(self) -> Recording:
        """As it counts: only the points that are fitted."""
        return self.model.recording

    @property
    def observed_m(self) -> Floats:
        """(P, A) [m]."""
        return np.asarray(self.recording.points.xyz_m[:, axes(self.model)])


@dataclass(frozen=True)
class Study:
    """Recordings of one object with their noise: what every model is fitted to.

    nuisances: what each recording has for itself, with the deviation expected of it (its prior). histories:
    likewise, in models with a law that remembers. stiffnesses: those that act; where the rope is not twisted
    GJ does not, and equals EI. rolls: how one end is rolled against the other, where no recording says that.
    ahead: the held-out frames of those recordings, by number, that have some. numbers: of the recordings,
    where not all are here. most_bent_1_m: the elastic rope's largest curvature.
    """

    seen: tuple[Seen, ...]
    nuisances: Mapping[Unknown, float] = field(default_factory=dict)
    histories: Mapping[Unknown, float] = field(default_factory=dict)
    stiffnesses: tuple[str, ...] = tuple(STIFFNESSES)
    rolls: tuple[str, ...] = ()
    ahead: Mapping[int, Seen] = field(default_factory=dict)
    numbers: tuple[int, ...] | None = None
    most_bent_1_m: float = 10.0

    @property
    def heldout(self) -> Study | None:
        """The held-out frames as a study of their own."""
        if not self.ahead:
            return None
        return replace(self, seen=tuple(self.ahead.values()), ahead={}, numbers=tuple(self.ahead))

    def number(self, k: int) -> int:
        """The number by which parameters know the k-th recording here."""
        return k if self.numbers is None else self.numbers[k]

    def pivot_m(self, recording: int | None) -> Floats:
        """The middle (3,) [m] of what was seen of the rope in the recording of this number."""
        numbers = self.numbers or tuple(range(len(self.seen)))
        k = numbers.index(recording) if recording in numbers else 0
        return np.asarray(self.seen[k].recording.points.xyz_m.mean(axis=0))

    @cached_property
    def frames(self) -> int:
        """Frames observed: the independent observations, since the points of one move together."""
        return sum(one.whitener.shape[0] for one in self.seen)

    def rod(self, k: int, values: Values) -> Rod:
        """The rod of recording k.

        Raises:
            SimulationError: a value that it has for itself takes it, with what all share, out of bounds.
        """
        one = self.seen[k]
        both = {"torsional_stiffness": values["bending_stiffness"], **values}
        try:
            return Rod.of(one.recording.rope, both, one.model.particles)
        except ParameterError as error:
            raise SimulationError(error.problem, mend=error.mend) from error

    def bounds(self, unknown: Unknown) -> tuple[float, float]:
        """Of the fit's own coordinate: a place is on the rope, a time in the recording, and nothing takes
        longer than that lasts: what hardly fades in it would stand for what does not fade."""
        if unknown.stiffness:
            return within(self.seen[0].recording.rope.linear_density_kg_m)
        low, high = unknown.bounds
        expected = {**self.nuisances, **self.histories}.get(unknown)
        if expected is not None and bounded(unknown.name):
            turns = swung(unknown, self.pivot_m(unknown.recording))
            most = expected + sum(abs(arm) * self.nuisances.get(turn, 0.0) for turn, arm in turns.items())
            return -FARTHEST * most, FARTHEST * most
        known = parameter(unknown.name)
        rope, spans_s = self.seen[0].recording.rope, self.spans_s
        if known.along == "motion":
            return spans_s[0][0], spans_s[-1][1]
        if known.along == "duration":
            return low, unknown.inward(max(self.longest_s, min(known.starts)))
        if known.along == "rope" or (known.unit == "m" and np.isinf(high)):
            return low, unknown.inward(rope.length_m)
        if np.isinf(high):
            return low, unknown.inward(AS_GOOD_AS_RIGID * max(known.starts))
        return low, high

    @property
    def spans_s(self) -> list[tuple[float, float]]:
        """When recordings were seen, first and last frames, in order; those that overlap are one."""
        times = [one.recording.points.t_s for one in self.seen]
        found: list[tuple[float, float]] = []
        for first, last in sorted((float(t.min()), float(t.max())) for t in times):
            if found and first <= found[-1][1]:
                first, last = found[-1][0], max(found.pop()[1], last)
            found.append((first, last))
        return found

    def parts(self, k: int) -> list[Seen]:
        """Recording k as it is fitted, and its held-out frames where it has some."""
        return [self.seen[k], *([self.ahead[k]] if k in self.ahead else [])]

    def begins_unseen(self, k: int) -> bool:
        """Whether what came before recording k is not known; its first frames may be held out."""
        return any(begins_unseen(one.recording) for one in self.parts(k))

    @property
    def poses(self) -> int:
        """How many poses of the ends all recordings together show, as far as that matters."""
        return sum(poses(one.recording, one.recording.points.t_s) for one in self.seen)

    @property
    def longest_s(self) -> float:
        """How long the longest recording lasts."""
        return max(float(np.ptp(one.recording.points.t_s)) for one in self.seen)

    def starts(self, name: str, form: Sequence[str], touches: Sequence[Touch]) -> list[dict[str, float]]:
        """Where fits of an effect may begin: every combination of its parameters' starts, also with its sizes
        neutral, where a linear step tells what a little of it would gain.

        An effect whose place no grid can cover begins where something seems to touch the rope (its `guess`).
        """
        effect = EFFECTS[name]
        places: list[dict[str, float]] = [{}]
        if hasattr(effect, "guess"):
            places = [effect.guess(touch) for touch in touches]
            if not places:
                return []
        grids = {part: self._grid(f"{name}.{part}") for part in form if part not in places[0]}
        neutral = {part: parameter(f"{name}.{part}").neutral for part in grids if part in sizes(effect)}
        absent = {part: [value] for part, value in neutral.items() if np.isfinite(value)}
        found = [
            {
                f"{name}.{part}": value
                for part, value in {**place, **dict(zip(grid, values, strict=True))}.items()
            }
            for place in places
            for grid in (grids, {**grids, **absent})
            for values in itertools.product(*grid.values())
        ]
        return [start for k, start in enumerate(found) if start not in found[:k]]

    def rigid(self, point: Point) -> bool:
        """Whether the rope is too stiff there for its weight to bend it; then nothing tells how stiff."""
        return point[Unknown("bending_stiffness")] > self._weight / UNBENT

    def beginnings(self, point: Point, effect: str) -> list[dict[Unknown, float]]:
        """Stiffnesses in the place of a point's, where a fit with one more effect may begin: its own first,
        but for a GJ that ran off, in whose place are the nearest usual one and EI; then softer ones where the
        point is rigid or stiff for want of that effect.

        What a model lacks may leave it limp in twist. A limp rope coils up or snaps under the least of what
        would explain it, so that no fit begun there would find it.
        """
        stiff = self.rigid(point) or stiffens(effect)
        eis = [share * self._weight for share in BENT_BY_WEIGHT if stiff]
        eis = [ei for ei in eis if ei < point[Unknown("bending_stiffness")]]
        found = [*self.usual(point), *({Unknown(name): ei for name in self.stiffnesses} for ei in eis)]
        if not self.rolls or not has_sides(effect):
            return found
        roll = Unknown(ROLL)
        turned = [float(np.angle(np.exp(1j * (point[roll] + turn)))) for turn in ROLLS]
        return [{**one, roll: angle} for one in found for angle in turned]

    def usual(self, point: Point) -> list[dict[Unknown, float]]:
        """The GJ to begin with where a point's ran off."""
        ei, gj = Unknown("bending_stiffness"), Unknown("torsional_stiffness")
        if gj not in point:
            return [{}]
        low, high = (ratio * point[ei] for ratio in USUAL_TWIST)
        if low <= point[gj] <= high:
            return [{}]
        return [{gj: float(np.clip(point[gj], low, high))}, {gj: point[ei]}]

    @property
    def _weight(self) -> float:
        """The rope's, as the EI [N m²] of a rope that bends as much under itself as it is long."""
        rope = self.seen[0].recording.rope
        return STANDARD_GRAVITY_M_S2 * (rope.linear_density_kg_m or 1.0) * rope.length_m**3

    def middle(self, name: str) -> float:
        """A usual value of a parameter: the middle one of its starts."""
        starts = self._grid(name)
        return starts[len(starts) // 2]

    def _grid(self, name: str) -> list[float]:
        known = parameter(name)
        if known.along == "motion":
            return [begin + (end - begin) * start for begin, end in self.spans_s for start in known.starts]
        scales = {"rope": self.seen[0].recording.rope.length_m, "bend": self.most_bent_1_m}
        return [scales.get(known.along, 1.0) * start for start in known.starts]


def seen_as(recording: Recording, used: Bools, whitener: Whitener, settings: DiagnoseSettings) -> Seen:
    """A recording with only some of its points (P,)."""
    points = recording.points
    covariance = None if points.covariance_m2 is None else points.covariance_m2[used]
    some = replace(
        points, frame=points.frame[used], t_s=points.t_s[used], s_m=points.s_m[used],
        xyz_m=points.xyz_m[used], covariance_m2=covariance,
    )  # fmt: skip
    length = recording.rope.length_m
    n = settings.particles_for(length)
    step_s = dynamic_step(recording.motion, settings.time_step_s)
    if recording.quasi_static:
        step_s = max(step_s, float(np.ptp(points.t_s)) / MOST_STEPS)
    # what is simulated the whole recording decides: whether poses settled each by itself, where it began
    model = model_of(recording, n, step_s)
    if isinstance(model, RecordingModel):
        model = replace(model, first=first_points(recording))
    return Seen(replace(model, recording=replace(model.recording, points=some)), whitener)


def acting_only(study: Study, ratios_m4_s2: Sequence[float]) -> Study:
    """The study without a torsional stiffness and nuisances that move no point, at the best of some EI over
    density; that rod's shapes are where those of others are sought from."""
    density = study.seen[0].recording.rope.linear_density_kg_m or 1.0

    def off(ei: float) -> float:
        """The distance squared [m²] that it leaves; a rope so soft or stiff may tear on this way."""
        try:
            made = [
                one.model.predict(study.rod(k, {"bending_stiffness": ei})).xyz_m
                for k, one in enumerate(study.seen)
            ]
        except SimulationError:
            return np.inf
        seen = zip(study.seen, made, strict=True)
        return sum(float(np.sum((xyz[:, axes(one.model)] - one.observed_m) ** 2)) for one, xyz in seen)

    ei = min((ratio * density for ratio in ratios_m4_s2), key=off)
    # where none can be simulated, the first of them says why here
    twisted = bool(study.rolls)
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
    rods = [study.rod(k, {"bending_stiffness": ei}) for k in range(len(study.seen))]
    most = max(bent(one.model, rod) for one, rod in zip(study.seen, rods, strict=True))
    seen = tuple(replace(one, model=near(one.model, rod)) for one, rod in zip(study.seen, rods, strict=True))
    ahead = {k: replace(one, model=near(one.model, rods[k])) for k, one in study.ahead.items()}
    return replace(
        study, seen=seen, ahead=ahead, stiffnesses=stiffnesses, nuisances=acting, most_bent_1_m=most
    )


def bent(model: Model, rod: Rod) -> float:
    """The largest curvature that the rod takes in a recording, but for its ends [1/m]."""
    return float(np.linalg.norm(moments(model.roll_out(rod))[0][:, :, 1:-1, :2], axis=-1).max())


def remembers(effects: Iterable[str]) -> bool:
    """Whether what happened before a recording shows in one of these laws."""
    return any(getattr(EFFECTS[name], "REMEMBERS", False) for name in effects)


def ideal(effect: str) -> bool:
    """Whether it is a law of a form that no real rope has to the last digit."""
    return getattr(EFFECTS[effect], "IDEAL", False)


def abrupt(effect: str) -> bool:
    """Whether it sets in past a threshold."""
    return getattr(EFFECTS[effect], "ABRUPT", False)


def stiffens(effect: str) -> bool:
    """Whether a rope comes out too stiff without it."""
    return getattr(EFFECTS[effect], "STIFFENS", False)


def placed(effect: str) -> bool:
    """Whether it has a place in space, which no grid can cover."""
    return hasattr(EFFECTS[effect], "guess")


def has_sides(effect: str) -> bool:
    """Whether a rope with it is not alike all round: how it is rolled matters then."""
    return getattr(EFFECTS[effect], "SIDED", False)


def library(
    study: Study, without: Sequence[str], beside: Sequence[str] = ()
) -> list[tuple[str, tuple[str, ...]]]:
    """Every effect that could act here, with each of its forms; `beside` others that act already.

    One pose cannot tell a form with many parameters from any other cause: an uneven set fits every shape.
    """
    still = study.poses < FEWEST_POSES
    contact = any(one.recording.obstacles for one in study.seen)
    unknown = any(study.begins_unseen(k) for k in range(len(study.seen))) and not study.histories
    found = []
    for name in EFFECTS:
        if name in (*without, *beside) or (name == "contact_friction" and not contact):
            continue
        if name == "end_twist" and study.rolls:
            continue
        if name == "prior_history" and not (unknown and remembers(beside)):
            continue
        found += [
            (name, form) for form in forms_of(study, name) if len(form) <= MOST_OF_ONE_POSE or not still
        ]
    return found


def forms_of(study: Study, effect: str) -> list[tuple[str, ...]]:
    """The forms of an effect that have a use for these recordings."""
    suits = getattr(EFFECTS[effect], "suits", lambda form, recordings: True)
    recordings = [one.recording for one in study.seen]
    return [
        form
        for form in forms(EFFECTS[effect])
        if held_somewhere(study, effect, form) and suits(form, recordings)
    ]


def held_somewhere(study: Study, effect: str, form: Sequence[str]) -> bool:
    """Whether every part of an effect belongs to no end, or to one that is held in some recording."""
    return all(any(held(one.recording, f"{effect}.{part}") for one in study.seen) for part in form)
