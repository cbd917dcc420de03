"""Play an experiment with its effects: what a perfect camera would see of the rope."""

from __future__ import annotations

import contextlib
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.errors import SimulationError
from dlolib.formats.motion import interpolate_motion
from dlolib.proof.equilibrium import Drift, Equilibrium
from dlolib.proof.forms import Way
from dlolib.proof.world import (
    BODIES,
    NOTHING,
    POINTS,
    REMEMBERS,
    Effects,
    Experiment,
    build,
    free_length,
    turned_end,
    vertex_masses,
)
from dlolib.types import Floats

# What remembers takes every so many rows of the motion: reports/proof/refinement.json says what finer
# steps would change.
STRIDE, FINE_STRIDES = 4, {"inertia_drag": 1, "contact_friction": 2}
# A step takes 3 to 5 weighings of the balance; a rope that takes many more is no quasi-static one.
PATIENCE = 12
VIEWING_AXIS = np.array([0.0, 1.0, 0.0])
# A rope pulled deeper than this into a bar is held longer than it is: some 15 times its weight pulls at it.
DEEPEST_M = 1e-4
# Chains further apart than this went different ways.
OTHERWISE_M = 2e-3
# Of these chains the first that is fine enough is taken: what it lacks of a rope leaves less than this in χ².
# Each is twice the last one: two with a body between them would be extrapolated from the same pair where
# the coarser one's neighbour took another way, and would agree for no other reason.
CHAINS = tuple(factor * (POINTS - 1) for factor in (2, 4, 8, 16))
LEFT = 2.0


def play(experiment: Experiment, effects: Effects = NOTHING, bodies: int = BODIES, finer: int = 1) -> Floats:
    """The rope's points in every frame [m], shape (F, 30, 3), without noise.

    A chain of so many bodies bends like a rope that is a percent stiffer, an error that falls with their
    square: one with a body less between two points tells how much is left (Richardson), or, in frames where
    that one took another way, one with a body more.

    Args:
        experiment: what is known of it.
        effects: what is not, by the names and parameters of formats.md.
        bodies: of the chain, a multiple of 29.
        finer: how many times as many steps along the motion.

    Raises:
        SimulationError: the rope finds no balance, as where it is pulled longer than it is, or round a bar.
    """
    points = _played(experiment, effects, bodies, finer)
    found, alone = points.copy(), np.full(len(points), bodies > POINTS - 1)
    for other in (bodies - (POINTS - 1), bodies + (POINTS - 1)):
        if alone.any():
            with contextlib.suppress(SimulationError):
                more = points - _played(experiment, effects, other, finer)
                alike = alone & (np.abs(more).max(axis=(1, 2)) < OTHERWISE_M)
                found[alike] = points[alike] + more[alike] / ((bodies / other) ** 2 - 1)
                alone &= ~alike
    return _through_camera(found, effects)


def settled(experiment: Experiment, effects: Effects, noise_m: float) -> tuple[Floats, int]:
    """The rope's points as `play` shows them, and the bodies of a chain fine enough for a camera's noise [m].

    What moves most ropes by a hundredth of a millimetre moves one that all but twists over by two. So each
    recording is played by finer chains until what the last one lacks could not be taken for physics: its
    change, as if that fell with the square of the bodies' length. Extrapolated, most fall faster.

    Raises:
        SimulationError: as `play`; or it does not settle, so that nobody knows what such a rope would do.
    """
    before = play(experiment, effects, CHAINS[0])
    for coarse, bodies in pairwise(CHAINS):
        points = play(experiment, effects, bodies)
        lacks = (points - before) / ((bodies / coarse) ** 2 - 1)
        if np.sum((lacks / noise_m) ** 2) < LEFT:
            return points, bodies
        before = points
    raise SimulationError("finer chains show other shapes", mend="draw another motion")


def _played(experiment: Experiment, effects: Effects, bodies: int, finer: int) -> Floats:
    """What one chain shows (F, 30, 3) [m]."""
    t_s = seen_times(experiment, effects)
    times = np.unique(np.concatenate([_rows(experiment, effects, finer), t_s]))
    vertices, _ = _run(experiment, effects, bodies, times)
    return vertices[np.searchsorted(times, t_s), :: bodies // (POINTS - 1)]


def way(experiment: Experiment, effects: Effects) -> Way:
    """What the joints of the chain go through.

    Raises:
        SimulationError: the rope finds no balance.
    """
    times = np.unique(np.concatenate([_rows(experiment, effects, 1), seen_times(experiment, effects)]))
    _, curvature = _run(experiment, effects, BODIES, times)
    length_m = np.full(BODIES + 1, experiment.sizes.length_m / BODIES)
    length_m[[0, -1]] /= 2
    return Way(curvature, np.diff(times, prepend=times[0]), length_m)


def seen_times(experiment: Experiment, effects: Effects) -> Floats:
    """The times on the robot's clock that the frames show [s], (F,): within the motion."""
    late = effects.get("clock_offset", {}).get("time", 0.0)
    rows = experiment.motion.t_s
    return np.clip(experiment.frame_t_s - late, rows[0], rows[-1])


def _rows(experiment: Experiment, effects: Effects, finer: int) -> Floats:
    """Which of the motion's rows the chain must pass through [s]."""
    rows = experiment.motion.t_s
    if REMEMBERS.isdisjoint(effects) and not experiment.obstacles:
        return rows[:1]
    stride = min(FINE_STRIDES.get(name, STRIDE) for name in (*effects, ""))
    whole = np.arange(len(rows))
    return np.asarray(np.interp(np.arange(0, len(rows), stride / finer), whole, rows))


def _run(experiment: Experiment, effects: Effects, bodies: int, times: Floats) -> tuple[Floats, Floats]:
    """Vertices (T, N + 1, 3) [m] at these times, the motion's first row the first of them; and the joints'
    curvatures (T, N + 1, 2) [1/m]."""
    motion = interpolate_motion(experiment.motion, times)
    turns = turned_end(motion.end_q, effects, "end").as_matrix()
    rope = build(experiment, effects, bodies)
    rope.patience += PATIENCE * len(times)
    dynamics = _Dynamics(experiment, effects, bodies) if "inertia_drag" in effects else None
    found, bent = np.empty((len(times), bodies + 1, 3)), np.empty((len(times), bodies + 1, 2))
    for index, t_s in enumerate(times):
        step_s = float(t_s - times[index - 1]) if index else 0.0
        if "grasp_slip" in effects:
            rope.lengthen(free_length(experiment, effects, float(t_s)))
        drift = dynamics.drift(step_s) if dynamics and index else None
        _reach(rope, motion.end_m[index], turns[index], step_s, drift, first=index == 0)
        if max((contact.depth(rope.chain.vertices) for contact in rope.contacts), default=0.0) > DEEPEST_M:
            raise SimulationError(
                "held longer than it is, round an obstacle, it would tear", mend="draw another motion"
            )
        rope.keep(step_s)
        found[index] = rope.chain.vertices
        bent[index] = rope.curvature(rope.q)[:, :2]
        if dynamics:
            dynamics.keep(found[index], step_s)
    return found, bent


def _reach(
    rope: Equilibrium, position: Floats, turn: Floats, step_s: float, drift: Drift | None, first: bool
) -> None:
    """On the way to the first row nothing is in the way (formats.md), and then all of it at once."""
    contacts = rope.contacts
    if first:
        rope.contacts = []
        rope.reach(position, turn, step_s)
        rope.contacts = contacts
    rope.reach(position, turn, step_s, drift)


class _Dynamics:
    """Inertia and drag at the vertices by the second backward difference (BDF2), at rest before."""

    def __init__(self, experiment: Experiment, effects: Effects, bodies: int) -> None:
        effect = effects["inertia_drag"]
        self.mass = effect["inertia"] * vertex_masses(experiment, effects, bodies)[:, None]
        length = np.full((bodies + 1, 1), experiment.sizes.length_m / bodies)
        length[[0, -1]] /= 2
        self.drag = effect["drag"] * length
        self.last: list[Floats] = []
        self.velocity: list[Floats] = []
        self.step_s = 0.0

    def drift(self, step_s: float) -> Drift:
        """The missing force of a step as rate * x - drift, from the last two states."""
        fast, x = self._weights(step_s), self.last
        v = self.velocity
        behind = fast[1] * x[-1] + fast[2] * x[-2]
        pull = fast[1] * v[-1] + fast[2] * v[-2]
        rate = fast[0] ** 2 * self.mass + fast[0] * self.drag
        # v = f0 x + behind; a = f0 v + pull.
        return Drift(rate, -self.mass * (fast[0] * behind + pull) - self.drag * behind)

    def keep(self, x: Floats, step_s: float) -> None:
        """Append a state; the first one has stood for ever."""
        if not self.last:
            self.last, self.velocity = [x.copy(), x.copy()], [np.zeros_like(x), np.zeros_like(x)]
            return
        fast = self._weights(step_s)
        speed = fast[0] * x + fast[1] * self.last[-1] + fast[2] * self.last[-2]
        self.last, self.velocity = [self.last[-1], x.copy()], [self.velocity[-1], speed]
        self.step_s = step_s

    def _weights(self, step_s: float) -> tuple[float, float, float]:
        """Of the newest, the last and the state before it, for steps that may differ [1/s]."""
        ratio = step_s / self.step_s if self.step_s else 1.0
        new = (1 + 2 * ratio) / (1 + ratio)
        old = ratio**2 / (1 + ratio)
        return new / step_s, -(1 + ratio) / step_s, old / step_s


def _through_camera(points: Floats, effects: Effects) -> Floats:
    """`camera_pose`: turned about the world's origin and moved along the viewing axis."""
    error = effects.get("camera_pose")
    if error is None:
        return points
    turn = Rotation.from_rotvec([error[f"rotation_{axis}"] for axis in (1, 2, 3)]).as_matrix()
    return np.asarray(points @ turn.T + error["depth"] * VIEWING_AXIS)
