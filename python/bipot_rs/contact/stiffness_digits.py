"""A stiffness that is known to some digits, with its rigid motions restored.

Programs write the entries of K with six to twelve digits. Rounded row by row, K resists
rigid motions a little, or pushes them along: ``K Z`` is some 1e-8 of its terms in place
of rounding. The rigid motions ``Z`` themselves are known from the places of the degrees
of freedom. What is sought is the nearest stiffness that leaves them free,

    min Σ (δ_ij / s_ij)²  with  (K + δ) Z = 0,  δ = δᵀ,

over the entries that K has, ``s_ij`` being what ``k_ij`` is uncertain by. Its equations
``A S² Aᵀ λ = -K Z`` (A takes δ to δ Z) are solved by an iteration (LSQR), which starts
again from what is left until that is rounding. They are well conditioned row by row. A
direct factorisation would fill in far more than that of K, as they have as many unknowns
for each row as there are rigid motions. A full K, such as that of a superelement, is
treated alike: the projection ``P K P``, which is the least change by the sum of squares
of δ alone, would change small entries far from the diagonal by more than what they are
uncertain by.

Rotations are taken about the place of each row: a row then knows nothing of how long the
body is, and slender ones keep their bending.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh, lsqr

from bipot_rs._lib.messages import body_of
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import Csr, Parts, csr, number
from bipot_rs.contact.rigid_geometry import (
    ABOUT,
    UNKNOWN,
    amounts,
    axes_of,
    directions,
    motions,
)

OFFER = (
    ". Where K was written with few digits, stiffness_rtol with coordinates= restores its "
    "rigid motions"
)
EPS = float(np.finfo(np.float64).eps)
# Nothing is written with fewer digits, and elasticity would be lost with rigid motions.
MOST = 1e-3
# What assembly rounds an entry by, in ε of the geometric mean of its two diagonals. Some
# entries are that alone: sums of elements that cancel.
ASSEMBLY = 8.0
# "Right to 1e-8" and "written with eight digits" differ by up to ten: 1.0000000 is known
# to 5e-8 of itself.
SLACK = 10.0
# A support resists by so many times what digits may do, or nobody can tell it from them.
CLEAR = 100.0
# Eigenvalues below this part of the largest are not made by digits that anybody writes,
OF_DIGITS = 1e-5
# and nobody writes more than twelve.
LEAST_OFFER = 1e-12
# Of all rows of a body, the share that must be in balance for the rigid motions to be
# believed without a look at the whole matrix; supports touch few rows.
BELIEVED = 0.25
# Unknowns of a body up to which that look, a dense factorisation, takes seconds.
DENSE = 3000
# The same of a sparse one.
SPARSE = 20_000
# No row of a stiffness is softer than this part of the whole, as far as that look goes.
SOFTEST = 1e-4
# Of restored rows, in ε of the sum of sizes of their terms: what rounding the entries
# leaves of a row is 1, and the sums of a check add as much again.
RESTORED = 16.0
ENOUGH = 4.0
# The same of rows that supports hold, over others.
COMBINED = 8.0
# An energy below this part of its terms, in ε, is rounding.
ROUNDED = 64.0
# Entries of K whose rigid motions are fitted at once: some 60 MB.
BLOCK = 200_000
# Steps of least squares. Meshes of 100 cells across take some 500.
MOST_STEPS = 5000
# What one run of least squares can do in double precision; another goes on from there.
LEAST_REDUCTION = 1e-11


@dataclass(frozen=True)
class Digits:
    """What is known of K beside its entries.

    Attributes
    ----------
    rtol
        Relative error of the entries of K.
    places
        Of the degrees of freedom, ``(n, 3)``.
    d
        Dimension.
    bodies
        Their names, each with its first degree of freedom, for messages.
    """

    rtol: float
    places: Floats
    d: int
    bodies: Mapping[str, int] | None = None

    def restore(self, given: Csr) -> tuple[Parts, float]:
        """K with its rigid motions free, by rows, and how far they were off.

        The figure is the largest ``|K z|`` of a row over the sum of sizes of its terms.
        Rows that supports within K hold are left out, and keep their resistance.

        Raises
        ------
        ValueError
            Rows are off by more than the digits explain.
        """
        K = self._mirrored(given.matrix)
        if K is None:
            return given.parts, 0.0  # refused by the core, with the entry
        direction = directions(self.places, self.d)
        if (direction == UNKNOWN).any():
            at = int(np.argmax(direction == UNKNOWN))
            raise ValueError(
                f"stiffness_rtol needs coordinates that tell nodes apart: the degrees of "
                f"freedom at the place of degree of freedom {at} are not those of whole "
                f"nodes, {self.d} each, or {3 if self.d == 2 else 6} with rotations"
            )
        rows = _Rows(K, direction, self)
        off = rows.classify()
        values = rows.restore()
        return csr("K", _whole(K.shape, rows.i, rows.j, values)).parts, off

    def amplification(self, parts: Parts, u: Floats) -> float:
        """How much of the energy of a displacement entries of K can change, over ``rtol``.

        ``Σ |e_i| |k_ij| |e_j|`` over ``uᵀ K u``. Rigid motions are free to the last digit,
        row by row: ``e`` is what the displacements that a row meets deviate by from the
        rigid motion nearest to them. Some tens, where a mesh resolves what bends it.
        """
        pointers, columns, values = parts
        K = sparse.csr_array((values, columns, pointers), shape=(len(u), len(u)))
        K = sparse.csr_array(sparse.tril(K))
        K = sparse.csr_array(K + sparse.csr_array(sparse.triu(K.T, 1)))
        K.sort_indices()
        energy = float(u @ (K @ u))
        size = np.abs(u)
        if energy <= ROUNDED * EPS * float(size @ (abs(K) @ size)):
            return 1.0  # it moves rigidly, as far as anybody can see
        direction = directions(self.places, self.d)
        changed, first = 0.0, 0
        while first < len(u):
            end = int(np.searchsorted(K.indptr, K.indptr[first] + BLOCK, side="right"))
            last = min(max(end - 1, first + 1), len(u))
            changed += self._deviation(K, direction, u, first, last)
            first = last
        return max(1.0, changed / energy)

    def _deviation(
        self, K: Any, direction: Ints, u: Floats, first: int, last: int
    ) -> float:
        """``Σ |e_i| |k_ij| |e_j|`` of some rows."""
        d = self.d
        pointer = K.indptr[first : last + 1] - K.indptr[first]
        entries = slice(K.indptr[first], K.indptr[last])
        there, weight = K.indices[entries], np.abs(K.data[entries])
        if not len(there):
            return 0.0
        row = np.repeat(np.arange(last - first), np.diff(pointer))
        arm = self.places[there] - self.places[first + row]
        Z = np.zeros((len(there), d + len(axes_of(d))))
        for k, one, amount in amounts(direction[there], arm, d):
            Z[one, k] += amount
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
        own = np.zeros(last - first)
        diagonal = there == first + row
        own[row[diagonal]] = e[diagonal]
        return float((own[row] * weight * e).sum())

    def _mirrored(self, given: Any) -> Any:
        """K symmetric to the bit; None where it is not symmetric to its digits."""
        K = sparse.csr_array(given)
        other = sparse.csr_array(K.T)
        roots = np.sqrt(np.abs(K.diagonal()))
        apart = sparse.coo_array(abs(K - other))
        at = sparse.coo_array(abs(K) + abs(other))
        # The core itself lets pass 1e-10 of the diagonal.
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
        return sparse.csr_array((K + other) / 2)


def checked(
    rtol: Any,
    places: Floats | None,
    d: int,
    bodies: Mapping[str, int] | None,
) -> Digits:
    """``stiffness_rtol`` as `ContactProblem` takes it, with what it needs."""
    value = number("stiffness_rtol", rtol)
    if not 0 < value <= MOST:
        raise ValueError(
            f"stiffness_rtol is {value:g}, expected a relative error of the entries of K "
            f"above 0, up to {MOST:g}"
        )
    if places is None:
        raise ValueError(
            "stiffness_rtol needs coordinates, the places of the degrees of freedom: from "
            "them the rigid motions are known that K has lost"
        )
    return Digits(value, places, d, bodies)


class _Rows:
    """Rows of ``K Z = 0``: those to restore, and how.

    Attributes
    ----------
    i, j, values
        Entries of the lower triangle.
    uncertain
        What each entry is uncertain by, over ``rtol``.
    A
        Takes entries to ``K Z``, rotations about the place of each row, ``(n m, entries)``.
    held
        Rows that supports within K hold, ``(n,)``.
    """

    def __init__(self, K: Any, direction: Ints, digits: Digits) -> None:
        low = sparse.coo_array(sparse.tril(K))
        self.i, self.j = low.row.astype(np.int64), low.col.astype(np.int64)
        self.values = low.data
        self.digits, self.direction = digits, direction
        self.n = K.shape[0]
        self.m = digits.d + len(axes_of(digits.d))
        roots = np.sqrt(np.abs(K.diagonal()))
        floor = min(ASSEMBLY * EPS / digits.rtol, 1.0)
        size = np.abs(self.values)
        size = size + np.where(size > 0, floor * roots[self.i] * roots[self.j], 0.0)
        self.uncertain = size
        self.A = self._operator()
        self.K = K
        self.held = np.zeros(self.n, bool)

    def _operator(self) -> Any:
        """A of all rows."""
        at, d = self.digits.places, self.digits.d
        apart = np.flatnonzero(self.i != self.j)
        every = np.arange(len(self.i))
        row, column, value = [], [], []
        for entries, of, by in ((every, self.i, self.j), (apart, self.j, self.i)):
            here, there = of[entries], by[entries]
            arm = at[there] - at[here]
            for k, one, amount in amounts(self.direction[there], arm, d):
                row.append(here[one] * self.m + k)
                column.append(entries[one])
                value.append(amount)
        shape = self.n * self.m, len(self.i)
        entries_ = np.concatenate(row), np.concatenate(column)
        A = sparse.csr_array((np.concatenate(value), entries_), shape=shape)
        A.eliminate_zeros()
        return A

    def classify(self) -> float:
        """Find the rows that supports hold, and what they leave free; how far rows are off.

        Raises
        ------
        ValueError
            Neither the digits nor supports explain ``K Z``.
        """
        forces = (self.A @ self.values).reshape(self.n, self.m)
        terms = (abs(self.A) @ self.uncertain).reshape(self.n, self.m)
        share = np.zeros_like(forces)
        # Translations and rotations each relative to the largest of their kind: a row
        # may have hardly any terms for one of them.
        for of in (slice(0, self.digits.d), slice(self.digits.d, self.m)):
            largest = terms[:, of].max(axis=1, keepdims=True)
            share[:, of] = np.abs(forces[:, of]) / np.where(largest > 0, largest, 1.0)
        off = share.max(axis=1)
        held = off > SLACK * self.digits.rtol
        used = float(off[~held].max(initial=0.0))
        if not held.any():
            return used
        # What holds a displacement resists translations. A row that is in balance under
        # these and not under rotations takes nodes to be where they are not.
        shifted = share[:, : self.digits.d].max(axis=1) > SLACK * self.digits.rtol
        turned = held & ~shifted & (self.direction < ABOUT)
        if turned.any():
            raise self._misplaced(turned, off)
        self.held = held
        return max(used, self._leave(held, off, forces))

    def _misplaced(self, turned: Any, off: Floats) -> ValueError:
        typical = float(np.median(off[turned]))
        remedy = (
            "The coordinates are not those of the degrees of freedom of K: another "
            "numbering, or other axes"
        )
        if typical <= SOFTEST:
            digits = 10.0 ** np.ceil(np.log10(typical))
            remedy = (
                "Give coordinates with all the digits that K was made with; if K itself "
                f"was written with fewer digits, stiffness_rtol={digits:.0e}"
            )
        return ValueError(
            f"{int(turned.sum())} of {self.n} rows of K are in balance under translations "
            "and not under rotations: they are off by more than stiffness_rtol = "
            f"{self.digits.rtol:g} explains, typically by {typical:.1e} of the sum of "
            f"sizes of their terms, the first at degree of freedom "
            f"{int(np.argmax(turned))}. {remedy}"
        )

    def _leave(self, held: Any, off: Floats, forces: Floats) -> float:
        """Take the rows that supports hold out, but for motions that they leave free."""
        at, d, m = self.digits.places, self.digits.d, self.m
        _, label = connected_components(self.K, directed=False)
        order = np.argsort(label, kind="stable")
        bodies = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
        mixing = []
        identity = np.repeat(~held, m).astype(np.float64)
        used = 0.0
        for dofs in bodies:
            rows = dofs[held[dofs]]
            if not len(rows) or len(dofs) == 1:
                continue
            Z, moved = motions(self.direction[dofs], at[dofs], d)
            free, worst = self._free(dofs, rows, Z, moved, off, forces)
            used = max(used, worst)
            if not free.shape[1]:
                continue
            turn = self._about(rows, dofs)
            # Row k of it: motion k of those left free, in terms of the row's own.
            block = np.zeros((len(rows), m, m))
            block[:, : free.shape[1]] = np.einsum("kf,rkl->rfl", free, turn)
            row, k, own = np.nonzero(block)
            mixing.append((rows[row] * m + k, rows[row] * m + own, block[row, k, own]))
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
        """Of each row, rigid motions about the middle of the body by those about its place."""
        at, d, m = self.digits.places, self.digits.d, self.m
        centre = at[dofs].mean(axis=0)
        arm = at[rows] - centre
        reach = float(np.abs((at[dofs] - centre)[:, :d]).max(initial=0.0)) or 1.0
        turn = np.zeros((len(rows), m, m))
        turn[:, range(m), range(m)] = np.where(np.arange(m) < d, 1.0, 1.0 / reach)
        for k, axis in enumerate(axes_of(d), start=d):
            a, b = (axis + 1) % 3, (axis + 2) % 3
            turn[:, k, a] = -arm[:, b] / reach
            turn[:, k, b] = arm[:, a] / reach
        return turn

    def _free(
        self,
        dofs: Ints,
        rows: Ints,
        Z: Floats,
        moved: Floats,
        off: Floats,
        forces: Floats,
    ) -> tuple[Floats, float]:
        """Combinations of rigid motions that supports leave free, ``(m, free)``.

        And how far these are off, at the most.
        """
        rtol = self.digits.rtol
        of_body = np.zeros(self.n)
        of_body[dofs] = moved
        size = abs(self.K[rows]) @ of_body
        turn = self._about(rows, dofs)
        resisted = np.einsum("rkl,rl->rk", turn, forces[rows]) / size[:, None]
        # At least as many rows as motions, lest some have no singular vector.
        padded = np.concatenate([resisted, np.zeros((self.m, self.m))])
        _, _, combined = np.linalg.svd(padded, full_matrices=False)
        amount = np.abs(Z @ combined.T).max(axis=0)
        resistance = np.abs(resisted @ combined.T).max(axis=0)
        # A motion that the body does not have: of a straight line, that about itself.
        none = amount <= 1e-10
        resistance = np.where(none, 0.0, resistance / np.where(none, 1.0, amount))
        free = resistance <= SLACK * rtol
        held = resistance[~free]
        many = len(rows) > (1 - BELIEVED) * len(dofs)
        if len(held) and held.min() < CLEAR * rtol:
            raise self._refusal(dofs, off, float(held.min()))
        left = _complement(combined[~free], Z[np.isin(dofs, rows)])
        if len(held) and many and not self._stiff(dofs, Z @ left, off):
            raise self._refusal(dofs, off, float(held.min()))
        return left, float(resistance[free].max(initial=0.0))

    def _stiff(self, dofs: Ints, free: Floats, off: Floats) -> bool:
        """Whether a body is held beyond doubt, whatever errors its entries have."""
        # All degrees of freedom, prescribed ones too: it is K that is to resist.
        if len(dofs) > DENSE:
            return False
        K = self.K[dofs][:, dofs].toarray()
        typical = float(np.median(off[dofs]))
        places, d = self.digits.places[dofs], self.digits.d
        _, moved = motions(self.direction[dofs], places, d)
        doubt = max(self.digits.rtol, min(typical, SOFTEST))
        shift = doubt * (np.abs(K) @ moved) / moved
        scale = np.abs(np.diag(K)).mean()
        try:
            np.linalg.cholesky(K - np.diag(shift) + scale * (free @ free.T))
        except np.linalg.LinAlgError:
            return False
        return True

    def _refusal(self, dofs: Ints, off: Floats, least: float) -> ValueError:
        rtol = self.digits.rtol
        over = off[dofs] > SLACK * rtol
        typical = float(np.median(off[dofs][over]))
        body = body_of(int(dofs[0]), self.digits.bodies)
        digits = 10.0 ** np.ceil(np.log10(typical))
        remedy = "If coordinates are those of another numbering, mend them"
        if digits <= MOST:
            remedy = (
                f"If K was written with fewer digits, give stiffness_rtol={digits:.0e}"
            )
        return ValueError(
            f"{body}: K does not leave the rigid motions free that coordinates describe: "
            f"{int(over.sum())} of {len(dofs)} rows of K Z are off by more than "
            f"stiffness_rtol = {rtol:g} explains, typically by {typical:.1e} of the sum of "
            f"sizes of their terms; the softest motion is resisted by {least:.1e}. "
            f"{remedy}; if supports or springs within K do this, leave stiffness_rtol out"
        )

    def restore(self) -> Floats:
        """Entries of the lower triangle, the nearest for which ``A`` gives zero.

        Raises
        ------
        ValueError
            The entries that K has do not suffice.
        """
        # Entries beside the diagonal stand for two.
        scale = self.uncertain * np.where(self.i == self.j, 1.0, np.sqrt(0.5))
        G = self.A.copy()
        G.data *= scale[G.indices]
        norm = np.sqrt(np.add.reduceat(np.append(G.data**2, 0.0), G.indptr[:-1]))
        norm[np.diff(G.indptr) == 0] = 0.0
        # A row of nothing asks for nothing.
        inverse = np.divide(1.0, norm, out=np.zeros_like(norm), where=norm > 0)
        G.data *= np.repeat(inverse, np.diff(G.indptr))
        terms = abs(self.A) @ np.abs(self.values)
        by_row = terms.reshape(self.n, self.m)
        # Combinations of motions are known to rounding themselves.
        by_row[self.held] = COMBINED * by_row[self.held].max(axis=1, keepdims=True)
        goal = inverse * EPS * terms
        values = self.values.copy()
        worst, best = np.inf, values
        for _ in range(4):
            left = inverse * (self.A @ values)
            now = float(np.abs(left / np.where(goal > 0, goal, 1.0)).max(initial=0.0))
            if now >= worst:
                break
            worst, best = now, values
            if worst <= ENOUGH:
                break
            reduction = max(0.2 / worst, LEAST_REDUCTION)
            values = values - scale * _least_change(G, left, reduction)
        if worst > RESTORED:
            raise ValueError(
                "stiffness_rtol: no change of the entries that K has restores its rigid "
                f"motions: {worst * EPS:.1e} of the terms of a row are left. Expected K of "
                "whole elements, with none of their entries dropped"
            )
        return np.asarray(best, np.float64)


def _complement(resisted: Floats, moved: Floats) -> Floats:
    """Motions at right angles to those that are resisted, ``(m, free)``.

    What is resisted is a combination of how the held degrees of freedom move, rows of
    ``moved``: K tells to its digits which one, and places tell the rest exactly.
    """
    _, sizes, across = np.linalg.svd(moved, full_matrices=False)
    possible = across[sizes > 1e-10 * sizes.max(initial=0.0)]
    within = resisted @ possible.T @ possible
    padded = np.concatenate([within, np.zeros((moved.shape[1],) * 2)])
    _, _, turned = np.linalg.svd(padded, full_matrices=False)
    return np.asarray(turned[len(resisted) :].T, np.float64)


def _least_change(G: Any, left: Floats, reduction: float) -> Floats:
    """Least x with ``G x = left`` but for this part of it, by least squares (LSQR).

    ``G Gᵀ``, whose diagonal is one, is singular, as ``Zᵀ K Z`` is symmetric whatever K
    is; what is asked for is consistent but for rounding, which least squares leave where
    it is.
    """
    turned = G.T
    product = LinearOperator(
        G.shape, matvec=lambda x: G @ x, rmatvec=lambda y: turned @ y, dtype=np.float64
    )
    found = lsqr(
        product, left, atol=reduction, btol=reduction, conlim=0, iter_lim=MOST_STEPS
    )
    return np.asarray(found[0], np.float64)


def _whole(shape: tuple[int, int], i: Ints, j: Ints, values: Floats) -> Any:
    """The matrix with this lower triangle, by rows."""
    apart = i != j
    row = np.concatenate([i, j[apart]])
    column = np.concatenate([j, i[apart]])
    data = np.concatenate([values, values[apart]])
    return sparse.csr_array((data, (row, column)), shape=shape)


def said_of_indefinite(
    parts: Parts, fixed: Ints, dof: int, digits: Digits | None
) -> str:
    """How negative an indefinite K is, and whether its digits explain that.

    Parameters
    ----------
    parts
        K by rows, of which the lower triangle is read.
    fixed
        Prescribed degrees of freedom.
    dof
        A degree of freedom of the body.
    digits
        What the caller has said of the digits of K, and was restored by it.
    """
    pointers, columns, values = parts
    n = len(pointers) - 1
    low = sparse.csr_array(
        sparse.tril(sparse.csr_array((values, columns, pointers), (n, n)))
    )
    free = np.setdiff1d(np.arange(n), fixed)
    K = sparse.csr_array(low + sparse.csr_array(sparse.triu(low.T, 1)))[free][:, free]
    _, label = connected_components(K, directed=False)
    at = int(np.searchsorted(free, dof))
    body = (
        np.flatnonzero(label == label[at])
        if free[at : at + 1] == dof
        else np.arange(len(free))
    )
    least = _least_eigenvalue(K[body][:, body])
    if least is None:
        return f"; no eigenvalue is below {-OF_DIGITS:.0e} of the largest" + _offer(
            OF_DIGITS, digits
        )
    if not least < 0:
        return ""
    said = f"; its most negative eigenvalue is {least:.1e} of the largest"
    return said + (_offer(-least, digits) if least >= -OF_DIGITS else "")


def _offer(negative: float, digits: Digits | None) -> str:
    if digits is not None:
        return (
            f". Its rigid motions were restored: entries right to stiffness_rtol = "
            f"{digits.rtol:g} leave no digit of its softest motion. Write K with more digits"
        )
    rtol = max(10.0 ** np.ceil(np.log10(negative)), LEAST_OFFER)
    return (
        f". A K that was written with some digits is like that: stiffness_rtol={rtol:.0e}, "
        "the relative error of its entries, with coordinates=, the places of its degrees "
        "of freedom, restores its rigid motions"
    )


def _least_eigenvalue(K: Any) -> float | None:
    """The least eigenvalue over the largest; None for a small one that costs too much."""
    n = K.shape[0]
    if not K.count_nonzero():
        return 0.0
    if n <= DENSE:
        # Scaled, lest squares of entries leave the range of doubles.
        values = np.linalg.eigvalsh(K.toarray() / np.abs(K.data).max())
        return float(values[0] / np.abs(values).max())
    largest = abs(float(eigsh(K, k=1, which="LM", tol=1e-3, v0=np.ones(n))[0][0]))
    try:
        rough = eigsh(K, k=1, which="SA", tol=1e-2, maxiter=20, v0=np.ones(n))[0]
    except ArpackNoConvergence as error:
        rough = error.eigenvalues
    if len(rough) and rough[0] < -OF_DIGITS * largest:
        return float(rough[0] / largest)
    if n > SPARSE:
        return None
    near = -OF_DIGITS * largest
    found = eigsh(K, k=1, sigma=near, which="LA", v0=np.ones(n))[0]
    return float(found[0] / largest)
