"""``bipot sweep --join``: join the parts of a study into one table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bipot_rs.cli.commands.sweep import opened, show, summary
from bipot_rs.cli.output_folder import SWEEP
from bipot_rs.cli.progress import complain
from bipot_rs.cli.study import join
from bipot_rs.cli.study.folder import set_aside, write_record
from bipot_rs.cli.study.table import write


def run(folders: Sequence[Path], out: Path | None, *, as_json: bool) -> int:
    """Join the parts; returns the worst exit status of the rows.

    Parameters
    ----------
    folders
        Folders of parts, or of studies solved in parts.
    out
        Folder to write; None: the one that the parts are in.

    Raises
    ------
    OSError, ValueError
        As `join.join`, or ``out`` is missing or cannot be written.
    """
    joined = join.join(folders)
    folder = joined.home if out is None else out
    if folder is None:
        raise ValueError("--out DIR is missing: the parts are in different folders")
    if any(folder.resolve() == one.resolve() for one in joined.folders.values()):
        raise ValueError(f"--out {folder} is the folder of a part, expected another")
    opened(folder)
    for before in set_aside(folder, {}):
        if not as_json:
            complain(f"an earlier table and its results are kept in {before}")
    path = folder / SWEEP
    join.copy_results(joined, folder)
    write_record(folder, joined.record)
    write(path, joined.keys, joined.rows)
    message = summary(joined.rows, folder)
    if missing := join.missing(joined):
        message += f"; {missing}"
    return show(joined.record.scene, joined.keys, joined.rows, message, as_json=as_json)
