"""Where something that was not recorded may have touched the rope.

A sphere that the simulated rope enters pushes it out again: in each frame where it is deepest, along the
sphere's normal, with the depth over the rope's compliance there as its force. What such forces would take
from χ², by a linear step and beside what the model's own parameters take up, tells which of the spheres along
the rope's way are worth a fit. Without friction, of contacts one at a time: more is left to the fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.distance import cdist

from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.probes import FORCES, PLACES, places, probe
from dlolib.diagnose.study import Seen, Study
from dlolib.errors import SimulationError
from dlolib.identify.problem import axes
from dlolib.sim.effects.base import Touch
from dlolib.sim.poses import Model
from dlolib.types import Floats, Points

# Spheres that are tried: so large, so deep in the rope [m], on so many sides of it, in so many frames of
# all recordings.
RADII_M, DEPTHS_M, SIDES, FRAMES = (0.005, 0.02), (0.001, 0.003, 0.009, 0.02), 12, 24
# But no deeper than this share of the way to its axis, where a sphere has no side.
DEEPEST = 0.9
# So many points of the rope about each place that is pushed, the middle one of them there.
FINER = 3
# What gives way less than this [m/N] would be pushed by forces without bound: no sphere is there.
RIGID_M_N = 1e-9
# So many of the best are told, no two centres nearer than this [m].
MOST, APART_M = 8, 0.025


@dataclass(frozen=True)
class _Pushed:
    """A recording's rope under forces (3) at PLACES; frames (F), points (S) along the rope, parameters (N).

    x_m (F, S, 3): where it is simulated. compliance (F, PLACES, 3, 3) [m/N]: how far a place gives way.
    along (F, PLACES, 3), square (F, PLACES, 3, 3) and shared (F, PLACES, 3, N): products, whitened, of what
    forces do to the points with what is left of them, with itself and with what the parameters do.
    """

    x_m: Floats
    compliance: Floats
    along: Floats
    square: Floats
    shared: Floats


def touches(study: Study, at: Fitted) -> list[Touch]:
    """The spheres that promise most beside a model, the best first."""
    try:
        pushed = [_pushed(study, at, k) for k in range(len(study.seen))]
    except SimulationError:
        return []
    radius_m = study.seen[0].recording.rope.radius_m
    frames = -(-FRAMES // len(pushed))
    spheres = np.concatenate([_spheres(each, radius_m, frames) for each in pushed])
    gains = sum((_gains(each, spheres, radius_m) for each in pushed), np.zeros(len(spheres)))
    best: list[Floats] = []
    for sphere in spheres[np.argsort(-gains, kind="stable")]:
        if len(best) < MOST and all(np.linalg.norm(sphere[:3] - other[:3]) > APART_M for other in best):
            best.append(sphere)
    return [Touch(sphere[:3], float(sphere[3])) for sphere in best]


def _pushed(study: Study, at: Fitted, k: int) -> _Pushed:
    one, rod = study.seen[k], study.rod(k, at.values(study.number(k)))
    made, arc = one.model.setup(rod), places(one.recording.rope.length_m)
    sides = [probe(made, name, s, arc[1] - arc[0]) for s in arc for name in FORCES]
    names = [u.name for u in at.unknowns if u.recording in (None, study.number(k))]
    seen, residual = axes(one.model), at.residuals[k]
    frames = len(residual)
    forces = one.whitener(one.model.respond(rod, sides).by_parameter[:, seen]).reshape(frames, -1, PLACES, 3)
    own = one.whitener(one.model.predict(rod, names).by_parameter[:, seen])
    basis = np.linalg.qr(own.reshape(residual.size, -1))[0]
    left = residual.ravel() - basis @ (basis.T @ residual.ravel())
    even = _evenly(one).respond(rod, sides)
    x_m = even.xyz_m.reshape(frames, PLACES * FINER, 3)
    moved = even.by_parameter.reshape(frames, PLACES, FINER, 3, PLACES, 3)[:, :, FINER // 2]
    compliance = np.moveaxis(np.diagonal(moved, axis1=1, axis2=3), -1, 1)
    return _Pushed(
        x_m,
        compliance,
        np.einsum("fipa,fi->fpa", forces, left.reshape(frames, -1)),
        np.einsum("fipa,fipb->fpab", forces, forces, optimize=True),
        np.einsum("fipa,fin->fpan", forces, basis.reshape(frames, -1, basis.shape[1]), optimize=True),
    )


def _evenly(one: Seen) -> Model:
    """The recording as if it had been seen at even places in each frame."""
    points, length_m = one.recording.points, one.recording.rope.length_m
    s_m = (np.arange(PLACES * FINER) + 0.5) / (PLACES * FINER) * length_m
    frame, first = np.unique(points.frame, return_index=True)
    rows = np.split(np.arange(len(points.frame)), first[1:])
    xyz_m = [[np.interp(s_m, points.s_m[row], axis[row]) for axis in points.xyz_m.T] for row in rows]
    even = Points(
        np.repeat(frame, len(s_m)), np.repeat(points.t_s[first], len(s_m)), np.tile(s_m, len(frame)),
        np.concatenate(np.swapaxes(xyz_m, 1, 2)),
    )  # fmt: skip
    return replace(one.model, recording=replace(one.recording, points=even))


def _spheres(pushed: _Pushed, radius_m: float, most: int) -> Floats:
    """Spheres (M, 4), centre and radius [m], into which the rope dips a little, all round it and along its
    way, in so many frames at most."""
    count = len(pushed.x_m)
    x_m = pushed.x_m[np.linspace(0, count - 1, min(count, most)).astype(int)]
    x_m = x_m.reshape(len(x_m), PLACES, FINER, 3)
    tangent = x_m[:, :, -1] - x_m[:, :, 0]
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    # across the axis that the tangent is least along
    across = np.cross(tangent, np.eye(3)[np.abs(tangent).argmin(axis=-1)])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    turns = 2 * np.pi * np.arange(SIDES)[:, None] / SIDES
    both = across[..., None, :], np.cross(tangent, across)[..., None, :]
    ways = np.cos(turns) * both[0] + np.sin(turns) * both[1]
    radii, depths = (part.ravel() for part in np.meshgrid(RADII_M, DEPTHS_M))
    reach = radii + radius_m
    reach -= np.minimum(depths, DEEPEST * reach)
    centers = x_m[:, :, FINER // 2, None, None] - ways[..., None, :] * reach[:, None]
    radii = np.broadcast_to(radii[:, None], (*centers.shape[:-1], 1))
    return np.concatenate([centers, radii], axis=-1).reshape(-1, 4)


def _gains(pushed: _Pushed, spheres: Floats, radius_m: float) -> Floats:
    """What each sphere (M, 4) would take from χ² (M,)."""
    gains, taken_up = np.zeros(len(spheres)), np.zeros((len(spheres), pushed.shared.shape[-1]))
    for f, x_m in enumerate(pushed.x_m):
        apart = cdist(spheres[:, :3], x_m)
        nearest = apart.argmin(axis=1)
        depth = spheres[:, 3] + radius_m - apart[np.arange(len(spheres)), nearest]
        hit = np.flatnonzero(depth > 0)
        place = nearest[hit] // FINER
        normal = x_m[nearest[hit]] - spheres[hit, :3]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        gives_way = np.einsum("ha,hab,hb->h", normal, pushed.compliance[f, place], normal)
        force = depth[hit] / np.maximum(gives_way, RIGID_M_N)
        gains[hit] -= 2 * force * np.einsum("ha,ha->h", normal, pushed.along[f, place])
        gains[hit] -= force**2 * np.einsum("ha,hab,hb->h", normal, pushed.square[f, place], normal)
        taken_up[hit] += force[:, None] * np.einsum("ha,han->hn", normal, pushed.shared[f, place])
    return np.asarray(gains + np.sum(taken_up**2, axis=1))


__all__ = ["touches"]
