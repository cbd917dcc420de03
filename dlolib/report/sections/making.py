"""How it was made: parameters and versions, without host or date."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from dlolib import __version__
from dlolib.report.model import Block, Column, Missing, Paragraph, Section, Table
from dlolib.report.results import Results
from dlolib.report.text import title

PACKAGES = (
    "quadrants",
    "numpy",
    "scipy",
    "opencv-python-headless",
    "open3d-cpu",
    "open3d",
    "mujoco",
    "matplotlib",
    "typst",
)


def section(results: Results, figures: Path) -> Section:
    """The parameters block by block and the versions of what computed them."""
    blocks: list[Block] = [
        Paragraph(
            "This page and the PDF are two renderings of `report.json` and the figures beside it. "
            "Nothing in it depends on the date or on the machine's name: `make repro` with the same "
            "parameters gives the same numbers, and `make compare` holds them against the committed ones."
        )
    ]
    if results.parameters:
        columns = (
            Column("Block", align="left"),
            Column(("Parameters, each with its unit at the end of its name"), align=("wide")),
        )
        rows = tuple(row for block, values in results.parameters.items() for row in _rows(str(block), values))
        blocks.append(Table("The parameters of the run (`params.yaml`).", columns, rows))
    else:
        blocks.append(Missing("The parameters of the run were not given to this report."))
    made = (("dlolib", __version__), *((name, found) for name in PACKAGES if (found := _version(name))))
    blocks.append(
        Table("Versions.", (Column("Package", align="left"), Column("Version", align="wide")), made)
    )
    return Section("making", "How it was made", tuple(blocks))


def _rows(block: str, values: Any) -> list[tuple[str, str]]:
    if not isinstance(values, Mapping):
        return [(title(block), _plain(values))]
    return [(title(block), "; ".join(f"`{key}` {_plain(value)}" for key, value in values.items()))]


def _plain(value: Any) -> str:
    """A value as params.yaml has it."""
    if isinstance(value, Mapping | list | tuple) and not value:
        return "{}" if isinstance(value, Mapping) else "[]"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_plain(inner)}" for key, inner in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_plain(inner) for inner in value)
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return f"{value:g}" if isinstance(value, float) else str(value)


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
