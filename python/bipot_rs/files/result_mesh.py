"""The mesh in a result file: nodes, their degrees of freedom, cells, and contacts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import AnyArray, Floats, Ints, Record
from bipot_rs.files.fields import MESH, labels

_CELLS, _FACETS = "cells", "contact_facets"


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of one kind.

    Attributes
    ----------
    kind
        Name of the kind, as in meshio: ``"triangle"``, ``"hexahedron20"``.
    corners
        Nodes of each cell, ``(cells, nodes of a cell)``, in the order of VTK.
    body
        Name of the body; empty for facets.
    """

    kind: str
    corners: Ints
    body: str = ""

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class ResultMesh:
    """Nodes and cells of the bodies of a result.

    ``displacement[dofs]`` is the displacement of the nodes if all ``dofs >= 0``;
    `of_nodes` also covers nodes without some degrees of freedom.

    Attributes
    ----------
    nodes
        Positions, ``(nodes, d)``.
    dofs
        Degree of freedom of each component of each node, ``(nodes, d)``; -1 for none.
    cells
        Cells of each body, with indices into ``nodes``; empty if not known.
    contact_nodes
        Node of each contact, on the body of the contact, ``(n_c,)``; None if not known.
    contact_facets
        Facets of the contact surfaces, with indices of contacts.

    Raises
    ------
    ValueError
        Shapes do not fit, or an index is out of range.
    """

    nodes: Floats
    dofs: Ints
    cells: Sequence[Cells] = ()
    contact_nodes: Ints | None = None
    contact_facets: Sequence[Cells] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        shape = self.nodes.shape
        if len(shape) != 2 or not np.isfinite(self.nodes).all():
            raise ValueError("nodes are wrong, expected (nodes, d) finite numbers")
        if self.dofs.shape != shape:
            raise ValueError(f"dofs has shape {self.dofs.shape}, expected {shape}")
        _check("dofs", self.dofs, -1, None)
        for cells in self.cells:
            _check("cells", cells.corners, 0, shape[0])
        if self.contact_nodes is not None:
            _check("contact_nodes", self.contact_nodes, 0, shape[0])
        for facets in self.contact_facets:
            _check("contact_facets", facets.corners, 0, None)

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        arrays = [self.nodes, self.dofs, self.contact_nodes]
        arrays += [block.corners for block in (*self.cells, *self.contact_facets)]
        return sum(array.nbytes for array in arrays if array is not None)

    def of_nodes(self, displacement: Floats) -> Floats:
        """Displacement of the nodes, ``(nodes, d)``, from that by degrees of freedom.

        Zero where a node has no degree of freedom.
        """
        return _pick(displacement, self.dofs)

    def of_contacts(self, displacement: Floats) -> Floats | None:
        """Displacement of the contact nodes, ``(n_c, d)``; None if they are not known."""
        if self.contact_nodes is None:
            return None
        return _pick(displacement, self.dofs[self.contact_nodes])

    def fits(self, contacts: int, unknowns: int | None) -> bool:
        """Whether indices are within these numbers of contacts and degrees of freedom."""
        facets = [block.corners.max(initial=-1) for block in self.contact_facets]
        has_contacts = self.contact_nodes is None or self.contact_nodes.shape == (
            contacts,
        )
        return bool(
            has_contacts
            and max(facets, default=-1) < contacts
            and (unknowns is None or self.dofs.max(initial=-1) < unknowns)
        )

    def save(
        self,
        group: Any,
        store: Callable[[Any, str, AnyArray, Mapping[str, str]], None],
        units: Mapping[str, str],
    ) -> None:
        """Write to a group; ``store(group, name, array, attributes)`` makes a dataset."""
        for name, field in MESH.items():
            array = getattr(self, name)
            if array is not None:
                store(group, name, _shorten(array), labels(field, units))
        for name, blocks in ((_CELLS, self.cells), (_FACETS, self.contact_facets)):
            if not blocks:
                continue
            inner = group.create_group(name)
            for k, block in enumerate(blocks):
                body = {"body": block.body} if block.body else {}
                store(
                    inner, str(k), _shorten(block.corners), {"kind": block.kind, **body}
                )

    @classmethod
    def load(cls, group: Any, arrays: Callable[[Any], Record]) -> ResultMesh:
        """Read from a group; ``arrays(group)`` are its datasets.

        Raises
        ------
        LookupError, TypeError, ValueError
            The group is not complete, or `ResultMesh` refuses it.
        """

        def widen(group: Any) -> Record:
            return {
                name: array.astype(np.int64) if array.dtype == np.int32 else array
                for name, array in arrays(group).items()
            }

        stored = widen(group)

        def blocks(name: str) -> list[Cells]:
            if name not in group:
                return []
            inner, blocks_read = group[name], widen(group[name])
            return [
                Cells(
                    str(inner[k].attrs["kind"]),
                    blocks_read[k],
                    str(inner[k].attrs.get("body", "")),
                )
                for k in sorted(blocks_read, key=int)
            ]

        return cls(
            stored["nodes"],
            stored["dofs"],
            blocks(_CELLS),
            stored.get("contact_nodes"),
            blocks(_FACETS),
        )


def _pick(displacement: Floats, dofs: Ints) -> Floats:
    """Entries of an array, and zero for the number -1."""
    picked: Floats = np.where(dofs >= 0, displacement[dofs], 0.0)
    return picked


def _shorten(array: AnyArray) -> AnyArray:
    """Whole numbers in 32 bits if they fit."""
    fits = array.dtype.kind == "i" and array.max(initial=0) < 2**31
    return array.astype(np.int32) if fits else array


def _check(name: str, index: AnyArray, low: int, high: int | None) -> None:
    """Refuse what is not an array of whole numbers from ``low`` and below ``high``."""
    array = np.asarray(index)
    if array.dtype.kind != "i":
        raise ValueError(f"{name} has type {array.dtype}, expected whole numbers")
    if array.size and (array.min() < low or (high is not None and array.max() >= high)):
        raise ValueError(
            f"{name} has indices {array.min()} to {array.max()}, expected them from "
            f"{low}" + ("" if high is None else f" to {high - 1}")
        )
