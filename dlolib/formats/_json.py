"""JSON at the border: parsed strictly, checked by a pydantic model, refused in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from dlolib.errors import FormatError

Model = TypeVar("Model", bound=BaseModel)
MENDS = {
    "missing": "add the key",
    "finite_number": "give a finite number",
    "greater_than": "give a larger value",
    "greater_than_equal": "give a larger value",
    "less_than_equal": "give a smaller value",
    "float_type": "give a number without quotes",
    "int_type": "give a whole number",
    "bool_type": "give true or false",
    "too_short": "give as many numbers as the format asks",
    "too_long": "give as many numbers as the format asks",
}


def existing(path: Path, what: str) -> Path:
    """Return `path` where it is a file; else a `FormatError` that says whether its folder exists."""
    if path.is_file():
        return path
    if path.is_dir():
        raise FormatError(f"is a folder where {what} should be", file=path, mend="give a file")
    if path.parent.is_dir():
        raise FormatError(f"no such file ({what})", file=path, mend="add it or correct the path")
    if path.parent.is_file():
        raise FormatError("is a file where a folder should be", file=path.parent, mend="give the folder")
    raise FormatError("no such folder", file=path.parent, mend="correct the path")


def read_json(path: Path, form: str) -> dict[str, Any]:
    """Parse the JSON object in `path` and check that its `format` is `form`."""
    existing(path, form)
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"), parse_constant=_refuse_constant)
    except UnicodeDecodeError as error:
        raise FormatError("is not text in UTF-8", file=path, mend="save it as UTF-8") from error
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise FormatError(
            f"is not JSON: {error.msg}", file=path, place=place, mend="mend it there"
        ) from error
    except _ConstantError as error:
        raise FormatError(f"{error} is not JSON", file=path, mend="give a finite number or null") from error
    except (ValueError, RecursionError) as error:
        # numbers of thousands of digits, and lists in lists without end
        raise FormatError(f"cannot be read: {str(error)[:80]}", file=path, mend="mend it") from error
    if not isinstance(content, dict):
        raise FormatError("holds no JSON object", file=path, mend='begin with {"format": ...}')
    if content.get("format") != form:
        problem = f"says {content.get('format')!r}, expected {form!r}"
        raise FormatError(problem, file=path, place="format", mend="give the right file or correct the key")
    return content


def checked(model: type[Model], content: dict[str, Any], path: Path) -> Model:
    """Build `model` from `content`; the first violation becomes a `FormatError` with the key's path."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"]) or "the whole"
        message = first["msg"].removeprefix("Value error, ")
        problem, _, own_mend = message.partition("; ")
        if first["type"] not in ("missing", "value_error"):
            problem = f"{problem}, got {_short(first['input'])}"
        mend = own_mend or MENDS.get(first["type"], "correct the value")
        raise FormatError(problem, file=path, place=place, mend=mend) from error


class _ConstantError(ValueError):
    """NaN or Infinity, which Python's reader takes and JSON does not know."""


def _refuse_constant(name: str) -> float:
    raise _ConstantError(name)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
