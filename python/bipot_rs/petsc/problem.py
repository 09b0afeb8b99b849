"""`ContactProblem` for a stiffness of PETSc: its arguments, checks and load paths."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

import bipot_rs._core as _core
from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.types import (
    Bools,
    Communicator,
    CsrMatrix,
    Floats,
    Ints,
    MatrixLike,
    PetscMat,
    PetscVec,
    Vectors,
)
from bipot_rs._lib.validation import (
    callback,
    csr,
    floats,
    indices,
    integer,
    settings,
)
from bipot_rs.contact.messages.remarks import examine_arrays
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.contact.path.load_path import PathProblem, PathSolver, find_start
from bipot_rs.contact.path.load_steps import Loading, Totals
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.path.prepared import WITHOUT_FACTOR
from bipot_rs.contact.path.step_control import (
    Increments,
    check_increments,
    solve_adaptively,
)
from bipot_rs.contact.results import summary
from bipot_rs.contact.results.latches import Latches
from bipot_rs.contact.results.solution import Step as WholeStep
from bipot_rs.contact.results.state import Start
from bipot_rs.contact.sensitivity.model import PathModel
from bipot_rs.petsc.agreement import check_same, do_together
from bipot_rs.petsc.derivatives import DistributedDerivatives
from bipot_rs.petsc.engine import NO_FRAMES, PetscEngine
from bipot_rs.petsc.library import Library, load
from bipot_rs.petsc.make_engine import Arguments, make_engine
from bipot_rs.petsc.result import Result


class ContactProblem:
    """Bodies, contacts and supports; ``K`` is a matrix of PETSc in parts.

    The problem is that of `bipot_rs.ContactProblem`. All ranks make it together, with the
    same contacts; nothing of the size of ``K`` is ever gathered. Each load step is solved by
    Newton's method on the displacements, with flexible GMRES and GAMG.

    Parameters
    ----------
    K
        Stiffness, ``(n, n)``: a petsc4py Mat in AIJ format, symmetric positive semidefinite,
        with prescribed degrees of freedom as assembled. The ``d`` degrees of freedom of a
        node follow each other on one rank.
    B
        Contact operator, ``(d n_c, n)``, as in `bipot_rs.ContactProblem`: a petsc4py Mat, or
        any sparse format of SciPy, the same on every rank.
    gap, mu, area, points, frame, cohesion, dilatancy
        As in `bipot_rs.ContactProblem`: of all contacts, the same on every rank.
    fixed
        Numbers of the prescribed degrees of freedom in ``K``, all of them on every rank.
    coordinates
        Of the degrees of freedom that this rank owns, ``(own rows, d)``. They give the
        preconditioner the rotations of the bodies. Without them it is slower, and it is not
        checked whether supports and contacts hold every rotation.
    gather
        Number of unknowns up to which the first rank takes all of ``K`` and factors it: the
        preconditioner of small problems, unless the options choose one. The default never
        gathers ``K``.

    Raises
    ------
    TypeError, ValueError
        An argument has the wrong type, shape or value, or differs between ranks, or the
        problem has a form that this engine cannot solve. All ranks raise it.
    ModuleNotFoundError, ImportError
        petsc4py or mpi4py is missing or broken. The message says what to do.

    Notes
    -----
    Options of PETSc have the prefix ``bipot_``: ``-bipot_pc_type hypre``,
    ``-bipot_ksp_monitor``. Those of the factor that replaces a preconditioner that does not
    converge have ``bipot_direct_``, those of the exact solution on an interface between
    bodies ``bipot_interface_``.
    """

    def __init__(
        self,
        K: PetscMat,
        B: PetscMat | MatrixLike,
        *,
        gap: ArrayLike,
        mu: ArrayLike,
        fixed: ArrayLike | None = None,
        coordinates: ArrayLike | None = None,
        area: ArrayLike | None = None,
        points: ArrayLike | None = None,
        frame: ArrayLike | None = None,
        cohesion: ArrayLike | None = None,
        dilatancy: ArrayLike | None = None,
        gather: int = 0,
        _motions: Floats | None = None,
        _latches: tuple[Ints, Floats] | None = None,
    ) -> None:
        began = time.perf_counter()
        library = load()
        K = _take_stiffness(K, library)
        self.comm = K.comm.tompi4py()
        whole = _gather_contact_operator(B, library, self.comm)

        def check() -> Arguments:
            operator = csr("B", whole)
            n = K.getSize()[0]
            if operator.shape[1] != n:
                raise ValueError(
                    f"B has shape {operator.shape}, expected {count_noun(n, 'column')}, as "
                    "many as K has rows"
                )
            if np.size(gap) == 0:
                raise ValueError("gap has no contacts, and engine='petsc' needs some")
            contacts = ContactSet.check(
                operator,
                gap=gap,
                mu=mu,
                cohesion=cohesion,
                dilatancy=dilatancy,
                area=area,
                points=points,
                frame=frame,
            )
            return Arguments(
                contacts,
                indices("fixed", fixed, n),
                _check_coordinates(coordinates, K, contacts.d),
                integer("gather", gather, least=0),
                _motions,
            )

        arguments = do_together(self.comm, check)
        contacts = arguments.contacts
        check_same(
            self.comm,
            B=np.concatenate([part.ravel() for part in contacts.operator.parts]),
            gap=contacts.gap_by_component,
            fixed=arguments.fixed,
            area=contacts.area,
            points=contacts.x,
            frame=contacts.frame,
            gather=np.array(arguments.gather),
            **contacts.law.arrays(),
        )
        if len(set(self.comm.allgather(arguments.coordinates is None))) > 1:
            raise ValueError(
                "coordinates are given on some ranks only, expected on all"
            )
        self._own_contact = contacts.operator.matrix[:, slice(*K.getOwnershipRange())]
        self._engine = make_engine(K, arguments, library)
        latches = None
        if _latches is not None:
            rows = _gather_rows(K, _latches[0] + 1, self.comm)
            whole_vector = partial(_gather_vector, comm=self.comm)
            latches = Latches(*_latches, arguments.fixed, rows, whole_vector)
        self._engines = {b"": self._engine}

        def set_free(free: Bools) -> PetscEngine:
            """The engine for a set of free latches; all of them count in one record."""
            key = free.tobytes() if free.any() else b""
            if latches is not None and key not in self._engines:
                fixed = np.delete(arguments.fixed, latches.at[free])
                made = make_engine(K, arguments._replace(fixed=fixed), library)
                self._engines[key] = replace(made, record=self._engine.record)
            self._engine = self._engines[key]
            return self._engine

        # Vecs pass through the load path as arrays do: it only hands them on.
        self._loading = Loading(
            K.getSize()[0],
            len(arguments.fixed),
            contacts,
            latches=latches,
            read_forces=self._read_loads,  # type: ignore[arg-type]
        )
        remarks = examine_arrays(
            contacts.operator, contacts.gap_by_component, contacts.x
        )
        self._path_problem = PathProblem(
            contacts,
            remarks,
            time.perf_counter() - began,
            make_result=partial(Result, comm=self.comm),
            latches=latches,
            engine_of=set_free,
        )

    def __repr__(self) -> str:
        dofs = count_noun(self._loading.n, "degree") + " of freedom"
        ranks = count_noun(self.comm.size, "rank")
        places = summary.describe_places(*self._loading.contacts.shape)
        return f"ContactProblem({dofs}, {places}, {ranks})"

    @property
    def stats(self) -> Mapping[str, object]:
        """Counts and seconds.

        ``engine`` is ``"petsc"``, ``preconditioner`` what the linear systems use, and
        ``engine_reason`` says if a factor replaced it, and why. ``newton`` and ``krylov`` are
        the iterations in all load paths so far, ``products`` those with ``K``, and
        ``gathers`` the messages with the values of all nodes of the interface, of
        ``bytes_gather`` bytes each.
        """
        solver, contacts = self._engine.solver, self._loading.contacts
        return WITHOUT_FACTOR | {
            "n": self._loading.n,
            "n_contact_dofs": contacts.d * contacts.count,
            "engine": "petsc",
            "engine_reason": solver.replaced or "K is a matrix of PETSc",
            "ranks": self.comm.size,
            "bytes_gather": 8 * len(self._engine.operator.interface.dofs),
            "seconds_condense": self._path_problem.seconds,
            **self._engine.stats,
        }

    def solve(
        self,
        load: Vectors | None = None,
        prescribed: ArrayLike | None = None,
        *,
        tol: float = 1e-10,
        start: Start | None = None,
        on_step: Callable[[int, WholeStep], object] | None = None,
        gap: ArrayLike | MovingGaps | None = None,
        max_iterations: int | None = None,
        max_seconds: float | None = None,
    ) -> Result:
        """Solve a load path step by step, with slip history. All ranks call it.

        Parameters
        ----------
        load
            A Vec with the layout of the rows of ``K``, or a list of them: totals at the end
            of each step; the default is zero.
        prescribed, gap
            As in `bipot_rs.ContactProblem.solve`, the same on every rank; `MovingGaps` are
            refused.
        tol, max_iterations, max_seconds
            As in `bipot_rs.ContactProblem.solve`. The clock of the first rank counts.
        start
            A `Result` or one of its steps to continue from. A step from a file has no
            displacements; the path then takes more iterations.
        on_step
            Called as ``on_step(k, step)`` after each step, on every rank.

        Returns
        -------
        Result
            Arrays of contacts, whole on every rank. ``result[k].displacement`` is a Vec.

        Raises
        ------
        NoEquilibriumError
            Contacts contradict each other.
        NotConvergedError
            A step did not converge; ``.result`` holds the steps before.
        """

        def check() -> tuple[_core.Settings, list[Totals]]:
            checked = self._check_settings(tol, max_iterations, max_seconds, start)
            callback("on_step", on_step)
            if isinstance(gap, MovingGaps):
                raise ValueError(NO_FRAMES)
            steps = self._loading.list_totals(load, prescribed, gap)  # type: ignore[arg-type]
            return checked, steps

        checked, steps = do_together(self.comm, check)
        check_same(
            self.comm,
            prescribed=np.stack([moved for _, moved, _ in steps]),
            gap=None if gap is None else np.asarray(gap),
        )
        path = self._begin_path(checked, start, gap)
        for k, totals in enumerate(steps):
            step = path.advance(*totals)
            if on_step is not None:
                on_step(k, step)
        return cast("Result", path.result())

    def follow(
        self,
        load: Callable[[float], PetscVec],
        prescribed: Callable[[float], ArrayLike],
        *,
        stops: ArrayLike = 1.0,
        first: float | None = None,
        largest: float | None = None,
        smallest: float | None = None,
        slip: float | None = None,
        tol: float = 1e-10,
        max_iterations: int | None = None,
        max_seconds: float | None = None,
        start: Start | None = None,
        on_step: Callable[[int, WholeStep], object] | None = None,
        gap: Callable[[float], ArrayLike] | None = None,
    ) -> Result:
        """Solve a load path in adaptive steps, as `bipot_rs.ContactProblem.follow`.

        Parameters
        ----------
        load, prescribed, gap
            Totals as functions of ``s``: a Vec, values at ``fixed``, and gaps ``(n_c,)`` or
            ``(n_c, d)``. All ranks call them alike.
        stops, first, largest, smallest, slip, start, on_step
            As in `bipot_rs.ContactProblem.follow`.
        tol, max_iterations, max_seconds
            As in `solve`.
        """

        def check() -> tuple[_core.Settings, Increments, Callable[[float], Totals]]:
            checked = self._check_settings(tol, max_iterations, max_seconds, start)
            callback("on_step", on_step)
            callback("gap", gap)
            plan = check_increments(stops, first, largest, smallest, slip)
            end = plan.stops[-1]
            totals = self._loading.make_totals(load, prescribed, gap, end)  # type: ignore[arg-type]
            return checked, plan, totals

        checked, plan, totals = do_together(self.comm, check)
        path = self._begin_path(checked, start, gap)
        result = solve_adaptively(
            path, lambda s: do_together(self.comm, lambda: totals(s)), plan, on_step
        )
        return cast("Result", result)

    def _check_settings(
        self,
        tol: float,
        max_iterations: int | None,
        max_seconds: float | None,
        start: Start | None,
    ) -> _core.Settings:
        """Settings of the solver, after a start with other frames is refused."""
        checked = settings("newton", tol, max_iterations, max_seconds)
        before = find_start(start, self._loading.contacts.shape)
        if before is not None and before.frame is not None:
            raise ValueError(NO_FRAMES)
        return checked

    def _begin_path(
        self,
        checked: _core.Settings,
        start: Start | None,
        gap: ArrayLike | MovingGaps | Callable[[float], object] | None,
    ) -> PathSolver:
        model = PathModel(
            self._own_contact,
            self._engine.fixed,
            self._loading.contacts.gap.shape,
            self._loading.are_by_component(gap),
            latches=self._loading.latches,
        )
        derivatives = DistributedDerivatives(self._engine, model, self._read_vectors)
        return PathSolver(self._engine, self._path_problem, checked, start, derivatives)

    def _read_loads(self, load: Vectors | None) -> list[PetscVec]:
        """The load of each step."""
        if load is None:
            zeros = self._engine.stiffness.createVecLeft()
            zeros.set(0.0)
            return [zeros]
        return self._read_vectors("load", load)

    def _read_vectors(self, what: str, vectors: Vectors) -> list[PetscVec]:
        """The Vec of each step, with its layout and its numbers checked."""
        Vec = self._engine.operator.PETSc.Vec
        rows = self._engine.stiffness.getLocalSize()[0]
        of_steps: list[PetscVec] = (
            [vectors] if isinstance(vectors, Vec) else list(vectors)  # type: ignore[arg-type]
        )
        for k, vector in enumerate(of_steps):
            if not isinstance(vector, Vec):
                raise TypeError(
                    f"{what} of step {k + 1} is a {type(vector).__name__}, expected a Vec "
                    "of petsc4py"
                )
            if vector.getLocalSize() != rows:
                raise ValueError(
                    f"{what} of step {k + 1} has {vector.getLocalSize()} rows on rank "
                    f"{self.comm.rank}, expected {rows}, as K: make it with "
                    "K.createVecLeft()"
                )
            if not np.isfinite(vector.array_r).all():
                raise ValueError(f"{what} of step {k + 1} is not finite")
        return of_steps


def _take_stiffness(K: object, library: Library) -> PetscMat:
    """K in AIJ format."""
    PETSc = library.PETSc
    if not isinstance(K, PETSc.Mat):
        raise TypeError(
            f"K is a {type(K).__name__}, expected a Mat of petsc4py; for other matrices "
            "use bipot_rs.ContactProblem"
        )
    rows, columns = K.getSize()
    if rows != columns:
        raise ValueError(f"K has shape {(rows, columns)}, expected a square matrix")
    if not K.isAssembled():
        raise ValueError("K is not assembled: call K.assemble() first")
    by_rows = "aij" in K.getType() and "b" not in K.getType()
    matrix: PetscMat = K if by_rows else K.convert("aij")
    return matrix


def _gather_contact_operator(B: object, library: Library, comm: Communicator) -> object:
    """B as a matrix of SciPy on every rank, if it is one of PETSc."""
    from scipy.sparse import csr_array, vstack

    if not isinstance(B, library.PETSc.Mat):
        return B
    pointer, column, values = B.getValuesCSR()
    shape = len(pointer) - 1, B.getSize()[1]
    parts = comm.allgather(csr_array((values, column, pointer), shape=shape))
    whole: CsrMatrix = vstack(parts).tocsr()
    return whole


def _gather_rows(K: PetscMat, rows: Ints, comm: Communicator) -> CsrMatrix:
    """Some rows of K on every rank."""
    from scipy.sparse import csr_array, vstack

    (first, last), n = K.getOwnershipRange(), K.getSize()[0]
    ours: dict[int, CsrMatrix] = {}
    for row in rows[(rows >= first) & (rows < last)].tolist():
        column, values = K.getRow(row)
        ours[row] = csr_array((values, column, [0, len(column)]), shape=(1, n))
    everywhere = {row: it for part in comm.allgather(ours) for row, it in part.items()}
    whole: CsrMatrix = vstack([everywhere[row] for row in rows.tolist()]).tocsr()
    return whole


def _gather_vector(vector: PetscVec, comm: Communicator) -> Floats:
    """A Vec as an array on every rank."""
    return np.concatenate(comm.allgather(vector.array_r))


def _check_coordinates(value: ArrayLike | None, K: PetscMat, d: int) -> Floats | None:
    """Coordinates of own degrees of freedom, ``(rows, d)``, the same for each node."""
    first, last = K.getOwnershipRange()
    if first % d or last % d:
        raise ValueError(
            f"K has rows {first} to {last - 1} on rank {K.comm.rank}, expected whole "
            f"nodes: the {d} degrees of freedom of a node follow each other on one rank"
        )
    if value is None:
        return None
    at_rows = floats("coordinates", value, ndim=2)
    if at_rows.shape[0] != last - first or at_rows.shape[1] not in range(d, 4):
        raise ValueError(
            f"coordinates has shape {at_rows.shape}, expected ({last - first}, {d}): one "
            "row for each degree of freedom that this rank owns"
        )
    at = np.ascontiguousarray(at_rows[:, :d])
    nodes = at.reshape(-1, d, d)
    if (nodes != nodes[:, :1]).any():
        raise ValueError(
            f"coordinates differ within {d} degrees of freedom that follow each other, "
            "expected those of a node there, with the same coordinates"
        )
    return at
