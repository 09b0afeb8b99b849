"""The root table of a scene."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, PrivateAttr, Tag

from bipot_rs._lib.messages import count_noun
from bipot_rs.scene.schema.contact import (
    BoltTable,
    CyclicTable,
    PeriodicTable,
    RemoteTable,
    Rigid,
    Touch,
)
from bipot_rs.scene.schema.load import (
    BodyForce,
    Foundation,
    InitialStrain,
    LoadPath,
    Mirror,
    Prescribed,
    Pressure,
    Traction,
    WearTable,
)
from bipot_rs.scene.schema.mesh import BodyTable, Elastic, Mesh
from bipot_rs.scene.schema.table import (
    AXES,
    KIND,
    Table,
    Varying,
    no_entries,
    no_tables,
)

# Cells of an element, by dimension.
_CARRIES = {
    "P": {2: "triangle", 3: "tetrahedron"},
    "Q": {2: "quadrilateral", 3: "hexahedron"},
}


class Units(Table):
    """Names of units for pictures and exported problems; nothing is converted.

    If all three names are known, stress must be force / length² (`bipot_rs.scene.units`).
    """

    length: str = ""
    force: str = ""
    stress: str = ""


def _of_mesh(value: str) -> str:
    if value != "discretisation":
        raise ValueError("should be a number, or 'discretisation'")
    return value


_Tolerance = Annotated[
    Annotated[float, Field(gt=0), Tag(f"{KIND}number")]
    | Annotated[
        Literal["discretisation"], BeforeValidator(_of_mesh), Tag(f"{KIND}word")
    ],
    Discriminator(lambda v: KIND + ("word" if isinstance(v, str) else "number")),
]


class Solver(Table):
    """Settings of the contact solver; the command line overrides them.

    ``engine`` is that of `ContactProblem`, or ``"petsc"``: `bipot run` on the processes
    that mpirun starts.

    ``tol = "discretisation"`` computes tol from the error of the mesh
    (`discretisation.stopping`).
    """

    method: str = "auto"
    engine: Literal["auto", "direct", "iterative", "petsc"] = "auto"
    tol: _Tolerance = 1e-12
    max_iterations: Annotated[int, Field(gt=0)] | None = None


class Scene(Table):
    """A whole scene file."""

    title: str = ""
    units: Units = Field(default_factory=Units)
    parameter: dict[str, float] = Field(default_factory=no_tables)
    mesh: Mesh | None = None
    material: dict[str, Elastic]
    body: Annotated[dict[str, BodyTable], Field(min_length=1)]
    obstacle: dict[str, Rigid] = Field(default_factory=no_tables)
    support: list[Prescribed] = Field(default_factory=no_entries)
    symmetry: list[Mirror] = Field(default_factory=no_entries)
    cyclic: list[CyclicTable] = Field(default_factory=no_entries)
    periodic: list[PeriodicTable] = Field(default_factory=no_entries)
    remote: dict[str, RemoteTable] = Field(default_factory=no_tables)
    bolt: list[BoltTable] = Field(default_factory=no_entries)
    spring: list[Foundation] = Field(default_factory=no_entries)
    traction: list[Traction] = Field(default_factory=no_entries)
    pressure: list[Pressure] = Field(default_factory=no_entries)
    body_force: list[BodyForce] = Field(default_factory=no_entries)
    strain: list[InitialStrain] = Field(default_factory=no_entries)
    contact: Annotated[list[Touch], Field(min_length=1)]
    path: LoadPath = Field(default_factory=LoadPath)
    wear: WearTable | None = None
    solver: Solver = Field(default_factory=Solver)

    # Relative names of files refer to this folder.
    _folder: Path = PrivateAttr(default_factory=Path)
    _unused: tuple[str, ...] = PrivateAttr(default=())

    def __repr__(self) -> str:
        bodies, contacts = len(self.body), len(self.contact)
        return (
            f"Scene({self.title!r}: {count_noun(bodies, 'body')}, "
            f"{count_noun(contacts, 'contact')})"
        )

    __str__ = __repr__

    def beside(self, folder: Path, unused: Iterable[str] = ()) -> Self:
        """Set the folder of files and the keys that no formula used; return the scene."""
        if any(self.files()):
            self._folder = folder
        self._unused = tuple(unused)
        return self

    def place(self, file: str) -> Path:
        """Path of a file that the scene names."""
        return self._folder / file

    def files(self) -> Iterator[Path]:
        """Paths of all files that the scene names."""
        for block in self.body.values():
            if block.mesh is not None:
                yield self.place(block.mesh.file)
        for rigid in self.obstacle.values():
            if rigid.surface is not None:
                yield self.place(rigid.surface)

    @property
    def dim(self) -> int | None:
        """2 or 3; None if all bodies are meshes from files."""
        dims = (block.dim for block in self.body.values())
        return max((dim for dim in dims if dim), default=None)

    def cell(self, block: BodyTable) -> str | None:
        """Shape of the cells of a box: that of ``mesh.element``, else its own."""
        if block.dim is None or self.mesh is None or self.mesh.element is None:
            return block.cell
        return _CARRIES[self.mesh.element[0]][block.dim]

    def order(self, block: BodyTable) -> int | None:
        """Order of the cells of a body; None for the order in its file."""
        if self.mesh is not None and self.mesh.element is not None:
            return int(self.mesh.element[1])
        return block.order if block.mesh is None else block.mesh.order

    def unused(self) -> list[str]:
        """Parameters, and ``mesh.n``, that change nothing."""
        blocks = self.body.values()
        axes = [
            axis for block in blocks for axis in (block.x, block.y, block.z) if axis
        ]
        grows = any(first > 1 for axis in axes for first, _ in axis.growth)
        return [key for key in self._unused if key != "mesh.n" or not grows]

    def varying(self) -> Iterator[tuple[str, Varying]]:
        """Key path and value of each number that may have an amplitude."""
        for kind in ("support", "traction", "body_force"):
            for i, entry in enumerate(getattr(self, kind)):
                for k, number in entry.components().items():
                    yield f"{kind}.{i}.{AXES[k]}", number
        for i, pressure in enumerate(self.pressure):
            yield f"pressure.{i}", pressure
        for i, strain in enumerate(self.strain):
            end = "" if strain.temperature is None else ".temperature"
            yield f"strain.{i}{end}", strain.factor
        for i, bolt in enumerate(self.bolt):
            yield f"bolt.{i}.force", bolt.force
        for name, rigid in self.obstacle.items():
            for end, number in rigid.varying().items():
                yield f"obstacle.{name}.{end}", number
        for name, point in self.remote.items():
            for end, number in point.varying().items():
                yield f"remote.{name}.{end}", number

    def tied(self) -> str | None:
        """Key of the first obstacle that a force moves; None without one."""
        for name, rigid in self.obstacle.items():
            if rigid.force is not None:
                return f"obstacle.{name}.force"
        return None
