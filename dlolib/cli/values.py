"""What `--set`, `--effect` and `--topic` say, as values by name."""

from __future__ import annotations

from collections.abc import Sequence

from dlolib.errors import ParameterError
from dlolib.rope_values import STIFFNESSES

NAMES = (*STIFFNESSES, "linear_density")


def parse_values(given: Sequence[str]) -> dict[str, float]:
    """`NAME=VALUE` by name.

    Raises:
        ParameterError: an unknown name or one given twice, text in a number's place, or a value that is not
            positive.
    """
    values: dict[str, float] = {}
    for pair in given:
        name, sign, text = pair.partition("=")
        place = f"--set {pair}"
        if name in values:
            raise ParameterError(f"{name} is given twice", place=place, mend="give it once")
        if name not in NAMES:
            mend = f"valid are {', '.join(NAMES)}"
            raise ParameterError(f"unknown name {name!r}", place=place, mend=mend)
        try:
            value = _number(text)
        except ValueError:
            problem = f"{text!r} in a number's place" if sign else "no value"
            raise ParameterError(problem, place=place, mend=f"write {name}=NUMBER") from None
        if not 0 < value < float("inf"):
            raise ParameterError(f"{text} is not a positive number", place=place, mend="give one above 0")
        values[name] = value
    return values


def parse_effects(given: Sequence[str]) -> dict[str, float]:
    """`NAME:PARAM=VALUE,PARAM=VALUE` by `NAME.PARAM`; NAME alone stands for usual
    values, where the effect has such.

    Raises:
        ParameterError: an unknown effect or parameter or one given twice, text in a number's place, or a
            value out of range.
    """
    from dlolib.sim.effects import named

    values: dict[str, float] = {}
    for one in given:
        name, _, listed = one.partition(":")
        place = f"--effect {one}"
        parts: dict[str, float] = {}
        for pair in listed.split(",") if listed else ():
            part, sign, text = pair.partition("=")
            try:
                value = _number(text)
            except ValueError:
                problem = f"{text!r} in a number's place" if sign else "no value"
                mend = f"write {name}:{part or 'PARAM'}=NUMBER"
                raise ParameterError(problem, place=place, mend=mend) from None
            if part.strip() in parts:
                raise ParameterError(f"{part.strip()} is given twice", place=place, mend="give it once")
            parts[part.strip()] = value
        try:
            found = named(name.strip(), parts)
        except ParameterError as error:
            raise ParameterError(error.problem, place=place, mend=error.mend) from error
        if found.keys() & values.keys():
            raise ParameterError(f"{name.strip()} is given twice", place=place, mend="give it once")
        values |= found
    return values


def _number(text: str) -> float:
    """A number as other programs write it: Python itself would take 3_0 for 30."""
    if "_" in text:
        raise ValueError(text)
    return float(text)


def parse_topics(given: Sequence[str]) -> dict[str, str]:
    """`ROLE=NAME` by role.

    Raises:
        ParameterError: no name, or two for one role.
    """
    topics: dict[str, str] = {}
    for pair in given:
        role, _, name = pair.partition("=")
        if not role or not name:
            raise ParameterError("no role or no name", place=f"--topic {pair}", mend="write ROLE=NAME")
        if role in topics:
            raise ParameterError(f"{role} is named twice", place=f"--topic {pair}", mend="name it once")
        topics[role] = name
    return topics
