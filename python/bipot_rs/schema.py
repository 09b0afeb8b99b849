"""Tables of a scene file, and what is wrong with them.

A name `on` is ``"body.surface"``. A number of cells or a length may be given by the
scene's own ``mesh.n``: ``"n"``, ``"n/2"``, ``"6*n"``, ``"0.5/n"``.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
)

from bipot_rs.check import RATIO
from bipot_rs.fem import FACES
from bipot_rs.words import counted

Floats = NDArray[np.float64]
AXES = ("x", "y", "z")
# Cells along an axis, and load steps: more are a slip of the pen.
MOST = 1_000_000
# Lengths, moduli and forces beyond this, or below its inverse, overflow when a few of
# them are multiplied; in no system of units are there such.
LARGEST = 1e60
_DIM = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
# Cells that carry an element, by dimension.
_CARRIES = {
    "P1": {2: "triangle", 3: "tetrahedron"},
    "Q1": {2: "quadrilateral", 3: "hexahedron"},
}


class _Table(BaseModel):
    # Strict: a number in quotes, or `true` for 1, is a slip of the pen.
    model_config = ConfigDict(
        extra="forbid", strict=True, allow_inf_nan=False, populate_by_name=True
    )


def _wrap(key: str) -> BeforeValidator:
    """Let a plain value stand for a table with one key."""
    return BeforeValidator(lambda v: v if isinstance(v, dict | BaseModel) else {key: v})


_OF_N = re.compile(
    r"(?:(?P<factor>\d+(?:\.\d*)?)\s*\*\s*)?n(?:\s*/\s*(?P<divisor>\d+(?:\.\d*)?))?"
    r"|(?P<over>\d+(?:\.\d*)?)\s*/\s*n"
)


def _expression(value: Any) -> Any:
    """Keep a number, or one that depends on n, as text."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return str(value)
    if isinstance(value, str) and _OF_N.fullmatch(value.strip()):
        return value.strip()
    raise ValueError("should be a number, or like 'n', 'n/2', '6*n', '0.5/n'")


Expression = Annotated[str, BeforeValidator(_expression)]
Range = Annotated[list[float], Field(min_length=2, max_length=2)]
Vector = Annotated[list[float], Field(min_length=2, max_length=3)]
_Coefficient = Annotated[float, Field(ge=0)]
_Pair = Annotated[list[_Coefficient], Field(min_length=2, max_length=2)]
# What a union calls its kinds is no part of a place in the file: it begins with this.
KIND = "|"
Friction = Annotated[
    Annotated[_Coefficient, Tag(f"{KIND}number")]
    | Annotated[_Pair, Tag(f"{KIND}pair")],
    Discriminator(lambda v: KIND + ("pair" if isinstance(v, list) else "number")),
]


class Units(_Table):
    """Names of units, for pictures and exported problems; nothing is converted."""

    length: str = ""
    force: str = ""
    stress: str = ""


class Mesh(_Table):
    """Resolution, the one number that a study of convergence changes, and the element.

    With ``element`` all bodies have the cells of that element, whatever their own
    ``cell`` says: P1 are linear triangles and tetrahedra, Q1 bilinear quadrilaterals and
    trilinear hexahedra, on the same grid points.
    """

    n: Annotated[int | None, Field(gt=0, le=MOST)] = None
    element: Literal["P1", "Q1"] | None = None


class Elastic(_Table):
    """Isotropic elasticity."""

    young: Annotated[float, Field(gt=0)]
    poisson: Annotated[float, Field(gt=-1, lt=0.5)]


class Axis(_Table):
    """Grid points along an axis: equal cells, a graded grid, or all points.

    A graded grid has cells of size ``cell`` over ``uniform``, or one cell at
    ``from`` when ``uniform`` is missing, and from there on each cell ``growth``
    times as long as the one before. ``growth`` may depend on n: pairs of the
    first n and the ratio from there on.
    """

    start: Annotated[float | None, Field(alias="from")] = None
    end: Annotated[float | None, Field(alias="to")] = None
    cells: Expression | None = None
    cell: Expression | None = None
    uniform: Range | None = None
    growth: Annotated[
        list[Annotated[list[float], Field(min_length=2, max_length=2)]],
        BeforeValidator(lambda v: [[1.0, v]] if isinstance(v, int | float) else v),
    ] = Field(default_factory=lambda: [[1.0, 1.0]])
    points: Annotated[list[float], Field(min_length=2)] | None = None

    def grid(self, n: int | None) -> Floats:
        """Ascending grid points; `ValueError` says what does not fit."""
        grid = self._points(n)
        if len(grid) < 2 or not np.all(np.diff(grid) > 0):
            raise ValueError(
                "points should ascend, and no two may be one after rounding"
            )
        return grid

    def _points(self, n: int | None) -> Floats:
        if self.points is not None:
            if self.model_fields_set != {"points"}:
                raise ValueError("points stand alone, without other keys")
            return np.array(self.points)
        if self.start is None or self.end is None or self.start == self.end:
            raise ValueError("needs from and to, different, or points")
        if (self.cells is None) == (self.cell is None):
            raise ValueError("needs cells or cell, one of them")
        if self.cells is not None:
            if self.uniform is not None or "growth" in self.model_fields_set:
                raise ValueError("uniform and growth go with cell, not with cells")
            count = _whole(_of_n(self.cells, n), f"cells = {self.cells}", n)
            low, high = sorted((self.start, self.end))
            return np.linspace(low, high, count + 1)
        return self._graded(self.start, self.end, str(self.cell), n)

    def _graded(self, start: float, end: float, cell: str, n: int | None) -> Floats:
        size, ratio = _of_n(cell, n), 1.0
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
            raise ValueError("uniform should ascend and lie between from and to")
        count = _whole((high - low) / size, f"uniform over cell = {cell}", n)
        left = _grow(low, min(start, end), -size * ratio, ratio)
        right = _grow(high, max(start, end), size * ratio, ratio)
        return np.unique([*left, *np.linspace(low, high, count + 1), *right])


class Block(_Table):
    """A rectangle or a box, ``z`` in three dimensions only."""

    material: str
    cell: Literal["triangle", "quadrilateral", "tetrahedron", "hexahedron"]
    x: Axis
    y: Axis
    z: Axis | None = None
    plane: Literal["strain", "stress"] = "strain"
    thickness: Annotated[float, Field(gt=0)] = 1.0

    @property
    def dim(self) -> int:
        """2 or 3."""
        return _DIM[self.cell]


class Within(_Table):
    """Part of a surface: closed ranges of coordinates."""

    x: Range | None = None
    y: Range | None = None
    z: Range | None = None

    def box(self) -> dict[int, tuple[float, float]]:
        """Ranges by axis."""
        given = (self.x, self.y, self.z)
        return {k: (r[0], r[1]) for k, r in enumerate(given) if r is not None}


class Varying(_Table):
    """A number times an amplitude; without one, the same in every load step."""

    value: float
    amplitude: str | None = None


Component = Annotated[Varying, _wrap("value")]


class _Vector(_Table):
    x: Component | None = None
    y: Component | None = None
    z: Component | None = None

    def components(self) -> dict[int, Varying]:
        """Those given, by axis."""
        given = (self.x, self.y, self.z)
        return {k: v for k, v in enumerate(given) if v is not None}


class Prescribed(_Vector):
    """Displacement components prescribed on a surface; others stay free."""

    on: str
    within: Within | None = None


class Traction(_Vector):
    """Force per area on a surface."""

    on: str


class Pressure(_Table):
    """Pressure on a surface, positive inwards."""

    on: str
    value: float
    amplitude: str | None = None


class BodyForce(_Vector):
    """Force per volume of a body."""

    on: str


class Plane(_Table):
    """A rigid plane; the normal points to the body."""

    point: Vector
    normal: Vector


class Clearance(_Table):
    """What is added to the gap: a height, and r²/(2 radius) around a centre."""

    # Along an edge three values tell it.
    QUADRATIC: ClassVar[bool] = True

    height: float = 0.0
    radius: float | None = None
    centre: Vector | None = None

    def at(self, points: Floats) -> Floats:
        """Clearance at places ``(n_c, d)``."""
        clearance = np.full(len(points), self.height)
        if self.radius is not None:
            centre = np.zeros(points.shape[1]) if self.centre is None else self.centre
            clearance += np.sum((points - centre) ** 2, axis=1) / (2 * self.radius)
        return clearance


class Touch(_Table):
    """Nodes of a surface that may meet a rigid plane or another body.

    Two numbers ``mu`` are friction along ``axis``, made tangential, and across it.
    """

    on: str
    mu: Friction
    axis: Vector | None = None
    plane: Plane | None = None
    against: str | None = None
    clearance: Annotated[Clearance, _wrap("height")] = Field(default_factory=Clearance)
    within: Within | None = None


class Amplitude(_Table):
    """Factor of each load step k = 0, 1, …: a table, sin(2π k/period), (k + 1)/steps."""

    table: Annotated[list[float], Field(min_length=1)] | None = None
    wave: Literal["sine", "ramp"] | None = None
    period: Annotated[float, Field(gt=0)] | None = None

    def values(self, steps: int) -> Floats:
        """Factors ``(steps,)``."""
        if self.table is not None:
            return np.array(self.table)
        if self.wave == "ramp":
            return np.arange(1.0, steps + 1) / steps
        turns = np.arange(steps) / (self.period or 1.0)
        factors: Floats = np.sin(2 * np.pi * turns)
        return factors


class LoadPath(_Table):
    """Load steps, from the unloaded state; each is one implicit increment."""

    steps: Annotated[int, Field(gt=0, le=MOST)] | None = None
    parameter: str | None = None
    amplitude: dict[str, Annotated[Amplitude, _wrap("table")]] = Field(
        default_factory=dict
    )

    def count(self) -> int:
        """Load steps: as given, or the length of the tables, or one."""
        lengths = [len(a.table) for a in self.amplitude.values() if a.table]
        return self.steps or max(lengths, default=1)


class Solver(_Table):
    """Settings of the contact solver; the command line overrides them.

    ``tol = "discretisation"`` goes as far as the mesh is worth (`enough`).
    """

    method: str = "auto"
    tol: Annotated[float, Field(gt=0)] | Literal["discretisation"] = 1e-12
    max_iterations: Annotated[int, Field(gt=0)] | None = None


class Scene(_Table):
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


def inconsistencies(scene: Scene) -> list[str]:
    """List what no table shows by itself: names, dimensions, grids, lengths."""
    found = list(_out_of_range(scene.model_dump(by_alias=True, exclude={"solver"})))
    if found:
        return found
    n = scene.mesh.n if scene.mesh else None
    dims = {name: block.dim for name, block in scene.body.items()}
    if len(set(dims.values())) > 1:
        found.append("body: bodies of two and of three dimensions do not mix")
    dim = max(dims.values())
    for name, block in scene.body.items():
        if block.material not in scene.material:
            found.append(
                f"body.{name}.material: {_unknown(block.material, scene.material)}"
            )
        if (block.z is None) != (block.dim == 2):
            needs = "takes no z" if block.dim == 2 else "needs z"
            found.append(f"body.{name}: a {block.cell} {needs}")
        sides = []
        for letter, axis in zip(AXES, (block.x, block.y, block.z), strict=True):
            try:
                if axis is not None:
                    sides.append(len(axis.grid(n)))
            except ValueError as error:
                found.append(f"body.{name}.{letter}: {error}")
        if len(sides) == block.dim:
            found += _too_large(name, math.prod(sides), block.dim, scene.path.count())

    def surface(path: str, on: str) -> None:
        body, dot, face = on.partition(".")
        if body not in scene.body:
            found.append(f"{path}: {_unknown(body, scene.body)}")
        elif not dot or face not in FACES[dims[body]]:
            faces = [f"{body}.{face}" for face in FACES[dims[body]]]
            found.append(f"{path}: {_unknown(on, faces)}")

    for kind in ("support", "traction", "pressure", "contact"):
        for i, entry in enumerate(getattr(scene, kind)):
            surface(f"{kind}.{i}.on", entry.on)
    for i, force in enumerate(scene.body_force):
        if force.on not in scene.body:
            found.append(f"body_force.{i}.on: {_unknown(force.on, scene.body)}")
    for kind in ("support", "traction", "body_force"):
        for i, entry in enumerate(getattr(scene, kind)):
            if not entry.components():
                found.append(f"{kind}.{i}: gives no component x, y or z")
            if dim == 2 and entry.z is not None:
                found.append(f"{kind}.{i}.z: a scene of two dimensions has no z")
    for i, contact in enumerate(scene.contact):
        if (contact.plane is None) == (contact.against is None):
            found.append(f"contact.{i}: needs plane or against, one of them")
        if contact.against is not None:
            surface(f"contact.{i}.against", contact.against)
            if contact.against.partition(".")[0] == contact.on.partition(".")[0]:
                found.append(f"contact.{i}.against: a body cannot meet itself")
        for key, vector in (
            ("plane.point", contact.plane.point if contact.plane else None),
            ("plane.normal", contact.plane.normal if contact.plane else None),
            ("clearance.centre", contact.clearance.centre),
            ("axis", contact.axis),
        ):
            if vector is not None and len(vector) != dim:
                found.append(f"contact.{i}.{key}: should have {dim} components")
        if contact.plane and not any(contact.plane.normal):
            found.append(f"contact.{i}.plane.normal: should not be zero")
        if isinstance(contact.mu, list):
            found += _elliptic(f"contact.{i}", contact.mu, contact.axis, dim)
        elif contact.axis is not None:
            found.append(f"contact.{i}.axis: mu is one number, the same all around")
        if contact.clearance.radius == 0:
            found.append(f"contact.{i}.clearance.radius: should not be zero")
    return found + _path_inconsistencies(scene)


def _elliptic(
    path: str, mu: Sequence[float], axis: Sequence[float] | None, dim: int
) -> Iterator[str]:
    """Friction along two tangents."""
    if dim == 2:
        yield f"{path}.mu: has two numbers, in two dimensions there is one tangent"
    elif axis is None:
        yield f"{path}.axis: is missing, the direction of the first number of mu"
    elif not any(axis):
        yield f"{path}.axis: should not be zero"
    if not min(mu) * RATIO >= max(mu):
        yield (
            f"{path}.mu: should be two positive numbers within a factor of {RATIO:g} of "
            f"each other, or twice zero, got {list(mu)}"
        )


def _out_of_range(value: Any, path: str = "") -> Iterator[str]:
    """Numbers that arithmetic cannot be trusted with."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _out_of_range(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from _out_of_range(inner, f"{path}.{k}")
    elif isinstance(value, float) and not (
        value == 0 or 1 / LARGEST <= abs(value) <= LARGEST
    ):
        yield (
            f"{path}: is {value:g}, expected zero or a size from {1 / LARGEST:g} "
            f"to {LARGEST:g}"
        )


def _too_large(name: str, nodes: int, dim: int, steps: int) -> Iterator[str]:
    """What no machine of this memory can hold, found before it is asked for."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    # Nodes of the cells around a node, a number and a column index for each component.
    stiffness = nodes * dim * 3**dim * dim * 12
    if stiffness > memory:
        yield (
            f"body.{name}: {nodes} nodes, whose stiffness alone takes {stiffness} bytes "
            f"of the {memory} of this machine"
        )
    elif 2 * 8 * nodes * dim * steps > memory:
        yield (
            f"path: {steps} load steps of {nodes} nodes of body {name!r}, whose loads and "
            f"displacements take {2 * 8 * nodes * dim * steps} bytes of the {memory} of "
            "this machine"
        )


def _path_inconsistencies(scene: Scene) -> list[str]:
    found, path = [], scene.path
    used = {path.parameter}
    for place, number in scene.varying():
        used.add(number.amplitude)
        if number.amplitude is not None and number.amplitude not in path.amplitude:
            found.append(
                f"{place}.amplitude: {_unknown(number.amplitude, path.amplitude)}"
            )
    if path.parameter is not None and path.parameter not in path.amplitude:
        found.append(f"path.parameter: {_unknown(path.parameter, path.amplitude)}")
    for name, amplitude in path.amplitude.items():
        place = f"path.amplitude.{name}"
        if (amplitude.table is None) == (amplitude.wave is None):
            found.append(f"{place}: should be a list of factors or a wave")
        elif amplitude.wave == "sine" and amplitude.period is None:
            found.append(f"{place}: a sine needs its period")
        elif amplitude.wave == "ramp" and amplitude.period is not None:
            found.append(f"{place}: a ramp has no period")
        elif amplitude.wave is not None and path.steps is None:
            found.append(f"path.steps: is missing, and the wave {name} has no end")
        elif amplitude.table is not None and len(amplitude.table) != path.count():
            found.append(
                f"{place}: has {counted(len(amplitude.table), 'factor')} for "
                f"{counted(path.count(), 'step')}"
            )
        if name not in used:
            found.append(f"{place}: nothing uses it")
    return found


def _of_n(expression: str, n: int | None) -> float:
    """Value of an `Expression`."""
    match = _OF_N.fullmatch(expression)
    if match is None:
        return float(expression)
    if n is None:
        raise ValueError(f"{expression} needs mesh.n, which is missing")
    if match["over"]:
        return float(match["over"]) / n
    divisor = float(match["divisor"] or 1)
    if divisor == 0:
        raise ValueError(f"{expression} divides by zero")
    return float(match["factor"] or 1) * n / divisor


def _whole(value: float, what: str, n: int | None) -> int:
    if not value <= MOST:
        raise ValueError(f"{what} gives {value:g} cells, more than {MOST}")
    count = round(value)
    # Quotients of decimal lengths are whole to rounding only.
    if count < 1 or abs(value - count) > 1e-9 * count:
        at = "" if n is None else f" for mesh.n = {n}"
        raise ValueError(f"{what} is not a whole number of cells{at}: {value:g}")
    return count


def _grow(start: float, end: float, cell: float, ratio: float) -> list[float]:
    """Points after ``start`` up to ``end``, cells growing from the signed size ``cell``.

    The last point is clipped to ``end``; where that leaves a last cell shorter
    than half of the one before, the two become one.
    """
    points, first = [start], abs(cell)
    while (end - points[-1]) * cell > 0:
        if len(points) > MOST:
            raise ValueError(f"cells from {first:g} on are more than {MOST}")
        points.append(points[-1] + cell)
        cell *= ratio
    if len(points) > 1:
        points[-1] = end
    if len(points) > 2 and abs(end - points[-2]) < 0.5 * abs(points[-2] - points[-3]):
        del points[-2]
    return points[1:]


def _unknown(name: str, known: Sequence[str] | dict[str, Any]) -> str:
    return f"there is no {name!r}, expected one of {', '.join(known) or 'none'}"
