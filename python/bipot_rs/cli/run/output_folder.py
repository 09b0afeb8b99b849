"""The folder of a run: all its files appear together; other files are not touched."""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import islice
from pathlib import Path

from bipot_rs.files.drafts import remove_abandoned

if sys.platform != "win32":
    import fcntl

RESULT = "result.h5"
# A link to it: ParaView chooses its reader by the suffix.
LINK = "result.vtkhdf"
# Load steps of a run on several ranks, while result.h5 holds another run.
UNFINISHED = "unfinished.h5"
# The table of a sweep, and what it is a study of.
SWEEP, SWEEP_RECORD = "sweep.csv", "sweep.json"
# Results of the rows of a sweep, in folders with the number of the row.
ROWS = "rows"
_DRAFT = ".bipot-"
# A file in each draft folder. A folder without it was made by someone else.
_MARKER = ".bipot-draft"
# At most this many neighbouring folders are searched for drafts of killed runs.
_MOST_NEIGHBOURS = 1000
# One file for each load step, and for each rank.
_SERIES = re.compile(
    r"result_\d+(_\d+)?\.vtu|result_\d+\.pvtu|contact_\d+\.vtu|problem-\d+\.hdf5"
)
_NAMES = (
    RESULT,
    LINK,
    UNFINISHED,
    "result.pvd",
    "contact.pvd",
    "steps.csv",
    "tractions.png",
    "error.png",
)


def make(folder: Path) -> None:
    """Make the folder if it does not exist, and remove the drafts of killed runs."""
    for place in (folder, *folder.parents):
        if place.exists() and not place.is_dir():
            raise NotADirectoryError(f"{place} is a file, expected a folder")
    folder.mkdir(parents=True, exist_ok=True)
    _clear(folder)


@contextmanager
def draft_in(folder: Path) -> Iterator[Path]:
    """A folder inside the folder, in which files are prepared; removed at the end.

    It is made before the work, so that a folder that cannot be written is found then.
    """
    try:
        make(folder)
        for path in map(folder.joinpath, _NAMES):
            if path.is_dir():
                raise IsADirectoryError(f"{path} is a folder")
        draft, lock = _make_draft(folder)
    except OSError as error:
        raise OSError(
            f"cannot write to the folder {folder}: {error}; choose another with --out DIR"
        ) from error
    with draft as name, lock:
        yield Path(name)


def _make_draft(folder: Path) -> tuple[tempfile.TemporaryDirectory[str], ExitStack]:
    """A draft and its lock. The lock tells other runs that this process is alive.

    Another run may remove the draft before it is locked: then a new one is made.
    """
    while True:
        draft = tempfile.TemporaryDirectory(prefix=_DRAFT, dir=folder)
        with suppress(FileNotFoundError), ExitStack() as stack:
            stack.enter_context(_lock(Path(draft.name)))
            # Without the marker, the draft of a run that is killed before this line stays.
            (Path(draft.name) / _MARKER).touch()
            return draft, stack.pop_all()
        with suppress(FileNotFoundError):
            draft.cleanup()


def replace(draft: Path, folder: Path) -> None:
    """Move the files of the draft into the folder, and remove those of an earlier run."""
    new = {path.name for path in draft.iterdir()} - {_MARKER}
    for name in sorted(new):
        (draft / name).replace(folder / name)
    for old in ours(folder):
        if old.name not in new:
            old.unlink()


def ours(folder: Path) -> list[Path]:
    """The files in the folder that a run writes."""
    series = [path for path in folder.glob("*") if _SERIES.fullmatch(path.name)]
    return [path for path in map(folder.joinpath, _NAMES) if path.exists()] + series


def describe(folder: Path) -> str:
    """The files of a run that the folder holds, in one line."""
    # result.pvd stands for the files of its series.
    listed = (path for path in ours(folder) if path.suffix not in (".vtu", ".pvtu"))
    names = sorted(path.name for path in listed)
    problems = [name for name in names if name.endswith(".hdf5")]
    if len(problems) > 2:
        names = [name for name in names if name not in problems[1:-1]]
        names.insert(names.index(problems[0]) + 1, "…")
    return f"{folder}: {', '.join(names)}"


@contextmanager
def _lock(draft: Path) -> Iterator[bool]:
    """Lock the draft; yields whether that was possible."""
    if sys.platform == "win32":
        # A folder has no lock there: drafts of killed runs stay, because one that is in use
        # looks the same.
        yield False
    else:
        handle = os.open(draft, os.O_RDONLY | os.O_DIRECTORY)
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                # Another process holds it, or the file system has no locks.
                yield False
            else:
                yield True
        finally:
            os.close(handle)


def _clear(folder: Path) -> None:
    """Remove the drafts of killed runs, in the folder and in output folders beside it."""
    folder = folder.absolute()
    beside: list[Path] = []
    with suppress(OSError), os.scandir(folder.parent) as entries:
        # To look into each of many folders takes time, and they are hardly runs.
        first = list(islice(entries, _MOST_NEIGHBOURS + 1))
        if len(first) <= _MOST_NEIGHBOURS:
            folders = [Path(e.path) for e in first if e.is_dir(follow_symlinks=False)]
            beside = [place for place in folders if place != folder]
    for place in [folder, *beside]:
        with suppress(OSError):
            if place == folder or _is_output(place):
                _remove_drafts(place)
    for place in [folder, *(folder / ROWS).glob("*")]:
        with suppress(OSError):
            remove_abandoned(place, (*_NAMES, SWEEP, SWEEP_RECORD))


def _drafts(folder: Path) -> list[Path]:
    """The draft folders that this program made."""
    drafts = folder.glob(f"{_DRAFT}*")
    return [path for path in drafts if (path / _MARKER).is_file()]


def _is_output(folder: Path) -> bool:
    """Whether a run writes into the folder: it has files of one, or only drafts."""
    if ours(folder) or (folder / SWEEP).exists():
        return True
    return len(_drafts(folder)) == sum(1 for _ in folder.iterdir())


def _remove_drafts(folder: Path) -> None:
    for draft in _drafts(folder):
        with suppress(OSError), _lock(draft) as abandoned:
            if abandoned:
                shutil.rmtree(draft)
