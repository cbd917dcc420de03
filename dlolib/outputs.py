"""Where a command may write: asked before any work, so that none is lost for want of a place."""

from __future__ import annotations

import tempfile
from pathlib import Path

from dlolib.errors import FormatError


def check_out(
    out: Path, known_by: str | tuple[str, ...], *inputs: Path | None, said: str = "", never: str = ""
) -> None:
    """Refuse a folder to write before any work is done, where writing it would fail or destroy something.

    Args:
        out: the folder; an earlier result in it is replaced whole.
        known_by: the file or files by which a folder is known as an earlier result of the same command.
        inputs: what is read.
        said: what the first of these files says, where others have a file of that name.
        never: a file that only another command's result has.

    Raises:
        FormatError: it is or holds the working folder or an input, is no folder, is a mount, which cannot be
            replaced, holds what is no result of the command, or cannot be written.
    """
    out, elsewhere = Path(out), "write to a folder of its own"
    whole = out.resolve()
    for one, what in (
        (Path.cwd(), "the working folder"),
        *((one, f"the input {one}") for one in inputs if one),
    ):
        if one.resolve().is_relative_to(whole):
            raise FormatError(f"is or holds {what}", file=out, mend=elsewhere)
    if out.is_symlink():
        raise FormatError("is a link", file=out, mend="give the folder itself")
    if out.exists() and not out.is_dir():
        raise FormatError("is a file", file=out, mend="give a folder")
    if out.is_mount():
        raise FormatError("is a mount, and a result is replaced whole", file=out, mend="give a folder in it")
    marks = [known_by] if isinstance(known_by, str) else known_by
    if out.is_dir() and any(out.iterdir()):
        missing = next((name for name in marks if not (out / name).is_file()), None)
        if missing is None and said and said.encode() not in (out / marks[0]).read_bytes():
            missing = marks[0]
        if missing is not None:
            raise FormatError(f"holds files, and no {missing} of an earlier run", file=out, mend=elsewhere)
        if never and (out / never).is_file():
            raise FormatError(f"holds {never}, another command's", file=out, mend=elsewhere)
    above = next(folder for folder in whole.parents if folder.exists())
    if not above.is_dir():
        raise FormatError("is a file", file=above, mend="give a folder")
    for folder in (above, whole):
        try:
            if folder.exists():
                with tempfile.TemporaryDirectory(dir=folder):
                    pass
        except OSError as error:
            mend = "give another, or the right to"
            raise FormatError("cannot be written to", file=folder, mend=mend) from error
