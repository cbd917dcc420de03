"""Before the pipeline: params.yaml is whole, and what it names is there or can be pulled."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from dlolib.errors import ParameterError
from dlolib.params import PARAMS, Params, load
from stages import CAPTURED, DATA, LABORATORY, run

CHAIN = DATA / "recordings" / CAPTURED


def main() -> None:
    """Refuse what the pipeline would stumble over after an hour."""
    params = load()
    captured = params.recordings.get(CAPTURED)
    if captured is not None and Path(captured.path) != CHAIN:
        # the report holds it against the capture, and against the laboratory's truth
        raise ParameterError(
            f"{CAPTURED} is what chain makes of the capture, in {CHAIN}, and not {captured.path}",
            file=PARAMS,
            place=f"recordings.{CAPTURED}.path",
            mend="give another recording a name of its own",
        )
    for place, folder in named(params):
        if not folder.exists() and not folder.with_name(f"{folder.name}.dvc").is_file():
            raise ParameterError(
                f"no such folder: {folder}", file=PARAMS, place=place, mend="correct the name, or add it"
            )
    logs = DATA / params.execute.source
    for name in params.layouts if params.execute.source != LABORATORY and logs.exists() else ():
        if not (logs / name / "log.csv").is_file():
            raise ParameterError(
                f"no such file: {logs / name / 'log.csv'}",
                file=PARAMS,
                place="execute.source",
                mend=f"execute {name}, too, or take it out of layouts",
            )


def named(params: Params) -> Iterator[tuple[str, Path]]:
    """The folders that no stage makes, and the key that names each."""
    for name in params.layouts:
        yield "layouts", DATA / "layouts" / name
    for name, entry in params.recordings.items():
        if name != CAPTURED:
            yield f"recordings.{name}.path", Path(entry.path)
    for key, source in (("ingest", params.ingest.source), ("execute", params.execute.source)):
        if source != LABORATORY:
            yield f"{key}.source", DATA / source


if __name__ == "__main__":
    run(main)
