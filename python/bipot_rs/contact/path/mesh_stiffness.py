"""K of a mesh in space that is read in parts, so that nobody has the whole of its entries."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import bipot_rs._core as _core
from bipot_rs._lib.types import CsrMatrix, Floats, Ints, MatrixLike
from bipot_rs._lib.validation import Parts, csr
from bipot_rs.contact.messages.remarks import InspectedBodies, scale_places


@dataclass(frozen=True, eq=False)
class MeshStiffness:
    """K of (1), bitwise symmetric, as the core has read it, and what assembles all of it."""

    shape: tuple[int, int]
    rows: _core.StiffnessRows  # the first engine takes them
    bodies: InspectedBodies
    assemble: Callable[[], MatrixLike]

    @property
    def parts(self) -> Parts:
        """K by rows, assembled."""
        return csr("K", self.assemble()).parts

    @classmethod
    def read(
        cls,
        parts: Iterable[CsrMatrix],
        coordinates: Floats,
        fixed: Ints,
        num_threads: int | None,
        assemble: Callable[[], MatrixLike],
    ) -> MeshStiffness | None:
        """Read all rows of K, in parts of some nodes each; None if one has no stiffness.

        ``coordinates (n, 3)``: positions of the degrees of freedom, which are numbered by nodes.
        ``fixed``: prescribed ones, ascending.
        """
        # Parts of a large matrix would leave holes in the heap.
        _core.return_heap()
        x, side = scale_places(coordinates)
        rows, first = _core.StiffnessRows(coordinates, fixed, num_threads), 0
        for part in parts:
            if not rows.append(csr("K", part).parts, x):
                return None
            first += part.shape[0]
        bodies = InspectedBodies(rows.bodies(x), side)
        return cls((first, first), rows, bodies, assemble)


def whole_parts(given: Parts | MeshStiffness) -> Parts:
    """K by rows, assembled if it was read in parts."""
    return given.parts if isinstance(given, MeshStiffness) else given
