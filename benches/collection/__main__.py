"""``python -m collection DIR`` in the folder ``benches``: write the collection, or check one."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from collection.catalogue import PATHS
from collection.checks import Checked, check, summary
from collection.manifest import Row
from collection.write import generate


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Returns
    -------
    int
        0; 1 if a file is wrong; 2 for a wrong argument, or a folder that cannot be read or
        written.
    """
    parser = argparse.ArgumentParser(prog="python -m collection", description=__doc__)
    parser.add_argument(
        "folder", nargs="?", metavar="DIR", help="folder of the collection"
    )
    parser.add_argument("--check", action="store_true", help="check the files of DIR")
    parser.add_argument("--only", metavar="NAME,...", help="write these paths alone")
    parser.add_argument("--list", action="store_true", help="print all paths, and stop")
    options = parser.parse_args(arguments)
    if options.list:
        _print("\n".join(f"{name:24} {entry.about}" for name, entry in PATHS.items()))
        return 0
    if options.folder is None:
        parser.error("DIR is missing")
    if options.check and options.only:
        parser.error("--only selects paths to write: leave it out with --check")
    try:
        if options.check:
            checked_files = check(options.folder, on_file=_tell)
            _print(summary(checked_files))
            return int(any(file.faults for file in checked_files))
        generate(
            options.folder, options.only and options.only.split(","), on_file=_progress
        )
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _print(text: str) -> None:
    print(text, flush=True)


def _tell(one: Checked) -> None:
    words = "; ".join(one.faults) or "right"
    _print(f"{one.file}: {words}, estimated error {one.error:.1e}")


def _progress(row: Row) -> None:
    answers = f"{row.answers} answers" if row.answers != 1 else "1 answer"
    _print(f"{row.file}: {row.contacts} contacts, {answers}")


if __name__ == "__main__":
    sys.exit(main())
