"""A scene described in Python: `Model` holds the same tables as a scene file.

The schema of the scene checks both.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.types import Floats, Ints, OpenRecord
from bipot_rs.contact.errors import BipotError
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Step
from bipot_rs.fem import resultants
from bipot_rs.fem.checks.inspection import review
from bipot_rs.fem.contact_surface import result_mesh, surface_labels
from bipot_rs.scene.build import bodies
from bipot_rs.scene.case import Case, assemble
from bipot_rs.scene.library import folder_of, text
from bipot_rs.scene.mistakes import Mistake, MistakeKind, SceneError
from bipot_rs.scene.reading import check, parse, put
from bipot_rs.scene.schema.root import Scene, Units

_UNITS = tuple(Units.model_fields)


class Model:
    """Elastic bodies in contact, their supports, loads and load path.

    Surfaces are named ``"body.surface"``. Those of a box are left, right, bottom and top,
    in three dimensions also front and back. Each method adds one table of the scene. Its
    keywords are the keys of that table, its values those of TOML: numbers, strings, lists
    and dictionaries; arrays become lists. Use `times` for a number that changes along the
    path. Nothing is checked until `scene`, `assemble` or `solve` is called; these report
    all mistakes together, with their key paths.

    Parameters
    ----------
    title
        Title of tables and pictures.
    units
        Names of the units of length, force and stress, for pictures and files: a mapping
        or three names. Nothing is converted.
    n
        The number n in sizes of cells such as ``"n"``, ``"n/2"``, ``"0.5/n"``.
    element
        ``"P1"``, ``"Q1"``, ``"P2"`` or ``"Q2"``; replaces the cells and the order of all
        bodies.

    Examples
    --------
    >>> m = Model("Pressed block", units=("mm", "N", "MPa"), n=8)
    >>> m.material("steel", young=210e3, poisson=0.3)
    >>> side = {"from": 0.0, "to": 40.0, "cells": "n"}
    >>> m.body("block", material="steel", cell="quadrilateral", x=side, y=side)
    >>> m.support("block.left", x=0)
    >>> m.traction("block.top", y=m.times(-50, "press"))
    >>> m.contact("block.bottom", plane={"point": [0, 0], "normal": [0, 1]}, mu=0.3)
    >>> m.path(press=[0.5, 1.0])
    >>> result = m.solve()
    >>> result.contact_force("block.bottom")[:, 1].round(6)
    array([1000., 2000.])
    """

    def __init__(
        self,
        title: str = "",
        *,
        units: Mapping[str, str] | Sequence[str] | None = None,
        n: int | None = None,
        element: str | None = None,
    ) -> None:
        self._table: OpenRecord = {}
        # Relative names of files refer to this folder.
        self._folder = Path()
        if title:
            self._table["title"] = title
        if units is not None:
            if not isinstance(units, Mapping):
                if isinstance(units, str) or len(units) != len(_UNITS):
                    raise ValueError(
                        f"units is {units!r}, expected a mapping or three names, for "
                        f"{', '.join(_UNITS)}"
                    )
                units = dict(zip(_UNITS, units, strict=True))
            self._table["units"] = _plain(units)
        mesh = _plain({"n": n, "element": element})
        if mesh:
            self._table["mesh"] = mesh

    @classmethod
    def from_toml(cls, source: str | os.PathLike[str]) -> Model:
        """Make the model of a shipped scene, a file, or a text of several lines.

        Names of mesh files in a scene file are relative to its folder.

        Raises
        ------
        SceneError
            There is no such file, or it is not TOML. Mistakes in its tables are reported
            when they are used.
        """
        made = cls()
        name = os.fspath(source)
        if "\n" in name:
            made._table = parse("text", name)
        else:
            made._table = parse(name, text(name))
            made._folder = folder_of(name)
        return made

    def to_toml(self, path: str | os.PathLike[str] | None = None) -> str:
        """Scene file of this model as text; also written to ``path`` if given.

        `bipot run` reads it, and `from_toml` returns an equal model. Names of files are
        rewritten relative to the folder of ``path``.

        Raises
        ------
        TypeError
            A table contains a value that TOML cannot represent.
        OSError
            The file cannot be written.
        """
        import tomli_w

        table = self.to_dict()
        if path is not None:
            _seen_from(Path(path).parent, self._folder, table)
        text_of_scene = tomli_w.dumps(table)
        if path is not None:
            content = text_of_scene.encode()  # before the file is emptied
            Path(path).write_bytes(content)
        return text_of_scene

    def to_dict(self) -> OpenRecord:
        """Copy of the tables, as `tomllib` would read them from the file."""
        return copy.deepcopy(self._table)

    def with_(self, **changes: object) -> Model:
        """Copy with some values changed, as ``--set`` does on the command line.

        >>> Model.from_toml("two_blocks").with_(**{"mesh.n": 4, "contact.0.mu": 0.5})
        Model('Stiff block on a soft block, pressed and sheared': 2 bodies, 1 contact)

        Raises
        ------
        SceneError
            There is no such place.
        """
        made = Model()
        made._table, made._folder = self.to_dict(), self._folder
        wrong = [
            Mistake(key, message, MistakeKind.NAME)
            for key, value in changes.items()
            if (message := put(made._table, key, _plain(value)))
        ]
        if wrong:
            raise SceneError(self.title, wrong)
        return made

    def parameter(self, **values: object) -> None:
        """Define names for formulas such as ``mu="mu"`` and ``x="2*F"`` in place of numbers.

        A formula has numbers, names, ``+ - * /`` and parentheses; ``n`` is that of the cells.
        """
        self._table.setdefault("parameter", {}).update(_plain(values))

    @staticmethod
    def times(value: float, amplitude: str) -> dict[str, object]:
        """A number times an amplitude of `path`."""
        return {"value": value, "amplitude": amplitude}

    def material(self, name: str, **table: object) -> None:
        """Add a material: ``young``, ``poisson``; if orthotropic ``shear``, ``axes``.

        An orthotropic material has three numbers for each of ``young``, ``poisson`` and
        ``shear``: along its axes 1, 2, 3, and in the planes 12, 13, 23.
        """
        self._add_named("material", name, table)

    def body(self, name: str, **table: object) -> None:
        """Add a body: a rectangle, a box, or a mesh from a file.

        ``material`` is a name, or a table of names by volume of the mesh. A box has
        ``cell``: ``"triangle"``, ``"quadrilateral"``, ``"tetrahedron"`` or
        ``"hexahedron"``; ``x``, ``y`` and in three dimensions ``z``: a list of grid
        points, or a table of ``from``, ``to`` and ``cells``, or of ``from``, ``to``,
        ``cell``, ``uniform`` and ``growth``; and ``order``, 1 or 2. A mesh has ``mesh``
        instead: a file, or a table of ``file``, ``group`` (names of volumes) and
        ``order``; the file names its surfaces. In two dimensions ``plane`` is
        ``"strain"``, ``"stress"`` or, with x as r and y as z, ``"axisymmetric"``, and
        ``thickness`` a length. ``surface`` defines more
        surfaces: for each name a table of ``within``, ``normal`` and ``angle`` in
        degrees.
        """
        self._add_named("body", name, table)

    def obstacle(self, name: str, **table: object) -> None:
        """Add a rigid obstacle; contacts refer to it by ``against``.

        Its shape is one of ``plane``, a table of ``point`` and ``normal``; ``sphere``, of
        ``centre`` and ``radius``; ``cylinder``, of ``point``, ``radius`` and in three
        dimensions ``axis``; in three dimensions ``torus``, of ``centre``, ``axis``,
        ``major_radius`` and ``minor_radius``; ``surface``, a file such as STL. ``inside``
        is true if the bodies lie inside the shape. ``move`` is a table of ``x``, ``y``,
        ``z``; ``turn`` is a table of ``angle`` in **degrees**, ``about`` and in three
        dimensions ``axis``. Both are totals along the path. ``force``, a table of ``x``,
        ``y``, ``z``, is the total force on the obstacle, which moves in these directions
        until the contacts balance it.
        """
        self._add_named("obstacle", name, table)

    def support(self, on: str, **table: object) -> None:
        """Prescribe displacements ``x``, ``y``, ``z`` on a part of a body.

        ``on`` is a surface, a volume or a body. ``within`` selects nodes by ranges of
        coordinates, ``at`` only the node nearest to a position, also inside the body.
        """
        self._add_to_list("support", on, table)

    def remote(self, name: str, **table: object) -> None:
        """Let a part ``on`` of a body follow a ``point``, or load it by a force there.

        The part, a surface, a volume or a body with ``within``, moves as a rigid body. Its
        point is moved by ``move`` and ``turn`` (degrees), loaded by ``force`` and
        ``moment``, each a table of ``x``, ``y``, ``z``; other components are free. With
        ``distributed=True`` the part may deform, and the force and the moment are spread
        over it.
        """
        self._add_named("remote", name, table)

    def bolt(self, section: str, **table: object) -> None:
        """Cut a shank at ``section``, and tighten it by ``force`` in the load steps ``step``.

        ``section`` is ``"body.surface"``, or a body that ``plane``, a table of ``point`` and
        ``normal``, cuts. ``step`` is the first and the last load step, counted from 1, in
        which the force (tension positive) determines the shortening; other steps keep it.
        With ``half=True`` a plane of symmetry divides the bolt. ``name`` is that in tables.
        """
        self._table.setdefault("bolt", []).append({"section": section} | _plain(table))

    def cyclic(self, on: str, onto: str, *, sectors: int, **table: object) -> None:
        """Make two cuts those of one of ``sectors`` equal sectors: ``about``, ``axis``."""
        self._add_to_list("cyclic", on, {"onto": onto, "sectors": sectors, **table})

    def periodic(self, on: str, onto: str) -> None:
        """Make two cuts those of a structure that repeats itself by a translation."""
        self._add_to_list("periodic", on, {"onto": onto})

    def symmetry(self, on: str) -> None:
        """Make a flat surface a plane of symmetry."""
        self._add_to_list("symmetry", on, {})

    def spring(self, on: str, **table: object) -> None:
        """Add springs per area: ``stiffness``, or ``normal`` and ``tangential``."""
        self._add_to_list("spring", on, table)

    def traction(self, on: str, **table: object) -> None:
        """Add a force per area on a surface: ``x``, ``y``, ``z``.

        ``within``, ranges of coordinates, selects a part of the surface, also of a facet.
        """
        self._add_to_list("traction", on, table)

    def pressure(self, on: str, value: object, **table: object) -> None:
        """Add a pressure on a surface, positive inwards: a number, or `times`.

        ``within`` selects a part, as in `traction`.
        """
        keys = dict(value) if isinstance(value, Mapping) else {"value": value}
        self._add_to_list("pressure", on, keys | table)

    def body_force(self, on: str, **table: object) -> None:
        """Add a force per volume of a body: ``x``, ``y``, ``z``."""
        self._add_to_list("body_force", on, table)

    def strain(self, on: str, **table: object) -> None:
        """Add an initial strain of a body, or of ``"body.volume"``: its stress-free strain.

        ``expansion`` and ``temperature``, or ``tensor`` and its ``amplitude``.
        """
        self._add_to_list("strain", on, table)

    def contact(self, on: str, **table: object) -> None:
        """Add contact of the nodes of a surface.

        ``mu`` is one number, or in three dimensions two: along ``axis`` and across it.
        ``cohesion`` is a stress, ``dilatancy`` a number up to ``mu``.
        The obstacle is either ``plane``, a table of ``point`` and ``normal``, or
        ``against``, the name of an obstacle or of a surface of another body. ``pairing``
        is ``"match"``, or for meshes that do not match ``"mortar"`` or ``"nodes"``.
        ``clearance`` is a height, or a table of ``height``, ``radius`` and ``centre``;
        ``within`` gives ranges of coordinates. Tables and files name the contact by
        ``name``, else by its surface.
        """
        self._add_to_list("contact", on, table)

    def path(
        self,
        *,
        steps: int | None = None,
        parameter: str | None = None,
        automatic: bool | Mapping[str, object] | None = None,
        **amplitude: object,
    ) -> None:
        """Set the load path, which starts at the unloaded bodies.

        Parameters
        ----------
        steps
            Number of load steps; by default the length of the amplitudes.
        parameter
            Name of the amplitude that is printed for each load step.
        automatic
            Whether load steps are divided if necessary; or a table of ``first``,
            ``largest``, ``smallest`` and ``slip``.
        amplitude
            For each name a list with one factor for each load step, or a table of
            ``wave`` and ``period``.
        """
        settings = {"steps": steps, "parameter": parameter, "automatic": automatic}
        table = _plain(settings)
        if amplitude:
            table["amplitude"] = _plain(amplitude)
        self._table["path"] = table

    def wear(self, *, coefficient: float, cycles: int, **table: object) -> None:
        """Repeat the load path and wear the contacts: ``steps``, ``jump``, ``rtol``.

        ``model.assemble().wear()`` then solves the cycles and returns a `Wear`.

        Parameters
        ----------
        coefficient
            Depth worn off per pressure and slip [1/stress].
        cycles
            Number of cycles.
        table
            ``steps``: number of load steps at the end of the path that form a cycle, by
            default all; ``jump``: whether cycles may be jumped over; ``rtol``: error that
            jumps may cause.
        """
        keys = {"coefficient": coefficient, "cycles": cycles, **table}
        self._table["wear"] = _plain(keys)

    def solver(self, **table: object) -> None:
        """Set the contact solver: ``method``, ``tol``, ``max_iterations``."""
        self._table["solver"] = _plain(table)

    def _add_named(self, kind: str, name: str, table: Mapping[str, object]) -> None:
        tables = self._table.setdefault(kind, {})
        if name in tables:
            raise ValueError(f"{kind} {name!r} is already defined: choose another name")
        tables[name] = _plain(table)

    def _add_to_list(self, kind: str, on: str, table: Mapping[str, object]) -> None:
        self._table.setdefault(kind, []).append({"on": on} | _plain(table))

    @property
    def title(self) -> str:
        """Title of the model."""
        return str(self._table.get("title", ""))

    @property
    def scene(self) -> Scene:
        """The checked scene.

        Raises
        ------
        SceneError
            All mistakes found, each with its key path; a `ValueError`.
        """
        return check(self.title, self.to_dict(), folder=self._folder)

    def assemble(self) -> Case:
        """Make the arrays of this model: ``case.model`` and its load path.

        Raises
        ------
        SceneError
            Mistakes in the tables, or found on the meshes.
        """
        scene = self.scene
        return assemble(scene, bodies(scene))

    def check(self) -> list[str]:
        """Assemble, and return warnings; ``bipot check`` prints the same.

        One sentence each: nodes that penetrate at the start, surfaces that face away from
        their obstacle or are too far from it, friction where supports prescribe the slip,
        unsupported bodies, inconsistent units, loads without effect.

        Raises
        ------
        SceneError
            As `assemble`.
        """
        return self.assemble().remarks()

    @property
    def contacts(self) -> Mapping[str, Ints]:
        """Assemble, and return the numbers of the contacts by name, or by surface without one."""
        return resultants.contacts_by_surface(self.assemble().model)

    def solve(
        self,
        *,
        method: str | None = None,
        tol: float | None = None,
        max_iterations: int | None = None,
        start: Result | Step | None = None,
        on_step: Callable[[int, Step], object] | None = None,
        progress: bool = False,
        mu: float | Sequence[float] | str | None = None,
    ) -> ModelResult:
        """Solve the whole path; bitwise the same result as `bipot run`.

        Parameters
        ----------
        method, tol, max_iterations
            Replace the settings of `solver`.
        start
            Result of an interrupted run of this path, also one read from a file. The path
            continues from it, bitwise as if it had not been interrupted. With automatic
            steps, a single step is enough.
        on_step
            Called as ``on_step(k, step)`` after each step.
        progress
            As in `ContactProblem.solve`.
        mu
            Friction of all contacts in place of their own, as a key of `contact`; of one
            contact by its name: ``m.with_(**{"contact.faying.mu": 0.1}).solve()``.

        Raises
        ------
        SceneError
            Mistakes in the model.
        TypeError, ValueError
            A wrong argument; the message names it.
        NoEquilibriumError, FloatingBodyError, NotConvergedError
            As `ContactProblem.solve`, with a `ModelResult` as ``.result``.
        """
        model = self if mu is None else self.with_(**{"contact.*.mu": mu})
        case = model.assemble()
        first = 0
        if isinstance(start, Result):
            first = start.first_step + len(start)
            count = case.scene.path.count() if case.scene else first
            if first > count and not any(step.s is not None for step in start):
                raise ValueError(
                    f"start has {first} steps, but this path only {count}: it belongs to "
                    "another path"
                )
        elif start is not None and getattr(start, "s", None) is None:
            raise TypeError(
                f"start is a {type(start).__name__}, expected a Result: its number of "
                "steps is needed to continue the path"
            )
        try:
            result = case.solve(
                method=method,
                tol=tol,
                max_iterations=max_iterations,
                start=start,
                first=first,
                on_step=on_step,
                progress=progress,
            )
        except BipotError as error:
            # The message counts steps from the start of the whole path.
            if error.step is not None:
                error.at_step(error.step + first)
            if error.result is not None:
                error.result = ModelResult(error.result, case, first)
                error.result.message = str(error)
            raise
        return ModelResult(result, case, first)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Model) and self._table == other._table

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        bodies, contacts = (len(self._table.get(k, ())) for k in ("body", "contact"))
        return (
            f"Model({self.title!r}: {count_noun(bodies, 'body')}, "
            f"{count_noun(contacts, 'contact')})"
        )


class ModelResult(Result):
    """A `Result` with the names of the surfaces of its model.

    Attributes
    ----------
    case
        The arrays of the model.
    """

    def __init__(self, result: Result, case: Case, first: int = 0) -> None:
        super().__init__(
            result.steps,
            contacts={**result.contacts, **surface_labels(case.model)},
            shape=case.model.points.shape,
            start=result.start,
            success=result.success,
            message=result.message,
            remarks=result.remarks,
            seconds=result.seconds,
            first_step=first,
            path_parameters=[
                case.step_parameter(first + k, step) for k, step in enumerate(result)
            ],
            derivatives=result.derivatives,
            mesh=partial(result_mesh, case.model),
        )
        if case.scene is not None:
            units = case.scene.units.model_dump().items()
            self.units = {name: unit for name, unit in units if unit}
        self.case = case
        self._reviewed: tuple[str, ...] | None = None

    @property
    def parameter(self) -> Floats:
        """Path parameter at the end of each step, ``(steps,)``."""
        return np.array([self.path_parameter(k) for k in range(len(self))], np.float64)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings of `Result`, and of `fem.review` about the solution."""
        if self._reviewed is None:
            remarks = review(self.case.model, self.steps)
            self._reviewed = (*self._remarks, *remarks)
        return self._reviewed

    def contacts_of(self, on: str) -> Ints:
        """Numbers of the contacts on a surface ``"body.surface"``, ascending.

        The surface is ``on`` of the contact's table; its ``name`` serves too. As
        `fem.resultants.contacts_on`.
        """
        return resultants.contacts_on(self.case.model, on)

    def contact_force(self, on: str) -> Floats:
        """Force of the contacts on a surface on its body, ``(steps, d)`` [N].

        As `fem.resultants.contact_force`.
        """
        return resultants.contact_force(self.case.model, self.steps, on)

    def contact_moment(self, on: str, about: ArrayLike | None = None) -> Floats:
        """Moment of the contact forces on a surface on its body, ``(steps, 3)`` [N m].

        In 2D ``(steps, 1)``; about a point ``(d,)``, by default the origin. As
        `fem.resultants.contact_moment`.
        """
        return resultants.contact_moment(self.case.model, self.steps, on, about)

    def support_force(self, on: str) -> Floats:
        """Force of the supports on a surface on their body, ``(steps, d)`` [N].

        As `fem.resultants.support_force`.
        """
        return resultants.support_force(self.case.model, self.steps, on)

    def reference_motion(self, name: str) -> tuple[Floats, Floats]:
        """Translation [m] and rotation [rad] of an obstacle with a force, or of a remote.

        ``(steps, d)``, of an obstacle in addition to its ``move``, and ``(steps, 3)``. As
        `fem.Assembly.reference_motion`.
        """
        moved = np.stack([step.displacement for step in self.steps])
        return self.case.model.reference_motion(name, moved)

    def reference_force(self, name: str) -> tuple[Floats, Floats]:
        """Total force [N] and moment [N m] at the point of an obstacle or a remote.

        ``(steps, d)`` and ``(steps, 3)``. As `fem.resultants.reference_force`.
        """
        return resultants.reference_force(self.case.model, self.steps, name)


def _seen_from(folder: Path, here: Path, table: OpenRecord) -> None:
    """Change file names relative to ``here`` into names relative to ``folder``."""

    def seen(file: object) -> object:
        if not isinstance(file, str) or Path(file).is_absolute():
            return file
        return Path(os.path.relpath(here / file, folder)).as_posix()

    for body in table.get("body", {}).values():
        mesh = body.get("mesh")
        if isinstance(mesh, dict) and "file" in mesh:
            mesh["file"] = seen(mesh["file"])
        elif mesh is not None:
            body["mesh"] = seen(mesh)
    for rigid in table.get("obstacle", {}).values():
        if "surface" in rigid:
            rigid["surface"] = seen(rigid["surface"])


def _plain(value: object) -> Any:
    """Value as `tomllib` reads it: tuples and arrays become lists, None is left out."""
    if isinstance(value, Mapping):
        return {key: _plain(v) for key, v in value.items() if v is not None}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, list | tuple | range):
        return [_plain(v) for v in value]
    return copy.deepcopy(value)
