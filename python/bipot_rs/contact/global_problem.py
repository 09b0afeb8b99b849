"""`GlobalProblem`: ``M v = H r + f``, condensed to the reactions."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.types import CsrMatrix, Floats, MatrixLike, Record
from bipot_rs._lib.validation import csr, floats, vectors
from bipot_rs.contact import tuning
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.reduced import ReducedProblem
from bipot_rs.contact.results.solution import Solution

# Relative to √|M_ii M_jj|, which does not depend on units. The limit of `ContactProblem`
# is ten times larger, so that it accepts all matrices that are symmetric here.
SYMMETRIC = 1e-11


class GlobalProblem:
    """A contact problem in all degrees of freedom, in the global form of FCLIB.

    The problem is ``M v = H r + f``, ``u = Hᵀ v + w``, with the law (9) between ``u`` and
    ``r``: equations (1) and (2) with ``K = M`` and ``B = Hᵀ``. In dynamics ``v`` is a
    velocity and ``r`` an impulse; the equations are the same.

    Parameters
    ----------
    M
        ``(n, n)``, any sparse format of SciPy, or dense. If it is symmetric to rounding, it
        must be positive semidefinite, and `ContactProblem` condenses it. Otherwise it is
        factored by LU, and the asymmetric ``W = Hᵀ M⁻¹ H`` is used.
    H
        ``(n, d n_c)``: column ``d i + k`` is component ``k`` of contact ``i``.
    f
        Load, ``(n,)``.
    w
        ``u`` at ``v = 0``, ``(n_c, d)``, normal first.
    mu, cohesion, dilatancy
        Friction coefficient, c and β, numbers or ``(n_c,)``, as in `ReducedProblem`: the
        law as it stands, nothing breaks.
    """

    def __init__(
        self,
        M: MatrixLike,
        H: MatrixLike,
        f: ArrayLike,
        w: ArrayLike,
        mu: ArrayLike,
        *,
        cohesion: ArrayLike | None = None,
        dilatancy: ArrayLike | None = None,
    ) -> None:
        mass, contact = csr("M", M), csr("H", H)
        n = mass.shape[0]
        if mass.shape != (n, n):
            raise ValueError(f"M has shape {mass.shape}, expected a square matrix")
        self.w = vectors("w", w)
        contacts, d = self.w.shape
        if contact.shape != (n, d * contacts):
            raise ValueError(
                f"H has shape {contact.shape}, expected {(n, d * contacts)}: as many rows "
                "as M, and one column for each entry of w"
            )
        # As they were given.
        self.M: Any = M
        self.H: Any = H
        self.f = floats("f", f, shape=(n,))
        self.law = ContactLaw.check(
            contacts, d, mu=mu, cohesion=cohesion, dilatancy=dilatancy
        )
        self.mu = self.law.mu
        self._mass, self._contact = mass.matrix, contact.matrix

    @cached_property
    def asymmetry(self) -> float:
        """Largest ``|M_ij - M_ji|`` over ``√|M_ii M_jj|``, independent of units.

        If a diagonal entry is zero, it is relative to the larger of the two entries.
        `ReducedProblem.asymmetry` is relative to the largest entry of ``W`` instead.
        """
        matrix = self._mass
        difference = abs(matrix - matrix.T).tocoo()
        if not difference.nnz:
            return 0.0
        # Two roots: the product of two diagonals may overflow.
        root = np.sqrt(np.abs(matrix.diagonal()))
        scale = root[difference.row] * root[difference.col]
        larger: Any = abs(matrix).maximum(abs(matrix.T)).tocsr()
        at = scale == 0
        scale[at] = np.ravel(larger[difference.row[at], difference.col[at]])
        nonzero = difference.data > 0
        return float((difference.data[nonzero] / scale[nonzero]).max(initial=0.0))

    @property
    def stats(self) -> Record:
        """Counts and seconds of the factorisation, and ``asymmetry``.

        The first use factors the matrix.
        """
        return {"asymmetry": self.asymmetry} | dict(self._condensed.stats)

    @cached_property
    def _condensed(self) -> _Symmetric | _Lu:
        kind = _Symmetric if self.asymmetry <= SYMMETRIC else _Lu
        return kind(self._mass, self._contact, self.f, self.w, self.law)

    @cached_property
    def _reduced(self) -> ReducedProblem:
        return self._condensed.reduced()

    def reduced(self) -> ReducedProblem:
        """The same problem in the reactions (5); the first call makes it.

        Raises
        ------
        ValueError
            ``M`` is symmetric and indefinite, or asymmetric and singular.
        FloatingBodyError
            A motion without energy moves no contact. Other motions without energy, of
            bodies held by contact alone, are in ``rigid`` of the reduced problem.
        MemoryError
            The factor or ``W`` does not fit into memory.
        """
        return self._reduced

    def solve(
        self,
        method: str = "auto",
        tol: float = 1e-10,
        max_iterations: int | None = None,
        max_seconds: float | None = None,
        start: Solution | ArrayLike | None = None,
        *,
        num_threads: int | None = None,
        callback: Callable[[int, float, float], object] | None = None,
    ) -> Solution:
        """Solve as `ReducedProblem.solve`; it also raises the errors of `reduced`.

        `Solution.relative_displacement` is ``u``. `velocity` computes ``v``.
        """
        return self.reduced().solve(
            method,
            tol,
            max_iterations,
            max_seconds,
            start,
            num_threads=num_threads,
            callback=callback,
        )

    def residual(self, r: ArrayLike, a: ArrayLike | None = None) -> float:
        """η of (13) at the reactions ``r (n_c, d)``, as `ReducedProblem.residual`."""
        return self.reduced().residual(r, a)

    def velocity(self, solution: Solution | ArrayLike) -> Floats:
        """``v = M⁻¹ (H r + f)``, ``(n,)``.

        Parameters
        ----------
        solution
            A `Solution`, or reactions ``(n_c, d)``. If contact alone holds a body, a
            `Solution` is needed, because reactions do not determine ``v``.
        """
        given_solution = solution if isinstance(solution, Solution) else None
        r = floats(
            "solution",
            given_solution.reaction if given_solution else solution,
            shape=self.w.shape,
        )
        rigid = given_solution.rigid_motion if given_solution else None
        free = self.reduced().rigid
        count = 0 if free is None else len(free[1])
        amounts = np.empty(0) if rigid is None else rigid
        if len(amounts) != count:
            raise ValueError(
                f"solution has {count_noun(len(amounts), 'rigid motion')}, expected {count}: "
                "contact alone holds a body, so give the Solution and not its reactions"
            )
        return self._condensed.velocity(r, amounts)


class _Factor(Protocol):
    """A factored matrix of SuperLU."""

    def solve(self, right: Floats, which: str = ..., /) -> Floats:
        """Solve with the matrix, or with its transpose, ``"T"``."""


class _Symmetric:
    """A symmetric matrix, condensed by `ContactProblem`."""

    def __init__(
        self, mass: CsrMatrix, contact: CsrMatrix, f: Floats, w: Floats, law: ContactLaw
    ) -> None:
        self._f, self._law = f, law
        try:
            # The law itself, in which nothing breaks, is that of the reduced problem.
            self._problem = ContactProblem(
                mass, contact.T, gap=w, mu=law.mu, dim=w.shape[1] or None
            )
        except ValueError as error:
            # The message calls the matrix K.
            message = re.sub(r"\b(stiffness )?K\b", "M", str(error))
            raise ValueError(message) from None
        self.stats = self._problem.stats

    def reduced(self) -> ReducedProblem:
        made, law = self._problem.reduced(self._f), self._law
        if law.is_coulomb:
            return made
        return ReducedProblem(
            made.W, made.q, law.mu, rigid=made.rigid, **law.without_mu()
        )

    def velocity(self, r: Floats, amounts: Floats) -> Floats:
        state = self._f, np.empty(0), r, amounts
        u: Floats = self._problem.stiffness.core.displacements([state])[0]
        return u


class _Lu:
    """An asymmetric matrix, factored by SuperLU."""

    def __init__(
        self, mass: CsrMatrix, contact: CsrMatrix, f: Floats, w: Floats, law: ContactLaw
    ) -> None:
        from scipy.sparse.linalg import splu

        self._contact, self._f, self._w, self._law = contact, f, w, law
        began = time.perf_counter()
        try:
            self._factor = splu(mass.tocsc())
        except RuntimeError:
            singular = True
        else:
            singular = bool(
                _estimate_condition(mass, self._factor) > 1 / np.finfo(float).eps
            )
        if singular:
            raise ValueError(
                "M is asymmetric and singular to rounding, so that W = Hᵀ M⁻¹ H does not "
                "exist: add supports or masses"
            )
        self.stats = {
            "n": mass.shape[0],
            "nnz_factor": int(self._factor.L.nnz + self._factor.U.nnz),
            "seconds_factor": time.perf_counter() - began,
        }

    def reduced(self) -> ReducedProblem:
        from scipy.sparse import csc_array, csr_array, hstack

        columns, rows = self._contact.tocsc(), self._contact.T.tocsr()
        pieces = []
        for begin in range(0, columns.shape[1], tuning.COLUMNS_TOGETHER):
            right = columns[:, begin : begin + tuning.COLUMNS_TOGETHER].toarray()
            # Sparse: entries between bodies that M does not connect are exactly zero.
            pieces.append(csc_array(rows @ self._factor.solve(right)))
        size = self._w.size
        whole = csr_array(hstack(pieces)) if pieces else csr_array((0, 0))
        W = whole if 4 * whole.nnz <= size**2 else whole.toarray()
        free = rows @ self._factor.solve(self._f)
        q, law = free.reshape(self._w.shape) + self._w, self._law
        return ReducedProblem(W, q, law.mu, rigid=None, **law.without_mu())

    def velocity(self, r: Floats, _: Floats) -> Floats:
        right = self._contact @ r.ravel() + self._f
        return np.asarray(self._factor.solve(right), np.float64)


def _estimate_condition(matrix: CsrMatrix, factor: _Factor) -> float:
    """Estimate ``‖ |M⁻¹| |M| ‖`` in scaled unknowns, independent of units."""
    from scipy.sparse.linalg import LinearOperator, onenormest

    n = matrix.shape[0]
    if n < 2:
        return 1.0
    size = abs(matrix)
    unit = np.sqrt(np.abs(matrix.diagonal()))
    largest = np.sqrt(
        np.maximum(size.max(axis=0).toarray(), size.max(axis=1).toarray())
    )
    unit = np.where(unit > 0, unit, largest.ravel())
    # The row norm of D M⁻¹ G, G = diag(|M| D⁻¹ 1), as the column norm of its transpose.
    rows = size @ (1 / unit)
    operator = LinearOperator(
        (n, n),
        matvec=lambda x: rows * factor.solve(unit * np.ravel(x), "T"),
        rmatvec=lambda x: unit * factor.solve(rows * np.ravel(x)),
        dtype=np.float64,
    )
    return float(onenormest(operator))
