"""fit.json: what identification found (format "dlo-fit/1")."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from dlolib.files import write_json
from dlolib.formats._json import checked, read_json
from dlolib.formats._schema import RopeModel, Strict
from dlolib.types import Estimate, Fit

FORM = "dlo-fit/1"
FILE = "fit.json"
POSITIVE = ("bending_stiffness", "torsional_stiffness", "linear_density")


class EstimateModel(Strict):
    """One parameter with its interval."""

    value: float
    low: float | None = None
    high: float | None = None
    unit: str = ""

    @model_validator(mode="after")
    def _ordered(self) -> EstimateModel:
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"low = {self.low:g} is above high = {self.high:g}; swap them")
        return self

    def estimate(self) -> Estimate:
        """The frozen dataclass."""
        return Estimate(self.value, self.low, self.high, self.unit)


class FitModel(Strict):
    """fit.json."""

    parameters: dict[str, EstimateModel]
    nuisances: dict[str, dict[str, EstimateModel]] = Field(default_factory=dict)
    rmse_m: float = Field(ge=0)
    frames: int = Field(ge=0)
    points: int = Field(ge=0)
    rope: RopeModel | None = None

    @model_validator(mode="after")
    def _positive(self) -> FitModel:
        for name, estimate in self.parameters.items():
            if name.startswith(POSITIVE) and estimate.value <= 0:
                raise ValueError(f"{name} = {estimate.value:g} is not positive; give a value above 0")
        return self


def read_fit(path: Path) -> Fit:
    """Read a fit from its file, or from the folder that holds fit.json.

    Raises:
        FormatError: names the file, the key and the mend.
    """
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    model = checked(FitModel, read_json(path, FORM), path)
    nuisances = {name: _estimates(values) for name, values in model.nuisances.items()}
    rope = None if model.rope is None else model.rope.rope()
    return Fit(_estimates(model.parameters), model.rmse_m, model.frames, model.points, nuisances, rope)


def write_fit(fit: Fit, path: Path) -> None:
    """Write a fit to `path`, or to fit.json in it where it is a folder."""
    path = Path(path)
    content = {
        "format": FORM,
        "parameters": _plain(fit.parameters),
        "nuisances": {name: _plain(values) for name, values in fit.nuisances.items()},
        "rmse_m": fit.rmse_m,
        "frames": fit.frames,
        "points": fit.points,
        "rope": None if fit.rope is None else vars(fit.rope),
    }
    write_json(path / FILE if path.is_dir() else path, content)


def _estimates(values: Mapping[str, EstimateModel]) -> dict[str, Estimate]:
    return {name: value.estimate() for name, value in values.items()}


def _plain(values: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: vars(value) for name, value in values.items()}
