"""From depth images to an ordered chain: data/capture → data/recordings/captured."""

from __future__ import annotations

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
    write_metrics("chain", result.metrics())


if __name__ == "__main__":
    run(main)
