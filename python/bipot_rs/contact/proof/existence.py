"""Decide whether a contact problem has a solution, without solving it; or search all.

The theorems are proved in section 10 of ``docs/theory.md``, those of `is_held` in
``docs/paper/6-contact-principles.md``. This module searches for witnesses; the core decides
whether a witness is a proof.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, SupportsIndex, overload

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, SparseMatrix
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.proof.equilibrium import make_cone_set, statics_of_rows
from bipot_rs.contact.results.solution import Solution

# A smaller component of a rigid motion of length 1 is rounding.
_FLAT = 1e-9
# Above the tolerance of linear programmes, 1e-7.
_MARGIN = 1e-6


def is_held(R: Floats, e: Floats, mu: Floats) -> bool:
    """Whether friction dissipates more on every sliding motion than the loads supply.

    Each rigid motion must be a sum of a sliding and a lift. A sliding moves no contact
    along its normal; a lift moves no contact with friction along its tangents. The
    pressures that balance the loads on lifts must be bounded. Otherwise the result is False.

    ``R, e``: rigid motions ``(d n_c, k)`` and the loads on them, ``(k,)``.
    ``mu``: friction coefficients, ``(n_c,)``.
    """
    from scipy.optimize import nnls

    Q, T = np.linalg.qr(R)
    e = np.linalg.solve(T.T, e)
    by_contact = Q.reshape(len(mu), -1, Q.shape[1])
    normal, tangents = by_contact[:, 0], by_contact[:, 1:] * (mu > 0)[:, None, None]
    slides, lifts = (
        _find_null_space(normal),
        _find_null_space(tangents.reshape(-1, Q.shape[1])),
    )
    whole = np.hstack([slides, lifts])
    if whole.shape[1] != Q.shape[1] or not slides.shape[1]:
        return False
    if np.linalg.svd(whole, compute_uv=False)[-1] < _FLAT:
        return False
    press, load = normal @ lifts, -lifts.T @ e
    size = float(np.abs(load).max(initial=0.0))
    closed = np.vstack([press.T, np.ones(len(mu))])
    unit = np.append(np.zeros(lifts.shape[1]), 1.0)
    # Bounded: every sum of pressures works on some lift.
    if not size or np.linalg.norm(closed @ nnls(closed, unit)[0] - unit) < _MARGIN:
        return False
    load, pull = load / size, slides.T @ e / size
    if not _is_within(press.T, load):
        return False
    moves = tangents @ slides
    return _share_friction(press, load, moves, pull, mu) or _find_limit(
        press, load, moves, pull, mu
    )


def _find_limit(
    press: Floats, load: Floats, moves: Floats, pull: Floats, mu: Floats
) -> bool:
    """Whether the pull is below the least friction of all pressures that balance the loads.

    Only for one sliding, or for translations, where all contacts slide in the same way.
    """
    from scipy.optimize import linprog

    # If all contacts can press a little, the loads work against every lift.
    if not _is_within(press.T, load - _MARGIN * press.sum(axis=0)):
        return False
    grams = np.einsum("ija,ijb->iab", moves, moves)
    reach = np.sqrt(np.trace(grams, axis1=1, axis2=2))
    alike = grams[reach > _FLAT]
    if not len(alike):
        return False
    # Each contact slides by its reach times a matrix that is the same for all.
    alike = alike / np.trace(alike, axis1=1, axis2=2)[:, None, None]
    if np.abs(alike - alike[0]).max() > _FLAT:
        return False
    if np.linalg.eigvalsh(alike[0])[0] <= _FLAT:
        return False
    drawn = float(np.sqrt(pull @ np.linalg.solve(alike[0], pull)))
    least = linprog(mu * reach, A_eq=press.T, b_eq=load)
    return least.fun is not None and bool(drawn < (1 - _MARGIN) * least.fun)


def _share_friction(
    press: Floats, load: Floats, moves: Floats, pull: Floats, mu: Floats
) -> bool:
    """Whether friction in proportion to pressure balances the pull, for all pressures.

    It looks for ``g_i`` with ``‖g_i‖ < μ_i`` and a matrix ``Y`` with ``T_iᵀ g_i = Y A_i`` and
    ``Y load = -pull``. Then the friction ``r_n,i g_i`` works on slidings by ``Y`` times the
    work of ``r_n,i`` on lifts.
    """
    from scipy.linalg import block_diag

    contacts, tangential, slides = moves.shape
    # Scale the rows: the sizes depend on the stiffness of each contact.
    sizes = np.linalg.norm(press, axis=1) + np.linalg.norm(moves, axis=(1, 2))
    sizes[sizes == 0] = 1.0
    press, moves = press / sizes[:, None], moves / sizes[:, None, None]
    # Unknowns: g, columns of Y.
    balance, each = block_diag(*moves.transpose(0, 2, 1)), np.eye(slides)
    last = np.kron(load[None], each)
    A = np.block(
        [[balance, -np.kron(press, each)], [np.zeros((slides, balance.shape[1])), last]]
    )
    b = np.append(np.zeros(len(balance)), -pull)
    # All solutions of the equations, to rounding; the programme chooses one.
    x0 = np.linalg.lstsq(A, b, rcond=None)[0]
    most = max(1.0, float(np.linalg.norm(pull)))
    if np.linalg.norm(A @ x0 - b) > _core.least_work * most:
        return False
    ways = _find_null_space(A / max(1.0, float(np.linalg.norm(A, 2))))
    free = contacts * tangential
    start = x0[:free].reshape(contacts, -1)
    change = ways[:free].reshape(contacts, tangential, -1)
    # The least t with (t mu_i, g_i) in a circular cone.
    rows = np.zeros((contacts, 1 + tangential, ways.shape[1] + 1))
    rows[:, 0, -1], rows[:, 1:, :-1] = mu, change
    cones = make_cone_set(
        rows.reshape(-1, rows.shape[2]), np.pad(start, [(0, 0), (1, 0)])
    )
    y, _, gap = cones.minimise(np.append(np.zeros(ways.shape[1]), 1.0))
    length = np.linalg.norm(start + change @ y[:-1], axis=1)
    inside = (length <= (1 - _MARGIN) * mu)[mu > 0].all()
    return bool(np.isfinite(gap) and inside)


def _is_within(columns: Floats, load: Floats) -> bool:
    """Whether the load is a sum of the columns with non-negative amounts."""
    from scipy.optimize import nnls

    return bool(
        np.linalg.norm(columns @ nnls(columns, load)[0] - load) <= _core.least_work
    )


def _find_null_space(A: Floats) -> Floats:
    """Orthonormal columns of the null space of a matrix with a norm of about 1."""
    _, values, rows = np.linalg.svd(A)
    rank = int((values > _FLAT).sum())
    return np.asarray(rows[rank:].T, np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Existence:
    """Verdict on the existence of a solution, with its witness.

    Attributes
    ----------
    verdict
        ``"guaranteed"``: a solution exists. ``"none"``: no solution exists.
        ``"unknown"``: neither is proved.
    reason
        The reason, in one sentence.
    motion
        Relative displacement ``(n_c, d)`` of each contact in a rigid motion; the
        largest has length 1. With ``"none"``: it lies in every dual cone and the loads
        do positive work on it, so that no reaction stops it. With ``"unknown"``: the loads
        do positive work on it, and normal reactions alone do not stop it.
    displacement
        That motion at all degrees of freedom, ``(n,)``; only for a `ContactProblem`.
    inside
        With ``"guaranteed"``: a possible relative displacement ``(n_c, d)`` inside every
        dual cone, ``v_n > mu |v_t|``; ``None`` if every displacement is possible.
    pressure
        With ``"guaranteed"``, if the loads on rigid motions can be balanced without
        friction: non-negative normal reactions ``(n_c,)`` that balance them.
    overlap
        With ``"none"``: non-negative amounts ``(n_c,)`` of normal displacements. No
        reaction changes the sum of the normal displacements, each times its amount, and
        this sum is negative.
    """

    verdict: Literal["guaranteed", "none", "unknown"]
    reason: str
    motion: Floats | None = None
    displacement: Floats | None = None
    inside: Floats | None = None
    pressure: Floats | None = None
    overlap: Floats | None = None

    __repr__ = short_repr


# The theorem of friction on planes needs null spaces: it is asked up to so many entries of R.
_MOST_HELD = 1_000_000


@dataclass(frozen=True)
class _Scaled:
    """The problem in scaled variables, without the tangents of contacts without friction.

    ``W``, ``q`` and ``R`` have the rows ``kept``; ``normal`` marks the normal ones.
    ``motions`` is ``R`` with all rows; its columns have length 1. ``e`` are the loads on
    these columns. Matrices are sparse.
    """

    W: CsrMatrix
    q: Floats
    R: CsrMatrix
    motions: CsrMatrix
    e: Floats
    mu: Floats
    kept: Bools
    normal: Bools
    scale: Floats

    @property
    def size(self) -> float:
        """Largest free displacement; diagonals are 1, so reactions have this size too."""
        return float(np.abs(self.q).max(initial=0.0))


def judge_existence(
    core: _core.Reduced,
    W: CsrMatrix,
    q: Floats,
    mu: Floats,
    rigid: tuple[CsrMatrix, Floats] | None,
    law: ContactLaw,
) -> Existence:
    """Give the verdict on ``v = W r + R a + q``, if some reaction balances the loads.

    ``core``: the problem, which decides whether a witness is a proof.
    ``W, q, mu, rigid``: as in `ReducedProblem`, sparse, with isotropic friction.
    ``law``: the law, which has cohesion and dilatancy besides.
    """
    if not len(q):
        return Existence(verdict="guaranteed", reason="there are no contacts")
    rubs = mu > 0 if law.cohesion is None else (mu > 0) | (law.cohesion > 0)
    p = _scale_problem(W, q, mu, rigid, rubs)
    symmetric = abs(p.W - p.W.T).max() <= 1e-8
    inside: Floats | None = None
    if not _is_definite(p.W):
        overlap = _find_overlap(core, p)
        if overlap is not None:
            return Existence(
                verdict="none",
                reason="contacts contradict each other: no displacement opens them all",
                overlap=overlap,
            )
        if not symmetric or not _is_semidefinite(p.W):
            what = "symmetric" if not symmetric else "positive semidefinite"
            return Existence(verdict="unknown", reason=f"the compliance is not {what}")
        inside = _find_inside(p)
        if inside is None:
            return Existence(
                verdict="unknown",
                reason="no displacement was found that opens every contact by more than "
                "mu times its slip",
            )
    pressure: Floats | None = None
    reason = "supports hold every body"
    if p.R.shape[1]:
        reason = "normal reactions alone can balance the loads"
        pressure, rest = _find_balanced(p)
        if pressure is None and rest is None:
            return Existence(
                verdict="unknown",
                reason="to balance the loads, normal reactions would have to be a billion "
                "times as large",
            )
        # That theorem is about Coulomb's law.
        if (
            rest is not None
            and law.is_coulomb
            and q.size * len(p.e) <= _MOST_HELD
            and is_held(p.motions.toarray(), p.e, mu)
        ):
            reason = "friction holds the bodies, however the pressures are distributed"
        elif rest is not None:
            motion = (p.motions @ rest).reshape(q.shape) / p.scale[:, None]
            motion /= np.linalg.norm(motion, axis=1).max()
            return Existence(
                verdict="unknown",
                reason="friction must take part in balancing the loads: that reactions of "
                "the cone can do it is necessary, and not sufficient",
                motion=motion,
            )
    room = (
        "contacts can move in any way"
        if inside is None
        else "some displacement opens every contact by more than mu times its slip"
    )
    return Existence(
        verdict="guaranteed",
        reason=f"{reason}, and {room}",
        inside=inside,
        pressure=pressure,
    )


def _scale_problem(
    W: CsrMatrix,
    q: Floats,
    mu: Floats,
    rigid: tuple[CsrMatrix, Floats] | None,
    rubs: Bools,
) -> _Scaled:
    from scipy.sparse import csr_array, diags_array

    contacts, d = q.shape
    matters = np.ones((contacts, d), bool)
    matters[:, 1:] = rubs[:, None]
    kept: Bools = matters.ravel()
    scale = find_scale(W, d)
    by_row = diags_array(np.repeat(scale, d))
    R, e = rigid or (csr_array((len(kept), 0)), np.empty(0))
    R = csr_array(by_row @ R)
    # Columns of unit length: rotations have other units than translations.
    length = np.sqrt((R * R).sum(axis=0))
    R = csr_array(R @ diags_array(1 / length))
    return _Scaled(
        W=csr_array(by_row @ W @ by_row)[kept][:, kept],
        q=(by_row @ q.ravel())[kept],
        R=R[kept],
        motions=R,
        e=e / length,
        mu=mu,
        kept=kept,
        normal=(np.arange(contacts * d) % d == 0)[kept],
        scale=scale,
    )


def find_scale(W: Floats | CsrMatrix, d: int) -> Floats:
    """Factor of the displacements of each contact that makes its mean compliance 1."""
    compliance = W.diagonal().reshape(-1, d).mean(axis=1)
    positive = compliance > 0
    # A contact without compliance gets the median scale of the others.
    usual = float(np.median(compliance[positive])) if positive.any() else 1.0
    return np.asarray(1 / np.sqrt(np.where(positive, compliance, usual)))


def _split_islands(W: CsrMatrix) -> Iterator[Floats]:
    """The symmetric part of each independent block of ``W``, dense."""
    from scipy.sparse.csgraph import connected_components

    count, label = connected_components(W, directed=False)
    members = np.split(np.argsort(label), np.cumsum(np.bincount(label))[:-1])
    for island in members[:count]:
        block = W[island][:, island].toarray()
        yield (block + block.T) / 2


def _is_definite(W: CsrMatrix) -> bool:
    """Whether the symmetric part of ``W`` is positive definite beyond rounding."""
    if not (W.diagonal() > 0).all():
        return False
    for block in _split_islands(W):
        diagonal, m = np.diag(block), len(block)
        unit = block / np.sqrt(np.outer(diagonal, diagonal))
        # L Lᵀ of a matrix with unit diagonal has an error of (m + 1) ε in each entry.
        shift = 2 * m * (m + 1) * np.finfo(float).eps
        try:
            np.linalg.cholesky(unit - shift * np.eye(m))
        except np.linalg.LinAlgError:
            return False
    return True


def _is_semidefinite(W: CsrMatrix) -> bool:
    values = np.concatenate([np.linalg.eigvalsh(b) for b in _split_islands(W)])
    return bool(values.min(initial=0.0) >= -1e-10 * np.abs(values).max(initial=0.0))


def _decide_normal(columns: SparseMatrix, load: Floats) -> _core.Decision:
    """Whether normal reactions, in rows of ``columns``, balance loads on its columns."""
    count = columns.shape[0]
    half_lines = np.ones(count, int), np.zeros(count), np.zeros(count)
    return statics_of_rows(columns, *half_lines).decide(load)


def _find_overlap(core: _core.Reduced, p: _Scaled) -> Floats | None:
    """Find ``λ >= 0`` with ``λ·W_n = 0``, ``λ·R_n = 0``, ``λ·q_n < 0``."""
    from scipy.sparse import hstack

    if not p.size:
        return None
    q = p.q[p.normal][:, None] / p.size
    columns = hstack([p.W[p.normal], p.R[p.normal], q])
    decision = _decide_normal(columns, np.append(np.zeros(columns.shape[1] - 1), 1.0))
    if decision.verdict != "balanced":
        return None
    # Amounts of unscaled displacements: the scaled ones are v times the scale.
    overlap = decision.reaction * p.scale / np.max(decision.reaction * p.scale)
    return overlap if core.is_contradiction(overlap) else None


def _find_inside(p: _Scaled) -> Floats | None:
    """A possible displacement with ``v_n > mu |v_t|`` at every contact."""
    from scipy.sparse import block_array, coo_array, diags_array, hstack

    contacts, d = len(p.mu), len(p.kept) // len(p.mu)
    size = p.size or 1.0
    # Back to all rows: the rows left out have mu = 0.
    span = coo_array(hstack([p.W, p.R]))
    rows = np.flatnonzero(p.kept)[span.coords[0]]
    span = coo_array((span.data, (rows, span.coords[1])), (len(p.kept), span.shape[1]))
    free = np.zeros(len(p.kept))
    free[p.kept] = p.q / size
    # (v_n - t, mu v_t) in the cones; the margin t is the last unknown, at most 1.
    by = np.ones((contacts, d))
    by[:, 1:] = p.mu[:, None]
    margin = coo_array(-np.tile(np.eye(1, d).T, (contacts, 1)))
    last = coo_array(-np.eye(d, 1))
    G = block_array([[diags_array(by.ravel()) @ span, margin], [None, last]])
    h = np.vstack([by * free.reshape(contacts, d), np.eye(1, d)])
    cost = np.append(np.zeros(span.shape[1]), -1.0)
    y = make_cone_set(G, h).minimise(cost)[0][:-1]
    v = (free + span @ y).reshape(contacts, d)
    open_by = v[:, 0] - p.mu * np.linalg.norm(v[:, 1:], axis=1)
    if open_by.min(initial=1.0) <= 1e-9 * (1 + np.abs(y).max(initial=0.0)):
        return None
    return np.asarray(v * size / p.scale[:, None], np.float64)


def _find_balanced(p: _Scaled) -> tuple[Floats | None, Floats | None]:
    """Find normal reactions that balance the loads, or a motion that they do not stop.

    Neither is returned if the reactions are larger than those of any solution.
    """
    # Rounding leaves a small component of a normal along which nothing can move a body.
    # Only reactions that are too large would balance the loads by it.
    columns = p.R[p.normal]
    columns.data[
        np.abs(columns.data) * _core.largest_reaction <= abs(p.motions).max()
    ] = 0
    decision = _decide_normal(columns, p.e)
    if decision.verdict == "none":
        return None, decision.motion
    most = _core.largest_reaction * max(float(np.linalg.norm(p.e)), p.size)
    if decision.verdict != "balanced" or decision.reaction.max() > most:
        return None, None
    return decision.reaction * p.scale, None


def make_dense(W: Floats | CsrMatrix) -> Floats:
    """``W`` as a dense array."""
    whole = W.toarray() if hasattr(W, "toarray") else W
    return np.asarray(whole, np.float64)


# Solutions whose relative displacements differ by less, relative to the largest, are the
# same: they are solved to 1e-12 and may lose some digits to conditioning.
_SAME = 1e-7


class Answers(Sequence[Solution]):
    """Solutions of one problem: a sequence of `Solution`.

    Attributes
    ----------
    complete
        Whether it is proved that there are no others. If the sequence is complete and
        empty, the problem has no solution.
    """

    def __init__(self, solutions: Sequence[Solution], *, complete: bool) -> None:
        self._solutions = tuple(solutions)
        self.complete = complete

    def __len__(self) -> int:
        return len(self._solutions)

    @overload
    def __getitem__(self, k: SupportsIndex) -> Solution: ...
    @overload
    def __getitem__(self, k: slice) -> tuple[Solution, ...]: ...
    def __getitem__(self, k: SupportsIndex | slice) -> Solution | tuple[Solution, ...]:
        return self._solutions[k]

    def __repr__(self) -> str:
        extent = "all there are" if self.complete else "there may be others"
        return f"Answers({len(self)} found, {extent})"


def search_answers(
    solve: Callable[[Floats | None], Solution],
    size: Floats,
    mu: Floats,
    dim: int,
    restarts: int,
    seed: int,
    moved: float,
) -> Answers:
    """Solve from many starts and collect the distinct solutions.

    There may be others.

    ``solve``: function of the reactions ``(n_c, d)`` to start from, or of None.
    ``size``: magnitudes of reactions to start from, ``(n_c,)``.
    ``mu``: friction coefficients, ``(n_c,)`` or ``(n_c, 2)``.
    ``dim, restarts, seed``: dimension, number of starts, and seed of the random starts.
    ``moved``: largest displacement that reactions cancel, if contacts stick.
    """
    solutions: list[Solution] = []
    rng = np.random.default_rng(seed)
    for start in _draw_starts(rng, size, mu, dim, restarts):
        solution = solve(start)
        if solution.converged and not any(
            _are_same(solution, s, moved) for s in solutions
        ):
            solutions.append(solution)
    return Answers(solutions, complete=False)


def _are_same(first: Solution, other: Solution, moved: float) -> bool:
    # Compare v: if W is singular, many reactions have the same v. If all contacts stick,
    # v is the rounding error of the cancelled displacements.
    apart = np.abs(first.relative_displacement - other.relative_displacement)
    sizes = (np.abs(s.relative_displacement).max(initial=0.0) for s in (first, other))
    return bool(apart.max(initial=0.0) <= _SAME * max(*sizes, moved))


def _draw_starts(
    rng: np.random.Generator, size: Floats, mu: Floats, dim: int, restarts: int
) -> Iterator[Floats | None]:
    """Starts: none; all contacts stick; all slip in one direction; then random ones."""
    yield None
    limits = (size * mu.T).T.reshape(len(size), -1)
    directions = np.vstack([np.zeros(dim - 1), np.eye(dim - 1), -np.eye(dim - 1)])
    for direction in directions:
        yield np.column_stack([size, limits * direction])
    for _ in range(max(restarts - 1 - len(directions), 0)):
        pressed = size * (rng.random(len(size)) < 0.7) * 10 ** rng.uniform(-1, 1)
        side = rng.normal(size=(len(size), dim - 1))
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        # Half of the starts are inside the cone, half on its boundary.
        share = np.minimum(2 * rng.random(len(size)), 1.0)
        reach = (share * pressed * mu.T).T.reshape(len(size), -1)
        yield np.column_stack([pressed, reach * side])
