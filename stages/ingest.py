"""A capture, checked, or another recording made into one: data/<source> → data/capture."""

from __future__ import annotations

from pathlib import Path

from dlolib.captures import ingest
from dlolib.params import Ingest, load_block
from stages import DATA, run


def main() -> None:
    given = load_block(Ingest)
    folder = DATA / given.source

    def inside(name: str | None) -> Path | None:
        return None if name is None else folder / name

    source = inside(given.recording) or folder
    topics = {str(role): topic for role, topic in given.topics.items()}
    ingest(source, DATA / "capture", inside(given.motion), topics, inside(given.object))


if __name__ == "__main__":
    run(main)
