"""The door through which physics enters the rod: what an effect is, and what it may change.

An effect is a file of this folder and a line in its `__init__`: a name, parameters, and `apply`, which takes
the set-up of one rope and returns it changed. A law of bending instead has `respond`, which the step calls at
every joint, and `coefficients`, the two numbers that it needs there (see `plastic_bending` for one).

No effect writes derivatives by its parameters: the solver takes them from the step's residual, which is an
explicit function of the set-up, by central differences at fixed state (see `dlolib.sim.derivatives`).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from dlolib.sim.scene import STIFFNESS
from dlolib.types import Ends, Floats, Rope

NO_TURN = NO_SHIFT = (0.0, 0.0, 0.0)
# Parts of a set-up that are a recording's own, or move nothing.
UNMOVING = ("rope", "ends", "camera")
ENDS: tuple[Literal["start"], Literal["end"]] = ("start", "end")


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Args:
        name: as in `<effect>.<name>`.
        unit: SI; empty for a ratio.
        says: what it is, for a person.
        neutral: the value at which the effect is not there, to the last bit.
        low, high: bounds within which it may be set.
        scale: a change of it that counts as one.
        starts: where a fit begins, if it is to try several.
        along: "rope" or "motion" where it is a place or a time: `starts` are then shares of the rope's length
            or of the recording's duration, which bound it, too; "bend" where they are shares of the largest
            curvature that an elastic rope takes; "duration" where it is how long something takes, of which
            no shorter recording can tell.
        end: "start" or "end" where it belongs to how that end is held, so that a free one has none of it.
        difference: how far a derivative looks to either side, in units of the scale; less where the parameter
            moves a contact, whose force sets in within microns.
        fitted: a fit goes no further up, though more may be set.
    """

    name: str
    unit: str
    says: str
    neutral: float
    low: float
    high: float
    scale: float
    starts: tuple[float, ...]
    difference: float = 1e-4
    along: Literal["", "rope", "motion", "bend", "duration"] = ""
    end: Literal["", "start", "end"] = ""
    fitted: float = np.inf


class Effect(Protocol):
    """A module of this folder.

    It may have `NAMED`, values of parameters that hold where the effect is named without them; `FORMS`, the
    sets of parameters that occur together (`forms`); `SIZES`, those that say how large it is (`sizes`);
    `STIFFENS`: without it a rope comes out too stiff, so that fits begin at softer ones, too; `SIDED`: the
    rope is not alike all round, so that its roll matters; `OF_RECORDING`: it belongs to one recording, to how
    it was held and seen, and goes with no rope to another place; and `guess(touch)`, values from which
    a fit may begin where something seems to `Touch` the rope. A law may have `REMEMBERS`: what happened
    before the recording shows in it (`prior_history`); `IDEAL`: it has a form that no real rope has to the
    last digit; `ABRUPT`: it sets in past a threshold, and no linear step foretells what it would gain;
    `RELAXES`: which of its two coefficients is the time in which its moment fades at rest; `FORGETS`: it has
    no history, its moment is that of the curvature now; `ROUND`: it has a potential where all joints are as
    stiff about one axis as about the other; `suits(form, recordings)`, whether a fit of one of its `FORMS` to
    these recordings has a use.
    """

    @property
    def NAME(self) -> str: ...

    @property
    def SAYS(self) -> str: ...

    @property
    def PARAMETERS(self) -> tuple[Parameter, ...]: ...

    def apply(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        """The set-up with the effect in it; `values` has every parameter by name."""
        ...


class Law(Protocol):
    """A module of this folder whose effect is a moment in every joint.

    SYMMETRIC: whether the moment has a potential within a step, in whatever rope. The kernel's function
    `respond(now, before, past, rest, p, d, ei, dt, branch)` takes the curvature (2) of a joint, that of the
    step before, the law's history (2), the curvature at rest (2), the two coefficients, EI about both axes,
    the rope's uniform EI, the duration of the step, and which branch of the law to take (to yield or not to;
    -1: as it comes out). It returns the moment beside D (now - rest), the new history, the work of that
    moment since the step before, six 2 x 2 matrices (the moment's derivatives by now, before and past, and
    the history's), and the branch. A derivative stays on its branch: at rest on a yield surface, differences
    would mix two.
    """

    @property
    def NAME(self) -> str: ...

    @property
    def SAYS(self) -> str: ...

    @property
    def PARAMETERS(self) -> tuple[Parameter, ...]: ...
    @property
    def SYMMETRIC(self) -> bool: ...

    @property
    def respond(self) -> Callable[..., Any]: ...

    def coefficients(self, values: Mapping[str, float]) -> tuple[float, float]:
        """What the law needs at a joint; (0, 0) is no law."""
        ...


@dataclass(frozen=True)
class Touch:
    """A sphere that may have been in the rope's way, its centre (3,) and radius [m]."""

    center_m: Floats
    radius_m: float


@dataclass(frozen=True)
class Slip:
    """Rope that slips through the end's grasp: length · ½ (1 + tanh((t - time) / duration)) is gone.

    A duration of 0 or less is a step: so a difference to either side of 0 reverses no slip.
    """

    length_m: float = 0.0
    time_s: float = 0.0
    duration_s: float = 0.0

    def gone(self, t_s: Floats) -> Floats:
        """Length that has slipped out at the times t_s [m]."""
        since_s = t_s - self.time_s
        # at the time itself half is gone, as it is however short a slip lasts
        side = np.tanh(since_s / self.duration_s) if self.duration_s > 0.0 else np.sign(since_s)
        return np.asarray(self.length_m * 0.5 * (1.0 + side))


@dataclass(frozen=True)
class Camera:
    """What the camera makes of the true points: turned about the world's origin, then moved, along its axis
    and anywhere."""

    rotation: tuple[float, float, float] = NO_TURN
    depth_m: float = 0.0
    shift_m: tuple[float, float, float] = NO_SHIFT


def tip(ends: Ends) -> int:
    """The particle at which a rope's tip mass is: the last one, unless the start alone is free."""
    return 0 if ends.start == "free" and ends.end == "clamped" else -1


@dataclass(frozen=True)
class Setup:
    """One rope before it is moved: its discretisation, its surroundings, how it is held and seen.

    Args:
        rope: the rope as recorded.
        ends: which ends are held.
        gravity_m_s2: shape (3,).
        arc_m: arc length of the particles (n,) [m], as recorded (a `length_error` does not change it).
        joints, segments, particles, contacts, obstacles, grips: one rope's rows of `Scene`.
        weight: mass that gravity acts on, by particle (n,) [kg].
        symmetric, path_dependent: as in `Scene`.
        moving: whether inertia or drag act, so that time passes between the steps.
        relaxes_s: the time in which a law's moment fades at rest [s].
        turns: how the start's and the end's frames are turned away from the recorded ones, about their own
            first two axes [rad]; `rolls`: then about the third.
        delay_s: the camera sees at t what the robot logged at t - delay.
        slip: rope that slips through the end's grasp.
        camera: error of the camera's pose.
    """

    rope: Rope
    ends: Ends
    gravity_m_s2: Floats
    arc_m: Floats
    joints: Floats
    segments: Floats
    particles: Floats
    contacts: Floats
    obstacles: Floats
    grips: Floats
    weight: Floats
    symmetric: bool = True
    path_dependent: bool = False
    moving: bool = False
    relaxes_s: float = np.inf
    turns: tuple[tuple[float, float], tuple[float, float]] = ((0.0, 0.0), (0.0, 0.0))
    rolls: tuple[float, float] = (0.0, 0.0)
    delay_s: float = 0.0
    slip: Slip = field(default_factory=Slip)
    camera: Camera = field(default_factory=Camera)

    @cached_property
    def mechanics(self) -> tuple[Hashable, ...]:
        """All that tells set-ups of one recording apart but the camera: alike in it, they move alike, unless
        they begin where the camera showed them."""
        values = [getattr(self, part.name) for part in fields(self) if part.name not in UNMOVING]
        return tuple(value.tobytes() if isinstance(value, np.ndarray) else value for value in values)

    @property
    def length_m(self) -> float:
        """The free length [m], before any of it slips away."""
        return float(self.segments[:, 0].sum())

    @property
    def particles_m(self) -> Floats:
        """The length of rope that each particle stands for [m], (n,); that of a `length_error`, too."""
        return particle_lengths(self.length_m, len(self.arc_m))

    def joint_arc_m(self) -> tuple[Floats, Floats]:
        """Arc length where each joint's piece of the rope begins and ends [m], (n,) each."""
        middles = (self.arc_m[1:] + self.arc_m[:-1]) / 2
        return np.concatenate([self.arc_m[:1], middles]), np.concatenate([middles, self.arc_m[-1:]])

    @property
    def is_round(self) -> bool:
        """Whether every joint is as stiff about one axis as about the other."""
        first, second = self.joints[:, STIFFNESS : STIFFNESS + 2].T
        return np.array_equal(first, second)

    def with_joints(self, columns: slice | int, values: ArrayLike) -> Setup:
        """A copy with some columns of every joint set; of a slice (n, columns) or what spreads to it."""
        joints = self.joints.copy()
        joints[:, columns] = values
        return replace(self, joints=joints)

    def with_load(self, force_n: Floats) -> Setup:
        """A copy with a further load (n, 3) [N] on the particles."""
        particles = self.particles.copy()
        particles[:, 2:] += force_n
        return replace(self, particles=particles)


def particle_lengths(length_m: float, particles: int) -> Floats:
    """The length of rope that each particle stands for [m], shape (n,): half a segment at the ends."""
    share = np.full(particles, length_m / (particles - 1))
    share[[0, -1]] /= 2
    return share


def forms(effect: Effect | Law) -> tuple[tuple[str, ...], ...]:
    """The sets of an effect's parameters that occur together, the others neutral: by default all of them."""
    every = tuple(p.name for p in effect.PARAMETERS)
    return getattr(effect, "FORMS", (every,))


def sizes(effect: Effect | Law) -> tuple[str, ...]:
    """The parameters that say how large an effect is, not where, when or how: by default all of them."""
    return getattr(effect, "SIZES", tuple(p.name for p in effect.PARAMETERS))
