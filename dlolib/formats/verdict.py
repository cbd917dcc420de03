"""verdict.json: what a diagnosis says (format "dlo-verdict/1")."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from dlolib.errors import FormatError
from dlolib.files import write_json
from dlolib.formats._json import read_json
from dlolib.types import Verdict

FORM = "dlo-verdict/1"
FILE = "verdict.json"


def read_verdict(path: Path) -> Verdict:
    """Read a verdict from its file, or from the folder that holds verdict.json.

    Raises:
        FormatError: names the file, the key and the mend.
    """
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    content = read_json(path, FORM)
    try:
        told = json.dumps({k: v for k, v in content.items() if k != "format"})
        return TypeAdapter(Verdict).validate_json(told, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        mend = "take the file as `dlo diagnose` wrote it"
        raise FormatError(first["msg"], file=path, place=place, mend=mend) from error


def write_verdict(verdict: Verdict, path: Path) -> None:
    """Write a verdict to `path`, or to verdict.json in it where it is a folder."""
    path = Path(path)
    write_json(path / FILE if path.is_dir() else path, {"format": FORM, **asdict(verdict)})
