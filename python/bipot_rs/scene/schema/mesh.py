"""Tables of bodies and materials: boxes, meshes from files, surfaces by geometry.

Cells may depend on ``mesh.n`` of the scene by formulas: ``"n"``, ``"n/2"``, ``"0.5/n"``.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag

from bipot_rs._lib.types import Floats
from bipot_rs.fem.bodies import materials
from bipot_rs.mesh.kinds import FIRST
from bipot_rs.scene.schema.table import (
    KIND,
    MOST,
    OneOrList,
    Range,
    Table,
    Triple,
    Vector,
    no_tables,
    wrap,
)


class Mesh(Table):
    """Resolution n, the number that a convergence study changes, and the element.

    ``element`` replaces the ``cell`` and ``order`` of all bodies. P1: linear triangles
    and tetrahedra; Q1: bilinear quadrilaterals and trilinear hexahedra, on the same grid
    points; P2 and Q2: the same with nodes at the middles between grid points. Meshes from
    files keep their cells, but take the order.
    """

    n: Annotated[int | None, Field(gt=0, le=MOST)] = None
    element: Literal["P1", "Q1", "P2", "Q2"] | None = None


class Axis(Table):
    """Grid points along an axis: equal cells, a graded grid, or a list of points.

    A graded grid has cells of size ``cell`` within ``uniform`` (without ``uniform``: one
    such cell at ``from``). Outside, each cell is ``growth`` times as long as the one
    before. ``growth`` may depend on n: each pair is the least n, and the ratio from that n
    on.
    """

    start: Annotated[float | None, Field(alias="from")] = None
    end: Annotated[float | None, Field(alias="to")] = None
    cells: float | None = None
    cell: float | None = None
    uniform: Range | None = None
    growth: Annotated[
        list[Annotated[list[float], Field(min_length=2, max_length=2)]],
        BeforeValidator(
            lambda v: [[1.0, v]] if isinstance(v, int | float | str) else v
        ),
    ] = Field(default_factory=lambda: [[1.0, 1.0]])
    points: Annotated[list[float], Field(min_length=2)] | None = None

    def grid(self, n: int | None) -> Floats:
        """Ascending grid points; a `ValueError` if keys contradict each other."""
        grid = self._points(n)
        if len(grid) < 2 or not np.all(np.diff(grid) > 0):
            raise ValueError("points should ascend, without two equal after rounding")
        return grid

    def _points(self, n: int | None) -> Floats:
        if self.points is not None:
            if self.model_fields_set != {"points"}:
                raise ValueError("remove the other keys: points defines the whole grid")
            return np.array(self.points)
        if self.start is None or self.end is None or self.start == self.end:
            raise ValueError("needs from and to with different values, or points")
        if (self.cells is None) == (self.cell is None):
            raise ValueError("needs exactly one of cells and cell")
        if self.cells is not None:
            if self.uniform is not None or "growth" in self.model_fields_set:
                raise ValueError("uniform and growth need cell instead of cells")
            count = _whole(self.cells, "cells", n)
            low, high = sorted((self.start, self.end))
            return np.linspace(low, high, count + 1)
        return self._grade_cells(self.start, self.end, self.cell or 0.0, n)

    def _grade_cells(
        self, start: float, end: float, size: float, n: int | None
    ) -> Floats:
        ratio = 1.0
        for first, value in self.growth:
            if n is None or n >= first:
                ratio = value
        if size <= 0 or ratio < 1:
            raise ValueError("needs cell > 0 and growth >= 1")
        sign = 1.0 if end > start else -1.0
        if self.uniform is None:
            return np.unique([start, *_grow(start, end, sign * size, ratio)])
        low, high = self.uniform
        if not min(start, end) <= low < high <= max(start, end):
            raise ValueError("uniform should ascend, between from and to")
        count = _whole((high - low) / size, f"uniform over cell = {size:g}", n)
        left = _grow(low, min(start, end), -size * ratio, ratio)
        right = _grow(high, max(start, end), size * ratio, ratio)
        return np.unique([*left, *np.linspace(low, high, count + 1), *right])


_Axis = Annotated[
    Axis, BeforeValidator(lambda v: {"points": v} if isinstance(v, list) else v)
]


class Within(Table):
    """Part of a surface: closed ranges of coordinates."""

    x: Range | None = None
    y: Range | None = None
    z: Range | None = None

    def box(self) -> dict[int, tuple[float, float]]:
        """Ranges by axis."""
        ranges = (self.x, self.y, self.z)
        return {k: (r[0], r[1]) for k, r in enumerate(ranges) if r is not None}


class Place(Table):
    """A surface defined by geometry.

    It consists of the boundary facets whose nodes all lie ``within`` ranges of
    coordinates, and whose outward normals make at most ``angle`` degrees with ``normal``.
    """

    within: Within | None = None
    normal: Vector | None = None
    angle: Annotated[float, Field(gt=0, lt=180)] = 30.0


_Names = Annotated[list[str], Field(min_length=1)]
ByVolume = Annotated[
    Annotated[str, Tag(f"{KIND}one")] | Annotated[dict[str, str], Tag(f"{KIND}many")],
    Discriminator(lambda v: KIND + ("many" if isinstance(v, dict) else "one")),
]


class MeshFile(Table):
    """A mesh from a file: ``.msh``, ``.inp``, ``.med`` or ``.vtu``.

    ``file`` is relative to the scene file, for a model in Python to the working
    directory. ``group`` names the volumes of the file that make up the body; the default
    is all. The file names the surfaces. ``order = 2`` adds mid-side nodes to a mesh of
    first order, ``order = 1`` removes those of a mesh of second order.
    """

    file: str
    group: OneOrList[str, _Names] | None = None
    order: Annotated[int, Field(ge=1, le=2)] | None = None


class BodyTable(Table):
    """A body: a rectangle or a box with ``x``, ``y``, ``z``, or a ``mesh``.

    A list in place of an axis gives its grid points. ``order = 2`` adds mid-side nodes.
    ``material`` is one name, or a table with one for each volume of the mesh. ``surface``
    defines more surfaces by geometry. With ``plane = "axisymmetric"`` x is r and y is z.
    """

    material: ByVolume
    mesh: Annotated[MeshFile | None, wrap("file")] = None
    cell: Literal["triangle", "quadrilateral", "tetrahedron", "hexahedron"] | None = (
        None
    )
    x: _Axis | None = None
    y: _Axis | None = None
    z: _Axis | None = None
    order: Annotated[int, Field(ge=1, le=2)] = 1
    plane: Literal["strain", "stress", "axisymmetric"] = "strain"
    thickness: Annotated[float, Field(gt=0)] = 1.0
    surface: dict[str, Place] = Field(default_factory=no_tables)

    @property
    def dim(self) -> int | None:
        """2 or 3; None for a mesh from a file."""
        return None if self.cell is None else FIRST[self.cell].dim

    @property
    def materials(self) -> dict[str, str]:
        """Names of the materials by the end of their key path."""
        if isinstance(self.material, str):
            return {"": self.material}
        return {f".{volume}": name for volume, name in self.material.items()}


def _whole(value: float, what: str, n: int | None) -> int:
    if not value <= MOST:
        raise ValueError(f"{what} gives {value:g} cells, expected at most {MOST}")
    count = round(value)
    # Quotients of decimal lengths are integers only up to rounding.
    if count < 1 or abs(value - count) > 1e-9 * count:
        at = "" if n is None else f" for mesh.n = {n}"
        raise ValueError(f"{what} is not a whole number of cells{at}: {value:g}")
    return count


def _grow(start: float, end: float, cell: float, ratio: float) -> list[float]:
    """Points after ``start`` up to ``end``, with cells that grow from ``cell`` (signed).

    The last point is moved to ``end``. If the last cell is then shorter than half of the
    one before, the two are merged.
    """
    points, first = [start], abs(cell)
    while (end - points[-1]) * cell > 0:
        if len(points) > MOST:
            raise ValueError(
                f"cells from {first:g} on: more than {MOST}, choose larger"
            )
        points.append(points[-1] + cell)
        cell *= ratio
    if len(points) > 1:
        points[-1] = end
    if len(points) > 2 and abs(end - points[-2]) < 0.5 * abs(points[-2] - points[-3]):
        del points[-2]
    return points[1:]


_Modulus = Annotated[float, Field(gt=0)]
_Moduli = Annotated[list[_Modulus], Field(min_length=3, max_length=3)]
_Ratio = Annotated[float, Field(gt=-1, lt=0.5)]


class Elastic(Table):
    """An elastic material: isotropic with two numbers, or orthotropic with nine.

    For an orthotropic material ``young`` are the moduli along its axes 1, 2, 3,
    ``poisson`` the ratios ν12, ν13, ν23 and ``shear`` the moduli G12, G13, G23. The rows
    of ``axes`` are its directions, in two dimensions 1 and 2; the default is the axes of
    coordinates.
    """

    young: OneOrList[_Modulus, _Moduli]
    poisson: OneOrList[_Ratio, Triple]
    shear: _Moduli | None = None
    axes: Annotated[list[Vector], Field(min_length=2, max_length=3)] | None = None

    def make(
        self,
        *,
        plane_stress: bool = False,
        thickness: float = 1.0,
        axisymmetric: bool = False,
    ) -> materials.Elastic:
        """Make the material; `ValueError`: its numbers fit no kind of material."""
        young, poisson = self.young, self.poisson
        plane = plane_stress, thickness, axisymmetric
        if isinstance(young, list) and isinstance(poisson, list) and self.shear:
            return materials.Orthotropic(young, poisson, self.shear, self.axes, *plane)
        if isinstance(young, list) or isinstance(poisson, list) or self.shear:
            raise ValueError(
                "an orthotropic material needs three numbers each in young, poisson and "
                "shear; an isotropic one needs one number in young and poisson, no shear"
            )
        if self.axes is not None:
            raise ValueError("remove axes: this material is isotropic")
        return materials.Material(young, poisson, *plane)
