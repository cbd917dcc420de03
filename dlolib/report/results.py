"""What the stages left behind, as the report reads it. What is not there reads as None, never as an error."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import pandas as pd

from dlolib.errors import FormatError
from dlolib.formats import (
    LEARNED_FOR,
    read_capture_index,
    read_fit,
    read_layout,
    read_recording,
    read_verdict,
)
from dlolib.formats.recording import points_table
from dlolib.report.measures import ChainError, chain_error
from dlolib.types import CaptureIndex, Fit, Floats, Layout, Recording, Verdict

CAPTURED = "captured"
"""The recording that the chain stage makes of the capture; the others were recorded elsewhere."""


BLOCKS = {"identify": "recordings", "diagnose": "recordings", "learn": "layouts", "execute": "layouts"}
"""Which block of the parameters names what has a folder in these."""
XYZ = ("x_m", "y_m", "z_m")
TABLES: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("identify", "loss.csv"): ("method", "iteration", "loss_m"),
    ("identify", "shapes.csv"): ("frame", "t_s", "s_m", *XYZ, "sim_x_m", "sim_y_m", "sim_z_m"),
    ("diagnose", "shapes.csv"): (
        "recording", "frame", "t_s", "s_m", *XYZ, "off",
        *(f"{rod}_{x}" for rod in ("elastic", "model") for x in XYZ),
    ),
    ("diagnose", "scan.csv"): ("recording", "s_m", "frame", "gain", "threshold"),
    ("diagnose", "moments.csv"): ("s_m", "curvature_1_m", "moment_n_m"),
    ("learn", "curve.csv"): ("iteration", "loss", "goal_error_mean_m", "min_clearance_m", "contact_margin_m"),
    ("learn", "ablation.csv"): (
        "loss", "seed", "iteration", "value", "goal_error_mean_m", "min_clearance_m", "contact_margin_m",
    ),
    ("learn", "shapes.csv"): ("step", *XYZ),
    ("learn", "trajectory.csv"): ("t_s", "end_x_m", "end_y_m", "end_z_m"),
    ("execute", "shapes.csv"): ("law", "step", *XYZ),
    ("execute", "log.csv"): ("timestamp",),
}  # fmt: skip
"""What the tables of each stage must say, as far as the report asks; what else they hold is optional."""


@dataclass(frozen=True)
class Truth:
    """What only the report may know of the laboratory: the laws, and the true axis at each frame.

    t_s (F,), xyz_m (F, M, 3) [m], s_m (M,) [m].
    """

    laws: Mapping[str, Any]
    t_s: Floats
    xyz_m: Floats
    s_m: Floats

    @property
    def bending_stiffness_n_m2(self) -> float:
        """The rope's true EI [N m²]."""
        return float(self.laws["bending_stiffness_n_m2"])


@dataclass(frozen=True)
class Results:
    """The folders of a run.

    Args:
        folder: the results (identify/, learn/, execute/, *.json).
        data: captures, recordings, layouts and the laboratory's truth.
        has_truth: whether data/truth belongs to this capture (it does where the laboratory made it).
        parameters: the pipeline's parameters, block by block, for the last section; None if unknown. What
            they name no more (layouts, recordings), though results of it still lie there, is not reported.
    """

    folder: Path
    data: Path
    has_truth: bool = True
    parameters: Mapping[str, Any] | None = None

    def json(self, *parts: str) -> dict[str, Any] | None:
        """A JSON object under the results, or None where there is no such file."""
        return read_object(self.folder.joinpath(*parts)) if self._asked_for(parts) else None

    def table(self, stage: str, name: str, file: str) -> pd.DataFrame | None:
        """A CSV that a stage left of a recording or a layout, or None where there is no such file.

        Raises:
            FormatError: it lacks a column that it must have.
        """
        path = self.folder / stage / name / file
        found = read_table(path) if self._asked_for((stage, name)) else None
        absent = [column for column in TABLES[stage, file] if found is not None and column not in found]
        if absent:
            raise FormatError(f"has no column {absent[0]}", file=path, mend="run its stage again")
        return found

    def learned(self, name: str) -> dict[str, Any] | None:
        """The result.json of a layout's learned motion, or None where there is none."""
        return self.json("learn", name, "result.json")

    def played(self, name: str, *apart: str) -> dict[str, dict[str, Any]]:
        """What came of a layout's motion in the laboratory, by rope; none where a robot ran it, or nobody.

        Args:
            name: the layout.
            apart: the folder of a run apart: `without` the verdict.
        """
        ropes: dict[str, dict[str, Any]] = (self.json("execute", name, *apart, "result.json") or {}).get(
            "laws", {}
        )
        return ropes

    def fit(self, name: str) -> Fit | None:
        """What identification found for a recording."""
        path = self.folder / "identify" / name / "fit.json"
        return read_fit(path) if path.is_file() and self._asked_for(("identify", name)) else None

    def verdict(self, name: str) -> Verdict:
        """What the diagnosis says of a recording."""
        return read_verdict(self.folder / "diagnose" / name)

    @cached_property
    def diagnosed(self) -> tuple[str, ...]:
        """Names of the diagnosed recordings: the captured one first, then by name."""
        folders = _folders(self.folder / "diagnose")
        told = [name for name in folders if (self.folder / "diagnose" / name / "verdict.json").is_file()]
        return self._named("recordings", told)

    @cached_property
    def recordings(self) -> tuple[str, ...]:
        """Names of the identified recordings: the captured one first, then by name."""
        return self._named("recordings", _folders(self.folder / "identify"))

    @cached_property
    def layouts(self) -> tuple[str, ...]:
        """Names of the layouts that were learned or executed."""
        return self._named("layouts", _folders(self.folder / "learn") + _folders(self.folder / "execute"))

    def _named(self, block: str, names: list[str]) -> tuple[str, ...]:
        """Those of the names that a block of the parameters still has: the captured one, then by name."""
        given = (self.parameters or {}).get(block, names)
        kept = {name for name in names if name in given}
        return tuple(sorted(kept, key=lambda name: (name != CAPTURED, name)))

    def _asked_for(self, parts: Sequence[str]) -> bool:
        """Whether the parameters still name the recording or layout that a result is of."""
        block = BLOCKS.get(parts[0])
        return block is None or len(parts) < 2 or parts[1] in self._named(block, [parts[1]])

    def layout(self, name: str) -> Layout | None:
        """A layout with its goal and obstacles: as learning left it beside what came of it, else that of the
        data, which may have been changed since or lie elsewhere."""
        paths = (self.folder / "learn" / name / LEARNED_FOR, self.data / "layouts" / name)
        return next((read_layout(path) for path in paths if path.is_dir()), None)

    @cached_property
    def capture(self) -> CaptureIndex | None:
        """The checked capture that the chain was found in."""
        path = self.data / "capture"
        return read_capture_index(path) if path.is_dir() else None

    @cached_property
    def captured(self) -> Recording | None:
        """The recording made of the capture."""
        path = self.data / "recordings" / CAPTURED
        return read_recording(path) if path.is_dir() else None

    @cached_property
    def truth(self) -> Truth | None:
        """The laboratory's truth; None for a capture from a real camera."""
        laws = read_object(self.data / "truth" / "truth.json") if self.has_truth else None
        shapes = self.data / "truth" / "shapes.npz"
        if laws is None or not shapes.is_file():
            return None
        try:
            with np.load(shapes, allow_pickle=False) as arrays:
                return Truth(laws, arrays["t_s"], arrays["xyz_m"], arrays["s_m"])
        except (ValueError, KeyError, EOFError, BadZipFile) as error:
            raise FormatError("holds no shapes", file=shapes, mend="run stage lab again") from error

    @cached_property
    def chain_error(self) -> ChainError | None:
        """The captured chain against the true axis."""
        if self.truth is None or self.captured is None:
            return None
        points = points_table(self.captured.points)
        return chain_error(points, self.truth.t_s, self.truth.xyz_m, self.truth.s_m)


def read_object(path: Path) -> dict[str, Any] | None:
    """A JSON object, or None where there is no file. What it lacks is refused when it is asked for.

    Raises:
        FormatError: the file is there but holds no JSON object.
    """
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise FormatError(f"no JSON ({error})", file=path, mend="run its stage again") from error
    if not isinstance(content, dict):
        raise FormatError("holds no JSON object", file=path, mend="run its stage again")
    said: dict[str, Any] = _said(content, path, ())
    return said


class _Said(dict[str, Any]):
    """An object of a result, which an older version may have written: a key that it lacks is refused in
    one line that says where."""

    def __init__(self, content: Mapping[str, Any], path: Path, place: tuple[str, ...]) -> None:
        super().__init__({key: _said(value, path, (*place, key)) for key, value in content.items()})
        self._path, self._place = path, ".".join(place) or None

    def __missing__(self, key: str) -> Any:
        raise FormatError(f"has no {key}", file=self._path, place=self._place, mend="run its stage again")


def _said(value: Any, path: Path, place: tuple[str, ...]) -> Any:
    if isinstance(value, dict):
        return _Said(value, path, place)
    if isinstance(value, list):
        return [_said(item, path, (*place, str(at))) for at, item in enumerate(value)]
    return value


def read_table(path: Path) -> pd.DataFrame | None:
    """A CSV with a header, or None where there is no file.

    Raises:
        FormatError: the file is there but is no table.
    """
    if not path.is_file():
        return None
    try:
        # a recording may be called 007
        return pd.read_csv(path, dtype={"recording": str})
    except (ValueError, UnicodeDecodeError) as error:
        raise FormatError(f"no CSV table ({error})", file=path, mend="run its stage again") from error


def _folders(path: Path) -> list[str]:
    return (
        [item.name for item in path.iterdir() if item.is_dir() and item.name[0] != "."]
        if path.is_dir()
        else []
    )
