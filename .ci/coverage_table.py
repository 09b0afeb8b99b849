"""Print which regions and branches of the core no test reaches, from `llvm-cov export`.

A generic function is compiled several times, and each test program has its own copies.
`llvm-cov report` prints the copy that is reached best; here a region counts as reached if any
copy is.
"""

import json
import sys
from collections import defaultdict
from pathlib import PurePath
from typing import Any, TextIO

# Of a region: first line, its column, last line, its column; of a side of a branch, also which.
Place = tuple[int, ...]
CODE = 0  # kind of a region that is code: others are gaps and skipped ones


def count_reached(
    exported: dict[str, Any], folders: list[str]
) -> dict[str, dict[Place, int]]:
    """Count runs of each region and side of a branch, by file, summed over all copies."""
    runs: dict[str, dict[Place, int]] = defaultdict(lambda: defaultdict(int))
    for function in exported["data"][0]["functions"]:
        for *place, count, file, _, kind in function["regions"]:
            if kind == CODE:
                runs[function["filenames"][file]][tuple(place)] += count
        for *place, when_true, when_false, file, _, _ in function["branches"]:
            for side, count in ((1, when_true), (0, when_false)):
                runs[function["filenames"][file]][*place, side] += count
    short = {name: name[name.rfind("/src/") + 1 :] for name in runs}
    return {
        short[name]: dict(places)
        for name, places in sorted(runs.items())
        if any(PurePath(short[name]).is_relative_to(folder) for folder in folders)
    }


def summarise(places: dict[Place, int]) -> list[int]:
    """Regions, reached ones, sides of branches, reached ones."""
    kinds = [
        [count for place, count in places.items() if len(place) == size]
        for size in (4, 5)
    ]
    return [
        n for counts in kinds for n in (len(counts), sum(count > 0 for count in counts))
    ]


def describe(place: Place) -> str:
    """The line of a place; of a side of a branch also its column and the side."""
    if len(place) == 5:
        return f"{place[0]}:{place[1]} never {'true' if place[4] else 'false'}"
    return f"{place[0]}" if place[0] == place[2] else f"{place[0]}-{place[2]}"


def write_row(out: TextIO, name: str, numbers: list[int]) -> None:
    """Write one row of the table."""
    regions, reached, sides, taken = numbers
    out.write(
        f"{name:58}{reached:6}/{regions:<6}{reached / max(regions, 1):7.1%}"
        f"{taken:7}/{sides:<6}{taken / max(sides, 1):7.1%}\n"
    )


def main(folders: list[str]) -> None:
    """Write the table by file and by folder."""
    out, totals = sys.stdout, defaultdict(lambda: [0, 0, 0, 0])
    out.write(f"{'':58}{'regions reached':>20}{'sides of branches':>21}\n")
    for name, places in count_reached(json.load(sys.stdin), folders).items():
        numbers = summarise(places)
        write_row(out, name, numbers)
        never = [
            describe(place) for place, count in sorted(places.items()) if count == 0
        ]
        if never:
            out.write(f"    not reached: {', '.join(dict.fromkeys(never))}\n")
        for folder in (
            *(f for f in folders if PurePath(name).is_relative_to(f)),
            "all",
        ):
            totals[folder] = [
                a + b for a, b in zip(totals[folder], numbers, strict=True)
            ]
    for folder, numbers in totals.items():
        write_row(out, folder, numbers)


if __name__ == "__main__":
    main(sys.argv[1:])
