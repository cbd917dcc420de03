"""What is no JSON object of a format is refused in one line, whatever it is."""

from __future__ import annotations

from pathlib import Path

import pytest

from dlolib.errors import FormatError
from dlolib.formats import read_fit, read_verdict


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"\xff\xfe{}", "is not text in UTF-8; save it as UTF-8"),
        (b"[]", "holds no JSON object; begin with"),
        (b'{"a": {"rmse_m": 1, "rmse_m": 2}}', "rmse_m: this key is given twice; remove one"),
        (b'"dlo-fit/1"', "holds no JSON object; begin with"),
        # Python's own reader gives up on these in other ways than on what is no JSON
        (b"[" * 100_000, "cannot be read: "),
        (b'{"rmse_m": 1' + b"0" * 5000 + b"}", "cannot be read: "),
    ],
)
def test_what_no_format_is(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "fit.json"
    path.write_bytes(content)
    for read in (read_fit, read_verdict):
        with pytest.raises(FormatError) as caught:
            read(path)
        assert str(caught.value).startswith(f"{path}: {says}")
        assert len(str(caught.value).splitlines()) == 1 and len(str(caught.value)) < 200 + len(str(path))


def test_a_folder_where_a_file_should_be(tmp_path: Path) -> None:
    (tmp_path / "fit.json").mkdir()
    with pytest.raises(FormatError, match="fit.json: is a folder where dlo-fit/1 should be; give a file"):
        read_fit(tmp_path)


def test_a_byte_order_mark_is_no_fault(tmp_path: Path) -> None:
    """Some editors put one before a text that they save as UTF-8."""
    content = b'{"format": "dlo-fit/1", "parameters": {}, "rmse_m": 0.001, "frames": 1, "points": 2}'
    (tmp_path / "fit.json").write_bytes(b"\xef\xbb\xbf" + content)
    assert read_fit(tmp_path).rmse_m == 0.001
