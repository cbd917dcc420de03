"""Named errors. Each is one line for a person: which file, which place in it, what is wrong, the mend."""

from __future__ import annotations

from os import PathLike
from pathlib import Path


class DloError(Exception):
    """Unusable input. The command line prints it as one line and exits with status 2.

    Args:
        problem: what is wrong, with the offending value and the valid choices.
        file: the file or folder it is in.
        place: where in it: a line, a key, a frame.
        mend: what to do about it, in the imperative.
    """

    def __init__(
        self,
        problem: str,
        *,
        file: str | PathLike[str] | None = None,
        place: str | None = None,
        mend: str | None = None,
    ) -> None:
        self.problem, self.place, self.mend = problem, place, mend
        self.file = None if file is None else Path(file)
        where = ": ".join(str(part) for part in (file, place) if part is not None)
        line = f"{where}: {problem}" if where else problem
        super().__init__(" ".join((f"{line}; {mend}" if mend else line).split()))


class FormatError(DloError):
    """A file does not have the form that the formats demand."""


class ParameterError(DloError):
    """A parameter is outside its valid range, or unknown."""


class LayoutError(DloError):
    """A layout that no rope can reach."""


class ChainError(DloError):
    """No rope can be found in a frame."""


class SimulationError(DloError):
    """The rod could not be solved: says at which step and why."""


class MotionRefused(DloError):  # noqa: N818  (what happened, as the log says it)
    """A robot's path fails a check made before the first motion."""
