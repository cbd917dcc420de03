"""One short script a stage: load, call, save. Run from the repository's root: `python -m stages.chain`."""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

# Same inputs, same bytes, whatever the number of cores: sums in threads depend on how they are divided.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"
os.environ["MPLBACKEND"] = "Agg"

from dlolib.errors import DloError, ParameterError  # noqa: E402  (after the variables that NumPy reads when it loads)
from dlolib.files import write_json  # noqa: E402

INTERRUPTED = 130
LABORATORY = "lab"
CAPTURED = "captured"
# Beside what was learned with a verdict: the same without it.
WITHOUT = "without"
DATA = Path("data")
REPORTS = Path("reports")


def run(stage: Callable[..., None], *arguments: str) -> None:
    """Run a stage; unusable input is one line on standard error and exit status 2, Ctrl-C status 130."""
    try:
        _check_arguments(stage, arguments)
        stage(*arguments)
    except DloError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None
    except OSError as error:
        where = error.filename or _name(stage)
        print(f"{where}: {error.strerror}; correct the path or its permissions", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        raise SystemExit(INTERRUPTED) from None


def _check_arguments(stage: Callable[..., None], given: Sequence[str]) -> None:
    takes = inspect.signature(stage)
    try:
        takes.bind(*given)
    except TypeError:
        names = " ".join(name.upper() for name in takes.parameters) or "none"
        problem = f"arguments given: {len(given)}"
        raise ParameterError(problem, place=_name(stage), mend=f"give {names}") from None


def _name(stage: Callable[..., None]) -> str:
    """Of its module, also where that is the one run by `python -m`."""
    run_by_name = getattr(sys.modules[stage.__module__], "__spec__", None)
    return stage.__module__ if run_by_name is None else run_by_name.name


def known(given: Sequence[str], names: Iterable[str], what: str) -> None:
    """Refuse what is none of the names.

    Raises:
        ParameterError: one is not; it says which there are.
    """
    among = list(names)
    for one in given:
        if one not in among:
            raise ParameterError(f"there is no {what} {one}", mend=f"give some of {', '.join(among)}")


def number(text: str, what: str, least: int = 0) -> int:
    """A count from the command line.

    Raises:
        ParameterError: it is none, or too few: their result would replace one of many.
    """
    if not text.isdecimal() or int(text) < least:
        from_least = f" from {least} on" if least else ""
        raise ParameterError(f"{what} is {text}", mend=f"give {what} as a whole number{from_least}")
    return int(text)


def write_metrics(name: str, figures: Mapping[str, Any]) -> None:
    """Write reports/metrics/<name>.json, which git keeps: the numbers among the figures, to nine digits."""
    write_json(REPORTS / "metrics" / f"{name}.json", _numbers(figures))


def _numbers(figures: Mapping[str, Any]) -> dict[str, Any]:
    kept: dict[str, Any] = {}
    for key, value in figures.items():
        if isinstance(value, Mapping):
            kept[key] = _numbers(value)
        elif isinstance(value, float):
            kept[key] = float(f"{value:.9g}")
        elif value is None or isinstance(value, int):
            kept[key] = value
    return kept
