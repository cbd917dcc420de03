"""The laboratory with its law switched to elastic, through chain and identification: reports/elastic.json.

Beside the pipeline (`make elastic`): with nothing missing in the rod, what is left is the error of camera,
chain and discretisation.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from dlolib.captures import open_capture
from dlolib.chain import ChainSettings, extract_chain
from dlolib.files import write_json
from dlolib.identify import identify, summary
from dlolib.lab.record import record
from dlolib.params import Chain, Lab, load_block
from stages import REPORTS, run
from stages.identify import settings
from stages.lab import experiment


def main() -> None:
    made = experiment(load_block(Lab))
    rope = replace(made.rope, law="elastic")
    with tempfile.TemporaryDirectory() as folder:
        capture, truth = Path(folder) / "capture", Path(folder) / "truth"
        record(replace(made, rope=rope), capture, truth)
        chain = ChainSettings(**load_block(Chain).model_dump())
        recording = extract_chain(open_capture(capture), chain).recording
    found = summary(identify([recording], settings()), [recording])
    stiffness = found["parameters"]["bending_stiffness"]
    true = rope.bending_stiffness_n_m2
    figures = {
        "command": "make elastic",
        "bending_stiffness": stiffness,
        "true_ei_n_m2": true,
        "ei_error": stiffness["value"] / true - 1,
        "rmse_m": found["rmse_m"],
        "mean_distance_m": found["mean_distance_m"],
        "heldout_rmse_m": found["heldout_rmse_m"],
    }
    write_json(REPORTS / "elastic.json", figures)
    error = f"{100 * figures['ei_error']:+.2f} %"
    print(f"EI {stiffness['value']:.4g} N m^2, {error}; RMS {1e3 * found['rmse_m']:.2f} mm")


if __name__ == "__main__":
    run(main, *sys.argv[1:])
