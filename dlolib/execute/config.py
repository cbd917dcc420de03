"""robot.json: where the robot stands, how it holds the rope, and what it may do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from dlolib.errors import FormatError
from dlolib.execute.limits import BOX, IDENTITY, Joints, Limits, Matrix, Point, RobotConfig
from dlolib.execute.robots import ROBOTS
from dlolib.formats import read_object, say

LARGEST_M = 50.0
RIGID = 1e-3

Positive = Annotated[float, Field(gt=0)]


class _Border(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


class _LimitsModel(_Border):
    """The key `limits`."""

    workspace_m: tuple[Point, Point] = BOX
    reach_m: Positive = Limits.reach_m
    speed_m_s: Positive = Limits.speed_m_s
    angular_speed_rad_s: Positive = Limits.angular_speed_rad_s
    acceleration_m_s2: Positive = Limits.acceleration_m_s2
    angular_acceleration_rad_s2: Positive = Limits.angular_acceleration_rad_s2
    approach_speed_m_s: Annotated[float, Field(gt=0, le=0.25)] = Limits.approach_speed_m_s
    step_m: Positive = Limits.step_m
    step_rad: Positive = Limits.step_rad
    joints_rad: tuple[Joints, Joints] | None = None

    @field_validator("workspace_m", "joints_rad")
    @classmethod
    def _ordered(cls, value: tuple[tuple[float, ...], ...] | None) -> tuple[tuple[float, ...], ...] | None:
        if value is not None and not (np.array(value[0]) < np.array(value[1])).all():
            raise ValueError("the first row is not below the second; give [lowest, highest]")
        return value


class _RobotModel(_Border):
    """robot.json."""

    robot: str = RobotConfig.robot
    base_from_world: Matrix
    tool_from_grasp: Matrix = IDENTITY
    limits: _LimitsModel = _LimitsModel()
    time_scale: Annotated[float, Field(ge=1)] = 1.0

    @field_validator("robot")
    @classmethod
    def _known(cls, value: str) -> str:
        if value not in ROBOTS:
            raise ValueError(f"unknown robot {value!r}; valid are {', '.join(ROBOTS)}")
        return value

    @field_validator("base_from_world", "tool_from_grasp")
    @classmethod
    def _rigid(cls, value: Matrix) -> Matrix:
        matrix = np.array(value)
        turn = matrix[:3, :3]
        orthogonal = np.abs(turn @ turn.T - np.eye(3)).max() < RIGID and np.linalg.det(turn) > 0
        if not orthogonal or np.abs(matrix[3] - [0, 0, 0, 1]).max() > 0:
            raise ValueError("is no rigid motion; give [[R, t], [0, 0, 0, 1]] row by row, R a rotation")
        if np.abs(matrix[:3, 3]).max() > LARGEST_M:
            raise ValueError("looks like millimetres; give the translation in metres")
        return value


def read_robot(file: Path | None) -> RobotConfig:
    """Read robot.json; None gives the defaults, which is said: they are of no arm in particular.

    Raises:
        FormatError: names file, key and mend.
    """
    if file is None:
        where = "the world of the recordings is taken for the robot's base frame, the grasp for its tool"
        say([f"without --robot {where}; give robot.json (base_from_world, tool_from_grasp) if they are not"])
        return RobotConfig()
    path = Path(file)
    content = read_object(path, "robot.json")
    try:
        # as JSON again: there a tuple is a list, strictly
        model = _RobotModel.model_validate_json(json.dumps(content))
    except ValidationError as error:
        raise _refusal(error, path) from error
    given = model.model_dump()
    return RobotConfig(**{**given, "limits": Limits(**given["limits"])})


def _refusal(error: ValidationError, path: Path) -> FormatError:
    """The first violation as one line with the key's path."""
    first = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in first["loc"]) or None
    problem, _, mend = first["msg"].removeprefix("Value error, ").partition("; ")
    if first["type"] == "extra_forbidden":
        model = _LimitsModel if place and place.startswith("limits.") else _RobotModel
        problem, mend = "unknown key", f"valid are {', '.join(model.model_fields)}"
    return FormatError(problem, file=path, place=place, mend=mend or "correct the value")
