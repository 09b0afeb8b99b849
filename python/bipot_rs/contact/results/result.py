"""A load path: its steps, their arrays stacked, and their files."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, SupportsIndex, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.optional import load_library
from bipot_rs._lib.records import copy_sharing, deepcopy_sharing
from bipot_rs._lib.types import (
    AnyArray,
    Bools,
    Floats,
    Integers,
    Ints,
    MatrixLike,
    OpenRecord,
)
from bipot_rs._lib.validation import integers, one_of
from bipot_rs.contact.law.frames import find_step_frames
from bipot_rs.contact.results import summary, tables
from bipot_rs.contact.results.contact_fields import (
    ContactData,
    find_farthest,
    list_instants,
    make_path_fields,
    measure_distances,
)
from bipot_rs.contact.results.derivatives import (
    LOST,
    Cotangents,
    DataChange,
    Gradient,
    PathDerivatives,
    Tangent,
)
from bipot_rs.contact.results.error_bound import ErrorBound
from bipot_rs.contact.results.solution import Step, recover_displacements
from bipot_rs.contact.results.step_record import make_record
from bipot_rs.files import export, series
from bipot_rs.files.result_mesh import ResultMesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from bipot_rs.contact.results.contact_fields import ContactArrays

# Attributes of a file whose stiffness has a known relative error.
OF_STIFFNESS = ("stiffness_rtol", "rigid_motions_off")


class Result(Sequence[Step]):
    """The steps of a load path; ``result[k]`` is step ``k``, and arrays are stacked.

    Attributes
    ----------
    steps
        The converged steps.
    contacts
        Data of the contacts: ``x`` (also found as ``points``), ``normal``, ``frame``,
        ``area``, ``gap``, ``mu``; ``None`` if not known. Of a model also ``surface``,
        ``surface_names`` and in 3D ``facets``, for pictures: numbers of contacts
        ``(m, k)``, corners first, -1 after the last node. May be set, as
        ``result.contacts["facets"] = pairs.facets``.
    start
        The step that the path started from, ``None`` for the unloaded bodies.
    seconds
        Times ``condense``, ``solve`` and ``recover_displacements`` (of displacements).
    success, message
        Whether the whole path was solved, and a sentence about it.
    remarks
        Warnings, one sentence each: contacts that penetrate at the start, normals that
        point out of their body, coordinates in another order than the degrees of freedom,
        no closed contact, inconsistent units of loads. Some need ``coordinates``.
    units
        Names of the units of ``"length"``, ``"force"`` and ``"stress"``, for labels;
        empty if not known. May be set.
    mesh
        Nodes, cells and degrees of freedom of the bodies; ``None`` if not known, as for a
        problem given as arrays. May be set.
    stiffness_rtol, rigid_motions_off
        Relative error of the entries of K if it was given, and the error of its rigid
        motions before they were restored; else ``None``.
    shape
        ``(n_c, d)``, the numbers of contacts and of their components.
    first_step
        Number of steps of the whole path before these.
    derivatives
        The problem, for `jvp` and `vjp`; ``None`` if it is not available.
    """

    def __init__(
        self,
        steps: Sequence[Step],
        *,
        contacts: ContactArrays,
        shape: tuple[int, int],
        start: Step | None = None,
        seconds: dict[str, float] | None = None,
        success: bool,
        message: str,
        units: Mapping[str, str] | None = None,
        remarks: Sequence[str] = (),
        stiffness_rtol: float | None = None,
        rigid_motions_off: float | None = None,
        first_step: int = 0,
        mesh: ResultMesh | Callable[[], ResultMesh] | None = None,
        path_parameters: Sequence[float] | None = None,
        derivatives: PathDerivatives[Result] | None = None,
    ) -> None:
        self.steps = tuple(steps)
        self.contacts = ContactData(contacts)
        self.shape = shape
        self.start = start
        # Not a copy: the load path adds the time of displacements that are computed later.
        self.seconds = (
            {"condense": 0.0, "solve": 0.0, "recover": 0.0}
            if seconds is None
            else seconds
        )
        self.success = success
        self.message = message
        self.units = dict(units or {})
        self._remarks = tuple(remarks)
        self.stiffness_rtol = stiffness_rtol
        self.rigid_motions_off = rigid_motions_off
        self.first_step = first_step
        self._mesh = mesh
        self._path_parameters = path_parameters
        self.derivatives = derivatives

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"derivatives": None}

    def __copy__(self) -> Self:
        return copy_sharing(self)

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return deepcopy_sharing(self, memo, ("derivatives", "_comm"))

    @property
    def mesh(self) -> ResultMesh | None:
        """Nodes, cells and degrees of freedom of the bodies."""
        if callable(self._mesh):
            self._mesh = self._mesh()
        return self._mesh

    @mesh.setter
    def mesh(self, mesh: ResultMesh | None) -> None:
        self._mesh = mesh

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings to look at, one sentence each."""
        if self.stiffness_rtol is None:
            return self._remarks
        off = self.rigid_motions_off or 0.0
        digits = (
            f"the entries of K have a relative error of {self.stiffness_rtol:g}, and the "
            f"results are not more exact; its rigid motions had an error of {off:.1e} and "
            "were restored"
        )
        return (*self._remarks, digits)

    def __len__(self) -> int:
        return len(self.steps)

    @overload
    def __getitem__(self, k: SupportsIndex) -> Step: ...
    @overload
    def __getitem__(self, k: slice) -> tuple[Step, ...]: ...
    def __getitem__(self, k: SupportsIndex | slice) -> Step | tuple[Step, ...]:
        return self.steps[k]

    def __repr__(self) -> str:
        contacts = len(self.status[-1]) if self.steps else 0
        return (
            f"Result({count_noun(len(self), 'step')}, {count_noun(contacts, 'contact')}, "
            f"{self.message})"
        )

    def _summarise(self) -> summary.Summary:
        title = f"Result: {self.message}"
        times = ", ".join(
            f"{k} {summary.format_seconds(v)}" for k, v in self.seconds.items()
        )
        where = summary.describe_places(*self.shape)
        if not self.steps:
            return title, [("contacts", where), ("cost", times)]
        last, x = self[-1], self.contacts.get("x")
        frame, ratio = self.contacts.get("frame"), 0.0
        if frame is not None:
            frame = find_step_frames(last, frame)
        if x is not None and len(x):
            ratio = find_farthest(self, measure_distances(x), np.arange(len(x)))[2]
        lost = f"friction dissipated {self.dissipation.sum():.5g} in total"
        far = (
            f", contacts slid by up to {ratio:.2g} times their distance from each other"
        )
        forces = f"at the end {summary.describe_forces(last.reaction, frame)}"
        surfaces = tables.describe_surfaces(last, self.contacts)
        worst = max(self, key=lambda step: step.residual)
        iterations = count_noun(sum(step.iterations for step in self), "iteration")
        work = f"{sum(step.work for step in self):.4g} products with W"
        rows = [
            (
                "contacts",
                f"{where}, at the end {summary.describe_statuses(last.status)}",
            ),
            *(surfaces or [("forces", forces)]),
            ("path", lost + (far if ratio > 1 else "")),
            ("residual", f"at most {worst.residual:.2g}, limit {worst.tolerance:.2g}"),
            ("cost", f"{iterations}, {work}: {times}"),
        ]
        if self.stiffness_rtol is not None:
            rows.append(("stiffness", f"relative error {self.stiffness_rtol:g}"))
        return title, [*rows, *(("remark", remark) for remark in self.remarks)]

    def __str__(self) -> str:
        return summary.format_text(self._summarise())

    def _repr_html_(self) -> str:
        return summary.format_html(self._summarise())

    def _stack(
        self, name: str, empty: tuple[int, ...], dtype: type = np.float64
    ) -> NDArray[Any]:
        if not self.steps:
            return np.empty(empty, dtype)
        return np.stack([np.asarray(getattr(step, name), dtype) for step in self.steps])

    @property
    def reaction(self) -> Floats:
        """Nodal contact forces, ``(steps, n_c, d)``."""
        return self._stack("reaction", (0, *self.shape))

    @property
    def traction(self) -> Floats | None:
        """``reaction / area``, ``(steps, n_c, d)``; ``None`` without areas."""
        if self.contacts.get("area") is None:
            return None
        return self._stack("traction", (0, *self.shape))

    @property
    def pressure(self) -> Floats:
        """Normal part of `traction`, ``(steps, n_c)``; a `ValueError` without areas."""
        self._require("area")
        return self._stack("pressure", (0, self.shape[0]))

    @property
    def shear_traction(self) -> Floats:
        """Tangential part of `traction`, ``(steps, n_c, d - 1)``; needs areas as well."""
        self._require("area")
        contacts, d = self.shape
        return self._stack("shear_traction", (0, contacts, max(d - 1, 0)))

    @property
    def points(self) -> Floats:
        """Coordinates of the contacts, ``(n_c, d)``; a `ValueError` if not known."""
        return self._require("points")

    def _require(self, name: str) -> Floats:
        """An array of the contacts, which must be known."""
        array: Floats | None = self.contacts.get(name)
        if array is None:
            what = "areas" if name == "area" else "coordinates"
            raise ValueError(
                f"the {what} of the contacts are not known: give {name}= to ContactProblem "
                f'or solve, or set result.contacts["{name}"]'
            )
        return array

    @property
    def relative_displacement(self) -> Floats:
        """Total relative displacement ``B u + gap``, ``(steps, n_c, d)``."""
        return self._stack("relative_displacement", (0, *self.shape))

    @property
    def slip(self) -> Floats:
        """Slip increment of each step, ``(steps, n_c, d - 1)``."""
        contacts, d = self.shape
        return self._stack("slip", (0, contacts, max(d - 1, 0)))

    @property
    def status(self) -> NDArray[np.int8]:
        """`Status` of each contact, ``(steps, n_c)``."""
        return self._stack("status", (0, self.shape[0]), np.int8)

    @property
    def broken(self) -> Bools:
        """Contacts that have lost their cohesion, ``(steps, n_c)``; none without cohesion."""
        none = np.zeros(self.shape[0], np.bool_)
        rows = [none if step.broken is None else step.broken for step in self.steps]
        return np.stack(rows) if rows else np.empty((0, self.shape[0]), np.bool_)

    @property
    def displacement(self) -> Floats:
        """Displacement of all degrees of freedom, ``(steps, n)``, computed on first use."""
        recover_displacements(self.steps)
        return self._stack("displacement", (0, 0))

    @property
    def dissipation(self) -> Floats:
        """`Step.dissipation`, energy dissipated by friction in each step, ``(steps,)``."""
        return self._stack("dissipation", (0,))

    @property
    def resultant(self) -> Floats:
        """Sum of the contact forces on the bodies with the contacts, ``(steps, d)``.

        Components are global if the frames of the contacts are known. Otherwise they are
        ``(n, t1[, t2])``, and the sum is a force only if all contacts have the same frame.
        """
        return self.resultants(np.zeros(self.shape[0], np.int64))[:, 0]

    def resultants(self, group: Integers) -> Floats:
        """`resultant` of each group of contacts, ``(steps, groups, d)``.

        Parameters
        ----------
        group
            Number of the group of each contact, ``(n_c,)`` integers from 0, such as
            ``fem.Assembly.group``.

        Raises
        ------
        TypeError, ValueError
            ``group`` has the wrong type, shape or values.
        """
        number = integers("group", group)
        contacts = self.shape[0]
        if number.shape != (contacts,):
            raise ValueError(f"group has shape {number.shape}, expected ({contacts},)")
        if (number < 0).any():
            raise ValueError(
                f"group of contact {int(np.argmax(number < 0))} is {number.min()}, "
                "expected it from 0"
            )
        force, frame = self.reaction, self.contacts.get("frame")
        if frame is not None and self.steps:
            every = np.stack([find_step_frames(step, frame) for step in self.steps])
            force = np.einsum("sck,sckd->scd", force, every)
        # Without contacts there is one group, whose sum is zero.
        groups = range(int(number.max(initial=0)) + 1)
        return np.stack([force[:, number == g].sum(axis=1) for g in groups], axis=1)

    @property
    def work(self) -> Floats:
        """Cost of each step in products with ``W``, ``(steps,)``."""
        return self._stack("work", (0,))

    @property
    def s(self) -> Floats | None:
        """Path parameter of each adaptive step, ``(steps,)``; ``None`` for other steps."""
        if not self.steps or any(step.s is None for step in self.steps):
            return None
        return self._stack("s", (0,))

    @property
    def error(self) -> tuple[ErrorBound, ...]:
        """`Solution.error` of each step, computed on first use."""
        return tuple(step.error for step in self.steps)

    @property
    def residual(self) -> Floats:
        """η of each step, ``(steps,)``."""
        return self._stack("residual", (0,))

    @property
    def iterations(self) -> Ints:
        """Iterations of each step, ``(steps,)``."""
        return self._stack("iterations", (0,), np.int64)

    @property
    def converged(self) -> Bools:
        """Whether each step converged, ``(steps,)``."""
        return self._stack("converged", (0,), np.bool_)

    def jvp(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        gap: ArrayLike | None = None,
        mu: ArrayLike | None = None,
        *,
        K: MatrixLike | None = None,
        cohesion: ArrayLike | None = None,
        dilatancy: ArrayLike | None = None,
    ) -> Tangent:
        """Exact derivatives of the whole path in a direction of its data (33).

        Each argument is a change of the quantity of that name, shaped as in
        `ContactProblem`: the default is zero. A single row is the change in all steps.
        ``K`` is a symmetric change of the stiffness, ``(n, n)``, sparse or dense. The state
        of ``start`` does not change, and the same contacts break. Each step costs one
        factorisation of the system of its closed contacts; ``K`` is not factored again. The
        result keeps these factors for further derivatives if they need at most 256 MiB.

        If contacts are on a border between two statuses (`Tangent.one_sided`), the result
        is the directional derivative there: it is not linear in the direction.

        A result of the iterative engine is differentiated without a factor: each step costs
        one linear solve with its preconditioner, and each contact on a border ``d`` more.
        If that does not converge, the direct engine replaces it.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the problem of the result is not available: it was read
            from a file or came from another process. With ``loads=`` there is no factor,
            and only ``gap`` and ``mu`` may change.
        NotDifferentiableError
            The derivative does not exist or is not unique: reactions are not determined,
            or several changes of statuses fit the direction.
        MemoryError
            The system of a step does not fit into memory; or the linear solver of the
            iterative engine does not converge, and the factor of the direct one does not fit.

        Examples
        --------
        A point on two springs of 1000 N/m is pressed onto a wall by 10 N, pulled along it
        by 5 N, and slips. With μ its friction force changes by -10 N, and its slip by the
        opposite force over the stiffness:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> problem = bp.ContactProblem(1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3)
        >>> tangent = problem.solve([-10.0, 5.0]).jvp(mu=1.0)
        >>> tangent.reaction[0, 0].round(9), tangent.slip[0, 0].round(9)
        (array([  0., -10.]), array([-0.01]))
        """
        change = DataChange(load, prescribed, gap, mu, K, cohesion, dilatancy)
        return self._differentiable().jvp(self, change)

    def vjp(
        self,
        reaction: ArrayLike | None = None,
        displacement: ArrayLike | None = None,
        relative_displacement: ArrayLike | None = None,
        slip: ArrayLike | None = None,
    ) -> Gradient:
        """Exact gradient, through the whole path, of a number that depends on it (34).

        Parameters
        ----------
        reaction, displacement, relative_displacement, slip
            Derivatives of the number by the quantity of that name, shaped as in `Result`;
            the default is zero. For a path of one step, that step may be left out of the
            shape.

        Returns
        -------
        Gradient
            Derivatives of the number by ``load``, ``prescribed``, ``gap``, ``mu`` and
            ``K``. It costs one factorisation of the system of the closed contacts for each
            step; ``K`` is not factored again.

        Raises
        ------
        TypeError, ValueError, NotDifferentiableError, MemoryError
            As `jvp`.

        Examples
        --------
        The friction force of a sliding point, -μ r_n, and its derivatives:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> problem = bp.ContactProblem(1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3)
        >>> gradient = problem.solve([-10.0, 5.0]).vjp(reaction=[[0.0, 1.0]])
        >>> gradient.mu.round(9), gradient.load.round(9)
        (array([-10.]), array([[0.3, 0. ]]))
        """
        cotangents = Cotangents(reaction, displacement, relative_displacement, slip)
        return self._differentiable().vjp(self, cotangents)

    def _differentiable(self) -> PathDerivatives[Result]:
        if not self.steps:
            raise ValueError(
                f"the result has no steps to differentiate: {self.message}"
            )
        if self.derivatives is None:
            raise ValueError(LOST)
        turned = [k for k, step in enumerate(self.steps) if step.frame is not None]
        if turned:
            raise ValueError(
                f"load step {turned[0] + 1} has frames of its own, because an obstacle turns, "
                "or is curved and moves: derivatives need the same frames in all steps"
            )
        return self.derivatives

    def save(
        self, path: str | os.PathLike[str], *, displacements: bool | None = None
    ) -> None:
        """Write the result to an HDF5 file, which `load_result` reads.

        Parameters
        ----------
        path
            File to write or to replace.
        displacements
            Whether to compute missing displacements ``(n,)`` first, with one solve for
            each step. The default is to compute them if the problem keeps its factor
            (not with ``loads=``) and if they fit into memory. Known displacements are
            always written. Displacements that are not in the file are lost.

        Raises
        ------
        OSError
            The file cannot be written. An earlier file of that name is intact.
        ValueError
            ``displacements=True``, and the problem of a step is not available.
        """
        if displacements is None:
            self._recover()
        elif displacements:
            recover_displacements(self.steps)
            for step in self.steps:
                _ = step.displacement  # raises if the problem is not available
        export.write_result(
            path,
            self.contacts,
            [
                make_record(step, self.path_parameter(k))
                for k, step in enumerate(self.steps)
            ],
            complete=self.success,
            attributes={
                "message": self.message,
                "first_step": self.first_step,
                "remarks": json.dumps(self._remarks),
            }
            | {f"seconds_{name}": value for name, value in self.seconds.items()}
            | {f"unit_{name}": unit for name, unit in self.units.items()}
            | {
                name: value
                for name in OF_STIFFNESS
                if (value := getattr(self, name)) is not None
            },
            fields=self._fields(),
            mesh=self.mesh,
            units=self.units,
        )

    def _recover(self) -> None:
        """Compute missing displacements of problems that keep their factor, if they fit."""
        ready = [
            step
            for step in self.steps
            if step.recovery is not None and step.recovery.has_factor()
        ]
        with suppress(MemoryError):
            recover_displacements(ready)

    def path_parameter(self, k: int) -> float:
        """Path parameter of step ``k`` in files; its time if no scene has another."""
        if self._path_parameters is not None:
            return self._path_parameters[k]
        return list_instants(self.steps[k : k + 1], first=self.first_step + k)[0][
            "load"
        ]

    def instants(self) -> list[dict[str, float]]:
        """``load``, the path parameter in files, and ``time`` of each step.

        ``time`` is the number of the step from 1, its place `Step.s` on an adaptive path,
        or the number of its cycle.
        """
        parameters = [self.path_parameter(k) for k in range(len(self.steps))]
        return list_instants(self.steps, parameters, self.first_step)

    def _fields(self) -> Callable[[int], dict[str, AnyArray | float]]:
        """Fields of the contacts in a file, by the index of a step."""
        return make_path_fields(self.steps, self.contacts, self.instants(), self.mesh)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the contacts as a PVD series of points for ParaView.

        The fields are those of ``contact.pvd`` of a run and of ``/fields`` of `save`:
        ``force``, ``traction``, ``slip`` and ``normal`` along global axes, if the frames
        are known; ``reaction_local``, ``slip_local`` and ``relative_displacement_local`` in
        components ``(n, t1[, t2])``; ``pressure``, ``gap``, ``status``.

        Raises
        ------
        ValueError
            The coordinates of the contacts are not known, or the name does not end in
            ``.pvd``.
        OSError
            A file cannot be written.
        """
        index = series.check_index(path)
        x = self.points
        if self.mesh is not None:
            self._recover()
        fields = self._fields()
        series.write_series(
            index, x, None, map(fields, range(len(self.steps))), units=self.units
        )

    def plot(self, kind: str | None = None, **options: object) -> Axes:
        """Draw a picture by its name, see `bipot_rs.plots.plot`.

        Parameters
        ----------
        kind
            Name of the picture, as ``bipot plot --kind``: ``"slip"``, ``"deformed"``,
            ``"pressure_map"``, …. Default: ``"tractions"`` in 2D, in 3D ``"pressure_map"``,
            or ``"pressure_3d"`` if the surface is not flat.
        options
            Arguments of the function of the picture, such as ``step``, ``where``, ``ax``.

        Returns
        -------
        matplotlib.axes.Axes
            ``result.plot().figure.savefig("a.png")`` writes the picture.

        Raises
        ------
        ModuleNotFoundError
            matplotlib is not installed.
        TypeError, ValueError
            A wrong argument; the message names it.
        """
        from bipot_rs import plots

        return plots.plot(self, kind, **options)

    def animate(
        self,
        path: str | os.PathLike[str],
        kind: str | None = None,
        *,
        steps: ArrayLike | None = None,
        frames_per_second: float = 4.0,
        dpi: float = 100.0,
        **options: object,
    ) -> Path:
        """Write a GIF with one frame for each load step, see `bipot_rs.plots.animate`.

        All frames have the same scales. Arguments as there; those of `plot` are ``kind``
        and ``options``.
        """
        from bipot_rs import plots

        shown: OpenRecord = {"steps": steps, **options}
        written: Path = plots.animate(
            self, path, kind, frames_per_second=frames_per_second, dpi=dpi, **shown
        )
        return written

    def to_xarray(self) -> Any:
        """The arrays of the contacts as an ``xarray.Dataset``, which needs xarray.

        Dimensions are ``step``, ``contact``, ``component`` (``"n"``, ``"t1"``, ``"t2"``) and
        ``tangent``; ``load`` and ``time`` belong to each step, ``x``, ``y``, ``z``, ``area``
        and ``mu`` to each contact, if known. Variables are ``reaction``, ``traction``,
        ``relative_displacement``, ``slip``, ``status``, ``residual``, ``iterations`` and
        ``converged``.

        Raises
        ------
        ModuleNotFoundError
            xarray is not installed.
        """
        every: tuple[str, ...] = ("step", "contact", "component")
        dims = dict.fromkeys(("reaction", "traction", "relative_displacement"), every)
        dims |= {"slip": ("step", "contact", "tangent"), "status": every[:2]}
        dims |= dict.fromkeys(("residual", "iterations", "converged"), every[:1])
        arrays = {name: (axes, getattr(self, name)) for name, axes in dims.items()}
        x, instants = self.contacts.get("x"), self.instants()
        of_contacts = {name: self.contacts.get(name) for name in ("area", "mu")}
        of_contacts |= {} if x is None else dict(zip("xyz", x.T, strict=False))
        coordinates = {
            name: (every[1], a) for name, a in of_contacts.items() if np.ndim(a) == 1
        }
        coordinates |= {
            name: (every[0], [instant[name] for instant in instants])
            for name in ("load", "time")
        }
        local = ["n", "t1", "t2"][: self.shape[1]]
        return load_library("xarray", extra="", need="datasets").Dataset(
            {name: pair for name, pair in arrays.items() if pair[1] is not None},
            {**coordinates, "component": local, "tangent": local[1:]},
        )

    def table(self, rows: str = "steps") -> Any:
        """The numbers of the path as a table: a pandas ``DataFrame`` if pandas is installed.

        Otherwise it is a structured array of NumPy with the same columns: in both
        ``table["residual"]`` is a column.

        Parameters
        ----------
        rows
            ``"steps"``: a row for each load step. Columns are those of ``steps.csv`` of the
            command line: ``step`` from 0, ``load``, the load parameter, which is ``step +
            1`` for a path of arrays; the numbers of contacts ``open``, ``slip`` and
            ``stick``, with cohesion also ``broken``; ``normal_force``, ``tangential_force``
            and ``friction_used`` (NaN if nothing presses), for several surfaces followed by
            ``of body.surface``, if the frames of the contacts are known; ``moment_x``,
            ``moment_y`` and ``moment_z`` of the contact forces about the origin and, of a flat
            surface in 3D, ``torque`` about its normal through its centre; ``residual``,
            ``iterations``, ``seconds``; with wear ``cycle``, ``worn_volume`` and
            ``largest_depth``.

            ``"contacts"``: a row for each contact in each step. Columns are ``step``,
            ``contact``, ``surface``, ``x``, ``y``, ``z``, ``area``, ``mu``, ``status``
            (``"open"``, ``"slip"`` or ``"stick"``), and components ``_n``, ``_t1``, ``_t2``
            of ``reaction``, ``traction``, ``relative_displacement`` and ``slip``, as in
            `Step`; with cohesion ``broken``, with wear ``wear``. Columns of unknown data are
            left out.

        Raises
        ------
        ValueError
            ``rows`` is neither of these.
        """
        one_of("rows", rows, ("steps", "contacts"))
        if rows == "contacts":
            return tables.make_frame(tables.list_contacts(self.steps, self.contacts))
        parameters = [self.path_parameter(k) for k in range(len(self.steps))]
        return tables.make_frame(
            tables.list_steps(self.steps, parameters, self.contacts)
        )
