"""The numbers behind a picture: a CSV beside it, which a fresh run is compared with.

The picture carries a digest of its numbers, so that one that is older than they are shows.
"""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

HEAD = ("panel", "curve", "x", "y")


class Point(NamedTuple):
    """A point of a curve of a panel."""

    panel: str
    curve: str
    x: float
    y: float


def write(path: Path, points: Iterable[Point]) -> None:
    """Write a CSV, its numbers with six digits."""
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(HEAD)
        rows.writerows((p.panel, p.curve, f"{p.x:.6g}", f"{p.y:.6g}") for p in points)


def read(path: Path) -> list[Point]:
    """Read what `write` has written."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return [Point(r["panel"], r["curve"], float(r["x"]), float(r["y"])) for r in rows]


def digest(path: Path) -> str:
    """What the picture says of the numbers that it was drawn from."""
    return "sha256 " + hashlib.sha256(path.read_bytes()).hexdigest()


def save(figure: Any, picture: Path, numbers: Path, **options: Any) -> None:
    """Save a picture with the digest of its numbers, without a date."""
    metadata = {"Description": digest(numbers)}
    if picture.suffix == ".svg":
        metadata["Date"] = None
    figure.savefig(picture, metadata=metadata, **options)
