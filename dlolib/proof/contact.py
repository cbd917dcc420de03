"""The rope against obstacles: points along it are pushed away, and a tracked cone holds them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from dlolib.errors import ParameterError
from dlolib.types import Floats, Ints, Obstacle

# The rope touches at points a half body apart, each for its length l: pushed back with this times l times
# how deep it is [N/m²], and growing smoothly from nothing over a few times 0.01 mm. A rope that lies on a
# bar (0.4 N/m) or is pulled taut over it (24 N/m) is within 0.04 mm of touching.
HARDNESS_N_M2, SOFT_M = 1e6, 1e-5
# Sideways the surface gives way more, and the cone's edge is rounded by this power.
SIDEWAYS, ROUND = 0.1, 8
SHARES = (0.25, 0.75)


@dataclass(frozen=True)
class Touch:
    """Where the rope touches one obstacle, and what it does to it.

    body (C,); share (C,) of the touched point along its body; force (C, 3) [N]; slope (C, 3, 3), its
    derivative by the point's place [N/m]; points_m (C, 3), the places, and point (C,), their numbers.
    """

    body: Ints
    share: Floats
    force: Floats
    slope: Floats
    points_m: Floats
    point: Ints


class Contact:
    """One sphere or cylinder (as long as need be), with Coulomb friction by a tracked cone.

    The cone's apex follows the material (as MuJoCo's and Cundall and Strack's, Géotechnique 29 (1979), 47):
    a tangential spring grows with the slip since the last step and is cut to the cone.

    Args:
        obstacle: of recording.json, or the hidden one.
        rope_radius_m: comes on top of the obstacle's [m].
        friction: Coulomb's coefficient.
        bodies: of the chain.
        hardness: of the obstacle, force by depth for each metre of rope [N/m²].
    """

    def __init__(
        self,
        obstacle: Obstacle,
        rope_radius_m: float,
        friction: float,
        bodies: int,
        hardness: float = HARDNESS_N_M2,
    ) -> None:
        if obstacle.shape not in ("sphere", "cylinder"):
            raise ParameterError(
                f"the laboratory has no obstacle {obstacle.shape!r}", mend="use sphere or cylinder"
            )
        self.center = np.array(obstacle.values["center_m"], dtype=float)
        self.reach = float(obstacle.values["radius_m"][0]) + rope_radius_m
        axis = np.array(obstacle.values.get("axis", (0.0, 0.0, 0.0)), dtype=float)
        self.across = np.eye(3) - np.outer(axis, axis) / max(axis @ axis, 1e-12)
        self.friction, self.hardness = friction, hardness
        self.body = np.repeat(np.arange(bodies), len(SHARES))
        self.share = np.tile(SHARES, bodies)
        self.held = np.zeros((len(self.body), 3))
        self.before: Floats | None = None

    def touch(self, vertices: Floats) -> Touch:
        """The forces on the chain with these vertices (N + 1, 3) [m]."""
        return self._touch(vertices)[0]

    def depth(self, vertices: Floats) -> float:
        """How far the rope is pulled into the obstacle where it is deepest [m]; negative away from it."""
        away = (self._points(vertices) - self.center) @ self.across
        return float(self.reach - np.linalg.norm(away, axis=1).min())

    def keep(self, vertices: Floats) -> None:
        """Make this step history."""
        touch, held = self._touch(vertices)
        self.held = np.zeros_like(self.held)
        self.held[touch.point] = held
        self.before = self._points(vertices)

    def _points(self, vertices: Floats) -> Floats:
        share = self.share[:, None]
        return np.asarray((1 - share) * vertices[self.body] + share * vertices[self.body + 1])

    def _touch(self, vertices: Floats) -> tuple[Touch, Floats]:
        points = self._points(vertices)
        away = (points - self.center) @ self.across
        distance = np.linalg.norm(away, axis=1)
        point = np.flatnonzero(distance < self.reach + 20 * SOFT_M)
        normal = away[point] / distance[point, None]
        length = float(np.linalg.norm(vertices[1] - vertices[0]))
        spring = self.hardness * length / len(SHARES)
        depth = (self.reach - distance[point]) / SOFT_M
        push = spring * SOFT_M * np.logaddexp(0.0, depth)
        stiff = spring * expit(depth)
        out = normal[:, :, None] * normal[:, None, :]
        slope = (push / distance[point])[:, None, None] * (self.across - out) - stiff[:, None, None] * out
        force, held = push[:, None] * normal, np.zeros((len(point), 3))
        if self.friction and self.before is not None:
            slip = points[point] - self.before[point]
            held, stuck = self._hold(self.held[point], slip, normal, SIDEWAYS * spring, push, stiff)
            force, slope = force + held, slope + stuck
        return Touch(self.body[point], self.share[point], force, slope, points[point], point), held

    def _hold(
        self, held: Floats, slip: Floats, normal: Floats, spring: float, push: Floats, stiff: Floats
    ) -> tuple[Floats, Floats]:
        """Friction (C, 3) and its slope (C, 3, 3): the old one turned with the surface, grown, cut."""
        flat = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        trial = np.einsum("cij,cj->ci", flat, held - spring * slip)
        size = np.maximum(np.linalg.norm(trial, axis=1), 1e-15)
        cone = self.friction * push
        over = np.clip(size / cone, 1e-6, 1e12)
        # (1 + over^p)^(-1/p), the cut to the cone with its corner rounded, and its slope by log(over).
        share = np.exp(-np.logaddexp(0.0, ROUND * np.log(over)) / ROUND)
        fall = -share * expit(ROUND * np.log(over))
        unit = trial / size[:, None]
        along = unit[:, :, None] * unit[:, None, :]
        slope = -spring * (share[:, None, None] * flat + fall[:, None, None] * along)
        steeper = -fall * size * stiff / push
        slope -= steeper[:, None, None] * unit[:, :, None] * normal[:, None, :]
        return trial * share[:, None], slope
