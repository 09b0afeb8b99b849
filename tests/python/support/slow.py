"""Slow variants of parametrised tests, which `make verify` runs and `make test` does not.

    python -m pytest -n 2 --dist loadgroup -m "verify or not verify" -k … --junitxml=times.xml
    python tests/python/support/slow.py times.xml

writes ``tests/python/slow_tests.txt`` anew from measured times. Each function keeps its
fastest variants, up to a second of all, so that every test function still runs in
`make test`.
"""

import sys
import xml.etree.ElementTree as ET
from collections import defaultdict
from pathlib import Path

LIST = Path(__file__).parents[1] / "slow_tests.txt"
# Seconds: of the variants of one function that stay, and of one that may go.
STAY, LONG = 1.0, 0.25


def listed() -> frozenset[str]:
    """Ids of the slow variants."""
    return frozenset(LIST.read_text(encoding="utf-8").split("\n")[:-1])


def slow(times: Path) -> list[str]:
    """Choose the slow variants by the times of a JUnit file."""
    variants = defaultdict(list)
    for case in ET.parse(times).iter("testcase"):
        file = case.attrib["classname"].replace(".", "/") + ".py"
        function, bracket, _ = case.attrib["name"].partition("[")
        if bracket:
            one = float(case.attrib["time"]), f"{file}::{case.attrib['name']}"
            variants[file, function].append(one)
    chosen = []
    for known in variants.values():
        spent = 0.0
        for k, (seconds, name) in enumerate(sorted(known)):
            spent += seconds
            if k and spent > STAY and seconds > LONG:
                chosen.append(name)
    return sorted(chosen)


if __name__ == "__main__":
    LIST.write_text("\n".join([*slow(Path(sys.argv[1])), ""]), encoding="utf-8")
