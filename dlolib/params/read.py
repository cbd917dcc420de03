"""params.yaml read and checked, whole or a block of it; each refusal is one line."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import ValidationError

from dlolib.errors import ParameterError
from dlolib.params.blocks import EFFECTS, FITTED, Block, Diagnose, Identify, Params

PARAMS = Path("params.yaml")
# Names that a block may give, and what they are.
NAMES: dict[type[Block], tuple[str, Sequence[str], str]] = {
    Identify: ("parameters", FITTED, "what is fitted"),
    Diagnose: ("without", EFFECTS, "the effects"),
}

AnyBlock = TypeVar("AnyBlock", bound=Block)
Keys = tuple[str, ...]


def load(path: Path = PARAMS) -> Params:
    """Read and check the whole file.

    Raises:
        ParameterError: names file, line, key and mend.
    """
    params = _validated(Params, _read(path), path, ())
    identify, learn = params.identify, params.learn
    _check_names(identify, path)
    _check_names(params.diagnose, path)
    recordings = tuple(params.recordings)
    for given, valid, keys, where in (
        ([learn.verdict_of], recordings, ("learn", "verdict_of"), "recordings"),
        ([learn.ablation.layout], params.layouts, ("learn", "ablation", "layout"), "layouts"),
        (identify.paper_on, recordings, ("identify", "paper_on"), "recordings"),
    ):
        for name in given:
            if name not in valid:
                raise _unknown_name(name, valid, path, keys, where)
    return params


def ours(path: Path = PARAMS) -> bool:
    """Whether the file has any block of ours: other projects have a params.yaml, too.

    Raises:
        ParameterError: it is no YAML.
    """
    content = _content(path)
    return isinstance(content, dict) and not Params.model_fields.keys().isdisjoint(content)


def load_block(block: type[AnyBlock], path: Path = PARAMS) -> AnyBlock:
    """Read one block, by its class (`Rod` is the block `rod`), without looking at the others.

    Raises:
        ParameterError: names file, line, key and mend.
    """
    name = block.__name__.lower()
    content = _read(path)
    if name not in content:
        raise ParameterError("this block is missing", file=path, place=name, mend=f"add a block `{name}:`")
    read = _validated(block, content[name], path, (name,))
    _check_names(read, path)
    return read


class _Twice(Exception):  # noqa: N818  (what happened, as the error that it becomes says it)
    """A key that stands twice in a block, with its line: YAML would silently take the last."""


class _Once(yaml.SafeLoader):
    """Reads YAML in which no key of a block stands twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if str(key.value) in seen:
                raise _Twice(f"line {key.start_mark.line + 1}, {key.value}")
            seen.add(str(key.value))
        return super().construct_mapping(node, deep)


def _read(path: Path) -> dict[str, Any]:
    content = _content(path)
    if not isinstance(content, dict):
        raise ParameterError("holds no blocks", file=path, mend="write one block a stage")
    return content


def _content(path: Path) -> Any:
    try:
        return _Once(path.read_text(encoding="utf-8")).get_single_data()
    except FileNotFoundError:
        raise ParameterError("no such file", file=path, mend="run from the repository's root") from None
    except _Twice as error:
        raise ParameterError(
            "this key is given twice", file=path, place=str(error), mend="remove one"
        ) from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # no text, a date that no calendar has
        mark = getattr(error, "problem_mark", None)
        place = f"line {mark.line + 1}" if mark else None
        raise ParameterError("is not valid YAML", file=path, place=place, mend="correct that line") from error


def _check_names(block: Block, path: Path) -> None:
    """Refuse a name that the block gives and nothing has."""
    if type(block) in NAMES:
        key, valid, where = NAMES[type(block)]
        for name in getattr(block, key) or ():
            if name not in valid:
                raise _unknown_name(name, valid, path, (type(block).__name__.lower(), key), where)


def _validated(block: type[AnyBlock], content: Any, path: Path, above: Keys) -> AnyBlock:
    try:
        return block.model_validate(content)
    except ValidationError as error:
        raise _refusal(error, block, path, above) from error


def _refusal(error: ValidationError, block: type[Block], path: Path, above: Keys) -> ParameterError:
    """The first violation as one line; an unknown key first, since a missing one may be its misspelling."""
    found = sorted(error.errors(include_url=False), key=lambda one: one["type"] != "extra_forbidden")[0]
    inside = tuple(str(part) for part in found["loc"] if part != "[key]")
    place = _place(path, above + inside)
    if found["type"] == "extra_forbidden":
        valid = _keys_at(block, inside[:-1])
        closest = difflib.get_close_matches(inside[-1], valid, n=1, cutoff=0.5)
        mend = f"did you mean `{closest[0]}`?" if closest else f"valid are {', '.join(valid)}"
        return ParameterError("unknown key", file=path, place=place, mend=mend)
    if found["type"] == "missing":
        return ParameterError("this key is missing", file=path, place=place, mend="add it")
    problem = found["msg"].removeprefix("Input ").removeprefix("Value error, ")
    if found["type"] == "string_pattern_mismatch":
        problem = "should be a name of letters, digits, - and _, or a path of such within the folder"
    given = f" (it is {found['input']!r})" if isinstance(found["input"], int | float | str) else ""
    number = isinstance(found["input"], str) and found["type"] in ("float_type", "int_type")
    mend = (
        "give a number without quotes, with a point before an exponent and a sign in it (1.0e-4, 1.0e+4)"
        if number
        else "correct the value"
    )
    return ParameterError(f"{problem}{given}", file=path, place=place, mend=mend)


def _keys_at(block: type[Block], keys: Keys) -> list[str]:
    """The valid keys of the block below these keys."""
    for key in keys:
        field = block.model_fields.get(key)
        if field is None:  # a name of the user's own, such as a recording's
            continue
        types = (field.annotation, *get_args(field.annotation))
        block = next((one for one in types if isinstance(one, type) and issubclass(one, Block)), block)
    return list(block.model_fields)


def _place(path: Path, keys: Keys) -> str:
    """`line 12, lab.length_m`: where in the file the key is, or the nearest one above it that is there."""
    node, line = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader), 0
    for key in keys:
        pairs = node.value if isinstance(node, yaml.MappingNode) else []
        below = next(((name, value) for name, value in pairs if name.value == key), None)
        if below is None:
            break
        line, node = below[0].start_mark.line + 1, below[1]
    return f"line {line}, {'.'.join(keys)}" if line else ".".join(keys)


def _unknown_name(name: str, valid: Sequence[str], path: Path, keys: Keys, where: str) -> ParameterError:
    closest = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    return ParameterError(
        f"`{name}` is not among {where} ({', '.join(valid)})",
        file=path,
        place=_place(path, keys),
        mend=f"did you mean `{closest[0]}`?" if closest else "name one of them",
    )
