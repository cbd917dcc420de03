"""A trajectory in the laboratory, or what a robot's log says of it. A pipeline never moves a robot."""

from __future__ import annotations

import json
import sys

import pandas as pd

from dlolib.execute import execute_from_log
from dlolib.execute.laboratory import execute_in_lab
from dlolib.files import whole_folder
from dlolib.formats import read_layout, read_motion
from dlolib.lab.rope import LabRope
from dlolib.params import Execute, Lab, load_block
from stages import DATA, LABORATORY, REPORTS, WITHOUT, run, write_metrics


def main(name: str) -> None:
    settings = load_block(Execute)
    learned = REPORTS / "learn" / name
    trajectory = read_motion(learned / "trajectory.csv")
    with whole_folder(REPORTS / "execute" / name) as out:
        if settings.source == LABORATORY:
            layout = read_layout(DATA / "layouts" / name)
            rope = LabRope(**load_block(Lab).rope.model_dump())
            shapes = pd.read_csv(learned / "shapes.csv")
            execute_in_lab(trajectory, layout, rope, settings.laws, shapes).write(out)
            without = read_motion(learned / WITHOUT / "trajectory.csv")
            execute_in_lab(without, layout, rope, settings.laws).write(out / WITHOUT)
        else:
            execute_from_log(trajectory, DATA / settings.source / name, out)
    result = json.loads((REPORTS / "execute" / name / "result.json").read_text(encoding="utf-8"))
    write_metrics(f"execute_{name}", {key: value for key, value in result.items() if key != "reason"})


if __name__ == "__main__":
    run(main, *sys.argv[1:])
