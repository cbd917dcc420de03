"""The virtual laboratory records its rope: data/lab, a capture, and data/truth, which report alone reads."""

from __future__ import annotations

import sys

from dlolib.files import whole_folder, write_json
from dlolib.lab.camera import Sensor
from dlolib.lab.record import Experiment, record
from dlolib.lab.rope import LabRope
from dlolib.params import Ingest, Lab, load_block
from stages import DATA, LABORATORY, run

CAPTURE, TRUTH = DATA / "lab", DATA / "truth"


def main() -> None:
    source = load_block(Ingest).source
    if source != LABORATORY:
        stay_off(source)
        return
    record(experiment(load_block(Lab)), CAPTURE, TRUTH)


def experiment(block: Lab) -> Experiment:
    """The block `lab` as the laboratory takes it."""
    return Experiment(
        rope=LabRope(**block.rope.model_dump()),
        sensor=Sensor(**block.sensor.model_dump()),
        waypoints=block.waypoints,
        waypoint_interval_s=block.waypoint_interval_s,
        frame_every=block.frame_every,
    )


def stay_off(source: str) -> None:
    """Leave an empty capture, and say in the truth's place that there is none."""
    print(f"the laboratory is off: ingest.source is {source}", file=sys.stderr)
    with whole_folder(CAPTURE):
        pass
    with whole_folder(TRUTH) as folder:
        write_json(folder / "truth.json", {"source": source, "truth": None})


if __name__ == "__main__":
    run(main, *sys.argv[1:])
