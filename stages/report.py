"""All of it on paper: reports/report.html, report.pdf and report.json."""

from __future__ import annotations

import json

from dlolib.errors import DloError
from dlolib.params import load
from dlolib.report import build_report
from stages import DATA, LABORATORY, REPORTS, run, write_metrics


def main() -> None:
    params = load()
    build_report(
        REPORTS,
        REPORTS,
        data=DATA,
        has_truth=params.ingest.source == LABORATORY,
        parameters=params.model_dump(mode="json"),
    )
    write_metrics("report", read_headline())


def read_headline() -> dict[str, object]:
    """The five figures of report.json.

    Raises:
        DloError: there is no report.
    """
    path = REPORTS / "report.json"
    if not path.is_file():
        raise DloError("no such file", file=path, mend="run make repro first")
    return dict(json.loads(path.read_text(encoding="utf-8"))["headline"])


if __name__ == "__main__":
    run(main)
