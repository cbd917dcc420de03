"""From a recording to a verdict on what physics is missing: reports/diagnose/<name>."""

from __future__ import annotations

import sys
from pathlib import Path

from dlolib.diagnose import DiagnoseSettings, diagnose, write_diagnosis
from dlolib.files import whole_folder
from dlolib.formats import read_recording
from dlolib.params import Diagnose, Rod, load_block
from stages import REPORTS, run, write_metrics


def main(name: str, path: str) -> None:
    diagnosis = diagnose([read_recording(Path(path))], settings())
    with whole_folder(REPORTS / "diagnose" / name) as folder:
        write_diagnosis(diagnosis, folder)
    verdict = diagnosis.verdict
    figures = {
        "explained": int(verdict.status in ("explained", "ambiguous")),
        "baseline_rmse_m": verdict.baseline.rmse_m,
        "augmented_rmse_m": verdict.augmented.rmse_m,
        "parameters": {key: value.value for key, value in verdict.augmented.parameters.items()},
    }
    write_metrics(f"diagnose_{name}", figures)


def settings() -> DiagnoseSettings:
    """The blocks `rod` and `diagnose` as the diagnosis takes them."""
    return DiagnoseSettings(**load_block(Diagnose).settings(load_block(Rod)))


if __name__ == "__main__":
    run(main, *sys.argv[1:])
