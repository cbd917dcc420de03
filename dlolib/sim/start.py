"""A first shape from which Newton's method finds the equilibrium between two held poses."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from dlolib.errors import SimulationError
from dlolib.sim.scene import Scene
from dlolib.sim.simulate import AT_REST, Clock, Path, Rollout, State, relax, roll_out
from dlolib.types import Floats, Ints, Pose

SAMPLES = 2001
# Damped steps towards equilibrium before the quasi-static one, short ones first: (number, seconds each).
SETTLING = ((30, 0.03), (10, 0.3))
# A marker this near to a held end, as a share of the length, is on the clamp: noise would kink the two.
ON_CLAMP = 1e-3


def settle(scene: Scene, state: State, ends: Path) -> Rollout:
    """Equilibrium of B ropes whose ends stand at the path's first step, found by damped motion.

    The laws see each rope come from being straight, or from what `prior_history` says, at once.

    Raises:
        SimulationError: no equilibrium was found.
    """
    try:
        now = state
        for steps, step_s in SETTLING:
            now = roll_out(scene, now, ends.still(steps), Clock(step_s, AT_REST, fresh=True)).final
        return roll_out(scene, now, ends.still(1), Clock(None, fresh=True))
    except SimulationError:
        pass
    # a soft rope that hangs far below its first shape, or one that lies on something, takes more care
    try:
        return relax(scene, state, ends, fresh=True)
    except SimulationError as error:
        raise SimulationError(
            f"before the first step: {error.problem}",
            mend="begin at a pose that leaves the rope slack and clear of obstacles, or check its stiffness",
        ) from None


def first_shape(
    length_m: float, particles: int, start: Pose | None, end: Pose | None, gravity_m_s2: Floats
) -> State:
    """A curve of the right length between the held poses, sagging with gravity; straight from a single one.

    Args:
        length_m: free length [m].
        particles: n.
        start, end: poses of the held ends; None of a free one.
        gravity_m_s2: the direction in which slack hangs, shape (3,).

    Returns:
        One rope at rest: x (1, n, 3), q (1, n + 1, 4).

    Raises:
        SimulationError: the held ends are further apart than the rope is long, or none is held.
    """
    if start is not None and end is not None:
        points = _curve(length_m, particles, start, end, np.asarray(gravity_m_s2, float))
    elif start is not None:
        points = start.position_m + np.linspace(0, length_m, particles)[:, None] * _axes(start)[:, 2]
    elif end is not None:
        points = end.position_m + np.linspace(-length_m, 0, particles)[:, None] * _axes(end)[:, 2]
    else:
        raise SimulationError("no end is held: there is no place to begin", mend="hold an end")
    frames = frames_along(points, start, end)
    return State(points[None], points[None].copy(), frames[None])


def _axes(pose: Pose) -> Floats:
    return np.asarray(Rotation.from_quat(pose.quaternion, scalar_first=True).as_matrix())


def _curve(length: float, particles: int, start: Pose, end: Pose, gravity: Floats) -> Floats:
    chord = end.position_m - start.position_m
    apart = float(np.linalg.norm(chord))
    if apart > length:
        raise SimulationError(
            f"the held ends are {apart:.4g} m apart, the rope is {length:.4g} m long",
            mend="check units and length",
        )
    down = _hanging(chord, gravity, _axes(start)[:, 0])
    t = np.linspace(0, 1, SAMPLES)[:, None]
    hermite = start.position_m + (3 - 2 * t) * t**2 * chord
    tangents = t * (1 - t) ** 2 * _axes(start)[:, 2] - t**2 * (1 - t) * _axes(end)[:, 2]
    bump = 16 * t**2 * (1 - t) ** 2 * down

    def excess(stiff: float, sag: float) -> float:
        curve = hermite + stiff * tangents + sag * bump
        return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()) - length

    stiff, sag = 0.7 * length, 0.0
    if excess(stiff, 0.0) > 0:
        stiff = float(brentq(excess, 0.0, stiff, args=(0.0,))) if excess(0.0, 0.0) < 0 else 0.0
    else:
        sag = float(brentq(lambda s: excess(stiff, s), 0.0, length))
    curve = hermite + stiff * tangents + sag * bump
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    nodes = np.linspace(0, along[-1], particles)
    return np.stack([np.interp(nodes, along, curve[:, k]) for k in range(3)], axis=1)


def _hanging(chord: Floats, gravity: Floats, aside: Floats) -> Floats:
    """Where slack goes: down, but not along the chord."""
    along = chord / max(float(np.linalg.norm(chord)), 1e-9)
    for direction in (gravity, aside, np.array([1.0, 0.0, 0.0])):
        norm = float(np.linalg.norm(direction))
        if norm > 0:
            across = direction / norm - (direction / norm) @ along * along
            if float(np.linalg.norm(across)) > 0.2:
                return np.asarray(across / np.linalg.norm(across))
    return np.cross(along, [0.0, 1.0, 0.0])


def off_clamps(s_m: Floats, length_m: float, held_m: Iterable[float]) -> Ints:
    """Which of the points at arc lengths s_m (P,) lie on none of the clamps, which are at held_m [m]."""
    away = [np.abs(s_m - end) > ON_CLAMP * length_m for end in held_m]
    return np.flatnonzero(np.all(away, axis=0) if away else np.ones(len(s_m), dtype=bool))


def curve_through(s_m: Floats, xyz_m: Floats, nodes_m: Floats) -> Floats:
    """Smooth curve through points (P, 3) [m] seen at arc lengths s_m, at other arc lengths (n,): (n, 3)."""
    order = np.argsort(s_m)
    return np.asarray(CubicSpline(s_m[order], xyz_m[order], bc_type="natural")(nodes_m))


def shape_seen(
    s_m: Floats, xyz_m: Floats, length_m: float, particles: int, start: Pose | None, end: Pose | None
) -> State:
    """A rope at rest where its points (P, 3) [m] at arc lengths s_m were seen, its ends as they are held.

    Straight from its one held end where nothing else of it was seen.
    """
    held = {s: pose.position_m for s, pose in ((0.0, start), (length_m, end)) if pose is not None}
    seen = off_clamps(s_m, length_m, held)
    if len(seen) + len(held) < 2:
        return first_shape(length_m, particles, start, end, np.zeros(3))
    nodes = np.linspace(0.0, length_m, particles)
    places = np.concatenate([xyz_m[seen], *(x[None] for x in held.values())])
    x = curve_through(np.concatenate([s_m[seen], [*held]]), places, nodes)
    return State(x[None], x[None].copy(), frames_along(x, start, end)[None])


def released(s_m: Floats, xyz_m: Floats, segments_m: Floats) -> State:
    """A rope that nobody holds, at rest where its points (P, 3) [m] at arc lengths s_m were seen.

    Its segments have their own lengths (n - 1,) [m], along the directions of a curve through the points.

    Raises:
        SimulationError: fewer than two points were seen.
    """
    if len(s_m) < 2:
        raise SimulationError(
            f"no end is held and the first frame has {len(s_m)} point: there is no shape to begin with",
            mend="begin with a frame of two points or more",
        )
    nodes = np.concatenate([[0.0], np.cumsum(segments_m)])
    steps = np.diff(curve_through(s_m, xyz_m, nodes), axis=0)
    steps *= segments_m[:, None] / np.linalg.norm(steps, axis=1, keepdims=True)
    x = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    x += (xyz_m - np.stack([np.interp(s_m, nodes, x[:, k]) for k in range(3)], axis=1)).mean(axis=0)
    return State(x[None], x[None].copy(), frames_along(x, None, None)[None])


def frames_along(points: Floats, start: Pose | None, end: Pose | None) -> Floats:
    """Frames of wall, segments and grasp (n + 1, 4): transported along the points, twist spread evenly.

    Where neither is held the first frame is any along the first segment.
    """
    tangents = np.diff(points, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    held = start if start is not None else end
    if held is None:
        frame = _turned_onto(Rotation.identity(), tangents[0])
    else:
        frame = Rotation.from_quat(held.quaternion, scalar_first=True)
    frames = [frame]
    for tangent in tangents:
        frame = _turned_onto(frame, tangent)
        frames.append(frame)
    last = frame if end is None or start is None else Rotation.from_quat(end.quaternion, scalar_first=True)
    aligned = _turned_onto(last, tangents[-1])
    twist = float((frame.inv() * aligned).as_rotvec()[2])
    share = np.linspace(0, twist, len(frames))
    turned = [f * Rotation.from_rotvec([0.0, 0.0, angle]) for f, angle in zip(frames, share, strict=True)]
    quaternions = np.array([f.as_quat(scalar_first=True) for f in [*turned, last]])
    return quaternions


def _turned_onto(frame: Rotation, tangent: Floats) -> Rotation:
    """The frame turned the shortest way so that its third axis is the tangent."""
    own = frame.as_matrix()[:, 2]
    axis = np.cross(own, tangent)
    sine, cosine = float(np.linalg.norm(axis)), float(own @ tangent)
    if sine < 1e-12:
        return frame if cosine > 0 else frame * Rotation.from_rotvec([np.pi, 0.0, 0.0])
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine)) * frame
