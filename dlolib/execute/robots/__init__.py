"""The robots that a trajectory can run on."""

from __future__ import annotations

from dlolib.execute.robots.base import Robot, RobotKind
from dlolib.execute.robots.ur import UR

ROBOTS: dict[str, RobotKind] = {"ur": UR}
"""By the key `robot` of robot.json."""

__all__ = ["ROBOTS", "Robot", "RobotKind"]
