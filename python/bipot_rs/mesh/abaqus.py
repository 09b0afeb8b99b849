"""Reader of Abaqus and CalculiX input files: nodes, cells, sets and surfaces.

meshio reads these files too, but it does not know plane strain and ``*SURFACE``, and it
assigns sets to the wrong cells if a block of cells has no set or two blocks share one.

Sets of the part and of the assembly are separate. If both have a set of the same name, the
name means that of the assembly, which supports and loads use. The set of the part is then
``INSTANCE.NAME``, as in the assembly.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from bipot_rs._lib.text_files import real, whole, without
from bipot_rs._lib.types import Ints
from bipot_rs.mesh.elements import Content
from bipot_rs.mesh.kinds import FACETS, OF_VTK

S = TypeVar("S")
T = TypeVar("T")
# Key of a set: whether it belongs to the part, and its name in capitals.
Key = tuple[bool, str]

# Nodes of cells are in the order of VTK.
_SOLIDS = {4: "tetra", 8: "hexahedron", 10: "tetra10", 20: "hexahedron20"}
_PLANE = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8"}
_LINES = {2: "line", 3: "line3"}
_NODES = {
    **{name: n for n, name in (*_SOLIDS.items(), *_PLANE.items())},
    "line": 2,
    "line3": 3,
}
# Family, number of nodes, letters for integration and formulation. Beams have the degree in
# place of the number of nodes, and triangles of STRI that of unknowns.
_TYPES = (
    (re.compile(r"C3D(\d+)[A-Z]*"), _SOLIDS),
    (re.compile(r"(?:CPE|CPS|CAX|S|M3D|SFM3D|R3D)(\d+)[A-Z]*"), _PLANE),
    (re.compile(r"STRI(\d+)[A-Z]*"), {3: "triangle", 65: "triangle6"}),
    (re.compile(r"(?:T2D|T3D|R2D)(\d+)[A-Z]*"), _LINES),
    (re.compile(r"B[23](\d)[A-Z]*"), {1: "line", 2: "line3", 3: "line"}),
)
# Shells and membranes: they are not cells of a 2D body.
_SHELL = re.compile(r"(?:S|M3D|SFM3D|R3D|STRI)\d+[A-Z]*")
_NUMBER = re.compile(r"[+-]?[0-9]+")

# Keywords that create or move nodes or cells, so that the lists are not complete.
_MAKING = {"SYSTEM", "NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY"}


# Keywords whose data are not of the mesh alone, but which say to which part it belongs.
_OUTLINE = {"END PART", "ASSEMBLY", "END ASSEMBLY", "END INSTANCE"}
# Files that include each other more deeply include themselves.
_DEEPEST = 16


@dataclass
class Section:
    """A keyword with its parameters, and its data lines with their numbers."""

    path: Path
    line: int
    word: str
    parameters: dict[str, str]
    rows: list[tuple[int, list[str]]]

    def named(self, key: str) -> str:
        """A parameter in capitals; "" without it."""
        return self.parameters.get(key, "").upper()

    def reals(self, line: int, row: Sequence[str]) -> list[float]:
        """The numbers of a data line; a missing one between commas is zero."""
        try:
            return [real(p.upper().replace("D", "E")) if p else 0.0 for p in row]
        except ValueError:
            what = f"is {', '.join(row)!r}, expected numbers"
            raise ValueError(f"{self.path}, line {line}: {what}") from None


def list_files(path: Path) -> Iterator[Path]:
    """A deck, and the files that it includes."""
    yield from dict.fromkeys(file for file, _, _ in _lines(path, path.parent))


def is_axisymmetric(path: Path) -> bool:
    """Whether a deck has cells of type CAX."""
    cells = re.compile(r"\*ELEMENT\b.*\bTYPE\s*=\s*CAX", re.IGNORECASE)
    return any(cells.match(line) for _, _, line in _lines(path, path.parent))


def _lines(path: Path, folder: Path, depth: int = 0) -> Iterator[tuple[Path, int, str]]:
    """Lines that are not comments, with file and number; those of ``*INCLUDE`` in place."""
    content = without(path.read_bytes())
    try:
        text = content.decode()
    except UnicodeDecodeError:
        # Comments may have any encoding; the data are ASCII.
        text = content.decode("latin-1")
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        if not line or line.startswith("**"):
            continue
        if not line.upper().startswith("*INCLUDE"):
            yield path, number, line
            continue
        name = _read_head(path, number, line).parameters.get("INPUT", "")
        beside, below = path.parent / name, folder / name
        file = beside if beside.is_file() else below
        if depth == _DEEPEST or not file.is_file():
            why = "which does not exist" if depth < _DEEPEST else "in a circle"
            raise ValueError(f"{path}, line {number}: includes {name!r}, {why}")
        yield from _lines(file, folder, depth + 1)


def list_sections(path: Path) -> Iterator[Section]:
    """The keywords of a deck in their order, with those of the files that it includes."""
    current: Section | None = None
    head = ""
    for file, number, text in _lines(path, path.parent):
        if text.startswith("*") or head:
            head += text
            if head.endswith(","):  # continued on the next line
                continue
            if current is not None:
                yield current
            current, head = _read_head(file, number, head), ""
        elif current is not None:
            current.rows.append((number, [part.strip() for part in text.split(",")]))
    if current is not None:
        yield current


def _read_head(path: Path, line: int, text: str) -> Section:
    word, *rest = (part.strip() for part in text[1:].split(","))
    parameters = {}
    for part in rest:
        key, _, value = part.partition("=")
        parameters[key.strip().upper()] = value.strip().strip('"')
    return Section(path, line, " ".join(word.upper().split()), parameters, [])


def read(path: Path) -> Content:
    """Read a file; keywords that do not concern the mesh are ignored.

    Raises `ValueError`: a line is invalid or not supported; the message gives its number. The
    file has shells but no solids.
    """
    return Reader(path).content


class Reader:
    """Reads the sections of a file in their order.

    ``rest`` are those that do not concern the mesh, and ``types`` the type of cells of each
    block of ``content``.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.node: dict[int, int] = {}
        self.places: list[list[float]] = []
        self.cell: dict[int, tuple[int, int]] = {}
        self.blocks: list[tuple[str, Ints]] = []
        self.types: list[str] = []
        self.rest: list[Section] = []
        self.shells = False
        self.nodes_of: dict[Key, list[int]] = {}
        self.cells_of: dict[Key, list[int]] = {}
        self.name: dict[Key, str] = {}
        self.faces: dict[Key, list[tuple[int, ...]]] = {}
        self.free: dict[Key, list[int]] = {}
        self.in_part = False
        self.part = ""
        take = {
            "NODE": self._nodes,
            "ELEMENT": self._cells,
            "NSET": self._set,
            "ELSET": self._set,
            "SURFACE": self._surface,
        }
        parts = 0
        for section in list_sections(path):
            self.path = section.path
            if "INPUT" in section.parameters:
                raise self._error(
                    section.line, "reads another file: copy its lines into this file"
                )
            if section.word in take:
                take[section.word](section)
            elif section.word in _MAKING:
                raise self._error(
                    section.line,
                    f"has *{section.word}, which creates or moves nodes and cells and is not "
                    "supported: write a file that lists all of them",
                )
            elif section.word == "PART":
                parts += 1
                if parts > 1:
                    raise self._error(
                        section.line,
                        "has a second part, whose numbers start again: write one file for "
                        "each part",
                    )
                self.in_part = True
                self.part = section.parameters.get("NAME", "")
            elif section.word == "END PART":
                self.in_part = False
            elif section.word == "INSTANCE":
                if section.rows:
                    raise self._error(
                        section.line,
                        "moves its part, expected an instance without translation",
                    )
                self.part = section.parameters.get("NAME", self.part)
            elif section.word not in _OUTLINE:
                self.rest.append(section)
        self.path = path
        points = np.zeros((len(self.places), 3))
        for row, place in zip(points, self.places, strict=True):
            row[: len(place)] = place
        if self.shells and not any(kind in _SOLIDS.values() for kind, _ in self.blocks):
            raise ValueError(
                f"the mesh {path} has shells but no solids: use CPE, CPS or CAX cells in 2D, or "
                "solid cells"
            )
        self.content = Content(
            points,
            self.blocks,
            sets=self._name_sets(self.cells_of, self._by_block),
            free=self._name_sets(self.free, self._by_block),
            node_sets=self._name_sets(self.nodes_of, self._places),
            faces={self._name_set(k, self.faces): v for k, v in self.faces.items()},
        )

    def _name_sets(
        self, sets: dict[Key, list[int]], made: Callable[[list[int]], T]
    ) -> dict[str, T]:
        return {
            self._name_set(key, sets): made(members) for key, members in sets.items()
        }

    def _name_set(self, key: Key, sets: Mapping[Key, Sequence[object]]) -> str:
        """Name of a set, with the instance if the assembly has another set of the name."""
        other = sets.get((False, key[1]))
        if key[0] and other is not None and set(other) != set(sets[key]):
            return f"{self.part}.{self.name[key]}"
        return self.name[key]

    def _places(self, numbers: list[int]) -> Ints:
        return np.unique([self.node[n] for n in numbers]).astype(np.int64)

    def _key(self, name: str) -> Key:
        return self.in_part, name.upper()

    def find_set(self, sets: dict[Key, S], name: str) -> S | None:
        """Find a set by name: ``INSTANCE.NAME`` in the part, or NAME in the part or assembly."""
        word = name.strip('"').upper()
        outer, _, inner = word.partition(".")
        if inner and outer == self.part.upper():
            members = sets.get((True, inner))
            if members is not None:
                return members
        first = sets.get((self.in_part, word))
        return sets.get((not self.in_part, word)) if first is None else first

    def _error(self, line: int, what: str) -> ValueError:
        return ValueError(f"{self.path}, line {line}: {what}")

    def _numbers(self, line: int, row: list[str]) -> list[int]:
        try:
            return [whole(part) for part in row if part]
        except ValueError:
            raise self._error(
                line, f"is {', '.join(row)!r}, expected whole numbers"
            ) from None

    def _nodes(self, section: Section) -> None:
        if section.parameters.get("SYSTEM", "R").upper() != "R":
            raise self._error(section.line, "has nodes that are not Cartesian")
        numbers = []
        for line, (first, *rest) in section.rows:
            (number,) = self._numbers(line, [first]) or [0]
            while rest and not rest[-1]:
                rest.pop()
            place = section.reals(line, rest)
            if not 2 <= len(place) <= 3:
                raise self._error(
                    line, f"has {len(place)} coordinates, expected 2 or 3"
                )
            if number in self.node:
                raise self._error(line, f"defines node {number} a second time")
            self.node[number] = len(self.places)
            self.places.append(place)
            numbers.append(number)
        if "NSET" in section.parameters:
            self._add(self.nodes_of, section.parameters["NSET"], numbers)

    def _cells(self, section: Section) -> None:
        name = section.parameters.get("TYPE", "").upper()
        kind = self._kind(section.line, name)
        flat: list[int] = []
        width = 1 + _NODES[kind]
        for line, row in section.rows:
            flat += self._numbers(line, row)
            last = line
        if not flat:
            return
        if len(flat) % width:
            raise self._error(
                last, f"ends before a cell of type {name} has its {width - 1} nodes"
            )
        table = np.array(flat, dtype=np.int64).reshape(-1, width)
        unknown = [n for n in np.unique(table[:, 1:]).tolist() if n not in self.node]
        if unknown:
            raise self._error(
                section.line,
                f"has cells with node {unknown[0]}, which is not in the file",
            )
        numbers = np.vectorize(self.node.__getitem__, otypes=[np.int64])(table[:, 1:])
        if kind == "line3":  # nodes along the line; in VTK the midpoint comes last
            numbers = numbers[:, [0, 2, 1]]
        for k, number in enumerate(table[:, 0].tolist()):
            if number in self.cell:
                raise self._error(section.line, f"defines cell {number} a second time")
            self.cell[number] = (len(self.blocks), k)
        self.blocks.append((kind, numbers))
        self.types.append(name)
        self.shells |= bool(_SHELL.fullmatch(name))
        if "ELSET" in section.parameters:
            self._add(self.cells_of, section.parameters["ELSET"], table[:, 0].tolist())

    def _kind(self, line: int, name: str) -> str:
        for pattern, kinds in _TYPES:
            match = pattern.fullmatch(name)
            if match and int(match[1]) in kinds:
                return kinds[int(match[1])]
        why = ", which twist" if name.startswith("CGAX") else ""
        raise self._error(
            line,
            f"has cells of type {name or '?'}{why}, expected C3D4, C3D8, C3D10, C3D20, "
            "CPE, CPS or CAX with 3, 4, 6 or 8 nodes, or shells and lines on their surface",
        )

    def _add(self, sets: dict[Key, list[int]], name: str, numbers: list[int]) -> None:
        self.name.setdefault(self._key(name), name)
        sets.setdefault(self._key(name), []).extend(numbers)

    def _set(self, section: Section) -> None:
        nodes = section.word == "NSET"
        name = section.parameters.get(section.word, "")
        if not name:
            raise self._error(
                section.line, f"has no {section.word}=, the name of the set"
            )
        what: Literal["nodes", "cells"] = "nodes" if nodes else "cells"
        members: list[int] = []
        for line, row in section.rows:
            if "GENERATE" in section.parameters:
                existing = self.node if nodes else self.cell
                numbers = self._generate_numbers(line, row)
                members += [n for n in numbers if n in existing]
                continue
            for part in filter(None, row):
                members += self._members(line, part, what)
        if nodes and "ELSET" in section.parameters:
            places: set[int] = set()
            cells = section.parameters["ELSET"]
            for number in self._members(section.line, cells, "cells"):
                block, k = self.cell[number]
                places.update(self.blocks[block][1][k].tolist())
            members += [n for n, at in self.node.items() if at in places]
        self._add(self.nodes_of if nodes else self.cells_of, name, members)

    def _surface(self, section: Section) -> None:
        name = section.parameters.get("NAME", "")
        if not name:
            raise self._error(section.line, "has a surface without NAME=")
        self.name.setdefault(self._key(name), name)
        if section.parameters.get("TYPE", "ELEMENT").upper() == "NODE":
            for line, row in section.rows:
                members = self._members(line, row[0], "nodes")
                self._add(self.nodes_of, name, members)
            return
        faces = self.faces.setdefault(self._key(name), [])
        for line, row in section.rows:
            cells = self._members(line, row[0], "cells")
            label = row[1].upper() if len(row) > 1 else ""
            if not label:
                self.free.setdefault(self._key(name), []).extend(cells)
                continue
            for number in cells:
                block, k = self.cell[number]
                kind, nodes = self.blocks[block]
                sides = FACETS[OF_VTK[kind].shape] if kind in OF_VTK else []
                if not re.fullmatch(r"S[1-6]", label) or int(label[1]) > len(sides):
                    raise self._error(
                        line,
                        f"has face {label} of a {kind}, expected S1 to S{len(sides)}",
                    )
                face = sides[int(label[1]) - 1]
                faces.append(tuple(nodes[k, list(face)].tolist()))

    def _generate_numbers(self, line: int, row: list[str]) -> range:
        """Numbers from a line "first, last, step" of *NSET or *ELSET with GENERATE."""
        numbers = self._numbers(line, row)
        first, last, step = [*numbers, 1][:3] if len(numbers) in (2, 3) else (0, 0, 0)
        if step < 1 or last < first:
            raise self._error(
                line,
                f"generates {', '.join(filter(None, row)) or 'nothing'}, expected first, "
                "last, step with first <= last and step >= 1",
            )
        return range(first, last + 1, step)

    def _members(
        self, line: int, word: str, what: Literal["nodes", "cells"]
    ) -> list[int]:
        """Numbers of a set, or the one number that stands in place of a name."""
        sets, named = {
            "nodes": (self.nodes_of, self.node.keys()),
            "cells": (self.cells_of, self.cell.keys()),
        }[what]
        members = self.find_set(sets, word)
        if members is None and _NUMBER.fullmatch(word) and whole(word) in named:
            members = [whole(word)]
        if members is None:
            raise self._error(line, f"uses {what} {word!r} that are not defined")
        return members

    def _by_block(self, numbers: list[int]) -> list[Ints]:
        by_block: list[list[int]] = [[] for _ in self.blocks]
        for number in dict.fromkeys(numbers):
            block, k = self.cell[number]
            by_block[block].append(k)
        return [np.array(sorted(cells), dtype=np.int64) for cells in by_block]
