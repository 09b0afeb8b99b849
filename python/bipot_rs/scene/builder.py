"""A scene described in Python: the tables of the TOML file, one to one.

A `Model` holds tables and nothing else; what they may hold, and what is wrong with
them, the schema of the scene says for both.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bipot_rs._lib import toml_text
from bipot_rs._lib.messages import counted, later
from bipot_rs._lib.types import Floats, Ints
from bipot_rs.contact.errors import BipotError
from bipot_rs.contact.result import Result
from bipot_rs.contact.solution import Step
from bipot_rs.fem.contact_surface import surface_labels
from bipot_rs.fem.review import review
from bipot_rs.scene.build import bodies
from bipot_rs.scene.case import Case
from bipot_rs.scene.library import SceneError, folder_of, text
from bipot_rs.scene.reading import assemble, checked, parsed, put
from bipot_rs.scene.schema.root import Scene

_UNITS = ("length", "force", "stress")


class Model:
    """Elastic bodies that meet, their supports, loads and load path.

    Surfaces are named ``"body.surface"``; those of a block are left, right, bottom and
    top, in space also front and back. Each method adds one table of the scene, and takes
    the keys of that table as keywords, with the values that TOML has: numbers, strings,
    lists, dictionaries; arrays count as lists. A number that changes along the path is
    `times`. Nothing is checked before `scene`, `assemble` or `solve`, which say all
    mistakes at once, with their places.

    Parameters
    ----------
    title
        For tables and pictures.
    units
        Names of the units of length, force and stress, for pictures and files; nothing
        is converted. A mapping, or three names.
    n
        The number that cells may depend on, ``"n"``, ``"n/2"``, ``"0.5/n"``.
    element
        ``"P1"``, ``"Q1"``, ``"P2"`` or ``"Q2"``, in place of the cells and the order of
        all bodies.

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
        self._table: dict[str, Any] = {}
        # Where the files that it names are looked for.
        self._folder = Path()
        if title:
            self._table["title"] = title
        if units is not None:
            if not isinstance(units, Mapping):
                if isinstance(units, str) or len(units) != len(_UNITS):
                    raise ValueError(
                        f"units is {units!r}, expected names for {', '.join(_UNITS)}"
                    )
                units = dict(zip(_UNITS, units, strict=True))
            self._table["units"] = _plain(units)
        mesh = _plain({"n": n, "element": element})
        if mesh:
            self._table["mesh"] = mesh

    @classmethod
    def from_toml(cls, source: str | os.PathLike[str]) -> Model:
        """The model of a shipped scene, a file, or a text of several lines.

        Meshes and surfaces that a scene file names are looked for beside it.

        Raises
        ------
        SceneError
            There is no such file, or it is not TOML. What is wrong with its tables is
            said when they are used.
        """
        made = cls()
        name = os.fspath(source)
        if "\n" in name:
            made._table = parsed("text", name)
        else:
            made._table = parsed(name, text(name))
            made._folder = folder_of(name)
        return made

    def to_toml(self, path: str | os.PathLike[str] | None = None) -> str:
        """The scene file of this model, written to ``path`` where one is given.

        `bipot run` takes it, and `from_toml` gives an equal model back. Names of files
        are written as they are seen from ``path``.

        Raises
        ------
        TypeError
            A table holds what TOML has no word for; the message names the place.
        OSError
            The file cannot be written.
        """
        if path is None:
            return toml_text.text(self._table)
        table = self.to_dict()
        _seen_from(Path(path).parent, self._folder, table)
        told = toml_text.text(table)
        Path(path).write_text(told, encoding="utf-8")
        return told

    def to_dict(self) -> dict[str, Any]:
        """The tables, as `tomllib` would read them from the file."""
        return copy.deepcopy(self._table)

    def with_(self, **changes: Any) -> Model:
        """A copy with other values, as ``--set`` gives them to the command line.

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
            f"{key}: {said}"
            for key, value in changes.items()
            if (said := put(made._table, key, _plain(value)))
        ]
        if wrong:
            raise SceneError(self.title, wrong)
        return made

    @staticmethod
    def times(value: float, amplitude: str) -> dict[str, Any]:
        """A number times an amplitude of `path`."""
        return {"value": value, "amplitude": amplitude}

    def material(self, name: str, **table: Any) -> None:
        """A material: ``young``, ``poisson``; orthotropic ``shear`` and ``axes`` besides.

        An orthotropic one has three numbers of each, along its axes 1, 2, 3, and for the
        planes 12, 13, 23.
        """
        self._named("material", name, table)

    def body(self, name: str, **table: Any) -> None:
        """A rectangle or a box, or a mesh from a file.

        ``material``, its name, or names by volume of the mesh. Of a box ``cell``, which
        is ``"triangle"``, ``"quadrilateral"``, ``"tetrahedron"`` or ``"hexahedron"``;
        ``x``, ``y`` and in space ``z``, each the grid points or a table of ``from``,
        ``to`` and ``cells``, or ``cell``, ``uniform`` and ``growth``; ``order``, 1 or 2.
        Instead of these ``mesh``, a file or a table of ``file``, ``group``, the volumes
        of it, and ``order``; its surfaces are those that the file names. In the plane
        ``plane``, ``"strain"`` or ``"stress"``, and ``thickness``. ``surface`` names
        more surfaces: by name a table of ``within``, ``normal`` and ``angle`` in degrees.
        """
        self._named("body", name, table)

    def obstacle(self, name: str, **table: Any) -> None:
        """A rigid obstacle, which contacts are ``against`` by its name.

        One of ``plane``, a table of ``point`` and ``normal``; ``sphere``, of ``centre``
        and ``radius``; ``cylinder``, of ``point``, ``radius`` and in space ``axis``;
        ``surface``, a file such as STL. ``inside`` for bodies that are within it.
        ``move`` is a table of ``x``, ``y``, ``z``, and ``turn`` one of ``angle`` in
        **degrees**, ``about`` and in space ``axis``: totals along the path.
        """
        self._named("obstacle", name, table)

    def support(self, on: str, **table: Any) -> None:
        """Displacements prescribed on a surface: ``x``, ``y``, ``z``, ``within``."""
        self._listed("support", on, table)

    def symmetry(self, on: str) -> None:
        """A plane surface at which the body goes on mirrored."""
        self._listed("symmetry", on, {})

    def spring(self, on: str, **table: Any) -> None:
        """Springs per area: ``stiffness``, or ``normal`` and ``tangential``."""
        self._listed("spring", on, table)

    def traction(self, on: str, **table: Any) -> None:
        """A force per area on a surface: ``x``, ``y``, ``z``."""
        self._listed("traction", on, table)

    def pressure(self, on: str, value: Any, **table: Any) -> None:
        """A pressure on a surface, positive inwards: a number, or one of `times`."""
        given = dict(value) if isinstance(value, Mapping) else {"value": value}
        self._listed("pressure", on, given | table)

    def body_force(self, on: str, **table: Any) -> None:
        """A force per volume of a body: ``x``, ``y``, ``z``."""
        self._listed("body_force", on, table)

    def strain(self, on: str, **table: Any) -> None:
        """A strain that a body, or ``"body.volume"``, would have if nothing held it.

        ``expansion`` and ``temperature``, or ``tensor`` and its ``amplitude``.
        """
        self._listed("strain", on, table)

    def contact(self, on: str, **table: Any) -> None:
        """Nodes of a surface that may meet something.

        ``mu``, one number or in space two, along ``axis`` and across it; ``plane``, a
        table of ``point`` and ``normal``, or ``against``, an obstacle or the surface of
        another body; ``pairing``, ``"match"`` or for meshes that do not match
        ``"mortar"`` or ``"nodes"``; ``clearance``, a height, or a table of ``height``,
        ``radius`` and ``centre``; ``within``, ranges of coordinates.
        """
        self._listed("contact", on, table)

    def path(
        self,
        *,
        steps: int | None = None,
        parameter: str | None = None,
        automatic: bool | Mapping[str, Any] | None = None,
        **amplitude: Any,
    ) -> None:
        """The load path, from the unloaded bodies.

        Parameters
        ----------
        steps
            Load steps; the length of the tables where it is missing.
        parameter
            The amplitude that load steps are told by.
        automatic
            Whether load steps are divided where it is needed; or how, a table of
            ``first``, ``largest``, ``smallest`` and ``slip``.
        amplitude
            By name, a factor for each load step, or a table of ``wave`` and ``period``.
        """
        settings = {"steps": steps, "parameter": parameter, "automatic": automatic}
        table = _plain(settings)
        if amplitude:
            table["amplitude"] = _plain(amplitude)
        self._table["path"] = table

    def solver(self, **table: Any) -> None:
        """Settings of the contact solver: ``method``, ``tol``, ``max_iterations``."""
        self._table["solver"] = _plain(table)

    def _named(self, kind: str, name: str, table: Mapping[str, Any]) -> None:
        known = self._table.setdefault(kind, {})
        if name in known:
            raise ValueError(f"{kind} {name!r} is there already")
        known[name] = _plain(table)

    def _listed(self, kind: str, on: str, table: Mapping[str, Any]) -> None:
        self._table.setdefault(kind, []).append({"on": on} | _plain(table))

    @property
    def title(self) -> str:
        """As given."""
        return str(self._table.get("title", ""))

    @property
    def scene(self) -> Scene:
        """The checked scene.

        Raises
        ------
        SceneError
            With every mistake found, each with its place; a `ValueError`.
        """
        return checked(self.title, self.to_dict(), folder=self._folder)

    def assemble(self) -> Case:
        """The arrays of this model: ``case.model`` and its load path.

        Raises
        ------
        SceneError
            Mistakes, those that show on the meshes only included.
        """
        scene = self.scene
        return assemble(scene, bodies(scene))

    def check(self) -> list[str]:
        """What a person should look at before solving; it assembles.

        A sentence each, none where nothing is suspicious: nodes that penetrate at the
        start, surfaces that face away from what they may touch or are too far from it,
        friction where supports prescribe the slip, bodies that nothing holds, units that
        seem mixed, loads that do nothing. ``bipot check`` says the same.

        Raises
        ------
        SceneError
            Mistakes, as `assemble`.
        """
        return self.assemble().remarks()

    @property
    def contacts(self) -> Mapping[str, Ints]:
        """Numbers of the contacts on each surface that has some; it assembles."""
        return self.assemble().contacts

    def solve(
        self,
        *,
        method: str | None = None,
        tol: float | None = None,
        max_iterations: int | None = None,
        start: Result | Step | None = None,
        on_step: Callable[[int, Step], object] | None = None,
    ) -> ModelResult:
        """Solve the whole path; the same bits as `bipot run` of the same scene.

        Parameters
        ----------
        method, tol, max_iterations
            Instead of those of `solver`.
        start
            The result of an earlier run of this path that was left off, from a file too:
            it goes on from there, to the bits of one that went through. Of automatic
            steps one of them does.
        on_step
            Called as ``on_step(k, step)`` after each step.

        Raises
        ------
        SceneError
            Mistakes in the model.
        TypeError, ValueError
            A wrong argument, named.
        NoEquilibriumError, FloatingBodyError, NotConvergedError
            As `ContactProblem.solve`, with a `ModelResult` as ``.result``.
        """
        case = self.assemble()
        first = 0
        if isinstance(start, Result):
            first = start._first + len(start)
            count = case.scene.path.count() if case.scene else first
            if first > count and not any(step.s is not None for step in start):
                raise ValueError(
                    f"start has {first} steps, and this path {count}: it is of another"
                )
        elif start is not None and getattr(start, "s", None) is None:
            raise TypeError(
                f"start is a {type(start).__name__}, expected a Result: how many steps "
                "it has tells where the path goes on"
            )
        try:
            result = case.solve(
                method=method,
                tol=tol,
                max_iterations=max_iterations,
                start=start,
                first=first,
                on_step=on_step,
            )
        except BipotError as error:
            # Counted from the start of the whole path.
            error.args = (later(str(error), first),)
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
            f"Model({self.title!r}: {counted(bodies, 'body')}, "
            f"{counted(contacts, 'contact')})"
        )


class Remarks(tuple[str, ...]):
    """Sentences; called, as a list."""

    __slots__ = ()

    def __call__(self) -> list[str]:
        """The same, as a list."""
        return list(self)


class ModelResult(Result):
    """A `Result` that knows the names of its model.

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
        )
        # The same mapping: it is filled further when displacements are asked for.
        self.seconds = result.seconds
        if case.scene is not None:
            told = case.scene.units.model_dump().items()
            self.units = {name: unit for name, unit in told if unit}
        self.case = case
        self._first = first
        self._reviewed: Remarks | None = None

    @property
    def parameter(self) -> Floats:
        """The path parameter at the end of each step, ``(steps,)``."""
        return np.array([self._load(k) for k in range(len(self))], np.float64)

    def _load(self, k: int) -> float:
        return self.case.step_parameter(self._first + k, self.steps[k])

    @property
    def remarks(self) -> Remarks:
        """What a person should look at, those of `Result` and of the answer (`review`)."""
        if self._reviewed is None:
            found = review(self.case.model, self.steps)
            self._reviewed = Remarks((*self._remarks, *found))
        return self._reviewed

    def contacts_of(self, name: str) -> Ints:
        """Numbers of the contacts on a surface ``"body.surface"``, ascending."""
        return self.case.contacts_of(name)

    def contact_force(self, name: str) -> Floats:
        """Force on a body through the contacts on a surface, ``(steps, d)`` [N]."""
        return self.case.contact_force(self, name)

    def support_force(self, name: str) -> Floats:
        """Force of the supports on a surface on their body, ``(steps, d)`` [N]."""
        return self.case.support_force(self, name)


def _seen_from(folder: Path, here: Path, table: dict[str, Any]) -> None:
    """Rename the files of a table, which are seen from ``here``."""

    def seen(file: Any) -> Any:
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


def _plain(value: Any) -> Any:
    """As `tomllib` would have it: tuples and arrays are lists, what is None is missing."""
    if isinstance(value, Mapping):
        return {key: _plain(v) for key, v in value.items() if v is not None}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, list | tuple | range):
        return [_plain(v) for v in value]
    return copy.deepcopy(value)
