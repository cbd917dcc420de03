"""What a report is made of: sections of paragraphs, cards, tables and figures.

The HTML page and the PDF are two renderings of the same content, so that nothing is written twice.
Texts know three marks: `code`, **strong** and a~sub~script (`dlolib.report.text.spans`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import PurePosixPath
from typing import Any, ClassVar


@dataclass(frozen=True)
class Paragraph:
    """Running text."""

    kind: ClassVar[str] = "paragraph"
    text: str


@dataclass(frozen=True)
class Missing:
    """The sentence that stands where an input is absent: what is not there, and which command makes it."""

    kind: ClassVar[str] = "missing"
    text: str


@dataclass(frozen=True)
class Card:
    """One headline figure: what, the value with its unit, what it is held against, the command."""

    label: str
    value: str
    unit: str
    detail: str
    command: str


@dataclass(frozen=True)
class Cards:
    """The headline figures side by side."""

    kind: ClassVar[str] = "cards"
    items: tuple[Card, ...]


@dataclass(frozen=True)
class Column:
    """A column: its head, the unit of its numbers ("" where cells carry their own, or none)."""

    title: str
    unit: str = ""
    align: str = "right"


@dataclass(frozen=True)
class Table:
    """Rows of texts under columns, with a caption above."""

    kind: ClassVar[str] = "table"
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    number: int = 0


@dataclass(frozen=True)
class Figure:
    """An SVG beside the report: its path relative to the report, what to see in it, a short description."""

    kind: ClassVar[str] = "figure"
    file: PurePosixPath
    caption: str
    alt: str
    number: int = 0


Block = Paragraph | Missing | Cards | Table | Figure


@dataclass(frozen=True)
class Section:
    """One section: its anchor, its title and its blocks in reading order."""

    name: str
    title: str
    blocks: tuple[Block, ...]


def numbered(sections: tuple[Section, ...]) -> tuple[Section, ...]:
    """The same sections with figures and tables counted through from 1."""
    counts = {"figure": 0, "table": 0}
    out = []
    for section in sections:
        blocks: list[Block] = []
        for block in section.blocks:
            if isinstance(block, Figure | Table):
                counts[block.kind] += 1
                block = replace(block, number=counts[block.kind])
            blocks.append(block)
        out.append(replace(section, blocks=tuple(blocks)))
    return tuple(out)


def as_json(sections: tuple[Section, ...]) -> list[dict[str, Any]]:
    """The sections as JSON holds them; each block carries its `kind`."""
    return [
        {
            "name": section.name,
            "title": section.title,
            "blocks": [{"kind": block.kind, **_plain(asdict(block))} for block in section.blocks],
        }
        for section in sections
    ]


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: value.as_posix() if isinstance(value, PurePosixPath) else value for key, value in values.items()
    }
