"""What a command says: one line."""

from __future__ import annotations

import sys
from io import TextIOWrapper


def print_line(line: str) -> None:
    """Print what came of a command."""
    if isinstance(sys.stdout, TextIOWrapper):
        # a terminal that has no such letter is no reason to fail after the work is done
        sys.stdout.reconfigure(errors="replace")
    print(line)


def refuse(line: str) -> None:
    """Print why a command was not run."""
    print(f"dlo: {' '.join(line.split())}", file=sys.stderr)
