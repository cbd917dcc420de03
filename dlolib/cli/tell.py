"""What came of it, on paper: `dlo report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dlolib.cli import given
from dlolib.cli.say import print_line


def report(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the report and its figures.")],
    results: Annotated[Path, typer.Argument(help="What the stages left behind.")] = Path("reports"),
) -> None:
    """Write report.html and report.pdf, with their numbers in report.json."""
    from dlolib.report import build_report

    # what this folder's params.yaml says is of what lies here, and of no other results
    params = given.params() if results.resolve() == Path("reports").resolve() else None
    page = build_report(
        results,
        out,
        has_truth=params is None or params.ingest.source == "lab",
        parameters=None if params is None else params.model_dump(mode="json"),
    )
    print_line(str(page))
