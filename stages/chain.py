"""From depth images to an ordered chain: data/capture → data/recordings/captured."""

from __future__ import annotations

from dataclasses import asdict

from dlolib.calibrate import clock_offset
from dlolib.captures import open_capture
from dlolib.chain import ChainSettings, extract_chain
from dlolib.chain.sheet import write_sheet
from dlolib.files import whole_folder, write_json
from dlolib.formats import write_recording
from dlolib.params import Chain, load_block
from stages import CAPTURED, DATA, REPORTS, run, write_metrics


def main() -> None:
    settings = ChainSettings(**load_block(Chain).model_dump())
    source = open_capture(DATA / "capture")
    result = extract_chain(source, settings)
    write_recording(result.recording, DATA / "recordings" / CAPTURED)
    with whole_folder(REPORTS / "chain") as folder:
        write_json(folder / "metrics.json", result.metrics())
        write_sheet(result, source, folder / "sheet.png")
        # said and not applied: the clocks stay as they were recorded
        clock = clock_offset(result.recording)
        write_json(folder / "clock.json", {**asdict(clock), "says": clock.says})
    write_metrics("chain", result.metrics())
    print(clock.says)


if __name__ == "__main__":
    run(main)
