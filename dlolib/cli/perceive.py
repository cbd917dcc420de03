"""From cameras to a recording: `dlo ingest`, `dlo chain`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dlolib.cli import given
from dlolib.cli.options import Out
from dlolib.cli.say import print_line
from dlolib.cli.values import parse_topics
from dlolib.outputs import check_out


def ingest(
    source: Annotated[
        Path, typer.Argument(help="A capture folder; a bag, .mcap, .mkv; a folder of images or clouds.")
    ],
    out: Out,
    motion: Annotated[
        Path | None, typer.Option("--motion", metavar="CSV", help="motion.csv, where it lies elsewhere.")
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            "--topic",
            metavar="ROLE=NAME",
            help="Of a bag: which topic is color, depth, camera_info, camera_pose, motion.",
        ),
    ] = None,
    about: Annotated[
        Path | None,
        typer.Option("--object", metavar="FILE", help="What no camera knows, as in capture.json."),
    ] = None,
) -> None:
    """Check every frame of a recording and write it as a capture: dlo-capture/1."""
    from dlolib.captures import ingest as ingest_capture

    check_out(out, "capture.json", source, motion, about)
    index = ingest_capture(source, out, motion, parse_topics(topic or []), about)
    print_line(f"{out}: {len(index.frame)} frames of {index.rope.name}, {index.t_s[-1] - index.t_s[0]:.3g} s")


def chain(
    capture: Annotated[Path, typer.Argument(help="A capture folder.")],
    out: Out,
) -> None:
    """Find the rope in every frame of a capture as a chain of points: dlo-recording/1, and a sheet."""
    from dlolib.calibrate import clock_offset
    from dlolib.captures import open_capture
    from dlolib.chain import ChainSettings, extract_chain, write_sheet
    from dlolib.files import whole_folder
    from dlolib.formats import write_recording

    check_out(out, "sheet.png", capture)
    params = given.params()
    settings = ChainSettings() if params is None else ChainSettings(**params.chain.model_dump())
    source = open_capture(capture)
    result = extract_chain(source, settings)
    with whole_folder(out) as folder:
        write_recording(result.recording, folder)
        write_sheet(result, source, folder / "sheet.png")
    points = result.recording.points
    frames = len(set(points.frame.tolist()))
    print_line(
        f"{out}: {len(points.s_m)} points in {frames} frames of {result.recording.name}; look at sheet.png"
    )
    print_line(clock_offset(result.recording).says)
