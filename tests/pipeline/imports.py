"""What a stage really imports, from the import graph that import-linter too reads (grimp)."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[2]


@cache
def import_graph() -> grimp.ImportGraph:
    """All imports inside dlolib and stages, those inside functions too; not those for type checkers alone."""
    return grimp.build_graph("dlolib", "stages", exclude_type_checking_imports=True, cache_dir=None)


def modules_of(stage: str) -> set[str]:
    """Every module of dlolib and stages that the stage's script reaches, directly or not.

    A subpackage counts whole, since it is a dependency whole. dlolib/__init__.py counts where its version is
    asked for; it imports nothing.
    """
    graph, reached = import_graph(), set()
    waiting = {f"stages.{stage}"}
    while waiting:
        module = waiting.pop()
        reached.add(module)
        near = graph.find_modules_directly_imported_by(module) | (
            {"stages"} if module.startswith("stages.") else set()
        )
        part = ".".join(module.split(".")[:2])
        if module.startswith("dlolib."):
            near |= {part} | graph.find_descendants(part)
        waiting |= near - reached
    return reached


def parts_of(stage: str) -> set[str]:
    """The same as paths: subfolders of dlolib, its files at the top, and the stage's own files."""
    parts = set()
    for module in modules_of(stage):
        path = Path(*module.split(".")[:2])
        if module in ("dlolib", "stages"):
            parts.add(f"{module}/__init__.py")
        elif (ROOT / path).is_dir():
            parts.add(str(path))
        else:
            parts.add(f"{path}.py")
    return parts
