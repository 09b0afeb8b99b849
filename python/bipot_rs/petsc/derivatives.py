"""Derivatives of the load paths of a distributed stiffness, (33) and (34).

Arrays of contacts are whole on every rank. Of vectors of displacements and forces each rank
has the rows that it owns, so that the derivatives of `bipot_rs.contact.sensitivity` serve
here as they are: they only add such vectors and hand them over.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar, cast

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Bools, Floats, Ints, PetscMat, PetscVec, Vectors
from bipot_rs.contact.errors import NotConvergedError
from bipot_rs.contact.results.derivatives import (
    Cotangents,
    DataChange,
    Gradient,
    Tangent,
)
from bipot_rs.contact.results.solution import Step
from bipot_rs.contact.sensitivity.laws import Laws
from bipot_rs.contact.sensitivity.linear import LinearPath
from bipot_rs.contact.sensitivity.model import (
    PathChange,
    PathModel,
    check_changes,
    check_cotangent,
)
from bipot_rs.contact.sensitivity.path_derivatives import Backward, Forward
from bipot_rs.contact.sensitivity.response import (
    KrylovSystem,
    PathResponse,
    Stalled,
    sum_work,
)
from bipot_rs.petsc.agreement import check_same, do_together
from bipot_rs.petsc.engine import PetscEngine
from bipot_rs.petsc.operator import Operator
from bipot_rs.petsc.own_rows import OwnRows, scatter
from bipot_rs.petsc.result import Result

T = TypeVar("T")

# Relative residual of each linear system, and the one that is enough: derivatives have eight
# digits if the contacts multiply it by a thousand.
_WANTED = 1e-12
_ENOUGH = 1e-11


class DistributedResponse(PathResponse):
    """The response of distributed bodies: the unknowns are the displacements of the own rows.

    ``motions``: number of own rows.
    ``diagonal (n_c, d)``: estimate of the diagonal of W.
    """

    def __init__(self, engine: PetscEngine) -> None:
        self._engine, self._operator = engine, engine.operator
        self.motions = engine.operator.K.getLocalSize()[0]
        self.diagonal = engine.operator.variables.diagonal

    def stiffness(self) -> PetscMat:
        """The stiffness K, distributed over the ranks."""
        return self._operator.K

    def movable(self) -> Bools:
        """Components that a reaction moves, ``(n_c, d)``."""
        return self.diagonal > 0

    def factor_laws(self, laws: Laws) -> KrylovSystem:
        """The system (33) of these laws.

        Raises `Stalled`: one of them determines nothing.
        """
        core = _core.LinearisedLaws.of(self._operator.variables, *laws.parts)
        if core is None:
            raise Stalled
        shape = len(laws.contacts), laws.by_r.shape[1]
        return KrylovSystem(_IterativeSystem(self._engine, core, shape).solve_row)

    def find_relative_motion(self, _reaction: Floats, rigid: Floats) -> Floats:
        """``R y``, ``(n_c, d)``."""
        y = self._operator.make_vector(rigid)
        return self._operator.variables.moved(self._operator.interface.gather(y))

    def work(self, v: Floats) -> Floats:
        """``Rᵀ v`` of relative displacements, the own rows."""
        force = self._operator.make_zeros()
        places = self._operator.variables.work(np.ascontiguousarray(v))
        self._operator.interface.write(places, force)
        return np.array(force.array_r)

    def free(self, load: Floats, prescribed: Floats) -> tuple[Floats, Floats]:
        """``B_f u_f (n_c, d)`` of prescribed displacements, and forces on the own unknowns."""
        force = self._engine.make_force(self._operator.make_vector(load), prescribed)
        offsets = self._operator.variables.offsets(prescribed)
        return offsets, np.array(force.array_r)

    def displacements(
        self, states: list[tuple[Floats, Floats, Floats, Floats]]
    ) -> Floats:
        """``u`` of unknowns and prescribed displacements, the own rows."""
        vectors = [
            self._engine.make_displacement(self._operator.make_vector(y), moved)
            for _, moved, _, y in states
        ]
        return np.stack([u.array_r for u in vectors])

    def measure_work(self, steps: Sequence[Step], _fixed: Ints) -> Iterator[float]:
        """Work of loads and prescribed displacements of each step, without cancellation."""
        operator = self._operator
        for step in steps:
            work = sum_work(
                step.load.array_r,  # type: ignore[union-attr]
                step.displacement.array_r,  # type: ignore[attr-defined]
                operator.fixed,
                lambda y: (
                    _multiply(operator, operator.K, operator.make_vector(y)).array_r
                ),
            )
            yield float(operator.comm.allreduce(work))


@dataclass(frozen=True)
class _IterativeSystem:
    """A system (33) for a Krylov solve."""

    engine: PetscEngine
    core: _core.LinearisedLaws
    # Number of laws, and of components of each.
    shape: tuple[int, int]

    def solve_row(self, right: Floats, transposed: bool) -> Floats:
        """``dr`` of the contacts and ``dy`` of the own rows."""
        if transposed:
            return self._solve_backward(right)
        return self._solve_forward(right)

    def _split_right_side(self, right: Floats) -> tuple[Floats, PetscVec]:
        """Right sides of the laws, and those of the rows."""
        laws = math.prod(self.shape)
        at_contacts = np.ascontiguousarray(right[:laws].reshape(self.shape))
        return at_contacts, self.engine.operator.make_vector(right[laws:])

    def _solve_forward(self, right: Floats) -> Floats:
        s, g = self._split_right_side(right)
        core, operator = self.core, self.engine.operator
        gather = operator.interface.gather
        at_places = gather(g)
        tangent, s = core.aim(s, at_places)
        dy = self._iterate(tangent, operator.make_right_side(tangent, g))
        operator.set_known(tangent, dy)
        moved = gather(operator.multiply(dy))
        dr = core.reactions(s, at_places, gather(dy), moved)
        return np.concatenate([dr.ravel(), dy.array_r])

    def _solve_backward(self, right: Floats) -> Floats:
        rho, e = self._split_right_side(right)
        core, operator = self.core, self.engine.operator
        interface, tangent = operator.interface, core.tangent
        places = interface.gather(e)
        pulled = core.pulled(rho, places)
        interface.write(places, e)
        b = operator.make_zeros()
        interface.write(pulled, b)
        e.axpy(1.0, operator.multiply(b))
        places = interface.gather(e)
        cleared, left = e.copy(), places.copy()
        tangent.clear(left)
        interface.write(left, cleared)
        z = self._iterate(tangent, cleared, transposed=True)
        u, at = z.copy(), interface.gather(z)
        turned = at.copy()
        tangent.pull(turned)
        interface.write(turned, u)
        moved = interface.gather(operator.multiply(u))
        w = core.multipliers(rho, places, at, moved)
        b.axpy(-1.0, u)
        return np.concatenate([w.ravel(), b.array_r])

    def _iterate(
        self,
        tangent: _core.ContactTangent,
        right: PetscVec,
        *,
        transposed: bool = False,
    ) -> PetscVec:
        solver = self.engine.solver
        if not solver.prepare(tangent, self.core.statuses):
            raise Stalled
        x, _, _ = solver.solve(right, _WANTED, transposed=transposed)
        # The residual of the iteration may be smaller than the true one.
        if solver.measure_residual(right, x, transposed=transposed) > _ENOUGH:
            raise Stalled
        return x


@dataclass(frozen=True)
class DistributedDerivatives:
    """The problem of a load path, for `jvp` and `vjp` of its result. All ranks call them."""

    engine: PetscEngine
    model: PathModel  # `contact` has the columns that this rank owns
    # Checks vectors: a Vec or a list of them.
    read_vectors: Callable[[str, Vectors], list[PetscVec]]

    def jvp(self, result: Result, change: DataChange, /) -> Tangent:
        """`Result.jvp`; ``load`` is a Vec or a list of them, ``K`` a Mat."""
        operator = self.engine.operator

        def derive(path: LinearPath) -> Tangent:
            steps, mu, shape = len(path.steps), path.mu, path.shape

            def check() -> PathChange:
                rows_of_steps = self._read_rows("load", change.load, steps)
                data = change._replace(load=rows_of_steps, K=None)
                return check_changes(self.model, steps, mu, shape, data)

            along = do_together(operator.comm, check)
            check_same(operator.comm, prescribed=along.prescribed, gap=along.gap)
            if change.K is not None:
                pulled = np.stack(
                    [
                        -_multiply(operator, change.K, u).array_r
                        for u in result.displacement
                    ]
                )
                whole = pulled if along.load is None else along.load + pulled
                along = replace(along, load=whole)
            forward = Forward(path, along, None)

            return forward.tangent(
                lambda: [operator.make_vector(u) for u in forward.displacement()]  # type: ignore[arg-type, return-value]
            )

        return self._linearise(result, derive)

    def vjp(self, result: Result, given: Cotangents, /) -> Gradient:
        """`Result.vjp`; ``displacement`` is a list of Vecs."""
        comm = self.engine.operator.comm

        def derive(path: LinearPath) -> Gradient:
            steps, (contacts, d) = len(path.steps), path.shape
            stacked = steps, contacts, d

            def check() -> tuple[Floats | None, ...]:
                v = given.relative_displacement
                return (
                    check_cotangent("reaction", given.reaction, stacked),
                    self._read_rows("displacement", given.displacement, steps),
                    check_cotangent("relative_displacement", v, stacked),
                    check_cotangent("slip", given.slip, (steps, contacts, d - 1)),
                )

            r, u, v, slip = do_together(comm, check)
            check_same(comm, reaction=r, relative_displacement=v, slip=slip)
            backward = Backward(result, path, r, u, v, slip)
            adjoint = _DistributedAdjoint(
                self.engine.operator, self.model, result, backward, u
            )
            return backward.gradient(adjoint)  # type: ignore[arg-type]

        return self._linearise(result, derive)

    def _linearise(self, result: Result, derive: Callable[[LinearPath], T]) -> T:
        """What ``derive`` makes of the linearised steps."""
        if self.engine.copies is not None:
            raise ValueError(
                "contacts share nodes, or a support holds one along a direction that is "
                "neither its normal nor a tangent: engine='petsc' has no derivatives then; "
                "use engine='direct' or 'iterative'"
            )
        response = DistributedResponse(self.engine)
        path = LinearPath(self.model, result.steps, result.contacts, response)
        try:
            return derive(path)
        except Stalled:
            raise NotConvergedError(
                "the linear solver of PETSc does not converge for the derivatives; try "
                "other options of PETSc, as -bipot_pc_type hypre, or engine='direct' on "
                "one process",
                result,
            ) from None

    def _read_rows(self, what: str, vectors: object, steps: int) -> Floats | None:
        """Own rows of the Vec of each step, ``(steps, rows)``; one serves all steps."""
        if vectors is None:
            return None
        rows_of_steps = [
            v.array_r for v in self.read_vectors(what, cast("Vectors", vectors))
        ]
        if len(rows_of_steps) not in (1, steps):
            raise ValueError(
                f"{what} has {len(rows_of_steps)} steps, expected one or {steps} as the path"
            )
        return np.stack(
            rows_of_steps * steps if len(rows_of_steps) == 1 else rows_of_steps
        )


def _multiply(operator: Operator, K: PetscMat, u: PetscVec) -> PetscVec:
    product = operator.make_zeros()
    K.mult(u, product)
    return product


@dataclass(frozen=True)
class _DistributedAdjoint:
    """What the parts of a gradient are computed from. All ranks call these methods."""

    operator: Operator
    model: PathModel
    result: Result
    backward: Backward
    # Cotangents of the displacements, own rows.
    displacement: Floats | None

    def load(self) -> list[PetscVec]:
        """Adjoint displacements, a Vec for each step."""
        return [self.operator.make_vector(values) for values in self.backward.load()]

    def prescribed(self, load: Sequence[PetscVec]) -> Floats:
        """Derivatives by prescribed displacements, whole on every rank."""
        operator, gaps = self.operator, self.backward.gap_by_component
        fixed = self.model.fixed
        first, last = operator.K.getOwnershipRange()
        ours = (fixed >= first) & (fixed < last)
        forces = np.zeros((len(gaps), len(fixed)))
        for k, adjoint in enumerate(load):
            force = self.model.contact.T @ gaps[k].ravel()
            if self.displacement is not None:
                force = force + self.displacement[k]
            force = force - _multiply(operator, operator.K, adjoint).array_r
            forces[k, ours] = force[fixed[ours] - first]
        whole = np.empty_like(forces)
        operator.comm.Allreduce(forces, whole)
        return whole

    def stiffness(self, load: Sequence[PetscVec]) -> PetscMat:
        """Derivatives by the entries of K, a Mat of its layout and pattern."""
        K, PETSc = self.operator.K, self.operator.PETSc
        rows = OwnRows.of(K)
        outside = rows.outside()
        bring = scatter(K, outside, PETSc)
        at = np.repeat(np.arange(rows.count), np.diff(rows.pointer))
        column = rows.local(outside)
        values = np.zeros(len(column))
        for adjoint, u in zip(load, self.result.displacement, strict=True):
            w, v = bring(adjoint.array_r), bring(u.array_r)
            values -= w[at] * v[column] + v[at] * w[column]
        csr = rows.pointer, rows.column, values / 2
        gradient: PetscMat = PETSc.Mat().createAIJ(K.getSizes(), csr=csr, comm=K.comm)
        gradient.assemble()
        return gradient
