"""Play an experiment with its effects: what a perfect camera would see of the rope."""

from __future__ import annotations

import contextlib
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.errors import SimulationError
from dlolib.formats.motion import interpolate_motion
from dlolib.proof.equilibrium import Equilibrium
from dlolib.proof.forms import Way
from dlolib.proof.inertia import SHARES, Inertia
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
    dynamic = "inertia_drag" in effects
    stages = SHARES if dynamic else (1.0,)
    steps_s = np.diff(times, prepend=times[0])
    at_s = times[:, None] - np.outer(steps_s, 1 - np.array(stages))
    motion = interpolate_motion(experiment.motion, at_s.ravel())
    turns = turned_end(motion.end_q, effects, "end").as_matrix().reshape(*at_s.shape, 3, 3)
    places = motion.end_m.reshape(*at_s.shape, 3)
    rope = build(experiment, effects, bodies)
    rope.patience += PATIENCE * at_s.size
    _reach_first(rope, places[0, 0], turns[0, 0])
    inertia = Inertia(experiment, effects, bodies, rope.chain.vertices) if dynamic else None
    found, bent = np.empty((len(times), bodies + 1, 3)), np.empty((len(times), bodies + 1, 2))
    for index, step_s in enumerate(steps_s):
        for stage, share in enumerate(stages if index else ()):
            if "grasp_slip" in effects:
                rope.lengthen(free_length(experiment, effects, float(at_s[index, stage])))
            drift = inertia.drift(step_s) if inertia else None
            rope.reach(places[index, stage], turns[index, stage], share * step_s, drift)
            if inertia:
                inertia.keep(rope.chain.vertices, step_s)
        if max((contact.depth(rope.chain.vertices) for contact in rope.contacts), default=0.0) > DEEPEST_M:
            raise SimulationError(
                "held longer than it is, round an obstacle, it would tear", mend="draw another motion"
            )
        rope.keep(step_s)
        found[index] = rope.chain.vertices
        bent[index] = rope.curvature(rope.q)[:, :2]
    return found, bent


def _reach_first(rope: Equilibrium, position: Floats, turn: Floats) -> None:
    """On the way to the first row nothing is in the way (formats.md), and then all of it at once."""
    contacts = rope.contacts
    rope.contacts = []
    rope.reach(position, turn, 0.0)
    rope.contacts = contacts
    rope.reach(position, turn, 0.0)


def _through_camera(points: Floats, effects: Effects) -> Floats:
    """`camera_pose`: turned about the world's origin and moved along the viewing axis."""
    error = effects.get("camera_pose")
    if error is None:
        return points
    turn = Rotation.from_rotvec([error[f"rotation_{axis}"] for axis in (1, 2, 3)]).as_matrix()
    return np.asarray(points @ turn.T + error["depth"] * VIEWING_AXIS)
