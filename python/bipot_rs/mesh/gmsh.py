"""Physical groups of gmsh's files, by dimension and number.

meshio knows a group by its name alone, so that of two of one name, a curve's and a
surface's, one is lost; of version 4.1 it takes from an entity without a name the first of
its groups only, and none that is negative, whose entity is oriented the other way.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import numpy as np

# Numbers of groups of each entity, by dimension and tag of the entity.
Groups = dict[tuple[int, int], list[int]]

_NAMES = re.compile(rb"^\$PhysicalNames\s*?\n(.*?)^\$EndPhysicalNames", re.M | re.S)


def names(path: Path) -> dict[tuple[int, int], str]:
    """Names by dimension and number of the group; `ValueError` for what is no list."""
    found = _NAMES.search(path.read_bytes())
    if found is None:
        return {}
    known = {}
    for line in found[1].decode("utf-8", "replace").splitlines()[1:]:
        if not line.strip():
            continue
        try:
            dim, number, name = shlex.split(line)
            known[int(dim), int(number)] = name
        except ValueError:
            raise ValueError(
                f"the mesh {path} names a group by {line.strip()!r}, expected dimension, "
                "number and name in quotes"
            ) from None
    return known


def of_entities(path: Path) -> Groups | None:
    """Groups of each entity in a file of version 4.1; None of another, which has none.

    The sign, which orients the entity, is left out: normals point out of bodies.
    """
    content = path.read_bytes()
    head = re.search(rb"^\$MeshFormat\s*?\n(\S+) (\d) (\d)", content, re.M)
    start = re.search(rb"^\$Entities\s*?\n", content, re.M)
    # "4" stands for 4.1 in some files; 4.0 has its own order of fields.
    if head is None or head[1] not in (b"4", b"4.1") or start is None:
        return None
    rest = content[start.end() :]
    values: _Text | _Binary
    if head[2] == b"0":
        values = _Text(rest[: rest.find(b"$EndEntities")])
    else:
        values = _Binary(rest, int(head[3]))
    found: Groups = {}
    try:
        counts = [values.size() for _ in range(4)]
        for dim, count in enumerate(counts):
            for _ in range(count):
                tag = values.whole()
                values.skip(3 if dim == 0 else 6)
                own = [abs(values.whole()) for _ in range(values.size())]
                found[dim, tag] = list(dict.fromkeys(own))
                for _ in range(values.size() if dim else 0):
                    values.whole()
    except (StopIteration, ValueError):
        raise ValueError(
            f"the mesh {path} cannot be read: its $Entities are not as told"
        ) from None
    return found


class _Text:
    """Numbers written out."""

    def __init__(self, content: bytes) -> None:
        self._words: Iterator[bytes] = iter(content.split())

    def whole(self) -> int:
        return int(next(self._words))

    size = whole

    def skip(self, count: int) -> None:
        """Leave out real numbers."""
        for _ in range(count):
            next(self._words)


class _Binary:
    """Numbers as they stand in memory; counts take ``width`` bytes."""

    def __init__(self, content: bytes, width: int) -> None:
        self._content, self._at, self._width = content, 0, width

    def whole(self) -> int:
        return self._integer("i4")

    def size(self) -> int:
        return self._integer(f"u{self._width}")

    def skip(self, count: int) -> None:
        """Leave out real numbers."""
        self._at += 8 * count

    def _integer(self, kind: str) -> int:
        dtype = np.dtype(kind)
        (found,) = np.frombuffer(self._content, dtype, 1, self._at)
        self._at += dtype.itemsize
        return int(found)
