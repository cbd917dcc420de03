"""Calibration: where the camera stands against the robot, what stands around, whether the clocks agree."""

from dlolib.calibrate.hand_eye import HandEye, calibrate_hand_eye
from dlolib.calibrate.picture import draw_hand_eye, draw_obstacles
from dlolib.calibrate.robot_clock import ClockOffset, clock_offset
from dlolib.calibrate.standing import FoundObstacle, find_obstacles
from dlolib.calibrate.write import put_into_capture, write_calibration

__all__ = [
    "ClockOffset",
    "FoundObstacle",
    "HandEye",
    "calibrate_hand_eye",
    "clock_offset",
    "draw_hand_eye",
    "draw_obstacles",
    "find_obstacles",
    "put_into_capture",
    "write_calibration",
]
