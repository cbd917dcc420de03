"""Runs a learned trajectory on a robot; `dlolib.execute.laboratory` runs it in the laboratory.

Names are loaded when they are first used: the driver, which starts as a process of its own, needs few of
them, and none of them needs MuJoCo.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dlolib.execute.config import read_robot
    from dlolib.execute.limits import Limits, RobotConfig
    from dlolib.execute.log import ExecutionResult, RobotLog, evaluate, read_log
    from dlolib.execute.path import check_path, path_in_base
    from dlolib.execute.robot_run import execute_from_log, execute_on_robot

__all__ = [
    "ExecutionResult",
    "Limits",
    "RobotConfig",
    "RobotLog",
    "check_path",
    "evaluate",
    "execute_from_log",
    "execute_on_robot",
    "path_in_base",
    "read_log",
    "read_robot",
]
HOMES = {
    "config": ("read_robot",),
    "limits": ("Limits", "RobotConfig"),
    "log": ("ExecutionResult", "RobotLog", "evaluate", "read_log"),
    "path": ("check_path", "path_in_base"),
    "robot_run": ("execute_from_log", "execute_on_robot"),
}


def __getattr__(name: str) -> Any:
    for home, names in HOMES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{home}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
