"""The application that the commands hang on, and how it ends."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import typer
from typer.exceptions import TyperException

from dlolib.cli.infer import diagnose, identify, simulate
from dlolib.cli.move import execute, learn
from dlolib.cli.perceive import chain, ingest
from dlolib.cli.say import refuse
from dlolib.cli.tell import report
from dlolib.errors import DloError

UNUSABLE, INTERRUPTED = 2, 130
HELP = """A rope's stiffness from depth images, and motions that shape it without contact.

A params.yaml in the working directory, all blocks of it, sets what they name; without one the defaults hold.
"""
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, help=HELP)
for command in (ingest, chain, simulate, identify, diagnose, learn, execute, report):
    app.command()(command)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `dlo` and exit: 0 on success, 1 for a stopped motion, 2 with one line for unusable input."""
    sys.exit(run(arguments))


def run(arguments: Sequence[str] | None = None) -> int:
    """Run `dlo` on the given arguments (those of the process by default) and return its exit status."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        status = app(given or ["--help"], prog_name="dlo", standalone_mode=False)
    except DloError as error:
        return _refuse(str(error))
    except TyperException as error:
        return _refuse(f"{error.format_message().rstrip('.')}; see dlo --help")
    except OSError as error:
        return _refuse(f"{error.filename or '--out'}: {error.strerror}; correct the path or its permissions")
    except KeyboardInterrupt:
        return INTERRUPTED
    return status if isinstance(status, int) else 0


def _refuse(line: str) -> int:
    refuse(line)
    return UNUSABLE
