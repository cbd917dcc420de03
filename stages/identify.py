"""From a recording to stiffnesses with intervals: reports/identify/<name>."""

from __future__ import annotations

import sys
from pathlib import Path

from dlolib.formats import read_recording
from dlolib.identify import (
    Descended,
    DescentSettings,
    IdentifySettings,
    descend,
    identify,
    summary,
    write_identified,
)
from dlolib.params import Identify, Rod, load_block
from dlolib.types import Recording
from stages import REPORTS, run, write_metrics


def main(name: str, path: str) -> None:
    recording = read_recording(Path(path))
    identified = identify([recording], settings())
    descended = _paper(name, recording)
    write_identified(identified, [recording], REPORTS / "identify" / name, descended)
    write_metrics(f"identify_{name}", summary(identified, [recording], descended))


def settings() -> IdentifySettings:
    """The blocks `rod` and `identify` as identification takes them."""
    return IdentifySettings(**load_block(Identify).settings(load_block(Rod)))


def _paper(name: str, recording: Recording) -> Descended | None:
    """The paper's gradient descent, where it is asked for."""
    block = load_block(Identify)
    if block.method != "gradient_descent" and name not in block.paper_on:
        return None
    return descend(recording, DescentSettings(**block.paper.model_dump()), settings())


if __name__ == "__main__":
    run(main, *sys.argv[1:])
