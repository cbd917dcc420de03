"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

Out = Annotated[
    Path, typer.Option("--out", metavar="DIR", help="Folder to write; an earlier result is replaced whole.")
]
Values = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="A value of the rope, such as bending_stiffness=3e-4."),
]
Effects = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="NAME:PARAM=VALUE,...",
        help="Further physics, such as plastic_bending:yield_curvature=8.",
    ),
]
QuasiStatic = Annotated[
    Literal["true", "false"] | None,
    typer.Option("--quasi-static", metavar="BOOL", help="In the place of what the recording says."),
]
VerdictFile = Annotated[
    Path | None, typer.Option("--verdict", metavar="FILE", help="verdict.json of `dlo diagnose`.")
]
FitFile = Annotated[Path | None, typer.Option("--fit", metavar="FILE", help="fit.json of `dlo identify`.")]
