"""From checked arguments to the engine: reads the own rows of K once, and drops the copy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, diags_array

import bipot_rs._core as _core
from bipot_rs._lib.machine import available
from bipot_rs._lib.messages import place
from bipot_rs._lib.types import CsrMatrix, Floats, Ints, PetscMat
from bipot_rs._lib.validation import csr
from bipot_rs.contact.errors import NotIterativeError, describe_contact, with_reason
from bipot_rs.contact.path.choice import forecast_bytes
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.contact.path.springs import Springs
from bipot_rs.petsc import own_rows, tuning
from bipot_rs.petsc.agreement import do_together
from bipot_rs.petsc.bodies import (
    Bodies,
    check_holding,
    find_bodies,
    find_supported,
    hold_by_prescribed,
    orthonormal,
    rigid_motions,
)
from bipot_rs.petsc.engine import Copies, PetscEngine
from bipot_rs.petsc.library import Library
from bipot_rs.petsc.linear import options
from bipot_rs.petsc.linear.preconditioner import (
    ChosenPreconditioner,
    JoinedBodies,
    OneRankFactor,
    Preconditioner,
)
from bipot_rs.petsc.linear.solver import LinearSolver
from bipot_rs.petsc.linear.symmetric_part import SymmetricPart, make_transformation
from bipot_rs.petsc.operator import Operator, SharedPlaces

# Bytes of a factor in the plane for each unknown. It grows as n log n: this is more than enough.
_PLANE_FACTOR = 2000.0


class Arguments(NamedTuple):
    """Checked arguments of a problem, the same on every rank but for the coordinates."""

    contacts: ContactSet  # those of all ranks
    fixed: Ints  # all prescribed degrees of freedom, in the order of the caller
    coordinates: Floats | None  # (own rows, d) or None: of the own degrees of freedom
    gather: int  # number of unknowns up to which the first rank factors all of K
    # (own rows, m) or None: rigid motions, if ties or reference points have others than points.
    motions: Floats | None = None


class _Places(NamedTuple):
    """The places of the interface, and B there."""

    interface: SharedPlaces
    fixed: Ints  # prescribed rows of this rank
    # Number of each place among all prescribed degrees of freedom; their number for a free
    # place.
    position: Ints
    # Columns of B by places, with those of prescribed degrees of freedom.
    contact: CsrMatrix


def make_engine(
    K: PetscMat, given: Arguments, library: Library, copies: Copies | None = None
) -> PetscEngine:
    """Check K, find its bodies and what holds them, and make the engine.

    ``copies``: those that K has already. Contacts without a node of their own get some.
    Raises `ValueError`: K is not finite, not symmetric, or has a negative diagonal.
    Raises `NotIterativeError`: something may move freely.
    """
    comm, d = K.comm.tompi4py(), given.contacts.d
    rows = own_rows.OwnRows.of(K)
    do_together(comm, rows.check_finite)
    do_together(comm, lambda: _check_diagonal(K))
    own_rows.check_symmetry(K, comm)
    places = _number_places(K, given, library)
    interface, fixed, position, contact = places
    outside = rows.outside()
    local = rows.local(outside)
    bring = own_rows.scatter(K, outside, library.PETSc)
    prescribed = np.zeros(rows.count, bool)
    prescribed[fixed] = True
    free = bring(np.where(prescribed, 0.0, 1.0)) > 0
    of_node, count = find_bodies(comm, rows, local, free, d, bring)
    motions = given.motions
    if motions is None:
        motions = rigid_motions(comm, library.MPI, given.coordinates, rows.count, d)
    bodies = Bodies(of_node, count, motions, prescribed)
    holding = hold_by_prescribed(rows, local, bodies, bring, d)
    supported = find_supported(comm, count, holding)
    at_places = interface.gather_own(motions[interface.rows])
    body = np.repeat(of_node, d).astype(float)
    body_of_place = interface.gather_own(body[interface.rows]).astype(np.int64)
    free_contact: CsrMatrix = contact.copy()
    free_contact.data[position[free_contact.indices] < len(given.fixed)] = 0.0
    by_contact = free_contact, at_places, body_of_place
    try:
        loose = check_holding(comm, rows, local, bodies, bring, d, holding, by_contact)
    except NotIterativeError as error:
        raise with_reason(error, str(error), "petsc") from None
    blocks = interface.gather_own(_read_blocks(rows, interface, d))
    del rows, local

    def make_variables() -> _core.ContactVariables:
        try:
            return _core.ContactVariables(
                (contact.indptr, contact.indices, contact.data),
                given.contacts.gap_by_component,
                given.contacts.law,
                position,
                len(given.fixed),
                blocks.reshape(-1, d * d),
                body_of_place[::d].copy(),
                supported.astype(np.int64),
            )
        except NotIterativeError as error:
            x, i = given.contacts.x, error.contact
            where = "" if x is None or i is None else f" at {place(x[i])}"
            reason = error.reason if i is None else describe_contact(error, where)
            raise with_reason(error, reason, "petsc") from None

    try:
        variables = do_together(comm, make_variables)
    except NotIterativeError as error:
        if copies is not None or not error.contacts:
            raise
        about_nodes = error.contacts, body_of_place[::d], blocks
        changed = _copy_sides(K, given, library, places, about_nodes)
        if changed is None:
            raise
        return make_engine(*changed)
    operator = Operator(K, variables, interface, fixed, d, library.PETSc)
    solver = _make_solver(operator, motions, given.gather, loose=loose)
    # Without coordinates it is not known which rotations are soft. A body that contact alone
    # holds may have a motion that nothing resists, and no correction settles.
    soft = not loose and given.coordinates is None
    return PetscEngine(operator, solver, given.fixed, soft, copies=copies)


def _check_diagonal(K: PetscMat) -> None:
    first, _ = K.getOwnershipRange()
    wrong = K.getDiagonal().array_r < 0
    if wrong.any():
        row = first + int(np.argmax(wrong))
        raise ValueError(
            f"stiffness K is indefinite: its diagonal is negative at row {row}; K must be "
            "symmetric positive semidefinite"
        )


def _number_places(K: PetscMat, given: Arguments, library: Library) -> _Places:
    """The places: the degrees of freedom of all nodes that a contact touches."""
    d, matrix = given.contacts.d, given.contacts.operator.matrix
    nodes = np.unique(np.unique(matrix.indices[matrix.data != 0]) // d)
    dofs = (d * nodes[:, None] + np.arange(d)).ravel()
    ranges = np.asarray(K.getOwnershipRanges(), np.int64)
    interface = SharedPlaces(K.comm.tompi4py(), library.MPI, dofs, ranges)
    kept = csr_array(matrix, copy=True)
    kept.eliminate_zeros()
    entries = kept.data, interface.find_places(kept.indices), kept.indptr
    contact = csr_array(entries, shape=(matrix.shape[0], len(dofs)))
    order = np.argsort(given.fixed)
    ranked = given.fixed[order]
    position = np.full(len(dofs), len(ranked))
    if len(ranked):
        at = np.minimum(np.searchsorted(ranked, dofs), len(ranked) - 1)
        there = ranked[at] == dofs
        position[there] = order[at[there]]
    first, last = K.getOwnershipRange()
    own_places = ranked[(ranked >= first) & (ranked < last)] - first
    return _Places(interface, own_places, position, contact)


def _copy_sides(
    K: PetscMat,
    given: Arguments,
    library: Library,
    places: _Places,
    about: tuple[Sequence[int], Ints, Floats],
) -> tuple[PetscMat, Arguments, Library, Copies] | None:
    """The arguments of `make_engine` with copies at some contacts; None if none gets one.

    ``about``: contacts, the body of each node of the interface, and blocks of K there.
    """
    (contacts, body, blocks), d = about, given.contacts.d
    interface, size = places.interface, len(places.interface.dofs)
    numbers = np.arange(size)
    springs, operator = Springs.hold([], 0.0, size, d).with_copies(
        numbers,
        body,
        blocks[numbers, numbers % d],
        places.contact,
        contacts,
        np.flatnonzero(places.position < len(given.fixed)),
    )
    added = d * len(springs.contacts)
    if not added:
        return None
    rows, n, ranges = own_rows.OwnRows.of(K), K.getSize()[0], K.getOwnershipRanges()
    comm = K.comm.tompi4py()
    last = comm.rank == comm.size - 1
    count, total = rows.count + added * last, n + added
    dofs = np.concatenate([interface.dofs, np.arange(n, total)])
    ends = np.append(ranges[:-1], total).astype(np.int64)
    all_places = SharedPlaces(comm, library.MPI, dofs, ends)
    stretched = (springs.rows.T @ diags_array(springs.stiffness) @ springs.rows).tocoo()
    row = dofs[stretched.row] - rows.first
    here = (row >= 0) & (row < count)
    entries = stretched.data[here], (row[here], dofs[stretched.col[here]])
    pointer = np.append(rows.pointer, np.full(count - rows.count, rows.pointer[-1]))
    shape = count, total
    stiffened = csr_array((rows.values, rows.column, pointer), shape=shape)
    stiffened = csr_array(stiffened + csr_array(entries, shape=shape))
    kind = library.PETSc.IntType
    parts = (
        stiffened.indptr.astype(kind),
        stiffened.indices.astype(kind),
        stiffened.data,
    )
    sizes = ((count, total), (count, total))
    matrix = library.PETSc.Mat().createAIJ(sizes, bsize=d, csr=parts, comm=K.comm)
    B = csr_array(
        (operator.data, dofs[operator.indices], operator.indptr),
        shape=(operator.shape[0], total),
    )
    coordinates, motions = given.coordinates, given.motions
    if motions is not None:
        at = interface.gather_own(motions[interface.rows])
        at = np.column_stack([springs.spread(column) for column in at.T])
        motions = np.concatenate([motions, at[size:] if last else at[:0]])
    if coordinates is not None:
        at = interface.gather_own(coordinates[interface.rows])
        at = np.asarray(springs.place_coordinates(at))
        coordinates = np.concatenate([coordinates, at[size:] if last else at[:0]])
    changed = given._replace(
        contacts=replace(given.contacts, operator=csr("B", B)),
        coordinates=coordinates,
        motions=motions,
    )
    return matrix, changed, library, Copies(springs, K, interface, all_places)


def _read_blocks(rows: own_rows.OwnRows, interface: SharedPlaces, d: int) -> Floats:
    """Diagonal blocks of ``K`` at the own places of the interface, a row ``(d,)`` of each."""
    blocks = np.zeros((len(interface.rows), d))
    for k, row in enumerate(interface.rows):
        entries = slice(rows.pointer[row], rows.pointer[row + 1])
        column = rows.column[entries] - rows.first - (row - row % d)
        inside = (column >= 0) & (column < d)
        blocks[k, column[inside]] = rows.values[entries][inside]
    return blocks


def _make_solver(
    operator: Operator, motions: Floats, gather: int, *, loose: bool
) -> LinearSolver:
    """The linear solver with its matrix, which is ``Tᵀ K T`` at first.

    ``motions``: rigid motions at the own degrees of freedom, ``(rows, m)``.
    ``gather``: as in `Arguments`.
    ``loose``: whether contact alone holds a body.
    """
    PETSc, variables, d = operator.PETSc, operator.variables, operator.d
    T = make_transformation(operator)
    # A copy, because a product keeps what it was made of.
    product = operator.K.PtAP(T)
    A = product.copy()
    product.destroy()
    T.destroy()
    A.setBlockSize(d)
    A.setOption(PETSc.Mat.Option.SPD, True)
    A.setNearNullSpace(_make_near_null_space(operator, motions))
    contact = (d * variables.nodes[:, None] + np.arange(d)).ravel()
    part = SymmetricPart(
        A, operator, contact, tuning.LOOSE_BODY_SHIFT if loose else 0.0
    )
    chosen = options.is_of_the_user(PETSc, "pc_type")
    options.set_defaults(PETSc)
    preconditioner: Preconditioner
    if operator.K.getSize()[0] <= gather and not chosen:
        preconditioner = OneRankFactor(part)
    elif variables.join:
        preconditioner = JoinedBodies(operator, part, contact)
    else:
        preconditioner = ChosenPreconditioner(part, options.PREFIX, PETSc)
    return LinearSolver(operator, part, preconditioner, _factor_fits(operator))


def _make_near_null_space(operator: Operator, motions: Floats) -> object:
    """Rigid motions in the variables of the contacts, zero where prescribed."""
    own_motions = motions.copy()
    own_motions[operator.fixed] = 0.0
    interface = operator.interface
    for column in own_motions.T:
        places = interface.gather_own(column[interface.rows])
        operator.variables.to_own_variables(places)
        column[interface.rows] = places[interface.own]
    vectors = [
        operator.make_vector(v) for v in orthonormal(operator.comm, own_motions).T
    ]
    return operator.PETSc.NullSpace().create(vectors=vectors, comm=operator.K.comm)


def _factor_fits(operator: Operator) -> bool:
    """Whether a factor of ``K`` fits into the memory of this machine."""
    n = operator.K.getSize()[0]
    needed = forecast_bytes(n, 0) if operator.d == 3 else _PLANE_FACTOR * n
    free = available()
    return bool(min(operator.comm.allgather(free is None or needed < free)))
