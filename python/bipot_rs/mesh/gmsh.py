"""Physical groups of gmsh files, by dimension and number.

meshio identifies a group by its name only: of two groups of the same name, one of curves
and one of surfaces, it loses one. In version 4.1 it reads only the first group of an entity
without a name, and no negative group, which means a reversed orientation.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import numpy as np

# Group numbers of each entity, by dimension and tag of the entity.
Groups = dict[tuple[int, int], list[int]]

_NAMES = re.compile(rb"^\$PhysicalNames\s*?\n(.*?)^\$EndPhysicalNames", re.M | re.S)


def names(path: Path) -> dict[tuple[int, int], str]:
    """Names by dimension and number of the group; `ValueError` if a line is malformed."""
    match = _NAMES.search(path.read_bytes())
    if match is None:
        return {}
    names_of_groups = {}
    for line in match[1].decode("utf-8", "replace").splitlines()[1:]:
        if not line.strip():
            continue
        try:
            dim, number, name = shlex.split(line)
            names_of_groups[int(dim), int(number)] = name
        except ValueError:
            raise ValueError(
                f"the mesh {path} has the physical name {line.strip()!r}, expected "
                "dimension, number and name in quotes"
            ) from None
    return names_of_groups


def of_entities(path: Path) -> Groups | None:
    """Groups of each entity in a file of version 4.1; None for other versions.

    The sign of a group, the orientation of the entity, is ignored: normals of surfaces
    point out of bodies.
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
    tags_of: Groups = {}
    try:
        counts = [values.size() for _ in range(4)]
        for dim, count in enumerate(counts):
            for _ in range(count):
                tag = values.whole()
                values.skip(3 if dim == 0 else 6)
                tags = [abs(values.whole()) for _ in range(values.size())]
                tags_of[dim, tag] = list(dict.fromkeys(tags))
                for _ in range(values.size() if dim else 0):
                    values.whole()
    except (StopIteration, ValueError):
        raise ValueError(
            f"the mesh {path} cannot be read: its $Entities do not match their counts"
        ) from None
    return tags_of


class _Text:
    """Numbers in text form."""

    def __init__(self, content: bytes) -> None:
        self._words: Iterator[bytes] = iter(content.split())

    def whole(self) -> int:
        return int(next(self._words))

    size = whole

    def skip(self, count: int) -> None:
        """Skip real numbers."""
        for _ in range(count):
            next(self._words)


class _Binary:
    """Numbers in binary form; counts have ``width`` bytes."""

    def __init__(self, content: bytes, width: int) -> None:
        self._content, self._at, self._width = content, 0, width

    def whole(self) -> int:
        return self._integer("i4")

    def size(self) -> int:
        return self._integer(f"u{self._width}")

    def skip(self, count: int) -> None:
        """Skip real numbers."""
        self._at += 8 * count

    def _integer(self, kind: str) -> int:
        dtype = np.dtype(kind)
        (integer,) = np.frombuffer(self._content, dtype, 1, self._at)
        self._at += dtype.itemsize
        return int(integer)
