"""Read a contact problem from files of another program: stiffness, contacts, loads.

The stiffness is a Matrix Market file, or the lines ``row node, row component, column node,
column component, value`` of Abaqus (`*MATRIX OUTPUT, FORMAT=MATRIX INPUT`, its default),
with one triangle or both. For a Matrix Market file the node list gives the degrees of
freedom, in the order of its rows: x, y[, z] of each node (``node``), or all x, then all
y[, then all z] (``component``). K times each rigid motion of the listed nodes must be
zero, otherwise the files are refused (`dof_order`).

The tables are comma-separated; the first line names the columns:

contacts
    ``node``, with ``other`` if the obstacle is a node too; or degrees of freedom, counted
    from 0, ``dof_x, dof_y[, dof_z]``, with ``other_x, …``. The normal ``nx, ny[, nz]``, of
    any length, points from the obstacle to the body of ``node``. ``mu``. Optional: ``gap``,
    positive if open; by default the distance to ``other`` along the normal, or zero.
    ``area``, for tractions.
load
    ``node, fx, fy[, fz]``, or ``dof, force``; an empty cell is zero.
fixed
    Prescribed displacements ``node, ux, uy[, uz]``, or ``dof, value``; an empty cell is free.

``step``, counted from 0, in the last two makes a load path; values are totals at the end
of each step. Units are those of the files, and must be consistent.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bipot_rs._lib.messages import count_noun, printable
from bipot_rs._lib.text_files import real, strip_mark, whole, without
from bipot_rs._lib.types import Bools, Floats, Ints, OpenRecord, SparseMatrix
from bipot_rs._lib.validation import csr
from bipot_rs.contact.law.frames import frames, operator
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.stiffness import dof_order
from bipot_rs.files.csv_tables import CsvTable
from bipot_rs.files.result_mesh import ResultMesh
from bipot_rs.mesh.abaqus import Section, list_sections

Name = str | os.PathLike[str]

_AXES = ("x", "y", "z")
MARKET = "%%MatrixMarket"


@dataclass(frozen=True)
class MatrixProblem:
    """Contents of the files, as `ContactProblem` and its `solve` take them."""

    K: SparseMatrix  # (n, n)
    B: SparseMatrix  # (d n_c, n)
    gap: Floats  # (n_c,)
    mu: Floats  # (n_c,)
    area: Floats | None  # (n_c,) or None
    frame: Floats  # (n_c, d, d)
    points: Floats | None  # (n_c, d) or None: with a node list
    coordinates: Floats | None  # (n, d) or None: with a list of all nodes
    fixed: Ints  # (m,)
    load: Floats | None  # (steps, n) or None
    prescribed: Floats  # (steps, m)
    # Name of each degree of freedom: node and component, or its number.
    labels: list[tuple[int, str]]
    nodes: Ints | None  # (n_c,) or None: labels of the contact nodes

    def mesh(self) -> ResultMesh | None:
        """Nodes and their degrees of freedom; None without coordinates of all nodes."""
        if self.coordinates is None:
            return None
        axes = _AXES[: self.coordinates.shape[1]]
        place: dict[int, int] = {}
        rows = [place.setdefault(node, len(place)) for node, _ in self.labels]
        nodes = np.empty((len(place), len(axes)))
        nodes[rows] = self.coordinates
        dofs = np.full(nodes.shape, -1, dtype=np.int64)
        for dof, (row, (_, name)) in enumerate(zip(rows, self.labels, strict=True)):
            # Rotations have no column.
            if name in axes:
                dofs[row, axes.index(name)] = dof
        contacts = None
        if self.nodes is not None:
            contacts = np.array([place[n] for n in self.nodes.tolist()], np.int64)
        return ResultMesh(nodes, dofs, contact_nodes=contacts)

    def problem(
        self,
        *,
        num_threads: int | None = None,
        stiffness_rtol: float | None = None,
        engine: str = "auto",
    ) -> ContactProblem:
        """Make the problem; with ``stiffness_rtol``, restore the rigid motions of K."""
        if stiffness_rtol is not None and self.coordinates is None:
            raise ValueError(
                "--stiffness-rtol needs --nodes with the coordinates of all nodes of the "
                "stiffness: the rigid motions are computed from them"
            )
        return ContactProblem(
            self.K,
            self.B,
            gap=self.gap,
            mu=self.mu,
            area=self.area,
            fixed=self.fixed,
            points=self.points,
            frame=self.frame,
            coordinates=self.coordinates,
            dim=self.frame.shape[1],
            num_threads=num_threads,
            stiffness_rtol=stiffness_rtol,
            engine=engine,
        )


def read(
    stiffness: Name,
    contacts: Name,
    nodes: Name | None = None,
    load: Name | None = None,
    fixed: Name | None = None,
    *,
    order: str | None = None,
) -> MatrixProblem:
    """Read the files.

    ``stiffness, contacts, nodes, load, fixed``: the files.
    ``order``: one of `dof_order.ORDERS`, for a Matrix Market file; by default ``"node"``.
    """
    if order is not None and order not in dof_order.ORDERS:
        expected = " or ".join(dof_order.ORDERS)
        raise ValueError(f"order is {order!r}, expected {expected}")
    table = CsvTable(contacts)
    dim = 3 if "nz" in table.names else 2
    listed = None if nodes is None else _read_nodes(Path(nodes))
    K, dofs = _stiffness(Path(stiffness), dim, listed, order)
    arrays = _contacts(table, dim, dofs, listed)
    forces = (
        None
        if load is None
        else _values(CsvTable(load), dofs, [f"f{a}" for a in _AXES[:dim]], "force")
    )
    moved = (
        None
        if fixed is None
        else _values(CsvTable(fixed), dofs, [f"u{a}" for a in _AXES[:dim]], "value")
    )
    held, prescribed = _read_prescribed(moved, fixed)
    return MatrixProblem(
        K=K,
        fixed=held,
        prescribed=prescribed,
        load=None if forces is None else np.nan_to_num(forces),
        labels=dofs.labels(),
        coordinates=dofs.coordinates(listed, dim),
        **arrays,
    )


@dataclass(frozen=True)
class _Nodes:
    """The node list: its file, labels ``(nodes,)`` and coordinates ``(nodes, d)``."""

    path: Path
    labels: Ints
    places: Floats


def _read_nodes(path: Path) -> _Nodes:
    """Read a table ``node, x, y[, z]``, or the `*NODE` blocks of a deck, in their order.

    A z that is zero everywhere is kept: the contacts determine the dimension.
    """
    blocks = [s for s in list_sections(path) if s.word.startswith("NODE")]
    if blocks:
        rows = [row for s in blocks if s.word == "NODE" for row in _read_block(s)]
    else:
        table = CsvTable(path)
        table.expect(("node", "x", "y"), ("z",))
        axes = [table.numbers(axis) for axis in _AXES if axis in table.names]
        labels = table.integers("node").tolist()
        places = np.stack(axes, axis=1).tolist()
        lines = [(path, line) for line in table.lines]
        rows = list(zip(labels, lines, places, strict=True))
    seen: dict[int, tuple[Path, int]] = {}
    for label, (file, line), _ in rows:
        if label in seen:
            first, of_first = seen[label]
            before = "" if first == file else f"{first} "
            raise ValueError(
                f"{file} line {line}: repeats node {label} of {before}line {of_first}"
            )
        seen[label] = file, line
    if not rows:
        raise ValueError(f"{path} has no nodes")
    places = [place for _, _, place in rows]
    return _Nodes(path, np.array(list(seen), np.int64), np.array(places, np.float64))


def _read_block(block: Section) -> Iterator[tuple[int, tuple[Path, int], list[float]]]:
    """Label, line and three coordinates of each node; missing coordinates are zero."""
    if "INPUT" in block.parameters or block.named("SYSTEM")[:1] in ("C", "S"):
        raise ValueError(
            f"{block.path} line {block.line}: nodes in another file, or in cylindrical or "
            "spherical coordinates, are not supported; write Cartesian coordinates into this "
            "file"
        )
    for line, row in block.rows:
        try:
            label, place = whole(row[0]), block.reals(line, row[1:4])
        except ValueError:
            label, place = 0, [np.nan]
        if not np.isfinite(place).all():
            text = printable(", ".join(row))
            raise ValueError(
                f"{block.path} line {line}: is {text!r}, expected label, x, y, z"
            )
        yield label, (block.path, line), place + [0.0] * (3 - len(place))


class _Dofs:
    """The numbers of the degrees of freedom, by node and component from 1 if known."""

    def __init__(self, count: int, place: dict[tuple[int, int], int], why: str) -> None:
        self.count = count
        self.known = place
        self.why = why
        self.nodes = {node for node, _ in place}

    def number(self, dof: int, table: CsvTable, line: int) -> int:
        if not 0 <= dof < self.count:
            raise table.wrong(
                line,
                f"degree of freedom {dof} is out of range: the stiffness has {self.count} "
                f"(0 to {self.count - 1})",
            )
        return dof

    def at(self, node: int, component: int, table: CsvTable, line: int) -> int:
        dof = self.known.get((node, component))
        if dof is None:
            if not self.known:
                raise table.wrong(line, self.why)
            what = (
                f"node {node} has no component {component} in the stiffness"
                if node in self.nodes
                else f"there is no node {node}"
            )
            raise table.wrong(line, what)
        return dof

    def labels(self) -> list[tuple[int, str]]:
        if not self.known:
            return [(k, "") for k in range(self.count)]
        names_of_dofs = [(0, "")] * self.count
        for (node, component), dof in self.known.items():
            name = _AXES[component - 1] if component <= 3 else str(component)
            names_of_dofs[dof] = (node, name)
        return names_of_dofs

    def coordinates(self, listed: _Nodes | None, dim: int) -> Floats | None:
        """Coordinates of the node of each degree of freedom; None if some are unknown."""
        if listed is None or not self.known:
            return None
        place = dict(zip(listed.labels.tolist(), listed.places[:, :dim], strict=True))
        coordinates_of_dofs = np.full((self.count, dim), np.nan)
        for (node, _), dof in self.known.items():
            if node in place:
                coordinates_of_dofs[dof] = place[node]
        return coordinates_of_dofs if np.isfinite(coordinates_of_dofs).all() else None


def _stiffness(
    path: Path, dim: int, listed: _Nodes | None, order: str | None
) -> tuple[SparseMatrix, _Dofs]:
    with path.open("rb") as file:
        start = without(file.read(1024))
    if b"\0" in start:
        raise ValueError(
            f"{path} is not a text file, expected a Matrix Market file, as scipy.io.mmwrite "
            "writes, or lines of nodes and components"
        )
    if not start.startswith(MARKET.encode()):
        K, dofs = _of_nodes(path)
        if order is not None:
            raise ValueError(
                f"order is {order!r}, but {path} names its degrees of freedom by node and "
                "component: remove --order"
            )
        if listed is not None:
            _same_nodes(path, K, dofs, dim, listed)
        return K, dofs
    K = _market(path)
    n = K.shape[0]
    if listed is None:
        why = "names a node: give --nodes, or name degrees of freedom instead of nodes"
        return K, _Dofs(n, {}, why)
    labels = listed.labels
    if n != dim * len(labels):
        condensed = (
            ": if fixed degrees of freedom were removed, give the whole stiffness and "
            "--fixed"
            if n < dim * len(labels)
            else ""
        )
        raise ValueError(
            f"{path} has {n} rows, expected {dim} for each of the "
            f"{count_noun(len(labels), 'node')} of {listed.path}{condensed}"
        )
    _in_order(path, K, dim, listed, order)
    taken = order or "node"
    at = zip(
        labels[dof_order.node_of(taken, n, dim)].tolist(),
        dof_order.components(taken, n, dim).tolist(),
        strict=True,
    )
    dof_of = {(node, k + 1): dof for dof, (node, k) in enumerate(at)}
    return K, _Dofs(n, dof_of, "")


def _in_order(
    path: Path, K: SparseMatrix, dim: int, listed: _Nodes, order: str | None
) -> None:
    """Refuse a stiffness whose degrees of freedom do not fit the order of the nodes."""
    parts, labels, places = csr("K", K).parts, listed.labels, listed.places
    nodes = listed.path
    if places.shape[1] < dim:
        return  # The contacts, with normals of three components, are refused later.
    places, n = places[:, :dim], K.shape[0]
    taken = order or "node"

    how = dof_order.fit_order(parts, taken, dim, places)
    if how is None or how.fits:
        return
    if order is not None and how.translates and 2 * len(how.turned) < how.turnable:
        return  # Given explicitly, and correct in most rows: `ContactProblem` warns.
    sorted_ = places[np.argsort(labels, kind="stable")]
    advice = (
        f"no order of components fits, nor do the nodes sorted by label: the rows of {nodes} "
        "must be in the order of the stiffness"
    )
    if others := dof_order.list_fitting(parts, dim, places):
        advice = f"--order {others[0]} would fit, {dof_order.ORDERS[others[0]]}"
    elif others := dof_order.list_fitting(parts, dim, sorted_):
        advice = f"the rows of {nodes} sorted by label would fit"
        advice += f", with --order {others[0]}" if taken not in others else ""
    where = ""
    if how.translates and 2 * len(how.turned) < how.turnable:
        first = int(labels[dof_order.node_of(taken, n, dim)[how.turned[0]]])
        where = (
            f", first at node {first}; if springs of fixed direction join distant nodes "
            f"there, give --order {taken} to accept it"
        )
    raise ValueError(
        f"{path} does not fit the rows of {nodes} as {dof_order.ORDERS[taken]}: "
        f"{how.describe_misfit()}{where}; {advice}"
    )


def _same_nodes(
    path: Path, K: SparseMatrix, dofs: _Dofs, dim: int, listed: _Nodes
) -> None:
    """Refuse coordinates that do not fit the nodes named in the stiffness."""
    places = np.full((dofs.count, dim), np.nan)
    component, node_of = (np.full(dofs.count, -1, np.int64) for _ in range(2))
    of = dict(zip(listed.labels.tolist(), listed.places, strict=True))
    if listed.places.shape[1] < dim:
        return
    for (node, k), dof in dofs.known.items():
        if node in of and k <= dim:
            places[dof], component[dof], node_of[dof] = of[node][:dim], k - 1, node
    how = dof_order.fit(csr("K", K).parts, component, node_of, places)
    if how is not None and not how.fits:
        raise ValueError(
            f"{path} does not fit the coordinates of its nodes in {listed.path}: "
            f"{how.describe_misfit()}; are both of the same undeformed mesh, in the same axes?"
        )


def market_refuses(field: str, symmetry: str) -> str | None:
    """The reason why a matrix of this Matrix Market header is not a stiffness, or None."""
    if field not in ("real", "integer", "unsigned-integer"):
        return f"its numbers are {field}, expected real"
    if symmetry not in ("general", "symmetric"):
        return f"it is {symmetry}, expected symmetric or general"
    return None


def _market(path: Path) -> SparseMatrix:
    from scipy.io import mminfo, mmread

    try:
        with strip_mark(path) as source:
            rows, columns, _, _, field, symmetry = mminfo(source)
            if why := market_refuses(field, symmetry):
                raise ValueError(why)
            if rows != columns:
                raise ValueError(f"it has {rows} rows and {columns} columns")
            stiffness: SparseMatrix = mmread(source)
            return stiffness
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(
            f"{path} is not a stiffness in Matrix Market format: {printable(str(error))}"
        ) from None


def _of_nodes(path: Path) -> tuple[SparseMatrix, _Dofs]:
    """Read lines ``node, component, node, component, value``."""
    from scipy.sparse import coo_array, diags

    entries, values = [], []
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.strip()
            if not text or text.startswith("**") or text.lower().startswith("*matrix"):
                continue
            cells = text.replace(",", " ").split()
            try:
                ends = tuple(map(whole, cells[:4]))
                value = real(cells[4])
            except (ValueError, IndexError):
                ends, value = (), np.nan
            if len(cells) != 5 or len(ends) != 4 or not np.isfinite(value):
                raise ValueError(
                    f"{path} line {number}: is {printable(text[:60])!r}, expected row "
                    "node, row component, column node, column component, value; a Matrix "
                    f"Market file begins with {MARKET}"
                )
            if min(ends) < 1:
                raise ValueError(
                    f"{path} line {number}: {printable(text[:60])!r} belongs to an internal "
                    "variable, such as a multiplier: a stiffness has displacements only"
                )
            entries.append(ends)
            values.append(value)
    if not entries:
        raise ValueError(f"{path} has no entries")
    index = np.array(entries, np.int64)
    _once(path, index)
    pairs, dof_of = np.unique(index.reshape(-1, 2), axis=0, return_inverse=True)
    row, column = dof_of.reshape(-1, 2).T
    n = len(pairs)
    K = coo_array((np.array(values), (row, column)), shape=(n, n)).tocsr()
    apart = row != column
    there = np.unique(row[apart] * n + column[apart])
    if not np.isin(there, column[apart] * n + row[apart]).any():
        # The file has one triangle, in an order of rows that the labels do not show.
        K = K + K.T - diags(K.diagonal(), format="csr")
    number_of = {
        (node, component): k for k, (node, component) in enumerate(pairs.tolist())
    }
    return K, _Dofs(n, number_of, "")


def _once(path: Path, index: Ints) -> None:
    """Refuse an entry that is given twice, as in matrices that are not assembled."""
    entries, counts = np.unique(index, axis=0, return_counts=True)
    if (counts > 1).any():
        at = tuple(entries[np.argmax(counts > 1)].tolist())
        raise ValueError(
            f"{path} gives the entry of {at[:2]} and {at[2:]} several times: assemble the "
            "element matrices first"
        )


def _contacts(
    table: CsvTable, dim: int, dofs: _Dofs, listed: _Nodes | None
) -> OpenRecord:
    """The fields of `MatrixProblem` that a table of contacts gives."""
    axes = _AXES[:dim]
    by_dof = any(name.startswith("dof") for name in table.names)
    columns = [f"dof_{a}" for a in axes] if by_dof else ["node"]
    others = ["other"] if columns == ["node"] else [f"other_{a}" for a in axes]
    normal = [f"n{a}" for a in axes]
    table.expect((*columns, *normal, "mu"), (*others, "gap", "area"))
    if not len(table):
        raise ValueError(f"{table.path} has no contacts")
    first = _places(table, columns, dim, dofs)
    second = _places(table, others, dim, dofs) if others[0] in table.names else None
    if second is not None and (first == second).any():
        k = int(np.argmax((first == second).any(axis=1)))
        raise table.wrong(table.lines[k], "the node is in contact with itself")

    n = np.stack([table.numbers(name) for name in normal], axis=1)
    for k, length in enumerate(np.abs(n).max(axis=1)):
        if length == 0:
            raise table.wrong(table.lines[k], "the normal is zero")
    frame = frames(n)
    mu = table.numbers("mu")
    area = table.numbers("area") if "area" in table.names else None
    checks = [("mu", mu, mu < 0, "zero or positive")]
    if area is not None:
        checks.append(("area", area, area <= 0, "a positive number"))
    for name, column, bad, wished in checks:
        if bad.any():
            k = int(np.argmax(bad))
            raise table.wrong(
                table.lines[k], f"{name} is {column[k]:g}, expected {wished}"
            )

    points, nodes = None, None
    distance = np.zeros(len(table))
    if columns == ["node"]:
        nodes = table.integers("node")
        if listed is not None:
            points = _read_listed_nodes(table, nodes, listed, dim)
            if second is not None:
                other = table.integers("other", -1)
                has = second[:, 0] >= 0
                there = points.copy()
                there[has] = _read_listed_nodes(table, other, listed, dim, has)[has]
                distance = np.einsum("cd,cd->c", frame[:, 0], points - there)
    given = table.numbers("gap", np.nan)
    sides = [first] if second is None else [first, second]
    return {
        "B": operator(frame, sides, dofs.count),
        "gap": np.where(np.isfinite(given), given, distance),
        "mu": mu,
        "area": area,
        "frame": frame,
        "points": points,
        "nodes": nodes,
    }


def _places(table: CsvTable, names: list[str], dim: int, dofs: _Dofs) -> Ints:
    """Degrees of freedom ``(n_c, d)`` of one side; -1 where the cell is empty."""
    optional = names[0].startswith("other")
    missing = -(10**9) if optional else None
    columns = [table.integers(name, missing) for name in names]
    dofs_of_contacts = np.full((len(table), dim), -1, np.int64)
    for k, line in enumerate(table.lines):
        values = [int(column[k]) for column in columns]
        blank = [v == missing for v in values]
        if all(blank):
            continue
        if any(blank):
            lacks, has = names[blank.index(True)], names[blank.index(False)]
            raise table.wrong(
                line,
                f"{lacks} is empty but {has} is {values[blank.index(False)]}: give all of "
                "them, or none for a rigid obstacle",
            )
        if len(values) == 1:
            dofs_of_contacts[k] = [
                dofs.at(values[0], c + 1, table, line) for c in range(dim)
            ]
        else:
            dofs_of_contacts[k] = [dofs.number(v, table, line) for v in values]
        if len(set(dofs_of_contacts[k])) < dim:
            raise table.wrong(
                line,
                f"degree of freedom {dofs_of_contacts[k, 0]} is given for two components",
            )
    return dofs_of_contacts


def _read_listed_nodes(
    table: CsvTable, nodes: Ints, listed: _Nodes, dim: int, has: Bools | None = None
) -> Floats:
    place = {int(label): row for row, label in enumerate(listed.labels)}
    coordinates = np.zeros((len(nodes), dim))
    for k, node in enumerate(nodes.tolist()):
        if has is not None and not has[k]:
            continue
        if node not in place:
            raise table.wrong(table.lines[k], f"the node list has no node {node}")
        coordinates[k] = listed.places[place[node]][:dim]
    return coordinates


def _values(table: CsvTable, dofs: _Dofs, components: list[str], single: str) -> Floats:
    """Values ``(steps, n)`` of a table; not a number where none is given."""
    by_node = "dof" not in table.names
    needed = ("node",) if by_node else ("dof", single)
    table.expect(needed, (*(components if by_node else ()), "step"))
    names = [c for c in components if c in table.names] if by_node else [single]
    if not names:
        raise table.wrong(
            table.header_line, f"there is no column {' or '.join(components)}"
        )
    step = table.integers("step", 0)
    if step.size and step.min() < 0:
        k = int(np.argmin(step))
        raise table.wrong(table.lines[k], f"step is {step[k]}, expected 0 or more")
    count = int(step.max(initial=0)) + 1
    numbers = np.unique(step)
    if len(table) and len(numbers) < count:
        absent = int(np.argmax(numbers != np.arange(len(numbers))))
        raise ValueError(
            f"{table.path} has step {count - 1} but no step {absent}: steps count from 0"
        )
    prescribed = np.full((count, dofs.count), np.nan)
    where = np.zeros(prescribed.shape, np.int64)
    number = table.integers("node" if by_node else "dof")
    for name in names:
        blank = None if not by_node else np.nan
        for k, value in enumerate(table.numbers(name, blank)):
            if np.isnan(value):
                continue
            line = table.lines[k]
            if by_node:
                axis = components.index(name) + 1
                dof = dofs.at(int(number[k]), axis, table, line)
            else:
                dof = dofs.number(int(number[k]), table, line)
            if where[step[k], dof]:
                raise table.wrong(
                    line, f"{name} is already given on line {where[step[k], dof]}"
                )
            prescribed[step[k], dof] = value
            where[step[k], dof] = line
    return prescribed


def _read_prescribed(values: Floats | None, fixed: Name | None) -> tuple[Ints, Floats]:
    if values is None:
        return np.zeros(0, np.int64), np.zeros((1, 0))
    held = np.flatnonzero(np.isfinite(values).any(axis=0))
    prescribed = values[:, held]
    lacking = np.argwhere(np.isnan(prescribed))
    if len(lacking):
        step, k = lacking[0]
        raise ValueError(
            f"{fixed} prescribes degree of freedom {held[k]} in some steps but not in step "
            f"{step}: prescribe it in every step"
        )
    return held, prescribed
