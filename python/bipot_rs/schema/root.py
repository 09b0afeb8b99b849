"""A whole scene."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from bipot_rs.schema.contact import Touch
from bipot_rs.schema.load import BodyForce, Prescribed, Pressure, Traction
from bipot_rs.schema.material import Elastic
from bipot_rs.schema.mesh import Block, Mesh
from bipot_rs.schema.path import LoadPath
from bipot_rs.schema.table import AXES, Table, Varying

# Cells that carry an element, by dimension.
_CARRIES = {
    "P1": {2: "triangle", 3: "tetrahedron"},
    "Q1": {2: "quadrilateral", 3: "hexahedron"},
}


class Units(Table):
    """Names of units, for pictures and exported problems; nothing is converted."""

    length: str = ""
    force: str = ""
    stress: str = ""


class Solver(Table):
    """Settings of the contact solver; the command line overrides them.

    ``tol = "discretisation"`` goes as far as the mesh is worth (`enough`).
    """

    method: str = "auto"
    tol: Annotated[float, Field(gt=0)] | Literal["discretisation"] = 1e-12
    max_iterations: Annotated[int, Field(gt=0)] | None = None


class Scene(Table):
    """A whole scene file."""

    title: str = ""
    units: Units = Field(default_factory=Units)
    mesh: Mesh | None = None
    material: dict[str, Elastic]
    body: Annotated[dict[str, Block], Field(min_length=1)]
    support: list[Prescribed] = Field(default_factory=list)
    traction: list[Traction] = Field(default_factory=list)
    pressure: list[Pressure] = Field(default_factory=list)
    body_force: list[BodyForce] = Field(default_factory=list)
    contact: Annotated[list[Touch], Field(min_length=1)]
    path: LoadPath = Field(default_factory=LoadPath)
    solver: Solver = Field(default_factory=Solver)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return max(block.dim for block in self.body.values())

    def cell(self, block: Block) -> str:
        """Kind of the cells of a body: those of ``mesh.element``, else its own."""
        if self.mesh is None or self.mesh.element is None:
            return block.cell
        return _CARRIES[self.mesh.element][block.dim]

    def varying(self) -> Iterator[tuple[str, Varying]]:
        """Every number that may have an amplitude, with its path."""
        for kind in ("support", "traction", "body_force"):
            for i, entry in enumerate(getattr(self, kind)):
                for k, number in entry.components().items():
                    yield f"{kind}.{i}.{AXES[k]}", number
        for i, entry in enumerate(self.pressure):
            yield (
                f"pressure.{i}",
                Varying(value=entry.value, amplitude=entry.amplitude),
            )
