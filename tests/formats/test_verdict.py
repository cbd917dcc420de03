"""verdict.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from formats import samples
from report.diagnosed import verdict

from dlolib.errors import FormatError
from dlolib.formats import read_verdict, write_verdict


def test_round_trip_from_file_and_folder(tmp_path: Path) -> None:
    write_verdict(verdict(), tmp_path)
    again = read_verdict(tmp_path)
    assert again == read_verdict(tmp_path / "verdict.json") == verdict()
    write_verdict(again, tmp_path / "other.json")
    assert (tmp_path / "other.json").read_bytes() == (tmp_path / "verdict.json").read_bytes()


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("format", "dlo-fit/1", "format: says 'dlo-fit/1', expected 'dlo-verdict/1'"),
        ("status", "perhaps", "status: Input should be 'no_mismatch', 'explained'"),
        ("augmented.rmse_m", "1e-3", "augmented.rmse_m: Input should be a valid number"),
        ("effects.0.name", 7, "effects.0.name: Input should be a valid string"),
        ("next_motion.file", None, "next_motion.file: Input should be a valid string"),
    ],
)
def test_a_bad_key_is_named(tmp_path: Path, key: str, value: Any, says: str) -> None:
    write_verdict(verdict(), tmp_path)
    samples.set_key(tmp_path / "verdict.json", key, value)
    with pytest.raises(FormatError) as caught:
        read_verdict(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path / 'verdict.json'}: {says}")


def test_a_key_that_is_lacking_is_named(tmp_path: Path) -> None:
    write_verdict(verdict(), tmp_path)
    content = json.loads((tmp_path / "verdict.json").read_text())
    del content["candidates"]
    (tmp_path / "verdict.json").write_text(json.dumps(content))
    with pytest.raises(FormatError, match="verdict.json: candidates: Field required; take the file as"):
        read_verdict(tmp_path)
