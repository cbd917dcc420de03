"""What the held end must not enter on a robot: the obstacles that its path was learned among.

A path keeps clear of them; the straight way to its first pose, from wherever the robot stands, need not.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.execute.limits import IDENTITY, Matrix, RobotConfig
from dlolib.formats.geometry import signed_distance
from dlolib.types import Floats, Layout, Obstacle


@dataclass(frozen=True)
class Surroundings:
    """Obstacles in the world, the rope's radius [m], and the two matrices of `RobotConfig`."""

    obstacles: tuple[Obstacle, ...] = ()
    radius_m: float = 0.0
    base_from_world: Matrix = IDENTITY
    tool_from_grasp: Matrix = IDENTITY

    @classmethod
    def of(cls, layout: Layout, config: RobotConfig) -> Self:
        """Those of a layout, as a robot that stands so meets them."""
        return cls(layout.obstacles, layout.rope.radius_m, config.base_from_world, config.tool_from_grasp)

    @classmethod
    def read(cls, content: dict[str, Any]) -> Self:
        """From what `content` gave, once it has been JSON."""
        return cls(**{**content, "obstacles": tuple(Obstacle(**one) for one in content["obstacles"])})

    def content(self) -> dict[str, Any]:
        """What a process of its own can be told."""
        return asdict(self)

    def entered(self, poses: Floats) -> tuple[int, str] | None:
        """The first of the tool's poses (N, 6) in the base frame with which the held end enters an obstacle,
        and how; None where none does."""
        base, grasp = np.array(self.base_from_world), np.array(self.tool_from_grasp)
        end_m = poses[:, :3] + Rotation.from_rotvec(poses[:, 3:]).apply(grasp[:3, 3])
        end_m = (end_m - base[:3, 3]) @ base[:3, :3]
        for number, obstacle in enumerate(self.obstacles):
            depth_m = self.radius_m - signed_distance(obstacle, end_m)
            bad = np.flatnonzero(depth_m > 0)
            if bad.size:
                deepest = 1e3 * float(depth_m.max())
                what = f"obstacle {number} ({obstacle.shape})"
                return int(bad[0]), f"the held end would go {deepest:.1f} mm into {what}"
        return None
