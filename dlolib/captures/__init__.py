"""Captures: what a camera and a robot recorded, one file per kind of source behind one Protocol."""

from dlolib.captures.base import Frame, Source
from dlolib.captures.ingest import ingest, open_capture

__all__ = ["Frame", "Source", "ingest", "open_capture"]
