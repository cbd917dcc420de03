"""The two renderings of a report: one HTML page with everything inline, one PDF by Typst."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

import typst
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from dlolib.report.text import spans

TEMPLATES = files("dlolib.report") / "templates"
TAGS = {"code": "code", "strong": "strong", "sub": "sub"}
TEXTS = {"text", "caption", "label", "detail", "subtitle"}
"""The keys of report.json whose texts carry marks."""
PLAIN = " /:;,=?@!$*+|"
"""What needs no escape in a data URI within quotes, beside letters and digits."""


def render_html(report: Mapping[str, Any], folder: Path) -> str:
    """The page as a string; figures are read from `folder` and stand in it as data URIs."""
    environment = Environment(
        loader=PackageLoader("dlolib.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=False
    )
    environment.filters["inline"] = _markup
    environment.filters["data_uri"] = lambda name: data_uri(folder / name)
    style = Markup((TEMPLATES / "report.css").read_text(encoding="utf-8"))
    return environment.get_template("report.html.j2").render(report=report, style=style) + "\n"


def data_uri(path: Path) -> str:
    """An SVG as a data URI: it brings its own names, so that two figures on a page never mix them up.

    As text it takes a quarter less than in base64. A line's end is white space in an SVG, and none in a URI.
    """
    svg = " ".join(path.read_text(encoding="utf-8").split())
    return "data:image/svg+xml," + quote(svg, safe=PLAIN)


def render_pdf(report: Mapping[str, Any], folder: Path) -> bytes:
    """The PDF's bytes, the same at every run: no date, and no fonts but those that Typst brings."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        shutil.copytree(folder / "figures", work / "figures")
        (work / "content.json").write_text(json.dumps(_with_spans(report)), encoding="utf-8")
        (work / "report.typ").write_text(
            (TEMPLATES / "report.typ").read_text(encoding="utf-8"), encoding="utf-8"
        )
        document = typst.compile(str(work / "report.typ"), root=str(work), ignore_system_fonts=True)
    return bytes(document)


def _markup(text: str) -> Markup:
    out = Markup()
    for kind, body in spans(text):
        tag = TAGS.get(kind)
        out += Markup("<{0}>{1}</{0}>").format(Markup(tag), body) if tag else escape(body)
    return out


def _with_spans(content: Any, key: str = "") -> Any:
    """The content with every marked text split into spans, as the Typst template wants it."""
    if isinstance(content, Mapping):
        return {name: _with_spans(value, name) for name, value in content.items()}
    if isinstance(content, list | tuple):
        return [_with_spans(value, key) for value in content]
    if isinstance(content, str) and key in TEXTS | {"rows"}:
        return spans(content)
    return content
