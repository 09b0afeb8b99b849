"""`ContactProblem` for a stiffness of PETSc: its arguments, checks and load paths."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

import bipot_rs._core as _core
from bipot_rs._lib.memory import available
from bipot_rs._lib.messages import counted
from bipot_rs._lib.types import (
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
    Settings,
    callback,
    csr,
    floats,
    gaps,
    indices,
    integer,
    iteration_limit,
    rows_of_steps,
    settings,
    together,
)
from bipot_rs.contact.messages.remarks import examine_arrays
from bipot_rs.contact.path.choice import direct_bytes
from bipot_rs.contact.path.contacts import Contacts
from bipot_rs.contact.path.load_path import PathProblem, PathSolver, find_start
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.path.prepared import WITHOUT_FACTOR
from bipot_rs.contact.path.step_control import (
    Increments,
    check_increments,
    solve_adaptively,
)
from bipot_rs.contact.results import summary
from bipot_rs.contact.results.result import Result as WholeResult
from bipot_rs.contact.results.solution import Step as WholeStep
from bipot_rs.contact.sensitivity.model import PathModel
from bipot_rs.petsc import components, options, own_rows, supports
from bipot_rs.petsc.agreement import agreed, same
from bipot_rs.petsc.derivatives import Derivatives
from bipot_rs.petsc.engine import NO_FRAMES, PetscEngine
from bipot_rs.petsc.interface import Interface
from bipot_rs.petsc.joined import Joined
from bipot_rs.petsc.library import Library, load
from bipot_rs.petsc.linear_solver import LinearSolver
from bipot_rs.petsc.motions import orthonormal, rigid_motions
from bipot_rs.petsc.one_rank import OneRank
from bipot_rs.petsc.operator import Operator
from bipot_rs.petsc.result import Result, Step
from bipot_rs.petsc.symmetric_part import SHIFT, SymmetricPart, transformation

# Load, prescribed displacements and gaps at the end of a step.
Totals = tuple[PetscVec, Floats, Floats | None]


class _Given(NamedTuple):
    """Checked arguments, the same on every rank but for the coordinates."""

    contacts: Contacts
    fixed: Ints
    coordinates: Floats | None


@dataclass(frozen=True)
class _Parts:
    """What is known of the nodes of the interface."""

    interface: Interface
    # Prescribed rows of this rank, and the number of each place among all prescribed ones.
    fixed_rows: Ints
    position: Ints
    # Columns of B by places, with those of prescribed degrees of freedom.
    contact: CsrMatrix


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
    gap, mu, area, points, frame
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
        gather: int = 0,
    ) -> None:
        began = time.perf_counter()
        library = load()
        self._PETSc, self._MPI = library
        K = _matrix(K, library)
        self.comm = K.comm.tompi4py()
        whole = _whole(B, library, self.comm)

        def check() -> _Given:
            integer("gather", gather, least=0)
            return self._checked(
                K, whole, gap, mu, fixed, coordinates, area, points, frame
            )

        given = agreed(self.comm, check)
        contacts = given.contacts
        same(
            self.comm,
            B=np.concatenate([part.ravel() for part in contacts.operator.parts]),
            gap=contacts.gap_by_component,
            mu=contacts.mu,
            fixed=given.fixed,
            area=contacts.area,
            points=contacts.x,
            gather=np.array(gather),
        )
        if len(set(self.comm.allgather(given.coordinates is None))) > 1:
            raise ValueError(
                "coordinates are given on some ranks only, expected on all"
            )
        n = K.getSize()[0]
        self._fixed = given.fixed
        self._shape = n, *contacts.shape
        self._own_contact = contacts.operator.matrix[:, slice(*K.getOwnershipRange())]
        self._rows = K.getLocalSize()[0]
        self._gathered = n <= gather
        self._engine = self._made(K, given)
        remarks = examine_arrays(
            contacts.operator, contacts.gap_by_component, contacts.x
        )
        self._seconds = time.perf_counter() - began
        self._path_problem = PathProblem(
            contacts,
            remarks,
            self._seconds,
            make_step=Step,
            make_result=partial(Result, comm=self.comm),
        )

    def _checked(
        self,
        K: PetscMat,
        B: object,
        gap: ArrayLike,
        mu: ArrayLike,
        fixed: ArrayLike | None,
        coordinates: ArrayLike | None,
        area: ArrayLike | None,
        points: ArrayLike | None,
        frame: ArrayLike | None,
    ) -> _Given:
        """Check the arguments on this rank."""
        contact = csr("B", B)
        n = K.getSize()[0]
        if contact.shape[1] != n:
            raise ValueError(
                f"B has shape {contact.shape}, expected {counted(n, 'column')}, as many "
                "as K has rows"
            )
        if np.size(gap) == 0:
            raise ValueError("gap has no contacts, and engine='petsc' needs some")
        contacts = Contacts.check(
            contact, gap=gap, mu=mu, area=area, points=points, frame=frame
        )
        d = contacts.d
        first, last = K.getOwnershipRange()
        if first % d or last % d:
            raise ValueError(
                f"K has rows {first} to {last - 1} on rank {self.comm.rank}, expected "
                f"whole nodes: the {d} degrees of freedom of a node follow each other on "
                "one rank"
            )
        held = indices("fixed", fixed, n)
        at = _coordinates(coordinates, last - first, d)
        return _Given(contacts, held, at)

    def _made(self, K: PetscMat, given: _Given) -> PetscEngine:
        """The engine: reads the own rows of ``K`` once, and drops the copy."""
        comm, d = self.comm, given.contacts.d
        rows = own_rows.OwnRows.of(K)
        agreed(comm, rows.check_finite)
        agreed(comm, lambda: _check_diagonal(K))
        own_rows.check_symmetry(K, comm)
        parts = self._places(K, given)
        outside = rows.outside()
        local = rows.local(outside)
        bring = own_rows.scatter(K, outside, self._PETSc)
        prescribed = np.zeros(rows.count, bool)
        prescribed[parts.fixed_rows] = True
        free = bring(np.where(prescribed, 0.0, 1.0)) > 0
        of_node, count = components.bodies(comm, rows, local, free, d, bring)
        motions = rigid_motions(comm, self._MPI, given.coordinates, rows.count, d)
        bodies = supports.Bodies(of_node, count, motions, prescribed)
        holding = supports.prescribed(rows, local, bodies, bring, d)
        held = supports.held(comm, count, holding)
        interface = parts.interface
        at_places = np.column_stack(
            [interface.gather_own(column[interface.rows]) for column in motions.T]
        )
        body = np.repeat(of_node, d).astype(float)
        body_of_place = interface.gather_own(body[interface.rows]).astype(np.int64)
        free_contact = parts.contact.copy()
        free_contact.data[parts.position[free_contact.indices] < len(self._fixed)] = 0.0
        contact = free_contact, at_places, body_of_place
        loose = supports.check(comm, rows, local, bodies, bring, d, holding, contact)
        blocks = self._blocks(rows, interface, d)
        del rows, local
        contact_parts = parts.contact
        variables = agreed(
            comm,
            lambda: _core.ContactVariables(
                (contact_parts.indptr, contact_parts.indices, contact_parts.data),
                given.contacts.gap_by_component,
                given.contacts.mu,
                parts.position,
                len(self._fixed),
                blocks,
                body_of_place[::d].copy(),
                held.astype(np.int64),
            ),
        )
        operator = Operator(K, variables, interface, parts.fixed_rows, self._PETSc)
        solver = self._solver(operator, motions, d, loose)
        return PetscEngine(
            variables, operator, solver, self._fixed, self._shape[1:], self._PETSc
        )

    def _places(self, K: PetscMat, given: _Given) -> _Parts:
        """The interface: all nodes that a contact touches."""
        from scipy.sparse import csr_array

        d, matrix = given.contacts.d, given.contacts.operator.matrix
        used = np.unique(matrix.indices[matrix.data != 0])
        nodes = np.unique(used // d)
        dofs = (d * nodes[:, None] + np.arange(d)).ravel()
        ranges = np.asarray(K.getOwnershipRanges(), np.int64)
        interface = Interface(self.comm, self._MPI, dofs, ranges)
        kept = csr_array(matrix, copy=True)
        kept.eliminate_zeros()
        place = interface.number(kept.indices)
        shape = matrix.shape[0], len(dofs)
        contact = csr_array((kept.data, place, kept.indptr), shape=shape)
        order = np.argsort(given.fixed)
        ranked = given.fixed[order]
        position = np.full(len(dofs), len(ranked))
        if len(ranked):
            at = np.minimum(np.searchsorted(ranked, dofs), len(ranked) - 1)
            there = ranked[at] == dofs
            position[there] = order[at[there]]
        first, last = K.getOwnershipRange()
        ours = given.fixed[(given.fixed >= first) & (given.fixed < last)]
        return _Parts(interface, np.sort(ours) - first, position, contact)

    def _blocks(self, rows: own_rows.OwnRows, interface: Interface, d: int) -> Floats:
        """Diagonal blocks of ``K`` at the nodes of the interface, ``(nodes, d²)``."""
        found = np.zeros((len(interface.rows), d))
        for k, row in enumerate(interface.rows):
            entries = slice(rows.pointer[row], rows.pointer[row + 1])
            column = rows.column[entries] - rows.first - (row - row % d)
            inside = (column >= 0) & (column < d)
            found[k, column[inside]] = rows.values[entries][inside]
        columns = [interface.gather_own(column) for column in found.T]
        return np.column_stack(columns).reshape(-1, d * d)

    def _solver(
        self, operator: Operator, motions: Floats, d: int, loose: bool
    ) -> LinearSolver:
        """The linear solver with its matrix, which is ``Tᵀ K T`` at first."""
        PETSc, interface, variables = (
            self._PETSc,
            operator.interface,
            operator.variables,
        )
        T = transformation(
            operator.K, variables.transformation(), interface, operator.fixed, d, PETSc
        )
        # A copy, because a product keeps what it was made of.
        product = operator.K.PtAP(T)
        A = product.copy()
        product.destroy()
        T.destroy()
        A.setBlockSize(d)
        A.setOption(PETSc.Mat.Option.SPD, True)
        A.setNearNullSpace(self._near_null_space(operator, motions))
        contact = (d * variables.nodes[:, None] + np.arange(d)).ravel()
        part = SymmetricPart(
            A, interface, contact, operator.fixed, d, PETSc, SHIFT if loose else 0.0
        )
        fits = self._factor_fits()
        if self._gathered and not options.are_of_the_user(PETSc, "pc_type"):
            return LinearSolver(operator, part, None, d, PETSc, fits, OneRank(part, d))
        joined = Joined(operator, part, contact, d, PETSc) if variables.join else None
        return LinearSolver(operator, part, joined, d, PETSc, fits)

    def _near_null_space(self, operator: Operator, motions: Floats) -> object:
        """Rigid motions in the variables of the contacts, zero where prescribed."""
        own = motions.copy()
        own[operator.fixed] = 0.0
        interface = operator.interface
        for column in own.T:
            places = interface.gather_own(column[interface.rows])
            operator.variables.to_own_variables(places)
            column[interface.rows] = places[interface.own]
        vectors = []
        for column in orthonormal(self.comm, own).T:
            vectors.append(operator.zeros())
            vectors[-1].array[:] = column
        return self._PETSc.NullSpace().create(vectors=vectors, comm=operator.K.comm)

    def _factor_fits(self) -> bool:
        """Whether a factor of ``K`` fits into the memory of this machine."""
        n, _, d = self._shape
        # In the plane a factor grows as n log n: this is more than enough.
        needed = direct_bytes(n, 0) if d == 3 else 2000.0 * n
        free = available()
        return bool(min(self.comm.allgather(free is None or needed < free)))

    def __repr__(self) -> str:
        n, contacts, d = self._shape
        dofs = counted(n, "degree") + " of freedom"
        ranks = counted(self.comm.size, "rank")
        return f"ContactProblem({dofs}, {summary.places(contacts, d)}, {ranks})"

    @property
    def stats(self) -> Mapping[str, object]:
        """Counts and seconds.

        ``engine`` is ``"petsc"``, ``preconditioner`` what the linear systems use, and
        ``engine_reason`` says if a factor replaced it, and why. ``newton`` and ``krylov`` are
        the iterations in all load paths so far, ``products`` those with ``K``, and
        ``gathers`` the messages with the values of all nodes of the interface, of
        ``bytes_gather`` bytes each.
        """
        n, contacts, d = self._shape
        solver = self._engine.solver
        return WITHOUT_FACTOR | {
            "n": n,
            "n_contact_dofs": d * contacts,
            "engine": "petsc",
            "engine_reason": solver.replaced or "K is a matrix of PETSc",
            "ranks": self.comm.size,
            "bytes_gather": 8 * len(self._engine.operator.interface.dofs),
            "seconds_condense": self._seconds,
            **self._engine.stats,
        }

    def solve(
        self,
        load: Vectors | None = None,
        prescribed: ArrayLike | None = None,
        *,
        tol: float = 1e-10,
        start: WholeResult | WholeStep | None = None,
        on_step: Callable[[int, WholeStep], object] | None = None,
        gap: ArrayLike | MovingGaps | None = None,
        max_iterations: int | None = None,
        max_seconds: float | None = None,
        maxiter: int | None = None,
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
        tol, max_iterations, max_seconds, maxiter
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
        TypeError, ValueError
            An argument is wrong; the message names it.
        NoEquilibriumError
            Contacts contradict each other.
        NotConvergedError
            A step did not converge; ``.result`` holds the steps before.
        """
        contacts, d = self._shape[1:]

        def check() -> tuple[Settings, Sequence[Totals], Floats]:
            limit = iteration_limit(max_iterations, maxiter)
            chosen = settings("newton", tol, limit, max_seconds)
            callback("on_step", on_step)
            before = find_start(start, (contacts, d))
            turned = before is not None and before.frame is not None
            if isinstance(gap, MovingGaps) or turned:
                raise ValueError(NO_FRAMES)
            motions = rows_of_steps("prescribed", prescribed, len(self._fixed))
            steps = together(
                "prescribed",
                list(motions),
                "load",
                self._loads(load),
                lambda u, f: (f, u, None),
            )
            if gap is None:
                return chosen, steps, motions
            offsets = gaps(gap, contacts, d)
            steps = together(
                "gap",
                list(offsets),
                "the load path",
                steps,
                lambda g, asked: (*asked[:2], g),
            )
            return chosen, steps, motions

        chosen, steps, motions = agreed(self.comm, check)
        same(
            self.comm, prescribed=motions, gap=None if gap is None else np.asarray(gap)
        )
        following = self._following(chosen, start, gap)
        for k, asked in enumerate(steps):
            step = following.advance(*asked)  # type: ignore[arg-type]
            if on_step is not None:
                on_step(k, step)
        return cast("Result", following.result())

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
        start: WholeResult | WholeStep | None = None,
        on_step: Callable[[int, WholeStep], object] | None = None,
        gap: Callable[[float], ArrayLike] | None = None,
        maxiter: int | None = None,
    ) -> Result:
        """Solve a load path in adaptive steps, as `bipot_rs.ContactProblem.follow`.

        Parameters
        ----------
        load, prescribed, gap
            Totals as functions of ``s``: a Vec, values at ``fixed``, and gaps ``(n_c,)`` or
            ``(n_c, d)``. All ranks call them alike.
        stops, first, largest, smallest, slip, start, on_step
            As in `bipot_rs.ContactProblem.follow`.
        tol, max_iterations, max_seconds, maxiter
            As in `solve`.
        """
        contacts, d = self._shape[1:]

        def check() -> tuple[Settings, Increments]:
            limit = iteration_limit(max_iterations, maxiter)
            chosen = settings("newton", tol, limit, max_seconds)
            callback("on_step", on_step)
            callback("gap", gap)
            find_start(start, (contacts, d))
            return chosen, check_increments(stops, first, largest, smallest, slip)

        chosen, plan = agreed(self.comm, check)

        def totals(s: float) -> tuple[PetscVec, Floats, Floats | None]:
            force, moved = load(s), prescribed(s)

            def one() -> tuple[PetscVec, Floats, Floats | None]:
                (own,) = self._loads(force)
                (values,) = rows_of_steps("prescribed", moved, len(self._fixed))
                if gap is None:
                    return own, values, None
                return own, values, gaps(gap(s), contacts, d)[0]

            return agreed(self.comm, one)

        following = self._following(chosen, start, gap)
        return cast("Result", solve_adaptively(following, totals, plan, on_step))  # type: ignore[arg-type]

    def _following(
        self, chosen: Settings, start: WholeResult | WholeStep | None, gap: Any
    ) -> PathSolver:
        by_component = None if gap is None else callable(gap) or np.ndim(gap) == 3
        model = PathModel(
            self._own_contact,
            self._fixed,
            self._path_problem.contacts.gap.shape,
            by_component,
        )
        return PathSolver(
            self._engine,
            self._path_problem,
            chosen,
            start,
            Derivatives(self._engine, model, self._vectors),
        )

    def _loads(self, load: Vectors | None) -> list[PetscVec]:
        """The load of each step."""
        if load is None:
            return [self._engine.operator.zeros()]
        return self._vectors("load", load)

    def _vectors(self, what: str, vectors: Vectors) -> list[PetscVec]:
        """The Vec of each step, with its layout and its numbers checked."""
        Vec = self._PETSc.Vec
        found: list[PetscVec] = (
            [vectors] if isinstance(vectors, Vec) else list(vectors)  # type: ignore[arg-type]
        )
        for k, one in enumerate(found):
            if not isinstance(one, Vec):
                raise TypeError(
                    f"{what} of step {k + 1} is a {type(one).__name__}, expected a Vec of "
                    "petsc4py"
                )
            if one.getLocalSize() != self._rows:
                raise ValueError(
                    f"{what} of step {k + 1} has {one.getLocalSize()} rows on rank "
                    f"{self.comm.rank}, expected {self._rows}, as K: make it with "
                    "K.createVecLeft()"
                )
            if not np.isfinite(one.array_r).all():
                raise ValueError(f"{what} of step {k + 1} is not finite")
        return found


def _matrix(K: object, library: Library) -> PetscMat:
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


def _whole(B: object, library: Library, comm: Communicator) -> object:
    """B as a matrix of SciPy on every rank."""
    from scipy.sparse import csr_array, vstack

    if not isinstance(B, library.PETSc.Mat):
        return B
    pointer, column, values = B.getValuesCSR()
    shape = len(pointer) - 1, B.getSize()[1]
    parts = comm.allgather(csr_array((values, column, pointer), shape=shape))
    whole: CsrMatrix = vstack(parts).tocsr()
    return whole


def _check_diagonal(K: PetscMat) -> None:
    first, _ = K.getOwnershipRange()
    wrong = own_rows.negative_diagonal(K)
    if wrong.any():
        row = first + int(np.argmax(wrong))
        raise ValueError(
            f"stiffness K is indefinite: its diagonal is negative at row {row}; K must be "
            "symmetric positive semidefinite"
        )


def _coordinates(value: ArrayLike | None, rows: int, d: int) -> Floats | None:
    """Coordinates of own degrees of freedom, ``(rows, d)``, the same for each node."""
    if value is None:
        return None
    found = floats("coordinates", value, ndim=2)
    if found.shape[0] != rows or found.shape[1] not in range(d, 4):
        raise ValueError(
            f"coordinates has shape {found.shape}, expected ({rows}, {d}): one row for "
            "each degree of freedom that this rank owns"
        )
    at = np.ascontiguousarray(found[:, :d])
    nodes = at.reshape(-1, d, d)
    if (nodes != nodes[:, :1]).any():
        raise ValueError(
            f"coordinates differ within {d} degrees of freedom that follow each other, "
            "expected those of a node there, with the same coordinates"
        )
    return at
