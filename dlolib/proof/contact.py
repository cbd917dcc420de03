"""The rope against obstacles: every body pushes where it is nearest, and a tracked cone holds it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlolib.errors import ParameterError
from dlolib.types import Floats, Ints, Obstacle

# A body of length l pushes back with this times l times how deep it is [N/m²]: 0.02 N on 5 mm of rope is
# 4 µm.
STIFFNESS_N_M2 = 1e6


@dataclass(frozen=True)
class Touch:
    """Where bodies touch one obstacle, and what it does to them.

    body (C,); share (C,) of the touched point along its body; force (C, 3) [N]; slope (C, 3, 3), its
    derivative by the point's place [N/m]; held (C, 3), the part of the force that is friction [N].
    """

    body: Ints
    share: Floats
    force: Floats
    slope: Floats
    held: Floats


class Contact:
    """One sphere or cylinder (as long as need be), with Coulomb friction by a tracked cone.

    The cone's apex follows the material (as MuJoCo's and Cundall and Strack's, Géotechnique 29 (1979), 47):
    a tangential spring grows with the slip since the last step and is cut to the cone.

    Args:
        obstacle: of recording.json, or the hidden one.
        rope_radius_m: comes on top of the obstacle's [m].
        friction: Coulomb's coefficient.
        bodies: of the chain.
    """

    def __init__(self, obstacle: Obstacle, rope_radius_m: float, friction: float, bodies: int) -> None:
        if obstacle.shape not in ("sphere", "cylinder"):
            raise ParameterError(
                f"the laboratory has no obstacle {obstacle.shape!r}", mend="use sphere or cylinder"
            )
        self.center = np.array(obstacle.values["center_m"], dtype=float)
        self.reach = float(obstacle.values["radius_m"][0]) + rope_radius_m
        axis = np.array(obstacle.values.get("axis", (0.0, 0.0, 0.0)), dtype=float)
        self.across = np.eye(3) - np.outer(axis, axis) / max(axis @ axis, 1e-12)
        self.friction = friction
        self.held = np.zeros((bodies, 3))
        self.before: Floats | None = None

    def touch(self, vertices: Floats) -> Touch:
        """The forces on the chain with these vertices (N + 1, 3) [m]."""
        side = np.diff(vertices, axis=0)
        length = np.linalg.norm(side, axis=1)
        offset = (vertices[:-1] - self.center) @ self.across
        flat = side @ self.across
        share = np.clip(
            -np.sum(offset * flat, axis=1) / np.maximum(np.sum(flat**2, axis=1), 1e-12), 0.0, 1.0
        )
        away = offset + share[:, None] * flat
        distance = np.linalg.norm(away, axis=1)
        body = np.flatnonzero(distance < self.reach)
        normal = away[body] / distance[body, None]
        spring = STIFFNESS_N_M2 * length[body]
        push = spring * (self.reach - distance[body])
        out = normal[:, :, None] * normal[:, None, :]
        slope = -spring[:, None, None] * out
        slope += (push / distance[body])[:, None, None] * (self.across - out)
        force, held = push[:, None] * normal, np.zeros((len(body), 3))
        if self.friction and self.before is not None:
            moved = vertices - self.before
            slip = moved[:-1] + share[:, None] * np.diff(moved, axis=0)
            held, stuck = self._hold(body, slip[body], normal, spring, push)
            force, slope = force + held, slope + stuck
        return Touch(body, share[body], force, slope, held)

    def _hold(
        self, body: Ints, slip: Floats, normal: Floats, spring: Floats, push: Floats
    ) -> tuple[Floats, Floats]:
        """Friction (C, 3) and its slope (C, 3, 3): the old one turned with the surface, grown, cut."""
        flat = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        trial = np.einsum("cij,cj->ci", flat, self.held[body] - spring[:, None] * slip)
        size = np.maximum(np.linalg.norm(trial, axis=1), 1e-12)
        cone = self.friction * push
        slides = size > cone
        share = np.where(slides, cone / size, 1.0)
        unit = np.where(slides[:, None], trial / size[:, None], 0.0)
        kept = flat - unit[:, :, None] * unit[:, None, :]
        slope = -(share * spring)[:, None, None] * kept
        slope -= (self.friction * spring)[:, None, None] * unit[:, :, None] * normal[:, None, :]
        return trial * share[:, None], slope

    def keep(self, vertices: Floats) -> None:
        """Make this step history."""
        touch = self.touch(vertices)
        self.held = np.zeros_like(self.held)
        self.held[touch.body] = touch.held
        self.before = vertices.copy()
