"""JSON at the border: parsed strictly, checked by a pydantic model, refused in one line."""

from __future__ import annotations

import json
from collections.abc import Container, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from dlolib.errors import FormatError
from dlolib.formats.doubts import say

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
# A key that the formats do not name is somebody else's, unless it is as much like one that they do.
ALIKE = 0.8


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


def read_object(path: Path, what: str) -> dict[str, Any]:
    """Parse the JSON object in `path`; no key of one object stands in it twice."""
    existing(path, what)
    try:
        text = path.read_text(encoding="utf-8-sig")
        content = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_once)
    except UnicodeDecodeError as error:
        raise FormatError("is not text in UTF-8", file=path, mend="save it as UTF-8") from error
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise FormatError(
            f"is not JSON: {error.msg}", file=path, place=place, mend="mend it there"
        ) from error
    except _TwiceError as error:
        raise FormatError(
            "this key is given twice", file=path, place=str(error), mend="remove one"
        ) from error
    except _ConstantError as error:
        raise FormatError(f"{error} is not JSON", file=path, mend="give a finite number or null") from error
    except (ValueError, RecursionError) as error:
        # numbers of thousands of digits, and lists in lists without end
        raise FormatError(f"cannot be read: {str(error)[:80]}", file=path, mend="mend it") from error
    if not isinstance(content, dict):
        raise FormatError("holds no JSON object", file=path, mend='begin with {"format": ...}')
    return content


def read_json(path: Path, form: str) -> dict[str, Any]:
    """The JSON object in `path`, whose `format` is `form`."""
    content = read_object(path, form)
    if content.get("format") != form:
        problem = f"says {content.get('format')!r}, expected {form!r}"
        raise FormatError(problem, file=path, place="format", mend="give the right file or correct the key")
    return content


def checked(model: type[Model], content: dict[str, Any], path: Path) -> Model:
    """Build `model` from `content`; the first violation becomes a `FormatError` with the key's path, and a
    key that is ignored but looks misspelt a warning."""
    say(str(doubt) for doubt in _misspelt(model, content, path, ""))
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


def _misspelt(
    model: type[BaseModel], content: Mapping[str, Any], path: Path, above: str, outer: Container[str] = ()
) -> Iterator[FormatError]:
    """The keys that a file's format does not name, but for one that is much alike and not given, or that
    belongs outside of the block that it is in (among `outer`)."""
    fields = model.model_fields
    absent = [name for name in fields if name not in content]
    for key, value in content.items():
        if key in fields:
            for kind in (fields[key].annotation, *get_args(fields[key].annotation)):
                if isinstance(value, dict) and isinstance(kind, type) and issubclass(kind, BaseModel):
                    yield from _misspelt(kind, value, path, f"{above}{key}.", fields)
            continue
        if key in outer:
            mend = f"put it beside {above.split('.')[-2]}, if it is meant"
            yield FormatError("is not read here", file=path, place=f"{above}{key}", mend=mend)
            continue
        begun = [name for name in absent if name.startswith(f"{key}_")]
        alike = begun or get_close_matches(key, absent, n=1, cutoff=ALIKE)
        if alike:
            where = f"{above}{key}"
            yield FormatError("is not read", file=path, place=where, mend=f"write {alike[0]}, if it is meant")


class _TwiceError(ValueError):
    """A key that Python's reader would take the last value of."""


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise _TwiceError(next(key for k, (key, _) in enumerate(pairs) if key in dict(pairs[:k])))
    return found


class _ConstantError(ValueError):
    """NaN or Infinity, which Python's reader takes and JSON does not know."""


def _refuse_constant(name: str) -> float:
    raise _ConstantError(name)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
