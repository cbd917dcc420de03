"""Roll-outs of the direct solver: states, ways, clocks; and the equilibrium that a damped motion finds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dlolib.errors import SimulationError
from dlolib.sim import direct
from dlolib.sim.band import HALF
from dlolib.sim.inertia import VELOCITY, of_positions
from dlolib.sim.joints import HISTORY
from dlolib.sim.scene import Scene
from dlolib.types import Floats

TOLERANCE = 1e-8
MOST_ITERATIONS = 1000
# Which steps are implicit Euler's: all, each from rest; all.
AT_REST, ALL = -1, 2**31 - 1
# Damped motion to an equilibrium: steps of one length, the first and last length [s], how often at most, and
# how much longer each time. A step that takes more iterations is better made shorter.
RELAXING, RELAXING_S, MOST_RELAXING, LONGER = 5, (0.01, 10.0), 100, 3.0
RELAXING_ITERATIONS = 300
# A rope that snaps more often than this is on the edge of two shapes all the way.
MOST_SNAPS = 4
# A rope that is held this share longer than it is would tear; one that may stretch, this many times further
# than under its own weight.
TORN, TORN_OVER_WEIGHT = 0.05, 30.0


@dataclass(frozen=True)
class State:
    """Where B ropes are, and what they remember.

    Args:
        x: positions (B, n, 3) [m].
        before: those one step earlier, had the rope always been as fast as it is; for steps by implicit Euler
            where it was.
        q: frames (B, n + 1, 4); frames 0 and n are the wall's and the grasp's.
        past: histories of the laws (B, n, HISTORY); None: none yet.
        slip: stretch of the contacts' tangential springs (B, K, 3) [m]; None: none yet.
    """

    x: Floats
    before: Floats
    q: Floats
    past: Floats | None = None
    slip: Floats | None = None

    def at_rest(self) -> State:
        """The same without velocity."""
        return replace(self, before=self.x.copy())


@dataclass(frozen=True)
class Path:
    """Held poses at T steps: positions (B, T, 2, 3) [m] and frames (B, T, 2, 4) of start and end.

    Entries of a free end are not read. dt_s (B, T): the steps' durations, where they are not the clock's.
    span (B, T + 1): rest lengths over the scene's, from the initial state on; None: 1.
    """

    x: Floats
    q: Floats
    dt_s: Floats | None = None
    span: Floats | None = None

    def still(self, steps: int) -> Path:
        """So many steps at the first pose."""
        x, q = (np.repeat(part[:, :1], steps, axis=1) for part in (self.x, self.q))
        return Path(x, q, span=None if self.span is None else np.repeat(self.span[:, :1], steps + 1, axis=1))

    def of(self, rope: int, begin: int) -> Path:
        """One rope's, from a step on."""
        x, q, dt_s, span = (
            None if part is None else part[rope : rope + 1, begin:]
            for part in (self.x, self.q, self.dt_s, self.span)
        )
        assert x is not None and q is not None
        return Path(x, q, dt_s, span)

    def between(self, begin: int, end: int) -> Path:
        """The steps from one to before another."""
        dt_s, span = self.dt_s, self.span
        return Path(
            self.x[:, begin:end], self.q[:, begin:end], None if dt_s is None else dt_s[:, begin:end],
            None if span is None else span[:, begin : end + 1],
        )  # fmt: skip


@dataclass(frozen=True)
class Clock:
    """How time passes: `step_s` None is quasi-static. `euler`: so many of the first steps are implicit
    Euler's, none, `ALL`, or with `AT_REST` each of them from rest; the others are Park's (`inertia`).

    `fresh`: the laws see every step's rope come from being straight, or from what it once was, at once: so a
    first shape is found.
    """

    step_s: float | None = None
    euler: int = 0
    fresh: bool = False

    @property
    def flags(self) -> tuple[int, int, int]:
        """As the kernels take it: whether time passes, steps by implicit Euler, fresh."""
        return int(self.step_s is not None), self.euler, int(self.fresh)


@dataclass(frozen=True)
class Rollout:
    """States of B ropes at indices 0 (the initial one) ... T: x (B, T + 1, n, 3), q (B, T + 1, n + 1, 4),
    past (B, T + 1, n, HISTORY), slip (B, T + 1, K, 3), sliding (B, T + 1, K); K = 1 where nothing rubs."""

    scene: Scene
    clock: Clock
    path: Path
    before: Floats
    x: Floats
    q: Floats
    past: Floats
    slip: Floats
    sliding: np.ndarray[tuple[int, ...], np.dtype[np.int32]]
    iterations: np.ndarray[tuple[int, ...], np.dtype[np.int32]]

    @property
    def final(self) -> State:
        """The state to go on from."""
        weights = before_next(self.x.shape[1] - 1, self.clock)
        positions = np.concatenate([self.before[:, None], self.x], axis=1)[:, -len(weights) :]
        before = np.einsum("t,btnk->bnk", weights, positions)
        last = (self.x[:, -1], before, self.q[:, -1], self.past[:, -1], self.slip[:, -1])
        return State(*(part.copy() for part in last))


def before_next(steps: int, clock: Clock) -> Floats:
    """What the last positions of so many steps, with those before the first one where they are so few, make
    of `State.before` for what comes next: weights (K,), the last position's at the end."""
    if steps == 0 or clock.euler < 0 or steps <= clock.euler:
        return np.array([1.0, 0.0])
    weights = -of_positions(VELOCITY, steps)
    weights[0] += 1.0
    return weights[::-1]


def roll_out(scene: Scene, state: State, path: Path, clock: Clock) -> Rollout:
    """Move the held ends along the path.

    Where Newton's method does not follow a quasi-static rope without history, because it snaps to another
    shape, the rope goes there by damped motion.

    Raises:
        SimulationError: a step could not be solved; names the rope, the step and why. Or no end is held, and
            no time passes. Or the ends are held so that the rope would tear.
    """
    if clock.step_s is None and not scene.clamped.any(axis=1).all():
        raise SimulationError(
            "no end is held, and a quasi-static rope would fall for ever",
            mend="hold an end, or simulate it dynamically",
        )
    rollout, status = _launch(scene, state, path, clock)
    if status.any() and clock == Clock(None) and not scene.path_dependent:
        for rope in np.flatnonzero(status.any(axis=1)):
            _snap(rollout, status, int(rope))
    refuse(status)
    _refuse_torn(rollout)
    return rollout


def follow(scene: Scene, state: State, path: Path, clock: Clock, placed: State) -> Rollout:
    """As `roll_out`, but the first step is sought near where the ropes are `placed`, and not where they would
    go on to.

    Raises:
        SimulationError: a step could not be solved from there.
    """
    rollout, status = _launch(scene, state, path, clock, placed=placed)
    refuse(status)
    _refuse_torn(rollout)
    return rollout


def relax(scene: Scene, state: State, path: Path, fresh: bool = False) -> Rollout:
    """Equilibrium of B ropes at the path's first pose: damped motion in steps that grow while they can be
    solved, and the quasi-static step that ends it.

    Raises:
        SimulationError: they do not come to rest.
    """
    step_s = RELAXING_S[0]
    for _ in range(MOST_RELAXING):
        clock = Clock(step_s, AT_REST, fresh)
        moved, status = _launch(scene, state, path.still(RELAXING), clock, RELAXING_ITERATIONS)
        if status.any():
            step_s /= 4
            continue
        state = moved.final
        step_s *= LONGER
        if step_s > RELAXING_S[1]:
            rest, status = _launch(scene, state, path.still(1), Clock(None, fresh=fresh))
            if not status.any():
                return rest
            step_s = 0.1 * RELAXING_S[1]
    raise SimulationError(
        f"rope {int(np.argmax(status.any(axis=1)))} does not come to rest",
        mend="check its stiffness and how it is held",
    )


def _launch(
    scene: Scene, state: State, path: Path, clock: Clock, most_iterations: int | None = None,
    placed: State | None = None,
) -> tuple[Rollout, np.ndarray]:  # fmt: skip
    """The kernel's roll-out, and what became of every step (B, T); `placed`: where the first one begins."""
    ropes, n = state.x.shape[:2]
    count = path.x.shape[1]
    x, q = np.empty((ropes, count + 1, n, 3)), np.empty((ropes, count + 1, n + 1, 4))
    past, slip = np.zeros((ropes, count + 1, n, HISTORY)), np.zeros((ropes, count + 1, scene.slips, 3))
    sliding = np.zeros((ropes, count + 1, scene.slips), np.int32)
    x[:, 0], q[:, 0] = state.x, state.q
    if placed is not None:
        x[:, 1], q[:, 1] = placed.x, placed.q
    if state.past is not None:
        past[:, 0] = state.past
    if state.slip is not None:
        slip[:, 0] = state.slip
    status, taken = np.zeros((ropes, count), np.int32), np.zeros((ropes, count), np.int32)
    before, most = np.ascontiguousarray(state.before), most_iterations or MOST_ITERATIONS
    direct.roll_out(
        _plain(scene), x, q, before, past, slip, sliding, np.ascontiguousarray(path.x),
        np.ascontiguousarray(path.q), steps_of(path, clock), *scene.arrays(), *clock.flags,
        int(placed is not None), int(scene.symmetric), TOLERANCE, most,
        *(banded(ropes, n) for _ in range(4)),
        columns(ropes, 2, n), np.zeros((ropes, 7, scene.slips)), np.empty((ropes, n, 3)),
        *(np.empty((ropes, *shape)) for _ in range(2) for shape in ((n, 3), (n + 1, 4))), status, taken,
    )  # fmt: skip
    return Rollout(scene, clock, path, before, x, q, past, slip, sliding, taken), status


def _snap(rollout: Rollout, status: np.ndarray, rope: int) -> None:
    """Mend in place the steps of one rope that were not solved: each by damped motion, then on from there."""
    alone = rollout.scene.of(rope)
    for _ in range(MOST_SNAPS):
        if not status[rope].any():
            return
        step = int(np.argmax(status[rope] != 0))
        held = rollout.path.of(rope, step)
        x, q = rollout.x[[rope], step], rollout.q[[rope], step]
        # the span's first entry is that of the state before the step
        there = held if held.span is None else replace(held, span=held.span[:, 1:])
        try:
            rest = relax(alone, State(x, x.copy(), q), there)
        except SimulationError:
            return
        rollout.x[rope, step + 1], rollout.q[rope, step + 1] = rest.x[0, 1], rest.q[0, 1]
        after, status[rope, step + 1 :] = _launch(
            alone, rest.final.at_rest(), rollout.path.of(rope, step + 1), rollout.clock
        )
        status[rope, step] = 0
        rollout.x[rope, step + 2 :], rollout.q[rope, step + 2 :] = after.x[0, 1:], after.q[0, 1:]
        rollout.iterations[rope, step + 1 :] = after.iterations[0]


def steps_of(path: Path, clock: Clock) -> Floats:
    """Duration of the step to each index and span at it, (B, T + 1, 2); index 0 has the first step's."""
    ropes, count = path.x.shape[:2]
    steps = np.ones((ropes, count + 1, 2))
    steps[:, :, 0] = clock.step_s or 1.0
    if path.dt_s is not None:
        steps[:, 1:, 0] = path.dt_s
    # the state before the first took as long
    steps[:, 0, 0] = steps[:, min(count, 1), 0]
    if path.span is not None:
        steps[:, :, 1] = path.span
    return steps


def banded(slots: int, n: int) -> Floats:
    band = np.empty((slots, 6 * (n + 1) + HALF, HALF + 1))
    band[:, -HALF:] = 0.0
    return band


def columns(slots: int, columns: int, n: int) -> Floats:
    return np.zeros((slots, columns, 6 * (n + 1) + HALF))


def _plain(scene: Scene) -> bool:
    """Whether nothing acts on the ropes but what is elastic, loads and inertia."""
    return scene.symmetric and not scene.obstacles.shape[1] and not scene.has_laws


def refuse(status: np.ndarray) -> None:
    if not status.any():
        return
    rope, step = np.argwhere(status)[0]
    why = {
        direct.UNCONVERGED: f"no equilibrium within {MOST_ITERATIONS} iterations",
        direct.NOT_FINITE: "the rod's Hessian is singular or the state not finite",
        direct.TOO_FAR: "it takes the rope so far that it could pass through an obstacle near it",
    }[int(status[rope, step])]
    raise SimulationError(
        f"rope {rope}, step {step + 1}: {why}",
        mend="move the ends in smaller steps, or check stiffness and length",
    )


def stretches(scene: Scene) -> Floats:
    """By which share of its length each rope (B,) may be pulled longer, by many times its own weight."""
    weight = np.linalg.norm(scene.force, axis=2).sum(axis=1)
    return np.asarray(TORN_OVER_WEIGHT * weight / scene.segments[..., 3].min(axis=1))


def _refuse_torn(rollout: Rollout) -> None:
    """Refuse a rope that is held longer than it can be, by its ends or obstacles, or pressed shorter."""
    scene, path = rollout.scene, rollout.path
    held, among = bool(scene.clamped.all()), scene.obstacles.shape[1] > 0
    if path.x.shape[1] == 0 or not (held or among):
        return
    most = TORN + stretches(scene)
    span = 1.0 if path.span is None else path.span[:, 1:]
    over = np.zeros(path.x.shape[:2])
    if held:
        apart = np.linalg.norm(path.x[:, :, 1] - path.x[:, :, 0], axis=2)
        over = np.maximum(apart / scene.segment_l.sum(axis=1)[:, None] / span - 1, 0.0)
    if among:
        pieces = np.linalg.norm(np.diff(rollout.x[:, 1:], axis=2), axis=3) / scene.segment_l[:, None]
        off = pieces / np.asarray(span)[..., None] - 1
        worst = np.take_along_axis(off, np.abs(off).argmax(axis=2)[..., None], axis=2)[..., 0]
        over = np.where(np.abs(worst) > over, worst, over)
    torn = np.abs(over) > most[:, None]
    if torn.any():
        rope, step = np.argwhere(torn)[0]
        off = float(over[rope, step])
        raise SimulationError(
            f"rope {rope}, step {step + 1}: "
            f"held {100 * abs(off):.0f} % {'longer' if off > 0 else 'shorter'} than it is, it would tear",
            mend="bring the ends nearer to each other, check the length, or give axial_stretch",
        )
