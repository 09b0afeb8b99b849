"""The folder of a run: its files come all together, and nothing else in it is touched."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import islice
from pathlib import Path

RESULT = "result.h5"
# The table of a sweep.
SWEEP = "sweep.csv"
_DRAFT = ".bipot-"
# Folders of runs that are looked into for what killed runs have left.
_BESIDE = 1000
_NAMES = (
    RESULT,
    "result.pvd",
    "contact.pvd",
    "steps.csv",
    "tractions.png",
    "error.png",
)


def make(folder: Path) -> None:
    """Make a folder that may be there, and clear what killed runs have left.

    A file of its name is no place for results.
    """
    for one in (folder, *folder.parents):
        if one.exists() and not one.is_dir():
            raise NotADirectoryError(f"{one} is a file, expected a folder")
    folder.mkdir(parents=True, exist_ok=True)
    _clear(folder)


@contextmanager
def draft_in(folder: Path) -> Iterator[Path]:
    """Place inside the folder to prepare its files in, gone at the end.

    Made before the work, so that a folder that cannot be written is found then.

    Raises
    ------
    OSError
        One sentence, with what would help.
    """
    try:
        make(folder)
        for path in map(folder.joinpath, _NAMES):
            if path.is_dir():
                raise IsADirectoryError(f"{path} is a folder")
        draft, lock = _made(folder)
    except OSError as error:
        raise OSError(
            f"cannot write to the folder {folder}: {error}; --out DIR names another"
        ) from error
    with draft as name, lock:
        yield Path(name)


def _made(folder: Path) -> tuple[tempfile.TemporaryDirectory[str], ExitStack]:
    """A draft with its lock, held as long as this process lives: so others know it does.

    Another run may have taken it for an abandoned one before it was locked.
    """
    while True:
        draft = tempfile.TemporaryDirectory(prefix=_DRAFT, dir=folder)
        with suppress(FileNotFoundError), ExitStack() as stack:
            stack.enter_context(_locked(Path(draft.name)))
            if Path(draft.name).is_dir():
                return draft, stack.pop_all()
        with suppress(FileNotFoundError):
            draft.cleanup()


def replace(draft: Path, folder: Path) -> None:
    """Move the files of the draft in, and remove those of an earlier run."""
    new = {path.name for path in draft.iterdir()}
    for name in sorted(new):
        (draft / name).replace(folder / name)
    for old in ours(folder):
        if old.name not in new:
            old.unlink()


def ours(folder: Path) -> list[Path]:
    """Files that a run writes; whatever else a folder holds is not ours to touch."""
    series = [p for p in folder.glob("result_*.vtu") if p.stem[7:].isdigit()]
    series += [p for p in folder.glob("contact_*.vtu") if p.stem[8:].isdigit()]
    series += [p for p in folder.glob("problem-*.hdf5") if p.stem[8:].isdigit()]
    return [path for path in map(folder.joinpath, _NAMES) if path.exists()] + series


def describe(folder: Path) -> str:
    """The files of a run that the folder holds, in one line."""
    # The pieces of the series are named by its index, result.pvd.
    names = sorted(path.name for path in ours(folder) if path.suffix != ".vtu")
    problems = [name for name in names if name.endswith(".hdf5")]
    if len(problems) > 2:
        names = [name for name in names if name not in problems[1:-1]]
        names.insert(names.index(problems[0]) + 1, "…")
    return f"{folder}: {', '.join(names)}"


@contextmanager
def _locked(draft: Path) -> Iterator[bool]:
    """Whether the draft could be locked; nobody else locks it meanwhile."""
    handle = os.open(draft, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            # Someone holds it, or the file system knows no locks.
            yield False
        else:
            yield True
    finally:
        os.close(handle)


def _clear(folder: Path) -> None:
    """Remove what killed runs were preparing, in the folder and in those beside it."""
    beside: list[Path] = []
    with suppress(OSError), os.scandir(folder.absolute().parent) as entries:
        # A folder of many things is no folder of runs, and looking into each takes time.
        first = list(islice(entries, _BESIDE + 1))
        if len(first) <= _BESIDE:
            beside = [Path(e.path) for e in first if e.is_dir(follow_symlinks=False)]
    for place in dict.fromkeys([folder.absolute(), *beside]):
        with suppress(OSError):
            for draft in place.glob(f"{_DRAFT}*"):
                with suppress(OSError), _locked(draft) as abandoned:
                    if abandoned:
                        shutil.rmtree(draft)
