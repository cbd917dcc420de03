"""What recording.json, capture.json and layout.json have in common, as pydantic models.

Types are strict (a number in quotes is refused); keys that the formats do not name are ignored, since
other people's tools write them.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator, model_validator

from dlolib.obstacles import SHAPES
from dlolib.types import Ends, Floats, Obstacle, Pose, Rope

LARGEST_M = 50.0
LARGEST_G_M_S2 = 100.0
# Beyond it the square of a number is none.
LARGEST = 1e100
UNIT_TOLERANCE = 1e-2
POSITIVE = ("radius_m", "height_m", "size_m")
MILLIMETRES = "looks like millimetres; divide by 1000"
# No rope is denser than platinum; one of a density given in g/m is a thousand times too heavy.
DENSEST_KG_M3 = 22e3
# Nor does an arm carry so many kilograms, or a metre that weighs as much.
HEAVIEST = 50.0

Vector3 = Annotated[tuple[float, float, float], Field(strict=False)]
Vector4 = Annotated[tuple[float, float, float, float], Field(strict=False)]
FrameRange = Annotated[tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]], Field(strict=False)]


class Strict(BaseModel):
    """No coercion of types, no NaN, unknown keys ignored."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False, extra="ignore", frozen=True)


def _of_kilograms(value: float) -> float:
    if value > HEAVIEST:
        raise ValueError(f"{value:g} looks like grams; divide by 1000")
    return value


class RopeModel(Strict):
    """The key `object`."""

    name: str = "rope"
    length_m: float = Field(gt=0)
    diameter_m: float | None = Field(default=None, gt=0)
    linear_density_kg_m: Annotated[float, AfterValidator(_of_kilograms)] | None = Field(default=None, gt=0)
    tip_mass_kg: Annotated[float, AfterValidator(_of_kilograms)] | None = Field(default=None, ge=0)

    @field_validator("length_m")
    @classmethod
    def _metres(cls, value: float) -> float:
        if value > LARGEST_M:
            raise ValueError(f"a rope of {value:g} m {MILLIMETRES}")
        return value

    @model_validator(mode="after")
    def _slender(self) -> RopeModel:
        if self.diameter_m is not None and self.diameter_m >= self.length_m:
            raise ValueError(f"diameter_m = {self.diameter_m:g} is not less than length_m: {MILLIMETRES}")
        return self

    @model_validator(mode="after")
    def _of_a_material(self) -> RopeModel:
        if self.diameter_m is None or self.linear_density_kg_m is None:
            return self
        area = 0.25 * np.pi * self.diameter_m**2
        if self.linear_density_kg_m > DENSEST_KG_M3 * area:
            density = self.linear_density_kg_m / area if area else np.inf
            raise ValueError(
                f"linear_density_kg_m = {self.linear_density_kg_m:g} of diameter_m = {self.diameter_m:g} is "
                f"{density:.2g} kg/m³, more than any material has: g/m are to be divided by 1000"
            )
        return self

    def rope(self) -> Rope:
        """The frozen dataclass; a tip mass that was not measured counts as none."""
        return Rope(
            self.name, self.length_m, self.diameter_m, self.linear_density_kg_m, self.tip_mass_kg or 0.0
        )


class EndsModel(Strict):
    """The key `ends`."""

    start: Literal["clamped", "free"]
    end: Literal["clamped", "free"]


class RollModel(Strict):
    """The key `roll_known`."""

    start: bool = True
    end: bool = True


class PoseModel(Strict):
    """The keys `start` and `grasp` of a layout."""

    position_m: Vector3
    quaternion: Vector4

    @field_validator("quaternion")
    @classmethod
    def _unit(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        norm = float(np.linalg.norm(value))
        if norm == 0:
            raise ValueError("is a zero quaternion; give (w, x, y, z) of length 1")
        if abs(norm - 1) > UNIT_TOLERANCE:
            raise ValueError(f"has length {norm:.4g}, not 1; give (w, x, y, z) normalised")
        return value

    def pose(self) -> Pose:
        """The frozen dataclass, the quaternion normalised."""
        quaternion = np.array(self.quaternion, dtype=np.float64)
        return Pose(np.array(self.position_m, dtype=np.float64), quaternion / np.linalg.norm(quaternion))


class Scene(Strict):
    """What a recording, a capture and a layout share."""

    name: str | None = None
    source: str | None = None
    note: str | None = None
    object: RopeModel
    gravity_m_s2: Vector3
    ends: EndsModel
    roll_known: RollModel = RollModel()
    obstacles: list[dict[str, Any]] | None = None

    @field_validator("gravity_m_s2")
    @classmethod
    def _gravity(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if math.hypot(*value) > LARGEST_G_M_S2:
            raise ValueError(f"{math.hypot(*value):g} m/s^2 {MILLIMETRES}")
        return value

    @field_validator("obstacles")
    @classmethod
    def _obstacles(cls, values: list[dict[str, Any]] | None) -> list[dict[str, Any]] | None:
        for index, value in enumerate(values or ()):
            parse_obstacle(value, f"number {index}: ")
        return values

    def gravity(self) -> Floats:
        """Gravity [m/s^2], shape (3,)."""
        return np.array(self.gravity_m_s2, dtype=np.float64)

    def parsed_ends(self) -> Ends:
        """How the ends are held."""
        return Ends(self.ends.start, self.ends.end, self.roll_known.start, self.roll_known.end)

    def parsed_obstacles(self) -> tuple[Obstacle, ...]:
        """The obstacles, directions normalised."""
        return tuple(parse_obstacle(value, "") for value in self.obstacles or ())


def parse_obstacle(value: dict[str, Any], place: str) -> Obstacle:
    """One obstacle with its values checked; a `ValueError` says what is wrong."""
    shape = value.get("shape")
    if not isinstance(shape, str) or shape not in SHAPES:
        raise ValueError(f"{place}unknown shape {shape!r}; valid are {', '.join(SHAPES)}")
    numbers = {
        name: _obstacle_value(value, name, count, f"{place}{shape}: ")
        for name, count in SHAPES[shape].items()
    }
    return Obstacle(shape, numbers)


def _obstacle_value(value: dict[str, Any], name: str, count: int, place: str) -> tuple[float, ...]:
    given = value.get(name)
    listed: list[Any] = given if isinstance(given, list) else [given]
    right = all(isinstance(number, int | float) and not isinstance(number, bool) for number in listed)
    if len(listed) != count or not right or not all(abs(number) < LARGEST for number in listed):
        asked = "a number" if count == 1 else f"{count} numbers"
        raise ValueError(f"{place}{name} = {given!r}; give {asked}")
    numbers = np.array(listed, dtype=np.float64)
    if name in POSITIVE and (numbers <= 0).any():
        raise ValueError(f"{place}{name} = {given!r} is not positive; give a length in metres")
    if name.endswith("_m") and name != "height_m" and (np.abs(numbers) > LARGEST_M).any():
        raise ValueError(f"{place}{name} = {given!r} {MILLIMETRES}")
    if name in ("axis", "normal", "quaternion"):
        norm = float(np.linalg.norm(numbers))
        if norm == 0:
            raise ValueError(f"{place}{name} is zero; give a direction")
        numbers = numbers / norm
    return tuple(float(number) for number in numbers)


def scene_json(
    rope: Rope, gravity_m_s2: Floats, ends: Ends, obstacles: tuple[Obstacle, ...]
) -> dict[str, Any]:
    """The keys of `Scene` beside the name, as JSON values."""
    return {
        "object": {
            "name": rope.name,
            "length_m": rope.length_m,
            "diameter_m": rope.diameter_m,
            "linear_density_kg_m": rope.linear_density_kg_m,
            "tip_mass_kg": rope.tip_mass_kg,
        },
        "gravity_m_s2": [float(value) for value in gravity_m_s2],
        "ends": {"start": ends.start, "end": ends.end},
        "roll_known": {"start": ends.start_roll_known, "end": ends.end_roll_known},
        "obstacles": [_obstacle_json(obstacle) for obstacle in obstacles],
    }


def _obstacle_json(obstacle: Obstacle) -> dict[str, Any]:
    values = {name: list(value) if len(value) > 1 else value[0] for name, value in obstacle.values.items()}
    return {"shape": obstacle.shape, **values}
