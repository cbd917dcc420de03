"""Numbers as a reader wants them, and the three marks of running text."""

from __future__ import annotations

import math
import re

SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MINUS = "\u2212"
ABSENT = "–"
# A sign before a number, and the exponent behind one.
SIGN, EXPONENT = re.compile(r"(?<![\w.])-(?=\d)"), re.compile(r"(?<=\d)e([+-]\d+)")
MARKS = re.compile(r"`(?P<code>[^`]+)`|\*\*(?P<strong>.+?)\*\*|~(?P<sub>[^~\s]+)~")


def spans(text: str) -> list[tuple[str, str]]:
    """Split a text at its marks into (kind, text); kind is "text", "code", "strong" or "sub"."""
    out: list[tuple[str, str]] = []
    at = 0
    for match in MARKS.finditer(text):
        if match.start() > at:
            out.append(("text", text[at : match.start()]))
        kind = match.lastgroup or "text"
        out.append((kind, match.group(kind)))
        at = match.end()
    if at < len(text):
        out.append(("text", text[at:]))
    return out


def fixed(value: float | None, digits: int = 1) -> str:
    """A number with `digits` decimals and a true minus sign; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return ABSENT
    return f"{value:.{digits}f}".replace("-", MINUS)


def millimetres(value_m: float | None, digits: int = 1) -> str:
    """A length in m as a number of millimetres (the unit stands in the column or after it)."""
    return fixed(None if value_m is None else 1e3 * value_m, digits)


def power(exponent: int) -> str:
    """A power of ten, 10⁻⁴."""
    return "10" + str(exponent).translate(SUPERSCRIPT)


def scientific(value: float | None, digits: int = 3) -> str:
    """A number with `digits` significant digits: plain from 0.01 to 10 000, else as 3.02 × 10⁻⁴."""
    if value is None or not math.isfinite(value):
        return ABSENT
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    if -2 <= int(exponent) < 4:
        return fixed(value, max(0, digits - 1 - int(exponent)))
    return f"{mantissa.replace('-', MINUS)} × {power(int(exponent))}"


def span(low: float | None, high: float | None, digits: int = 3) -> str:
    """An interval in words, its ends on one power of ten; a dash where both ends are unbounded."""
    if low is None and high is None:
        return ABSENT
    if low is None or high is None:
        bound = low if high is None else high
        return f"{'above' if high is None else 'below'} {scientific(bound, digits)}"
    largest = max(abs(low), abs(high))
    exponent = math.floor(math.log10(largest)) if largest > 0 else 0
    if -2 <= exponent < 4:
        decimals = max(0, digits - 1 - exponent)
        return f"{fixed(low, decimals)} to {fixed(high, decimals)}"
    scale = 10.0**-exponent
    return f"{fixed(low * scale, digits - 1)} to {fixed(high * scale, digits - 1)} × {power(exponent)}"


def nice_unit(unit: str) -> str:
    """A unit of fit.json as a person writes it: N m^2 is N m²."""
    return unit.replace("^2", "²").replace("^4", "⁴")


def sentence(text: str) -> str:
    """A sentence of a result's file, whose letters are plain, as `scientific` and `nice_unit` write them."""
    powers = EXPONENT.sub(lambda found: f" × {power(int(found[1]))}", text)
    return nice_unit(SIGN.sub(MINUS, powers))


def title(name: str) -> str:
    """A folder's name as a person writes it: layout_1 is "Layout 1"."""
    words = name.replace("_", " ").replace("-", " ")
    return words[:1].upper() + words[1:]


def listed(items: list[str]) -> str:
    """Items as a sentence lists them: a, b and c."""
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]
