"""Print what the package needs, with the extras that are named: a requirement a line.

pip installs this while the core compiles; with the package itself it would do one after the other.
"""

import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

PROJECT = tomllib.loads(
    (Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8")
)["project"]


def list_extra(name: str) -> Iterator[str]:
    """The requirements of an extra, and of those that it names itself."""
    for requirement in PROJECT["optional-dependencies"][name]:
        if others := re.fullmatch(rf"{PROJECT['name']}\[(.*)\]", requirement):
            for other in others[1].split(","):
                yield from list_extra(other)
        else:
            yield requirement


if __name__ == "__main__":
    needed = PROJECT["dependencies"] + [
        r for name in sys.argv[1:] for r in list_extra(name)
    ]
    sys.stdout.writelines(f"{requirement}\n" for requirement in needed)
