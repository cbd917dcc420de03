"""The columns of log.csv: those of ur_rtde's own recorder for the variables that we ask for."""

from __future__ import annotations

RECORDED: dict[str, int] = {
    "timestamp": 1,
    "target_q": 6,
    "actual_q": 6,
    "actual_TCP_pose": 6,
    "actual_TCP_speed": 6,
    "actual_TCP_force": 6,
    "target_TCP_pose": 6,
    "target_TCP_speed": 6,
    "speed_scaling": 1,
    "robot_mode": 1,
    "safety_mode": 1,
    "runtime_state": 1,
}
"""RTDE's variables in the log, and how many columns ur_rtde's `startFileRecording` gives each."""


def columns(variables: dict[str, int] | None = None) -> list[str]:
    """The header of ur_rtde's recorder: a vector `v` of six gives `v_0` to `v_5`."""
    chosen = RECORDED if variables is None else variables
    return [
        name if size == 1 else f"{name}_{index}" for name, size in chosen.items() for index in range(size)
    ]
