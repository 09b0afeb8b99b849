"""A scene from a deck of Abaqus or CalculiX: materials, supports, loads, contacts and steps.

Parts of the mesh that share no node are separate bodies. A load step of the scene is the end of
a ``*STEP``, or a point of an amplitude within it. What a scene cannot say is listed by line.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats, OpenRecord
from bipot_rs.mesh.abaqus import Reader, Section
from bipot_rs.mesh.elements import facet_nodes
from bipot_rs.mesh.readers import read_mesh
from bipot_rs.scene.builder import Model
from bipot_rs.scene.schema.table import AXES

# Keywords that change no number of the solution.
_SILENT = re.compile(
    "HEADING|PREPRINT|RESTART|OUTPUT|.* OUTPUT|.* FILE|.* PRINT|MONITOR|END STEP|CONTROLS"
    "|TIME POINTS|FILE FORMAT"
)
_LOADS = ("BOUNDARY", "CLOAD", "DLOAD", "DSLOAD")
# Entries that each data line has at least; of the first three there is a line.
_LEAST = {"ELASTIC": 2, "DENSITY": 1, "FRICTION": 1, "CONTACT PAIR": 2, "BOUNDARY": 2}
_LEAST |= dict.fromkeys(_LOADS[1:], 3)
# Parameters that are taken, or change nothing; others are listed.
_KNOWN = {
    **dict.fromkeys(_LOADS, ("OP", "AMPLITUDE")),
    "STEP": ("INC", "NAME"),
    "STATIC": ("DIRECT", "SOLVER"),
    "AMPLITUDE": ("NAME", "TIME"),
    "CONTACT PAIR": ("INTERACTION", "TYPE", "SMALL SLIDING"),
    "SOLID SECTION": ("ELSET", "MATERIAL"),
}
_NAMED = {
    **dict.fromkeys(("ENCASTRE", "PINNED"), (1, 3)),
    **{f"{axis.upper()}SYMM": (k + 1, k + 1) for k, axis in enumerate(AXES)},
}
# Supports of nodes one by one, at most.
_MOST_NODES = 200
# Value and amplitude of a load, in the steps that change it.
_Changes = dict[int, tuple[float, str]]


@dataclass
class _LoadStep:
    start: float = 0.0
    period: float = 1.0
    sections: list[Section] = field(default_factory=list)
    times: list[float] = field(default_factory=list)


@dataclass
class _Piece:
    """A body: the material of each of its element sets, its cells, and places on its mesh."""

    plane: dict[str, object] = field(default_factory=dict)
    materials: dict[str, str] = field(default_factory=dict)
    cells: set[int] = field(default_factory=set)
    points: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    at: dict[tuple[float, ...], int] = field(default_factory=dict)
    # Name and nodes of each surface, by its name in capitals.
    surfaces: dict[str, tuple[str, set[int]]] = field(default_factory=dict)


class Deck:
    """A deck that becomes a scene.

    ``sets``: sets that the mesh of the scene needs besides those of the deck, as lines of a
    deck.
    ``notes``: what the scene does not take: ``"line 7: *TIE is not taken"``.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.sets: list[str] = []
        self.notes: list[str] = []
        self._mesh = Reader(path)
        # The data before the first step belong to it.
        self._steps = [_LoadStep()]
        self._elastic: dict[str, list[float]] = {}
        self._density: dict[str, float] = {}
        self._mu: dict[str, float] = {}
        self._amplitudes: dict[str, tuple[Floats, bool]] = {}
        self._pairs: list[Section] = []
        self._pieces: dict[str, _Piece] = {}
        self._factors: dict[tuple[float, ...], str] = {}
        self._read()
        for step in self._steps:
            times = {step.period}
            for section in step.sections:
                within = self._curve(section.named("AMPLITUDE"), step)[:, 0].tolist()
                times |= {t for t in within if 0 < t < step.period}
            step.times = sorted(times)
            self._name_faces(step)

    def _note(self, section: Section, why: str, line: int = 0) -> None:
        file = "" if section.path == self.path else f"{section.path.name}, "
        note = f"{file}line {line or section.line}: *{section.word} {why}"
        self.notes += [] if note in self.notes else [note]

    def _read(self) -> None:
        """Take the keywords that need no surfaces, and keep the others."""
        material = interaction = ""
        begun, solved, sectioned = False, True, []
        for section in self._mesh.rest:
            word, rows = section.word, section.rows
            least = _LEAST.get(word, 0)
            short = [line for line, row in rows if len(row) < least]
            if short or (least and word in list(_LEAST)[:3] and not rows):
                where = f"{section.path}, line {(short or [section.line])[0]}"
                raise ValueError(f"{where}: *{word} has fewer than {least} entries")
            parameters = _KNOWN.get(word, section.parameters)
            other = [key for key in section.parameters if key not in parameters]
            if other:
                self._note(section, f"has {', '.join(other)}, which is not taken")
            if word == "STEP":
                if begun:
                    last = self._steps[-1]
                    self._steps.append(_LoadStep(last.start + last.period))
                begun = solved = True
            elif not solved or (other and word in _LOADS):
                continue
            elif word == "STATIC":
                for line, row in rows[:1]:
                    (period,) = section.reals(line, [*row, ""][1:2])
                    self._steps[-1].period = period or 1.0
            elif word == "MATERIAL":
                material = section.named("NAME")
            elif word == "SURFACE INTERACTION":
                interaction = section.named("NAME")
            elif word == "ELASTIC" and section.named("TYPE")[:3] in ("", "ISO"):
                self._elastic[material] = section.reals(rows[0][0], rows[0][1][:2])
                if len(rows) > 1:
                    self._note(section, "varies: its first line is taken")
            elif word == "DENSITY":
                self._density[material] = section.reals(*rows[0])[0]
            elif word == "FRICTION":
                self._mu[interaction] = section.reals(*rows[0])[0]
            elif word == "SURFACE BEHAVIOR":
                if section.named("PRESSURE-OVERCLOSURE") not in ("", "HARD"):
                    self._note(section, "is taken as hard contact")
            elif word == "SOLID SECTION":
                sectioned.append(section)
            elif word == "CONTACT PAIR":
                self._pairs.append(section)
            elif word == "AMPLITUDE":
                flat = [v for line, row in rows for v in section.reals(line, row)]
                table = np.array(flat[: len(flat) // 2 * 2]).reshape(-1, 2)
                total = section.named("TIME").startswith("TOTAL")
                self._amplitudes[section.named("NAME")] = table, total
            elif word in _LOADS:
                here = self._steps[-1].sections
                if section.named("OP") == "NEW":
                    # Those before the first step end with it.
                    kept = [s for s in here if s.word != word or s.named("OP") == "NEW"]
                    here[:] = kept
                here.append(section)
            elif word in ("DYNAMIC", "FREQUENCY", "BUCKLE", "HEAT TRANSFER", "VISCO"):
                self._note(section, "is not static: its step is not taken")
                solved, begun = False, len(self._steps) > 1
                if begun:
                    self._steps.pop()
            elif not _SILENT.fullmatch(word):
                self._note(section, "is not taken")
        self._split_bodies(sectioned)

    def _curve(self, name: str, step: _LoadStep) -> Floats:
        """Times in a step and factors of an amplitude; empty without one."""
        table, total = self._amplitudes.get(name, (np.zeros((0, 2)), False))
        return table - [total * step.start, 0.0]

    def _split_bodies(self, sectioned: Sequence[Section]) -> None:
        """Split the mesh into bodies, parts that share no node, each with its materials."""
        mesh = self._mesh
        pairs = [(np.repeat(n[:, 0], n.shape[1]), n.ravel()) for _, n in mesh.blocks]
        ends = np.concatenate(pairs, axis=1) if pairs else np.zeros((2, 0), np.int64)
        part = _core.connected(len(mesh.places), *ends)
        pieces: dict[int, _Piece] = {}
        for section in sectioned:
            name = section.parameters.get("ELSET", "")
            cells: dict[int, list[int]] = {}
            for number in dict.fromkeys(mesh.find_set(mesh.cells_of, name) or ()):
                block, k = mesh.cell[number]
                cells.setdefault(part[mesh.blocks[block][1][k, 0]], []).append(number)
            for k, (owner, members) in enumerate(cells.items(), 1):
                body = name if len(cells) == 1 else f"{name}_{k}"
                if body != name:
                    rows = "\n".join(map(str, members))
                    self.sets.append(f"*ELSET, ELSET={body}\n{rows}")
                piece = pieces.setdefault(owner, _Piece())
                piece.materials[body] = section.named("MATERIAL")
                piece.cells.update(members)
                kind = mesh.types[mesh.cell[members[0]][0]]
                if kind.startswith("CPS"):
                    piece.plane["plane"] = "stress"
                if kind.startswith("CAX"):
                    piece.plane["plane"] = "axisymmetric"
                for line, row in section.rows[:1] if kind.startswith("CP") else ():
                    piece.plane["thickness"] = section.reals(line, row)[0] or 1.0
        if not pieces:
            raise ValueError(f"{self.path} has no *SOLID SECTION with cells")
        for piece in pieces.values():
            name = _make_name(next(iter(piece.materials)))
            while name in self._pieces:
                name += "_"
            self._pieces[name] = piece

    def _name_faces(self, step: _LoadStep) -> None:
        """Define surfaces of the faces that ``*DLOAD`` names by cells and a label."""
        for section in step.sections:
            for _, row in section.rows if section.word == "DLOAD" else ():
                if re.fullmatch("P[1-6]", row[1].upper()):
                    name = _make_name("_".join(row[:2])).upper()
                    text = f"*SURFACE, NAME={name}\n{row[0].upper()}, S{row[1][1]}"
                    self.sets += [] if text in self.sets else [text]

    def model(self, mesh: Path, file: str) -> Model:
        """The scene, whose bodies are parts of ``mesh``, which it calls ``file``."""
        m = Model(self.path.stem)
        each = [p.materials.values() for p in self._pieces.values()]
        for name in dict.fromkeys(chain(*each)):
            if name not in self._elastic:
                what = f"material {name!r} has no isotropic *ELASTIC"
                raise ValueError(f"{self.path}: {what}")
            young, poisson = self._elastic[name]
            m.material(_make_name(name), young=young, poisson=poisson)
        for name, piece in self._pieces.items():
            group = list(piece.materials)
            elements = read_mesh(mesh, group)
            piece.points = elements.p.T
            piece.at = {tuple(x): k for k, x in enumerate(elements.p.T.tolist())}
            for surface, facets in (elements.boundaries or {}).items():
                nodes = np.unique(facet_nodes(elements, np.asarray(facets))).tolist()
                piece.surfaces[surface.upper()] = surface, set(nodes)
            materials = {
                part: _make_name(word) for part, word in piece.materials.items()
            }
            only = len(group) == 1
            parts = {"file": file, "group": group[0] if only else group}
            material = materials[group[0]] if only else materials
            m.body(name, mesh=parts, material=material, **piece.plane)
        self._support(m)
        self._load(m)
        self._touch(m)
        count = sum(len(step.times) for step in self._steps)
        if count > 1:
            factors: OpenRecord = {n: list(f) for f, n in self._factors.items()}
            m.path(steps=count, **factors)
        return m

    def _list_rows(self, *words: str) -> Iterator[tuple[int, Section, int, list[str]]]:
        for k, step in enumerate(self._steps):
            for section in step.sections:
                for line, row in section.rows if section.word in words else ():
                    yield k, section, line, row

    def _choose_nodes(
        self, section: Section, line: int, word: str, *, each: bool = False
    ) -> Iterator[tuple[OpenRecord, int]]:
        """Keys that choose the nodes of a set, with the number of nodes that they choose.

        ``each``: whether nodes that are no whole surface are chosen one by one.
        """
        mesh = self._mesh
        node = int(word) if word.isdecimal() else -1
        numbers = mesh.find_set(mesh.nodes_of, word) or [node]
        if not all(number in mesh.node for number in numbers):
            where = f"{section.path}, line {line}"
            raise ValueError(f"{where}: there are no nodes {word!r}")
        wanted = {(*mesh.places[mesh.node[n]], 0.0)[:3] for n in numbers}
        for body, piece in self._pieces.items():
            d = piece.points.shape[1]
            here = {piece.at[x[:d]] for x in wanted if x[:d] in piece.at}
            if not here:
                continue
            name, nodes = piece.surfaces.get(word.strip('"').upper(), ("", set()))
            x = piece.points[sorted(here)]
            low, high = x.min(axis=0), x.max(axis=0)
            # As `within` chooses.
            slack = 1e-9 * np.ptp(piece.points, axis=0)
            inside = (piece.points >= low - slack) & (piece.points <= high + slack)
            if nodes == here:
                yield {"on": f"{body}.{name}"}, len(here)
            elif inside.all(axis=1).sum() == len(here) > 1 and not each:
                ranges = np.stack([low, high], axis=1).tolist()
                within = dict(zip(AXES, ranges, strict=False))
                yield {"on": body, "within": within}, len(here)
            elif len(here) <= _MOST_NODES:
                yield from (({"on": body, "at": at}, 1) for at in x.tolist())
            else:
                self._note(section, f"on {word}, no surface, is not taken", line)

    def _number(self, kind: str, changes: _Changes) -> Any:
        """A number of the scene, with its factors at the ends of the load steps."""
        values, value = [], 0.0
        for k, step in enumerate(self._steps):
            before = value
            renewed = {s.word for s in step.sections if s.named("OP") == "NEW"}
            kept = 0.0 if kind in renewed and kind != "BOUNDARY" else before
            end, amplitude = changes.get(k, (kept, ""))
            curve = self._curve(amplitude, step)
            for t in step.times:
                value = before + (end - before) * t / step.period
                if len(curve):
                    value = end * float(np.interp(t, *curve.T))
                values.append(value)
        largest = max(values, key=abs)
        factors = tuple(v / largest if largest else 1.0 for v in values)
        if set(factors) == {1.0}:
            return largest
        name = self._factors.setdefault(factors, f"history_{len(self._factors) + 1}")
        return {"value": largest, "amplitude": name}

    def _support(self, m: Model) -> None:
        supports: dict[str, tuple[OpenRecord, dict[int, _Changes]]] = {}
        for k, section, line, row in self._list_rows("BOUNDARY"):
            texts = [part or row[1] for part in (*row, "")[1:3]]
            reals = section.reals(line, texts) if row[1].upper() not in _NAMED else []
            dofs = _NAMED.get(row[1].upper()) or [int(v) for v in reals]
            if dofs[0] < 1:
                where = f"{section.path}, line {line}"
                raise ValueError(f"{where}: has component {row[1]}, expected 1 to 6")
            (value,) = section.reals(line, row[3:4]) or [0.0]
            if dofs[1] > 3:
                self._note(section, "of rotations is not taken", line)
            if k and section.named("OP") == "NEW":
                self._note(section, "has OP=NEW: supports stay until the end", line)
            for keys, _ in self._choose_nodes(section, line, row[0]):
                for dof in range(dofs[0] - 1, min(dofs[1], 3)):
                    held = supports.setdefault(str(keys), (keys, {}))[1]
                    if k and dof not in held:
                        self._note(section, "begins after step 1: not taken", line)
                    else:
                        change = value, section.named("AMPLITUDE")
                        held.setdefault(dof, {})[k] = change
        for keys, held in supports.values():
            d = self._pieces[keys["on"].partition(".")[0]].points.shape[1]
            each = [(k, self._number("BOUNDARY", c)) for k, c in held.items() if k < d]
            if each:
                m.support(**keys, **{AXES[k]: number for k, number in each})

    def _load(self, m: Model) -> None:
        """Pressures, tractions, gravity, and forces on nodes that make up a surface."""
        loads: dict[tuple[str, ...], _Changes] = {}
        first: dict[tuple[str, ...], tuple[Section, int]] = {}
        for k, section, line, row in self._list_rows("DLOAD", "DSLOAD", "CLOAD"):
            while not row[-1]:
                row.pop()
            # The direction is part of what is loaded.
            key = section.word, row[0].upper(), row[1].upper(), *row[3:]
            if k in loads.get(key, ()):
                self._note(section, "is repeated: the last one is taken", line)
            (value,) = section.reals(line, row[2:3]) or [0.0]
            loads.setdefault(key, {})[k] = value, section.named("AMPLITUDE")
            first.setdefault(key, (section, line))
        forces: dict[str, tuple[OpenRecord, OpenRecord]] = {}
        for key, changes in loads.items():
            (word, place, label, *rest), (section, line) = key, first[key]
            taken = False
            if word == "CLOAD" and label in ("1", "2", "3"):
                for keys, count in self._choose_nodes(section, line, place, each=True):
                    # A node may have the loads of several sets.
                    force = forces.setdefault(f"{place} {keys}", (keys, {}))[1]
                    number = self._number(word, changes)
                    force[AXES[int(label) - 1]] = _scale(number, count)
                    if "at" not in keys:
                        self._note(section, f"on {place} is spread evenly", line)
                    taken = True
            direction = np.array(section.reals(line, rest))
            for on in self._on(
                place if word == "DSLOAD" else _make_name(f"{place}_{label}")
            ):
                if re.fullmatch("P[1-6]?", label):
                    m.pressure(on, self._number(word, changes))
                    taken = True
                elif label == "TRVEC":
                    unit = direction / np.linalg.norm(direction)
                    m.traction(on, **self._vector(word, changes, unit))
                    taken = True
            for body, density in self._masses(place) if label == "GRAV" else ():
                weight = density * direction
                m.body_force(body, **self._vector(word, changes, weight))
                taken = True
            if not taken:
                self._note(section, f"{label} on {place} is not taken", line)
        for k, (keys, force) in enumerate(forces.values(), 1):
            if "at" not in keys:
                m.remote(_make_name(keys["on"]), **keys, distributed=True, force=force)
                continue
            # A rigid set of one node that does not turn is this node.
            within = {a: [x, x] for a, x in zip(AXES, keys["at"], strict=False)}
            turn = dict.fromkeys(AXES if len(within) == 3 else AXES[2:], 0.0)
            table: OpenRecord = {"within": within, "turn": turn, "force": force}
            m.remote(f"node_{k}", on=keys["on"], **table)

    def _vector(self, kind: str, changes: _Changes, parts: Floats) -> OpenRecord:
        number = self._number(kind, changes)
        each = zip(AXES, parts.tolist(), strict=False)
        return {axis: _scale(number, part) for axis, part in each if part}

    def _masses(self, place: str) -> Iterator[tuple[str, float]]:
        """Bodies of one density that are parts of a set."""
        cells = set(self._mesh.find_set(self._mesh.cells_of, place) or ())
        for body, piece in self._pieces.items():
            densities = {
                self._density.get(name, 0.0) for name in piece.materials.values()
            }
            if len(densities) == 1 and all(densities) and piece.cells <= cells:
                yield body, densities.pop()

    def _touch(self, m: Model) -> None:
        names: list[str] = []
        for section in self._pairs:
            mu = self._mu.get(section.named("INTERACTION"), 0.0)
            for line, (slave, master, *_) in section.rows:
                before = len(names)
                for on, against in product(self._on(slave), self._on(master)):
                    if on.partition(".")[0] == against.partition(".")[0]:
                        continue
                    name = _make_name(slave)
                    while name in names:
                        name += "_"
                    names.append(name)
                    m.contact(on, name=name, against=against, pairing="mortar", mu=mu)
                if len(names) == before:
                    self._note(section, "joins no two bodies: it is not taken", line)
        if not names:
            self.notes.append("no contact: add [[contact]], as with a rigid plane")

    def _on(self, name: str) -> list[str]:
        """A surface on each body that has a part of it."""
        surfaces = [(b, p.surfaces.get(name.upper())) for b, p in self._pieces.items()]
        return [f"{body}.{surface[0]}" for body, surface in surfaces if surface]


def _scale(number: Any, factor: float) -> Any:
    if isinstance(number, dict):
        return number | {"value": number["value"] * factor}
    return number * factor


def _make_name(name: str) -> str:
    """Make a name of a scene from one of a deck: letters, digits and ``_``, with a letter first."""
    word = re.sub(r"\W", "_", name)
    return word if re.match(r"[^\W\d]", word) else f"n{word}"
