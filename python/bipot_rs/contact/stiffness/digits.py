"""Restores the rigid motions of a stiffness whose entries were written with few digits.

Programs write the entries of K with six to twelve digits. With rounded entries ``K Z`` is
about 1e-8 of its terms instead of 1e-16. The rigid motions ``Z`` are known from the
coordinates of the degrees of freedom. The closest stiffness that leaves them free solves

    min Σ (δ_ij / s_ij)²  with  (K + δ) Z = 0,  δ = δᵀ,

over the entries of K, where ``s_ij`` is the uncertainty of ``k_ij``. The equations
``A S² Aᵀ λ = -K Z`` (A maps δ to δ Z) are solved by LSQR, which is restarted from the
remainder until this is rounding error. They are well conditioned for scaled rows. A direct
factorisation would have far more fill-in than that of K, because they have as many
unknowns for each row as there are rigid motions. A full K, such as that of a
superelement, is treated in the same way: the projection ``P K P``, which has the smallest
sum of squares of δ, would change small entries far from the diagonal by more than their
uncertainty.

Which rigid motions supports within K leave free is the theorem of ``src/bodies`` with the
relative error of the entries in place of ε: a motion is free if each row of ``K z`` is within
that error of its terms. The combinations to examine come from there. Between the error and a
hundred times it, a resistance may be a soft support or wrong digits: this is refused.

Rotations are taken about the point of each row. A row then does not depend on the length
of the body, and slender bodies keep their bending stiffness.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh, lsqr

import bipot_rs._core as _core
from bipot_rs._lib.matrices import rigid_motions
from bipot_rs._lib.messages import body_of
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import Csr, Parts, csr, number
from bipot_rs.contact.tuning import (
    CLEAR_SUPPORT,
    DENSE_DOUBT,
    FIT_AIM,
    FIT_ENTRIES,
    FIT_ITERATIONS,
    FIT_REMAINDER,
    FIT_RUNS,
    LEAST_DIGITS,
    LOST_DIGITS,
    SOFTEST_BODY,
    SPARSE_DOUBT,
    SUPPORTED_ROWS,
)

OFFER = (
    ". If K was written with few digits, give stiffness_rtol and coordinates, which restore "
    "its rigid motions"
)
COORDINATES = ". Give `coordinates`: with them, rigid motions are known exactly"
EPS = float(np.finfo(np.float64).eps)
# Directions of degrees of freedom from here on are rotations; below 0 they are unknown.
ABOUT = 3
# A motion of order one that the body does not have, such as the rotation of a straight line
# about itself, moves it by less: rounding of the coordinates and of their combinations.
NO_MOTION = 1e-10
# Rounding error of an entry in assembly, in ε of the geometric mean of its two diagonals.
# Some entries, whose terms cancel, are only this error.
ASSEMBLY = 8.0
# "Relative error 1e-8" and "eight digits" differ by up to ten: 1.0000000 has the relative
# error 5e-8.
SLACK = 10.0
# A row may be off by `SLACK`, and one entry may have to change for several rows.
MOST_CHANGE = 2.0 * SLACK
# Smallest stiffness_rtol to suggest: twelve digits.
LEAST_OFFER = 1e-12
# An energy below this part of its terms, in ε, is rounding error.
ROUNDED = 64.0
# Largest reduction of one LSQR run in double precision.
LEAST_REDUCTION = 1e-11


# What to do about a motion whose energy is rounding.
_LOST = (
    "the energy of this motion is smaller than the rounding of the entries. Add a support that "
    "holds it, or use less slender cells"
)


def describe_undecided(whose: str, motion: str) -> str:
    """Message of a motion that K has too few digits to call free or held.

    ``motion`` is ``"motion along x at (0, 0, 5)"``.
    """
    return (
        f"{whose}: it cannot be decided whether its {motion} is free. K has too few digits: "
        f"{_LOST}"
    )


def describe_soft(whose: str, motion: str, cells: str = "") -> str:
    """Message of a soft motion that K has too few digits for; a mesh shows that it is not free.

    ``cells`` describes the most slender ones.
    """
    return f"{whose}: K has too few digits for its soft {motion}: {_LOST}{cells}"


@dataclass(frozen=True)
class Digits:
    """Relative error of K, and the coordinates that determine its rigid motions."""

    rtol: float  # relative error of the entries of K
    places: Floats  # coordinates of the degrees of freedom, `(n, 3)`
    d: int  # dimension
    # Names of bodies, each with its first degree of freedom, for messages.
    bodies: Mapping[str, int] | None = None

    def restore(self, given: Csr) -> tuple[Parts, float]:
        """K with free rigid motions, by rows, and the error of the given K.

        The error is the largest ``|K z|`` of a row over the sum of the absolute values of
        its terms. Rows of supports within K are left out, and stay as they are.

        Raises `ValueError`: the error of a row is larger than ``rtol`` explains.
        """
        K = self._make_symmetric(given.matrix)
        if K is None:
            return given.parts, 0.0  # the core raises and names the entry
        direction = _core.dof_directions(self.places, self.d)
        if (direction < 0).any():
            at = int(np.argmax(direction < 0))
            raise ValueError(
                f"stiffness_rtol needs the coordinates of whole nodes: at the point of degree "
                f"of freedom {at} the number of degrees of freedom does not fit, expected "
                f"{self.d} for each node, or {3 if self.d == 2 else 6} with rotations"
            )
        rows = _Rows(K, direction, self)
        off = rows.classify()
        values = rows.restore()
        return csr("K", _make_whole(K.shape, rows.i, rows.j, values)).parts, off

    def amplification(self, parts: Parts, u: Floats) -> float:
        """Relative change of the energy of a displacement by the error of K, over ``rtol``.

        It is ``Σ |e_i| |k_ij| |e_j|`` over ``uᵀ K u``. Rigid motions are exactly free in
        each row: ``e`` is the difference of the displacements in a row from the closest
        rigid motion. The result is some tens for a mesh that resolves bending.
        """
        K = _mirror_triangle(parts)
        K.sort_indices()
        energy = float(u @ (K @ u))
        size = np.abs(u)
        if energy <= ROUNDED * EPS * float(size @ (abs(K) @ size)):
            return 1.0  # a rigid motion to rounding
        direction = _core.dof_directions(self.places, self.d)
        changed, first = 0.0, 0
        while first < len(u):
            end = int(
                np.searchsorted(K.indptr, K.indptr[first] + FIT_ENTRIES, side="right")
            )
            last = min(max(end - 1, first + 1), len(u))
            changed += self._sum_deviations(K, direction, u, first, last)
            first = last
        return max(1.0, changed / energy)

    def _sum_deviations(
        self, K: CsrMatrix, direction: Ints, u: Floats, first: int, last: int
    ) -> float:
        """``Σ |e_i| |k_ij| |e_j|`` over some rows."""
        d = self.d
        pointer = K.indptr[first : last + 1] - K.indptr[first]
        entries = slice(K.indptr[first], K.indptr[last])
        there, weight = K.indices[entries], np.abs(K.data[entries])
        if not len(there):
            return 0.0
        row = np.repeat(np.arange(last - first), np.diff(pointer))
        arm = self.places[there] - self.places[first + row]
        Z = _core.rigid_motions(direction[there], arm, d, 1.0)
        Z[:, d:] /= float(np.abs(arm).max()) or 1.0
        used = np.flatnonzero(np.diff(pointer))
        N = np.zeros((last - first, Z.shape[1], Z.shape[1]))
        N[used] = np.add.reduceat(
            weight[:, None, None] * Z[:, :, None] * Z[:, None, :], pointer[used]
        )
        b = np.zeros(N.shape[:2])
        b[used] = np.add.reduceat((weight * u[there])[:, None] * Z, pointer[used])
        near = np.einsum("rkl,rl->rk", np.linalg.pinv(N, 1e-12, hermitian=True), b)
        e = np.abs(u[there] - np.einsum("ek,ek->e", Z, near[row]))
        deviations = np.zeros(last - first)
        diagonal = there == first + row
        deviations[row[diagonal]] = e[diagonal]
        return float((deviations[row] * weight * e).sum())

    def _make_symmetric(self, given: CsrMatrix) -> CsrMatrix | None:
        """K made exactly symmetric; None if its asymmetry is larger than its error."""
        K = sparse.csr_array(given)
        other = sparse.csr_array(K.T)
        roots = np.sqrt(np.abs(K.diagonal()))
        apart = sparse.coo_array(abs(K - other))
        at = sparse.coo_array(abs(K) + abs(other))
        # The core allows 1e-10 of the diagonal.
        limit = sparse.csr_array(
            (
                SLACK * self.rtol * at.data + 1e-10 * roots[at.row] * roots[at.col],
                (at.row, at.col),
            ),
            shape=K.shape,
        )
        over = sparse.csr_array(apart) - limit
        if over.nnz and float(over.data.max()) > 0:
            return None
        symmetric: CsrMatrix = sparse.csr_array((K + other) / 2)
        return symmetric


def check_digits(
    rtol: object, places: Floats | None, d: int, bodies: Mapping[str, int] | None
) -> Digits:
    """Check ``stiffness_rtol`` of `ContactProblem`."""
    value = number("stiffness_rtol", rtol)
    if not 0 < value <= LEAST_DIGITS:
        raise ValueError(
            f"stiffness_rtol is {value:g}, expected the relative error of the entries of K, "
            f"above 0 and at most {LEAST_DIGITS:g}"
        )
    if places is None:
        raise ValueError(
            "stiffness_rtol needs coordinates: give those of the degrees of freedom, which "
            "determine the rigid motions"
        )
    return Digits(value, places, d, bodies)


class _Rows:
    """Equations ``K Z = 0`` of the rows of K to restore.

    ``i, j, values``: entries of the lower triangle.
    ``uncertain``: uncertainty of each entry, over ``rtol``.
    ``A``: maps entries to ``K Z`` with rotations about the point of each row, ``(n m,
    entries)``.
    ``held``: whether a support within K is in each row, ``(n,)``.
    """

    def __init__(self, K: CsrMatrix, direction: Ints, digits: Digits) -> None:
        low = sparse.coo_array(sparse.tril(K))
        self.i, self.j = low.row.astype(np.int64), low.col.astype(np.int64)
        self.values = low.data
        self.digits, self.direction = digits, direction
        self.n = K.shape[0]
        self.m = 3 * (digits.d - 1)
        roots = np.sqrt(np.abs(K.diagonal()))
        floor = min(ASSEMBLY * EPS / digits.rtol, 1.0)
        size = np.abs(self.values)
        size = size + np.where(size > 0, floor * roots[self.i] * roots[self.j], 0.0)
        self.uncertain = size
        self.A = self._build_operator()
        self.K = K
        self.held = np.zeros(self.n, bool)

    def _build_operator(self) -> CsrMatrix:
        """Build ``A`` for all rows."""
        at, d = self.digits.places, self.digits.d
        apart = np.flatnonzero(self.i != self.j)
        every = np.arange(len(self.i))
        row, column, value = [], [], []
        for entries, of, by in ((every, self.i, self.j), (apart, self.j, self.i)):
            here, there = of[entries], by[entries]
            arm = at[there] - at[here]
            motions = _core.rigid_motions(self.direction[there], arm, d, 1.0)
            entry, k = np.nonzero(motions)
            row.append(here[entry] * self.m + k)
            column.append(entries[entry])
            value.append(motions[entry, k])
        shape = self.n * self.m, len(self.i)
        entries_ = np.concatenate(row), np.concatenate(column)
        A: CsrMatrix = sparse.csr_array((np.concatenate(value), entries_), shape=shape)
        return A

    def classify(self) -> float:
        """Find the rows with supports, and return the largest error of the other rows.

        Raises `ValueError`: neither the error of K nor supports explain ``K Z``.
        """
        forces = (self.A @ self.values).reshape(self.n, self.m)
        share = np.abs(forces) / self._sum_largest_terms(self.uncertain)
        off = share.max(axis=1)
        held = off > SLACK * self.digits.rtol
        used = float(off[~held].max(initial=0.0))
        if not held.any():
            return used
        # A support resists translations. A row that balances for translations but not for
        # rotations has wrong coordinates.
        shifted = share[:, : self.digits.d].max(axis=1) > SLACK * self.digits.rtol
        turned = held & ~shifted & (self.direction < ABOUT)
        if turned.any():
            raise self._refuse_misplaced(turned, off)
        self.held = held
        return max(used, self._leave_supports_out(held, off, forces))

    def _sum_largest_terms(self, sizes: Floats) -> Floats:
        """Sums of the terms of each equation for entries of these sizes, ``(n, m)``.

        Of the translations, and of the rotations, of a row the largest counts: one of them
        may have no terms but entries that are the rounding of others. Never zero.
        """
        terms = (abs(self.A) @ sizes).reshape(self.n, self.m)
        for of in (slice(0, self.digits.d), slice(self.digits.d, self.m)):
            terms[:, of] = terms[:, of].max(axis=1, keepdims=True)
        # Rows with supports have combinations of motions.
        terms[self.held] = SUPPORTED_ROWS * terms[self.held].max(axis=1, keepdims=True)
        return np.where(terms > 0, terms, 1.0)

    def _refuse_misplaced(self, turned: Bools, off: Floats) -> ValueError:
        typical = float(np.median(off[turned]))
        remedy = (
            "The coordinates do not belong to the degrees of freedom of K: check the "
            "numbering and the axes"
        )
        if typical <= SOFTEST_BODY:
            digits = 10.0 ** np.ceil(np.log10(typical))
            remedy = (
                "Give the coordinates with all digits; if K itself was written with fewer "
                f"digits, give stiffness_rtol={digits:.0e}"
            )
        return ValueError(
            f"{int(turned.sum())} of {self.n} rows of K are in balance for translations but "
            f"not for rotations, the first at degree of freedom {int(np.argmax(turned))}: "
            f"their error is larger than stiffness_rtol = {self.digits.rtol:g}, typically by "
            f"{typical:.1e} of their terms. {remedy}"
        )

    def _leave_supports_out(self, held: Bools, off: Floats, forces: Floats) -> float:
        """Remove the rows with supports, except for motions that the supports leave free."""
        at, d, m = self.digits.places, self.digits.d, self.m
        couples = self.values != 0
        label = _core.connected(self.n, self.i[couples], self.j[couples])
        order = np.argsort(label, kind="stable")
        bodies = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
        mixing = []
        identity = np.repeat(~held, m).astype(np.float64)
        used = 0.0
        for dofs in bodies:
            rows = dofs[held[dofs]]
            if not len(rows) or len(dofs) == 1:
                continue
            Z, moved = _motions_of_body(self.direction[dofs], at[dofs], d)
            free, worst = self._find_free(dofs, rows, Z, moved, off, forces)
            used = max(used, worst)
            if not free.shape[1]:
                continue
            turn = self._about(rows, dofs)
            # Row k: free motion k in terms of the motions about the point of the row.
            block = np.zeros((len(rows), m, m))
            block[:, : free.shape[1]] = np.einsum("kf,rkl->rfl", free, turn)
            row, k, other_motion = np.nonzero(block)
            mixing.append(
                (
                    rows[row] * m + k,
                    rows[row] * m + other_motion,
                    block[row, k, other_motion],
                )
            )
        every = np.arange(self.n * m)
        mixing.append((every, every, identity))
        row, column, value = (
            np.concatenate(part) for part in zip(*mixing, strict=True)
        )
        left = sparse.csr_array((value, (row, column)), shape=(self.n * m,) * 2)
        left.eliminate_zeros()
        self.A = sparse.csr_array(left @ self.A)
        return used

    def _about(self, rows: Ints, dofs: Ints) -> Floats:
        """Rigid motions about the centre of the body, by those about the point of each row."""
        at, d, m = self.digits.places, self.digits.d, self.m
        centre = at[dofs].mean(axis=0)
        arm = at[rows] - centre
        reach = float(np.abs((at[dofs] - centre)[:, :d]).max(initial=0.0)) or 1.0
        turn = np.zeros((len(rows), m, m))
        turn[:, range(m), range(m)] = np.where(np.arange(m) < d, 1.0, 1.0 / reach)
        turn[:, :, :d] = rigid_motions(arm[:, :d], reach).swapaxes(1, 2)
        return turn

    def _find_free(
        self,
        dofs: Ints,
        rows: Ints,
        Z: Floats,
        moved: Floats,
        off: Floats,
        forces: Floats,
    ) -> tuple[Floats, float]:
        """Rigid motions that supports leave free, ``(m, free)``, and their largest error."""
        rtol = self.digits.rtol
        of_body = np.zeros(self.n)
        of_body[dofs] = moved
        size = abs(self.K[rows]) @ of_body
        turn = self._about(rows, dofs)
        resisted = np.einsum("rkl,rl->rk", turn, forces[rows]) / size[:, None]
        combined = _core.combine_motions(resisted)
        amount = np.abs(Z @ combined.T).max(axis=0)
        resistance = np.abs(resisted @ combined.T).max(axis=0)
        none = amount <= NO_MOTION
        resistance = np.where(none, 0.0, resistance / np.where(none, 1.0, amount))
        free = resistance <= SLACK * rtol
        held = resistance[~free]
        # With most rows in balance the rigid motions are right: supports are in few rows.
        # Otherwise the whole matrix is checked.
        many = len(rows) > (1 - _core.least_balanced) * len(dofs)
        if len(held) and held.min() < CLEAR_SUPPORT * rtol:
            raise self._refuse_resistance(dofs, off, float(held.min()))
        # A resisted motion is a combination of the motions of the held degrees of freedom,
        # which the coordinates give; K gives it with its error.
        resisted = combined[~free]
        absent = _core.free_motions(Z[np.isin(dofs, rows)], NO_MOTION)
        left = _core.free_motions(resisted - resisted @ absent.T @ absent).T
        if len(held) and many and not self._is_stiff(dofs, Z @ left, off):
            raise self._refuse_resistance(dofs, off, float(held.min()))
        return left, float(resistance[free].max(initial=0.0))

    def _is_stiff(self, dofs: Ints, free: Floats, off: Floats) -> bool:
        """Whether K holds a body for any errors of its entries within the tolerance."""
        # Including prescribed degrees of freedom: K itself must resist.
        if len(dofs) > DENSE_DOUBT:
            return False
        K = self.K[dofs][:, dofs].toarray()
        typical = float(np.median(off[dofs]))
        places, d = self.digits.places[dofs], self.digits.d
        _, moved = _motions_of_body(self.direction[dofs], places, d)
        doubt = max(self.digits.rtol, min(typical, SOFTEST_BODY))
        shift = doubt * (np.abs(K) @ moved) / moved
        scale = np.abs(np.diag(K)).mean()
        try:
            np.linalg.cholesky(K - np.diag(shift) + scale * (free @ free.T))
        except np.linalg.LinAlgError:
            return False
        return True

    def _refuse_resistance(self, dofs: Ints, off: Floats, least: float) -> ValueError:
        rtol = self.digits.rtol
        over = off[dofs] > SLACK * rtol
        typical = float(np.median(off[dofs][over]))
        body = body_of(int(dofs[0]), self.digits.bodies)
        digits = 10.0 ** np.ceil(np.log10(typical))
        remedy = "Check that coordinates have the numbering of K"
        if digits <= LEAST_DIGITS:
            remedy = (
                f"If K was written with fewer digits, give stiffness_rtol={digits:.0e}"
            )
        return ValueError(
            f"{body}: K resists the rigid motions that coordinates describe: the error of "
            f"{int(over.sum())} of {len(dofs)} rows of K Z is larger than stiffness_rtol = "
            f"{rtol:g}, typically by {typical:.1e} of their terms, and the resistance to the "
            f"softest motion is {least:.1e}. {remedy}; if K contains supports or springs, "
            "leave stiffness_rtol out"
        )

    def restore(self) -> Floats:
        """Entries of the lower triangle closest to those of K with ``A`` times them zero.

        Raises `ValueError`: no change within the uncertainty of the stored entries is enough.
        """
        # Entries off the diagonal count twice.
        scale = self.uncertain * np.where(self.i == self.j, 1.0, np.sqrt(0.5))
        G = self.A.copy()
        G.data *= scale[G.indices]
        norm = np.sqrt(np.add.reduceat(np.append(G.data**2, 0.0), G.indptr[:-1]))
        norm[np.diff(G.indptr) == 0] = 0.0
        # Empty rows have no equation.
        inverse = np.divide(1.0, norm, out=np.zeros_like(norm), where=norm > 0)
        G.data *= np.repeat(inverse, np.diff(G.indptr))
        sizes = np.abs(self.values)
        largest = EPS * self._sum_largest_terms(sizes)
        # The aim are the terms of each motion alone: bending of flat cells depends on them.
        terms = EPS * (abs(self.A) @ sizes).reshape(self.n, self.m)
        aim = np.where((terms > 0) & ~self.held[:, None], terms, largest).ravel()
        values = self.values.copy()
        worst, best = np.inf, values
        for _ in range(FIT_RUNS):
            left = self.A @ values
            now = float((np.abs(left) / aim).max(initial=0.0))
            if now >= worst:
                break
            worst, best = now, values
            if worst <= FIT_AIM:
                break
            reduction = max(0.2 / worst, LEAST_REDUCTION)
            values = values - scale * _find_least_change(G, inverse * left, reduction)
        remainder = float((np.abs(self.A @ best) / largest.ravel()).max(initial=0.0))
        if remainder > FIT_REMAINDER:
            raise ValueError(
                "stiffness_rtol: no change of the stored entries of K restores its rigid "
                f"motions, {remainder * EPS:.1e} of the terms of a row remain. Store all "
                "entries of the elements in K, also small ones"
            )
        change = np.abs(best - self.values) / np.where(scale > 0, self.uncertain, 1.0)
        if change.max(initial=0.0) > MOST_CHANGE * self.digits.rtol:
            raise self._refuse_change(int(np.argmax(change)), best)
        return np.asarray(best, np.float64)

    def _refuse_change(self, entry: int, restored: Floats) -> ValueError:
        value = self.values[entry]
        change = abs(restored[entry] / value - 1.0)
        digits = 10.0 ** np.ceil(np.log10(change))
        remedy = (
            f"give stiffness_rtol={digits:.0e}"
            if digits <= LEAST_DIGITS
            else "correct it"
        )
        return ValueError(
            f"stiffness_rtol: to restore the rigid motions of K, its entry ({self.i[entry]}, "
            f"{self.j[entry]}) = {value:.6g} must change by {change:.1e} of itself, more than "
            f"stiffness_rtol = {self.digits.rtol:g} explains. If it was written with fewer "
            f"digits, {remedy}; if small entries of the elements were left out, store them too"
        )


def _motions_of_body(direction: Ints, places: Floats, d: int) -> tuple[Floats, Floats]:
    """Rigid motions of one body, and the largest motion of each degree of freedom.

    The columns, ``(n, m)``, are translations by 1, and rotations about the centre that move
    a node by about 1 at most. Motions that a body does not have, such as the rotation of a
    straight line about itself, are zero or depend on other columns.
    """
    arm = places - places.mean(axis=0)
    reach = float(np.abs(arm[:, :d]).max(initial=0.0)) or 1.0
    Z = _core.rigid_motions(direction, arm, d, reach)
    return Z, np.where(direction < ABOUT, 1.0, 1.0 / reach)


def _find_least_change(G: CsrMatrix, left: Floats, reduction: float) -> Floats:
    """Smallest x with ``G x = left`` up to the factor ``reduction``, by LSQR.

    ``G Gᵀ``, which has a unit diagonal, is singular, because ``Zᵀ K Z`` is symmetric for
    any K. The equations are consistent up to rounding errors, which least squares ignore.
    """
    turned = G.T
    product = LinearOperator(
        G.shape, matvec=lambda x: G @ x, rmatvec=lambda y: turned @ y, dtype=np.float64
    )
    solution = lsqr(
        product,
        left,
        atol=LEAST_REDUCTION,
        btol=reduction,
        conlim=0,
        iter_lim=FIT_ITERATIONS,
    )
    return np.asarray(solution[0], np.float64)


def _make_whole(shape: tuple[int, int], i: Ints, j: Ints, values: Floats) -> CsrMatrix:
    """Symmetric matrix with this lower triangle, by rows."""
    apart = i != j
    row = np.concatenate([i, j[apart]])
    column = np.concatenate([j, i[apart]])
    data = np.concatenate([values, values[apart]])
    whole: CsrMatrix = sparse.csr_array((data, (row, column)), shape=shape)
    return whole


def _mirror_triangle(parts: Parts) -> CsrMatrix:
    """Symmetric matrix from the lower triangle of a matrix by rows."""
    pointers, columns, values = parts
    n = len(pointers) - 1
    low = sparse.tril(sparse.csr_array((values, columns, pointers), shape=(n, n)))
    low = sparse.csr_array(low)
    whole: CsrMatrix = sparse.csr_array(low + sparse.csr_array(sparse.triu(low.T, 1)))
    return whole


def describe_indefinite(
    parts: Parts, fixed: Ints, dof: int, digits: Digits | None
) -> str:
    """Describe the most negative eigenvalue of K, and whether its digits explain it.

    ``parts``: K by rows; the lower triangle is used.
    ``fixed``: prescribed degrees of freedom.
    ``dof``: a degree of freedom of the body.
    ``digits``: the error of K that the caller gave, or None.
    """
    K = _mirror_triangle(parts)
    free = np.setdiff1d(np.arange(K.shape[0]), fixed)
    K = K[free][:, free]
    row, column = K.nonzero()
    label = _core.connected(len(free), row, column)
    at = int(np.searchsorted(free, dof))
    body = (
        np.flatnonzero(label == label[at])
        if free[at : at + 1] == dof
        else np.arange(len(free))
    )
    least = _find_least_eigenvalue(K[body][:, body])
    if least is None:
        return f"; no eigenvalue is below {-LOST_DIGITS:.0e} of the largest" + _offer(
            LOST_DIGITS, digits
        )
    if not least < 0:
        return ""
    extent = f"; its most negative eigenvalue is {least:.1e} of the largest"
    return extent + (_offer(-least, digits) if least >= -LOST_DIGITS else "")


def _offer(negative: float, digits: Digits | None) -> str:
    if digits is not None:
        return (
            f". Its rigid motions were restored, but with stiffness_rtol = {digits.rtol:g} "
            "its softest motion has no correct digit: write K with more digits"
        )
    rtol = max(10.0 ** np.ceil(np.log10(negative)), LEAST_OFFER)
    return (
        f". If K was written with few digits, give stiffness_rtol={rtol:.0e}, the relative "
        "error of its entries, and coordinates, those of its degrees of freedom, which "
        "restore its rigid motions"
    )


def _find_least_eigenvalue(K: CsrMatrix) -> float | None:
    """Smallest eigenvalue over the largest; None if it is small and too expensive."""
    n = K.shape[0]
    if not K.count_nonzero():
        return 0.0
    if n <= DENSE_DOUBT:
        # Scaled, so that squares of entries do not overflow.
        values = np.linalg.eigvalsh(K.toarray() / np.abs(K.data).max())
        return float(values[0] / np.abs(values).max())
    largest = abs(float(eigsh(K, k=1, which="LM", tol=1e-3, v0=np.ones(n))[0][0]))
    try:
        rough = eigsh(K, k=1, which="SA", tol=1e-2, maxiter=20, v0=np.ones(n))[0]
    except ArpackNoConvergence as error:
        rough = error.eigenvalues
    if len(rough) and rough[0] < -LOST_DIGITS * largest:
        return float(rough[0] / largest)
    if n > SPARSE_DOUBT:
        return None
    near = -LOST_DIGITS * largest
    eigenvalue = eigsh(K, k=1, sigma=near, which="LA", v0=np.ones(n))[0]
    return float(eigenvalue[0] / largest)
