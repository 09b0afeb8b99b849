"""Files that appear whole or not at all: drafts beside them, renamed at the end."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path

from bipot_rs._lib.messages import make_type_error


def place(path: str | os.PathLike[str], what: str = "path") -> Path:
    """Convert to a `Path`; a `TypeError` names the argument ``what``."""
    try:
        return Path(os.fsdecode(path))
    except TypeError:
        raise make_type_error(what, path, "the name of a file") from None


@contextmanager
def writing(path: str | os.PathLike[str]) -> Iterator[None]:
    """Put the name of the file into system errors, instead of that of the draft.

    If two such contexts are nested, the outer name is used.
    """
    try:
        yield
    except OSError as error:
        cause = error.__cause__ if isinstance(error.__cause__, OSError) else error
        raise type(cause)(f"cannot write {path}: {cause.strerror or cause}") from cause


@contextmanager
def aside(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Draft to write instead of ``path``: renamed on success, removed on failure."""
    target = place(path)
    # Libraries look at the suffix, and two processes may write the same path.
    draft = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        with writing(target):
            yield draft
            draft.replace(target)
    finally:
        draft.unlink(missing_ok=True)


def remove_abandoned(folder: Path, names: Container[str]) -> None:
    """Remove the drafts of files with these names whose process is gone.

    On Windows they stay: nothing there asks whether a process lives without harm to it.
    """
    if sys.platform == "win32":
        return
    for path in folder.glob(".*"):
        draft = re.fullmatch(r"\.(.+)\.(\d{1,9})(\.\w+)", path.name)
        if not draft or draft[1] + draft[3] not in names:
            continue
        try:
            os.kill(int(draft[2]), 0)
        except ProcessLookupError:
            path.unlink(missing_ok=True)
        except OSError:
            pass
