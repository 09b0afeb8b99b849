"""Derivatives of the load paths of a distributed stiffness, (33) and (34).

Arrays of contacts are whole on every rank. Of vectors of displacements and forces each rank
has the rows that it owns, so that the derivatives of `bipot_rs.contact.sensitivity` serve
here as they are: they only add such vectors and hand them over.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Bools, Communicator, Floats, PetscMat, PetscVec, Vectors
from bipot_rs.contact.errors import NotConvergedError
from bipot_rs.contact.results.derivatives import (
    Cotangents,
    DataChange,
    Gradient,
    Tangent,
)
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.sensitivity.displacements import Stalled
from bipot_rs.contact.sensitivity.gradient import Backward
from bipot_rs.contact.sensitivity.laws import Laws
from bipot_rs.contact.sensitivity.linear_path import LinearPath
from bipot_rs.contact.sensitivity.model import (
    PathModel,
    check_changes,
    check_cotangent,
    reshape_gap_gradient,
)
from bipot_rs.contact.sensitivity.tangent import Forward
from bipot_rs.petsc.agreement import agreed, same
from bipot_rs.petsc.engine import PetscEngine
from bipot_rs.petsc.own_rows import OwnRows, scatter

T = TypeVar("T")

# Relative residual of each linear system, and the one that is enough.
_WANTED = 1e-12
_ENOUGH = 1e-11


class Response:
    """The response of distributed bodies: the unknowns are the displacements of the own rows.

    Attributes
    ----------
    motions
        Number of own rows.
    diagonal : (n_c, d)
        Estimate of the diagonal of W.
    """

    whole = True

    def __init__(self, engine: PetscEngine) -> None:
        self.engine = engine
        self.motions = engine.operator.K.getLocalSize()[0]
        self.diagonal = engine.operator.variables.diagonal

    def stiffness(self) -> PetscMat:
        """K."""
        return self.engine.operator.K

    def movable(self) -> Bools:
        """Components that a reaction moves, ``(n_c, d)``."""
        return self.diagonal > 0

    def factored(self, laws: Laws) -> _Iterated:
        """The system (33) of these laws.

        Raises
        ------
        Stalled
            One of them determines nothing.
        """
        d = laws.by_r.shape[1]
        by_r, by_v = laws.by_r.reshape(-1, d), laws.by_v.reshape(-1, d)
        variables = self.engine.operator.variables
        core = _core.LinearisedLaws.of(variables, laws.contacts, by_r, by_v)
        if core is None:
            raise Stalled
        return _Iterated(self.engine, core, (len(laws.contacts), d))

    def moved(self, _reaction: Floats, rigid: Floats) -> Floats:
        """``R y``, ``(n_c, d)``."""
        interface = self.engine.operator.interface
        return self.engine.operator.variables.moved(
            interface.gather(self.engine.operator.make_vector(rigid))
        )

    def work(self, v: Floats) -> Floats:
        """``Rᵀ v`` of relative displacements, the own rows."""
        places = self.engine.operator.variables.work(np.ascontiguousarray(v))
        made = self.engine.operator.make_zeros()
        self.engine.operator.interface.write(places, made)
        return np.array(made.array_r)

    def free(self, load: Floats, prescribed: Floats) -> tuple[Floats, Floats]:
        """``B_f u_f (n_c, d)`` of prescribed displacements, and forces on the own unknowns."""
        force = self.engine.force(self.engine.operator.make_vector(load), prescribed)
        return self.engine.operator.variables.offsets(prescribed), np.array(
            force.array_r
        )

    def displacements(
        self, states: list[tuple[Floats, Floats, Floats, Floats]]
    ) -> Floats:
        """``u`` of unknowns and prescribed displacements, the own rows."""
        own = [
            self.engine.displacement(self.engine.operator.make_vector(y), moved).array_r
            for _, moved, _, y in states
        ]
        return np.stack(own)


@dataclass(frozen=True)
class _Iterated:
    """A system (33) whose right sides take a Krylov solve each."""

    engine: PetscEngine
    core: _core.LinearisedLaws
    # Number of laws, and of components of each.
    shape: tuple[int, int]
    # Not known; the solver does not converge where it is small.
    reciprocal_condition: float = 1.0

    def solve(self, right: Floats, /) -> Floats:
        """``dr`` of the contacts and ``dy`` of the own rows, a row for each right side."""
        return np.stack([self._forward(row) for row in right])

    def solve_transposed(self, right: Floats, /) -> Floats:
        """The same with the transposed matrix."""
        return np.stack([self._transposed(row) for row in right])

    def _parts(self, right: Floats) -> tuple[Floats, PetscVec]:
        """Right sides of the laws, and those of the rows."""
        laws = math.prod(self.shape)
        own = np.ascontiguousarray(right[:laws].reshape(self.shape))
        return own, self.engine.operator.make_vector(right[laws:])

    def _forward(self, right: Floats) -> Floats:
        s, g = self._parts(right)
        core, operator = self.core, self.engine.operator
        at_places = operator.interface.gather(g)
        tangent, s = core.aim(s, at_places)
        dy = self._solved(tangent, operator.make_right_side(tangent, g))
        operator.set_known(tangent, dy)
        moved = operator.interface.gather(operator.multiply(dy))
        dr = core.reactions(s, at_places, operator.interface.gather(dy), moved)
        return np.concatenate([dr.ravel(), dy.array_r])

    def _transposed(self, right: Floats) -> Floats:
        rho, e = self._parts(right)
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
        z = self._solved(tangent, cleared, transposed=True)
        u, at = z.copy(), interface.gather(z)
        turned = at.copy()
        tangent.pull(turned)
        interface.write(turned, u)
        moved = interface.gather(operator.multiply(u))
        w = core.multipliers(rho, places, at, moved)
        b.axpy(-1.0, u)
        return np.concatenate([w.ravel(), b.array_r])

    def _solved(
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
class Derivatives:
    """The problem of a load path, for `jvp` and `vjp` of its result. All ranks call them.

    Attributes
    ----------
    model
        ``contact`` has the columns that this rank owns.
    loads
        Checks loads: a Vec or a list of them.
    """

    engine: PetscEngine
    model: PathModel
    loads: Callable[[str, Vectors], list[PetscVec]]

    @property
    def _comm(self) -> Communicator:
        return self.engine.operator.comm

    def jvp(self, result: Result, change: DataChange, /) -> Tangent:
        """`Result.jvp`; ``load`` is a Vec or a list of them, ``K`` a Mat."""

        def derive(path: LinearPath) -> Tangent:
            steps, mu_now = len(path.steps), path.mu
            shape = path.shape[0], path.shape[1]

            def check() -> Any:
                load = change.load
                own = None if load is None else self._rows("load", load, steps)
                data = change._replace(load=own, K=None)
                return check_changes(self.model, steps, mu_now, shape, data)

            given = agreed(self._comm, check)
            same(self._comm, prescribed=given.prescribed, gap=given.gap)
            if change.K is not None:
                pulled = np.stack(
                    [-self._product(change.K, u).array_r for u in result.displacement]
                )
                whole = pulled if given.load is None else given.load + pulled
                given = replace(given, load=whole)
            found = Forward(path, given, None)
            return Tangent(
                found.reaction,
                found.relative_displacement,
                found.slip,
                path.one_sided,
                lambda: self._vectors(found.displacement()),  # type: ignore[arg-type,return-value]
            )

        return self._derived(result, derive)

    def vjp(self, result: Result, given: Cotangents, /) -> Gradient:
        """`Result.vjp`; ``displacement`` is a list of Vecs."""

        def derive(path: LinearPath) -> Gradient:
            steps, (contacts, d) = len(path.steps), path.shape
            stacked = steps, contacts, d

            def check() -> Any:
                u, v = given.displacement, given.relative_displacement
                return (
                    check_cotangent("reaction", given.reaction, stacked),
                    None if u is None else self._rows("displacement", u, steps),
                    check_cotangent("relative_displacement", v, stacked),
                    check_cotangent("slip", given.slip, (steps, contacts, d - 1)),
                )

            r, u, v, moved = agreed(self._comm, check)
            same(self._comm, reaction=r, relative_displacement=v, slip=moved)
            found = Backward(result, path, r, u, v, moved)
            return Gradient(
                result,
                reshape_gap_gradient(self.model, found.gap_by_component),
                found.gap_by_component,
                found.mu,
                path.one_sided,
                _Adjoint(self, result, found, u),
            )

        return self._derived(result, derive)

    def _derived(self, result: Result, derive: Callable[[LinearPath], T]) -> T:
        """What ``derive`` makes of the linearised steps."""
        path = LinearPath(
            self.model, result.steps, result.contacts, Response(self.engine)
        )
        try:
            return derive(path)
        except Stalled:
            raise NotConvergedError(
                "the linear solver of PETSc does not converge for the derivatives; try "
                "other options of PETSc, as -bipot_pc_type hypre, or engine='direct' on "
                "one process",
                result,
            ) from None

    def _rows(self, what: str, vectors: Any, steps: int) -> Floats:
        """Own rows of the Vec of each step, ``(steps, rows)``; one serves all steps."""
        found = [v.array_r for v in self.loads(what, vectors)]
        if len(found) not in (1, steps):
            raise ValueError(
                f"{what} has {len(found)} steps, expected one or {steps} as the path"
            )
        return np.stack([found[min(k, len(found) - 1)] for k in range(steps)])

    def _product(self, K: PetscMat, u: PetscVec) -> PetscVec:
        made = self.engine.operator.make_zeros()
        K.mult(u, made)
        return made

    def _vectors(self, rows: Floats) -> list[PetscVec]:
        return [self.engine.operator.make_vector(own) for own in rows]


@dataclass(frozen=True)
class _Adjoint:
    """What the parts of a gradient are computed from. All ranks call these methods."""

    problem: Derivatives
    result: Result
    found: Backward
    displacement: Floats | None

    def load(self) -> Any:
        """Adjoint displacements, a Vec for each step."""
        return self.problem._vectors(self.found.load())

    def prescribed(self, load: Any) -> Floats:
        """Derivatives by prescribed displacements, whole on every rank."""
        problem, gaps = self.problem, self.found.gap_by_component
        fixed = problem.model.fixed
        first, last = problem.engine.operator.K.getOwnershipRange()
        ours = (fixed >= first) & (fixed < last)
        own = np.zeros((len(gaps), len(fixed)))
        for k, adjoint in enumerate(load):
            force = problem.model.contact.T @ gaps[k].ravel()
            if self.displacement is not None:
                force = force + self.displacement[k]
            force = force - problem._product(self._K, adjoint).array_r
            own[k, ours] = force[fixed[ours] - first]
        whole = np.empty_like(own)
        problem._comm.Allreduce(own, whole)
        return whole

    def stiffness(self, load: Any) -> Any:
        """Derivatives by the entries of K, a Mat of its layout and pattern."""
        PETSc = self.problem.engine.operator.PETSc
        rows = OwnRows.of(self._K)
        outside = rows.outside()
        bring = scatter(self._K, outside, PETSc)
        at = np.repeat(np.arange(rows.count), np.diff(rows.pointer))
        column = rows.local(outside)
        values = np.zeros(len(column))
        for adjoint, u in zip(load, self.result.displacement, strict=True):
            one, other = bring(adjoint.array_r), bring(u.array_r)
            values -= one[at] * other[column] + other[at] * one[column]
        made = PETSc.Mat().createAIJ(
            self._K.getSizes(),
            csr=(rows.pointer, rows.column, values / 2),
            comm=self._K.comm,
        )
        made.assemble()
        return made

    @property
    def _K(self) -> PetscMat:
        return self.problem.engine.operator.K
