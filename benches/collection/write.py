"""Write the collection: a file for each step, ``MANIFEST.csv`` and ``README.md``."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from bipot_rs._lib.messages import make_type_error, meant
from bipot_rs._lib.optional import load_library
from bipot_rs.contact.global_problem import GlobalProblem
from bipot_rs.contact.law.status import Status
from bipot_rs.fclib import Vectors
from bipot_rs.fclib import write as write_file
from bipot_rs.files.drafts import aside, place
from collection import manifest, rules
from collection.catalogue import PATHS
from collection.entry import Entry
from collection.load_path import LoadPath
from collection.manifest import Row
from collection.reference import Reference
from collection.steps import Step, steps


def generate(
    folder: str | os.PathLike[str],
    names: Sequence[str] | None = None,
    *,
    on_file: Callable[[Row], object] | None = None,
) -> list[Row]:
    """Write load paths of the collection with their reference answers.

    Two runs write the same bytes, with any number of threads. Other machines may round the
    entries of W and q differently; each file has the reference of its own numbers.

    Parameters
    ----------
    folder
        Folder to write to; it is made if it does not exist.
    names
        Keys of `PATHS`. The default is all 40, which takes minutes, 2 GB of memory and
        170 MB in the folder.
    on_file
        Called with the row of each file after it is written.

    Returns
    -------
    list of Row
        The rows of ``MANIFEST.csv``.

    Raises
    ------
    TypeError, ValueError
        ``names`` is not a list of names, or a name is unknown.
    OSError
        The folder cannot be written.
    """
    if isinstance(names, str):
        raise make_type_error("names", names, "a list of names")
    chosen = list(dict.fromkeys(PATHS if names is None else names))
    for name in chosen:
        if name not in PATHS:
            raise ValueError(
                f"names has {name!r}, which is no path of the collection"
                + meant(name, list(PATHS))
            )
    load_library("h5py")
    target = place(folder)
    target.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in chosen:
        entry = PATHS[name]
        path = entry.make()
        for number, step in enumerate(steps(path)):
            row = _row(name, number, entry, path, step)
            _write(target / row.file, row, entry, step)
            rows.append(row)
            if on_file is not None:
                on_file(row)
    manifest.write(target, rows)
    with aside(target / "README.md") as draft:
        draft.write_text(rules.page(rows), encoding="utf-8")
    return rows


def _row(name: str, number: int, entry: Entry, path: LoadPath, step: Step) -> Row:
    first = step.answers[0] if step.answers else None
    statuses = np.bincount(first.status, minlength=3) if first else np.zeros(3, int)
    local = not isinstance(step.problem, GlobalProblem)
    shape = path.gap_of(number).shape
    return Row(
        file=f"{name}-{number:04d}.hdf5",
        path=name,
        family=entry.family,
        step=number,
        form="local" if local else "global",
        dim=shape[1],
        contacts=shape[0],
        answers=len(step.answers),
        complete="yes" if step.complete else "no",
        determined="u" if path.redundant else "r and u",
        open=int(statuses[Status.OPEN]),
        slip=int(statuses[Status.SLIP]),
        stick=int(statuses[Status.STICK]),
        margin=first.margin if first else 1.0,
    )


def _write(target: Path, row: Row, entry: Entry, step: Step) -> None:
    vectors = [_vectors(step, answer) for answer in step.answers]
    answer, others = (vectors[0], vectors[1:]) if vectors else (None, [])
    guesses = others if step.proof is None else [step.proof]
    info = {
        "title": f"{row.path}, step {row.step + 1}",
        "description": entry.about + " " + rules.contents(row),
        "math_info": f"distance from a change of status {row.margin:.1e}",
    }
    write_file(target, step.problem, answer, guesses=guesses, info=info)


def _vectors(step: Step, answer: Reference) -> Vectors:
    if isinstance(step.problem, GlobalProblem):
        return Vectors(answer.u, answer.r, answer.y)
    rigid = step.problem.rigid
    return Vectors(answer.u, answer.r, None, None if rigid is None else answer.y)
