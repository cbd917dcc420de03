"""A capture, the laboratory's or one's own, checked: data/<source> → data/capture."""

from __future__ import annotations

from dlolib.captures import ingest
from dlolib.params import Ingest, load_block
from stages import DATA, run


def main() -> None:
    ingest(DATA / load_block(Ingest).source, DATA / "capture")


if __name__ == "__main__":
    run(main)
