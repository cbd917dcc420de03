"""What the streaming asks of a robot. A new robot is one file beside this one and a line in `ROBOTS`."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from dlolib.types import Floats


class Robot(Protocol):
    """A connected arm. Poses are (6,): tool position [m] and rotation vector [rad] in its base frame.

    No method raises on a fault of the robot: `trouble` says what is wrong, the others return False.
    """

    period_s: float
    """The controller's period [s]: how long one `servo` takes."""

    def pose(self) -> Floats:
        """The tool's present pose, shape (6,)."""
        ...

    def clock_s(self) -> float:
        """The controller's time [s] of the newest sample."""
        ...

    def trouble(self) -> str | None:
        """Why it may not move (on): connection lost, protective stop, not in remote control; or None."""
        ...

    def arm(self) -> None:
        """Make it ready to take commands; nothing moves.

        Raises:
            MotionRefused: the controller does not take commands.
        """
        ...

    def answers(self) -> bool:
        """Whether the controller can be asked about poses: it allows the one in which the robot stands."""
        ...

    def forbids(self, poses: Floats) -> tuple[int, str] | None:
        """The first of the poses (N, 6) that the controller itself cannot or may not reach, and why."""
        ...

    def joints(self, pose: Floats, near: Floats | None) -> Floats:
        """The joint angles [rad] that bring the tool to `pose`, nearest to `near` or to the present ones."""
        ...

    def record(self, raw: Path) -> None:
        """Begin to record into `raw` the columns of `recorded.RECORDED`; samples may repeat."""
        ...

    def stop_recording(self) -> None:
        """End the recording; `raw` is complete up to here."""
        ...

    def approach(self, pose: Floats, speed_m_s: float, acceleration_m_s2: float) -> bool:
        """Begin to move the tool in a straight line to `pose`; returns at once."""
        ...

    def keep_alive(self) -> bool:
        """Tell the controller that we are still there; called many times a second while approaching."""
        ...

    def servo(self, pose: Floats) -> bool:
        """Follow to `pose`; returns after one period."""
        ...

    def stop(self, deceleration_m_s2: float) -> None:
        """End any motion; does nothing where the connection is lost."""
        ...


@dataclass(frozen=True)
class RobotKind:
    """A kind of robot.

    connect: takes the host; connects on entry, lets go on exit, raises MotionRefused where nobody answers.
    end_program: takes the host; ends whatever moves there over a connection of its own, without waiting and
    without raising. It is called where the process that held the connection has died.
    """

    connect: Callable[[str], AbstractContextManager[Robot]]
    end_program: Callable[[str], None]
