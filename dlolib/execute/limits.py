"""What a robot may do and how it holds the rope: plain values, and light to import."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dlolib.types import Floats

Row = tuple[float, float, float, float]
Matrix = tuple[Row, Row, Row, Row]
Point = tuple[float, float, float]
Joints = tuple[float, float, float, float, float, float]
IDENTITY: Matrix = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
BOX: tuple[Point, Point] = ((-0.85, -0.85, -0.85), (0.85, 0.85, 0.85))

LOOKAHEAD_S = 0.1
"""The servo's look-ahead [s]: UR's servoj filters its target over it (script manual: 0.03 to 0.2 s)."""
ROUNDING = 1e-9


@dataclass(frozen=True)
class Limits:
    """What a path may ask of the robot, in its base frame; the defaults suit a UR5e beside people.

    workspace_m: two opposite corners of the box that the tool stays in. reach_m: the tool's largest
    distance from the base's origin (UR5e's data sheet: 850 mm). acceleration_m_s2 and
    angular_acceleration_rad_s2: all changes of velocity within the servo's look-ahead, over its length,
    from rest to rest; it also approaches and stops with the first. step_m, step_rad: between two
    rows of the trajectory. joints_rad: lowest and highest angle of each joint, asked of the robot's own
    inverse kinematics, or None.
    """

    workspace_m: tuple[Point, Point] = BOX
    reach_m: float = 0.85
    speed_m_s: float = 0.25
    angular_speed_rad_s: float = 1.0
    acceleration_m_s2: float = 2.5
    angular_acceleration_rad_s2: float = 10.0
    approach_speed_m_s: float = 0.05
    step_m: float = 0.02
    step_rad: float = 0.2
    joints_rad: tuple[Joints, Joints] | None = None


@dataclass(frozen=True)
class RobotConfig:
    """The content of robot.json; without one the world is the robot's base frame and the grasp its TCP.

    base_from_world, tool_from_grasp: rigid 4x4 matrices. The tool is the controller's active TCP, the
    grasp the pose of the moved end in trajectory.csv. time_scale: the trajectory runs this much slower.
    """

    robot: str = "ur"
    base_from_world: Matrix = IDENTITY
    tool_from_grasp: Matrix = IDENTITY
    limits: Limits = Limits()
    time_scale: float = 1.0

    def matrices(self) -> tuple[Floats, Floats]:
        """base_from_world and tool_from_grasp as arrays, each (4, 4)."""
        return np.array(self.base_from_world), np.array(self.tool_from_grasp)

    def content(self) -> dict[str, Any]:
        """What robot.json holds, for writing it back."""
        return asdict(self)


def outside(places_m: Floats, limits: Limits) -> tuple[int, str] | None:
    """The first of the places (N, 3) [m] outside workspace or reach, with what is wrong; None if none is."""
    low, high = (np.array(corner) for corner in limits.workspace_m)
    far = np.linalg.norm(places_m, axis=1)
    leaves = np.any((places_m < low - ROUNDING) | (places_m > high + ROUNDING), axis=1).reshape(-1)
    bad = np.flatnonzero(leaves | (far > limits.reach_m + ROUNDING))
    if not bad.size:
        return None
    row = int(bad[0])
    where = ", ".join(f"{value:.3f}" for value in places_m[row])
    if leaves[row]:
        return row, f"the tool at ({where}) m leaves the workspace {low.tolist()} to {high.tolist()} m"
    return (
        row,
        f"the tool at ({where}) m is {far[row]:.3f} m away, beyond the reach of {limits.reach_m:g} m",
    )
