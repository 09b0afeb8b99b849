"""Least and largest reactions where reactions are not determined.

With redundant supports or rigid bodies many reactions have the same relative displacement
``v``. They are ``r + z`` with ``W z + R b = 0`` and ``Rᵀ z = 0``, where the amplitudes may
change by ``b``, and the law (8) holds for ``r + z`` with the same ``v``: no reaction where a
contact is open; friction ``-mu r_n v_t/|v_t|`` where it slips; any reaction of the cone (7)
where it sticks. This set is convex, so that the extremes of a component are a linear
programme in the plane and one over circular cones in space.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, MatrixLike
from bipot_rs.contact.errors import NotConvergedError
from bipot_rs.contact.proof.equilibrium import make_cone_set
from bipot_rs.contact.proof.existence import find_scale, make_dense
from bipot_rs.contact.results.solution import Solution

# A singular value below this part of the largest one, times the order, is zero: ε, and one
# digit for the error of W.
_ROUNDING = 1e-15
# Displacements within this many tolerances of the solution are zero: η bounds them together.
_TOLERANCES = 10.0
# With more rows, rigid bodies are not asked for a null space, whose work grows with the cube.
_DENSE = 600
# A reaction that changes by less than this along unit vectors of the null space, whose
# errors are roundings over the least singular value that is not zero, is determined.
_DETERMINED = 1e-10
# A gap above this share of the bounds and of the largest reaction leaves a range without use.
_USEFUL = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class ReactionRange:
    """Least and largest value of one component of one reaction, over all answers.

    The answers are those with the relative displacement of one solution.

    Attributes
    ----------
    contact, component
        Number of the contact, and of the component: 0 is normal.
    found
        The value in the solution.
    least, largest
        Its bounds, in units of force; infinite if the answers have no bound. Both are
        attained if they are finite.
    reaction_at_least, reaction_at_largest
        Reactions ``(n_c, d)`` of answers that attain the bounds. If a bound is infinite,
        the reactions of the solution.
    direction_to_least, direction_to_largest
        If a bound is infinite, the proof: reactions ``(n_c, d)``, the largest normal one is
        1, any multiple of which may be added to an answer. Otherwise ``None``.
    gap
        How much lower than ``least``, or higher than ``largest``, the true bound may be,
        from the solution of the dual problem, in units of force. In space it is usually
        below 1e-9 of the largest reaction. It may be larger if the law leaves the answers
        almost no room.
    """

    contact: int
    component: int
    found: float
    least: float
    largest: float
    reaction_at_least: Floats
    reaction_at_largest: Floats
    direction_to_least: Floats | None = None
    direction_to_largest: Floats | None = None
    gap: float = 0.0

    __repr__ = short_repr

    @property
    def determined(self) -> bool:
        """Whether both bounds are equal, to within their gap."""
        return self.largest - self.least <= 2 * self.gap


def find_ranges(
    W: Floats | CsrMatrix,
    q: Floats,
    mu: Floats,
    rigid: tuple[Floats, Floats] | None,
    solution: Solution,
    contacts: list[int],
    component: int,
) -> list[ReactionRange]:
    """Ranges of a component of the reactions of some contacts.

    ``W, q, mu, rigid``: as in `ReducedProblem`.
    ``solution``: a converged solution.
    ``contacts, component``: numbers of contacts, and of the component.
    """
    if rigid is not None and q.size > _DENSE and not _entries(W).any():
        answers = _Answers.of_rigid_bodies(q, mu, rigid, solution)
    else:
        answers = _Answers.of(W, q, mu, rigid, solution)
    return [answers.range(contact, component) for contact in contacts]


@dataclass(frozen=True)
class _Answers:
    """All reactions with one relative displacement, ``r = factor (base + span y)``.

    ``span (d n_c, k)`` is dense or sparse.

    Components are scaled: friction is isotropic, contacts have unit compliance, and the
    largest reaction is 1. ``law`` is the set of ``y`` that the contact law allows.
    """

    found: Floats
    factor: Floats
    base: Floats
    span: Floats | CsrMatrix
    law: _core.ConeSet

    @classmethod
    def of(
        cls,
        W: Floats | CsrMatrix,
        q: Floats,
        mu: Floats,
        rigid: tuple[Floats, Floats] | None,
        solution: Solution,
    ) -> _Answers:
        d = q.shape[1]
        by, mu = _core.isotropic(mu, d)
        compliance = by.ravel()[:, None] * make_dense(W) * by.ravel()
        factor = by * find_scale(compliance, d)[:, None]
        scaled = make_dense(W) * np.outer(factor, factor)
        motions = np.zeros((q.size, 0))
        if rigid is not None:
            motions = _find_range(factor.ravel()[:, None] * make_dense(rigid[0]))
        r = solution.reaction / factor
        largest = float(np.abs(r).max(initial=0.0))
        size = largest if largest > 0 else 1.0
        r = r / size
        reach = (np.abs(scaled) @ np.abs(r).ravel() * size).reshape(q.shape)
        reach += np.abs(factor * q)
        v = factor * solution.relative_displacement
        width = float(reach.max(initial=0.0)) or float(np.abs(v).max(initial=0.0))
        v = v / (width or 1.0)
        held = max(solution.tolerance, solution.residual)
        free = _find_directions(r, v, mu, _TOLERANCES * held).toarray()
        # W z + R b = 0 for some b: W z has no part across the motions.
        across = scaled - motions @ (motions.T @ scaled)
        rows = np.vstack([across, motions.T])
        blur = _TOLERANCES * solution.residual
        x, null = _find_null_space(rows @ free, free, r, rows, blur)
        base = (free @ x).reshape(q.shape)
        span = (free @ null).reshape(*q.shape, -1)
        moved = np.linalg.norm(span, axis=(1, 2)) > _DETERMINED
        span[~moved] = 0.0
        G, h = _make_cones(span[moved], base[moved], mu, free, moved)
        law = make_cone_set(G.reshape(h.size, span.shape[2]), h)
        flat = span.reshape(q.size, -1)
        return cls(solution.reaction, factor * size, base, flat, law)

    @classmethod
    def of_rigid_bodies(
        cls, q: Floats, mu: Floats, rigid: tuple[MatrixLike, Floats], solution: Solution
    ) -> _Answers:
        """Without compliance: all that the law allows and that balances the loads.

        No null space is needed, and ``R`` may be sparse.
        """
        from scipy.sparse import csr_array, diags_array

        by, mu = _core.isotropic(mu, q.shape[1])
        r = solution.reaction / by
        size = float(np.abs(r).max(initial=0.0)) or 1.0
        v = by * solution.relative_displacement
        width = float(np.abs(v).max(initial=0.0))
        held = max(solution.tolerance, solution.residual)
        free = _find_directions(r / size, v / (width or 1.0), mu, _TOLERANCES * held)
        R = csr_array(diags_array(by.ravel()) @ csr_array(rigid[0]))
        length = np.sqrt((R * R).sum(axis=0))
        equations = csr_array(diags_array(1 / length) @ R.T @ free)
        widths = _find_widths(free, mu)
        law = make_cone_set(
            diags_array(widths.ravel()) @ free,
            np.zeros(q.shape),
            equations,
            -rigid[1] / length / size,
        )
        return cls(solution.reaction, by * size, np.zeros(q.shape), free, law)

    def range(self, contact: int, component: int) -> ReactionRange:
        """Range of one component of one reaction."""
        reaction_here = float(self.found[contact, component])
        shape = self.found.shape
        cost = make_dense(self.span[[contact * shape[1] + component]])[0]
        size = float(np.linalg.norm(cost))
        unit = float(self.factor[contact, component])
        if size <= _DETERMINED:
            return ReactionRange(
                contact=contact,
                component=component,
                found=reaction_here,
                least=reaction_here,
                largest=reaction_here,
                reaction_at_least=self.found,
                reaction_at_largest=self.found,
            )
        ends: list[tuple[float, Floats, Floats | None, float]] = []
        for sign in (1.0, -1.0):
            y, bounded, gap = self.law.minimise(sign * cost / size)
            moved = (self.span @ y).reshape(shape)
            if bounded:
                reaction = self.factor * (self.base + moved)
                # Rounding of zero, of both signs.
                reaction[:, 0] = np.maximum(reaction[:, 0], 0.0) + 0.0
                value = float(reaction[contact, component])
                ends.append((value, reaction, None, gap * size * unit))
            else:
                direction = self.factor * moved
                direction /= np.abs(direction[:, 0]).max()
                ends.append((-sign * np.inf, self.found, direction, 0.0))
        low, high = ends
        gap = max(low[3], high[3])
        bounds = [abs(value) for value, _, way, _ in ends if way is None]
        if not gap <= _USEFUL * max(unit, abs(reaction_here), *bounds):
            raise NotConvergedError(
                f"the range of component {component} of the reaction of contact {contact} was "
                f"not found: its ends may be off by {gap:.1e}, because the law leaves the "
                "reactions almost no room"
            )
        return ReactionRange(
            contact=contact,
            component=component,
            found=reaction_here,
            least=low[0],
            largest=high[0],
            reaction_at_least=low[1],
            reaction_at_largest=high[1],
            direction_to_least=low[2],
            direction_to_largest=high[2],
            gap=gap,
        )


def _find_range(columns: Floats) -> Floats:
    """Orthonormal columns that span those given."""
    length = np.linalg.norm(columns, axis=0)
    # Unit length first: rotations have other units than translations.
    columns = columns / np.where(length > 0, length, 1.0)
    U, size, _ = np.linalg.svd(columns, full_matrices=False)
    zero = _ROUNDING * max(columns.shape) * size.max(initial=0.0)
    return np.asarray(U[:, size > zero])


def _find_directions(r: Floats, v: Floats, mu: Floats, zero: float) -> CsrMatrix:
    """Orthonormal columns ``(n_c d, m)`` of the reactions that the law allows with ``v``.

    ``r`` and ``v`` are relative to the largest force and displacement; a displacement of at
    most ``zero`` is zero. The matrix is sparse.
    """
    from scipy.sparse import block_diag, csr_array

    d = r.shape[1]
    slip = np.linalg.norm(v[:, 1:], axis=1)
    blocks = []
    for i in range(len(r)):
        directions = np.eye(d)
        if v[i, 0] > zero and r[i, 0] <= v[i, 0]:
            directions = directions[:0]
        elif mu[i] == 0:
            directions = directions[:1]
        elif slip[i] > zero:
            directions = np.concatenate([[1.0], -mu[i] * v[i, 1:] / slip[i]])[None]
            directions /= np.linalg.norm(directions)
        blocks.append(directions.T)
    directions_of_all: CsrMatrix = csr_array(block_diag(blocks, format="csr"))
    return directions_of_all


def _find_null_space(
    A: Floats, free: Floats, r: Floats, rows: Floats, blur: float
) -> tuple[Floats, Floats]:
    """Unknowns nearest to ``r`` with the same image, and the null space of ``A``.

    Slip has an error, and so have the columns of ``A``, relative to its largest singular
    value ``blur``: what is smaller is zero.
    """
    x = free.T @ r.ravel()
    U, size, V = np.linalg.svd(A, full_matrices=len(A) < A.shape[1])
    zero = max(_ROUNDING * max(A.shape), blur) * size.max(initial=0.0)
    rank = int((size > zero).sum())
    missing = rows @ r.ravel() - A @ x
    # What is missing is an error of the solution, which small values would enlarge.
    safe = int((size > np.sqrt(zero * size.max(initial=0.0))).sum())
    x = x + V[:safe].T @ (U[:, :safe].T @ missing / size[:safe])
    return x, V[rank:].T


def _make_cones(
    span: Floats, base: Floats, mu_all: Floats, free: Floats, moved: Bools
) -> tuple[Floats, Floats]:
    """Vectors that lie in circular cones; half-lines of one unknown have no other component."""
    by = _find_widths(free, mu_all)[moved]
    offset = by * base
    # Rounding may leave the solution outside of a cone; y = 0 is allowed.
    out = np.linalg.norm(offset[:, 1:], axis=1) - offset[:, 0]
    offset[:, 0] += np.maximum(out, 0.0)
    return by[..., None] * span, offset


def _find_widths(free: Any, mu: Floats) -> Floats:
    """Factors ``(n_c, d)`` that make cones circular, zero for what is no unknown."""
    contacts = len(mu)
    used = make_dense((abs(free)).sum(axis=1)).reshape(contacts, -1) > 0
    unknowns = np.zeros(contacts, int)
    rows, columns = np.nonzero(free) if isinstance(free, np.ndarray) else free.nonzero()
    d = used.shape[1]
    pairs = np.unique(np.column_stack([rows // d, columns]), axis=0)
    np.add.at(unknowns, pairs[:, 0], 1)
    sticks = unknowns == d
    root = np.sqrt(np.where(sticks, mu, 1.0))
    by = np.zeros((contacts, d))
    by[:, 0] = root
    by[:, 1:] = (sticks / root)[:, None]
    return by


def _entries(W: Floats | CsrMatrix) -> Floats:
    return np.asarray(W.data if hasattr(W, "tocsr") else W)
