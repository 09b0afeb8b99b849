"""Decide whether a contact problem has a solution, without solving it.

The theorems are proved in section 10 of ``docs/theory.md``. This module searches for
witnesses; the core decides whether a witness is a proof.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import Bools, CsrMatrix, Floats
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.proof.cone_set import make_cone_set
from bipot_rs.contact.proof.equilibrium import statics_of_rows
from bipot_rs.contact.proof.existence_by_friction import is_held


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


@dataclass(frozen=True)
class _Scaled:
    """The problem in scaled variables, without the tangents of contacts without friction.

    ``W``, ``q`` and ``R`` have the rows ``kept``; ``normal`` marks the normal ones.
    ``motions`` is ``R`` with all rows; its columns are orthonormal. ``e`` are the loads on
    these columns.
    """

    W: Floats
    q: Floats
    R: Floats
    motions: Floats
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
    W: Floats,
    q: Floats,
    mu: Floats,
    rigid: tuple[Floats, Floats] | None,
    law: ContactLaw,
) -> Existence:
    """Give the verdict on ``v = W r + R a + q``, if some reaction balances the loads.

    ``core``: the problem, which decides whether a witness is a proof.
    ``W, q, mu, rigid``: as in `ReducedProblem`, dense, with isotropic friction.
    ``law``: the law, which has cohesion and dilatancy besides.
    """
    rubs = mu > 0 if law.cohesion is None else (mu > 0) | (law.cohesion > 0)
    p = _scale_problem(W, q, mu, rigid, rubs)
    symmetric = np.abs(p.W - p.W.T).max(initial=0.0) <= 1e-8
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
        pressure, rest = _find_balanced(core, p)
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
            and is_held(p.R[p.normal], p.R[~p.normal], p.e, mu, q.shape[1])
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
    W: Floats,
    q: Floats,
    mu: Floats,
    rigid: tuple[Floats, Floats] | None,
    rubs: Bools,
) -> _Scaled:
    contacts, d = q.shape
    matters = np.ones((contacts, d), bool)
    matters[:, 1:] = rubs[:, None]
    kept: Bools = matters.ravel()
    scale = find_scale(W, d)
    by_row = np.repeat(scale, d)
    R, e = (np.empty((len(kept), 0)), np.empty(0)) if rigid is None else rigid
    e = np.asarray(e, np.float64)
    if R.shape[1]:
        # Columns of unit length first: rotations have other units than translations.
        length = np.linalg.norm(R, axis=0)
        Q, T = np.linalg.qr(by_row[:, None] * R / length)
        R, e = Q, np.linalg.solve(T.T, e / length)
    return _Scaled(
        W=(W * np.outer(by_row, by_row))[np.ix_(kept, kept)],
        q=(q.ravel() * by_row)[kept],
        R=R[kept],
        motions=R,
        e=e,
        mu=mu,
        kept=kept,
        normal=(np.arange(contacts * d) % d == 0)[kept],
        scale=scale,
    )


def find_scale(W: Floats, d: int) -> Floats:
    """Factor of the displacements of each contact that makes its mean compliance 1."""
    compliance = np.diag(W).reshape(-1, d).mean(axis=1)
    positive = compliance > 0
    # A contact without compliance gets the median scale of the others.
    usual = float(np.median(compliance[positive])) if positive.any() else 1.0
    return np.asarray(1 / np.sqrt(np.where(positive, compliance, usual)))


def _is_definite(W: Floats) -> bool:
    """Whether the symmetric part of ``W`` is positive definite beyond rounding."""
    diagonal = np.diag(W)
    if not (diagonal > 0).all():
        return False
    m = len(W)
    unit = (W + W.T) / 2 / np.sqrt(np.outer(diagonal, diagonal))
    # L Lᵀ of a matrix with unit diagonal has an error of (m + 1) ε in each entry.
    shift = 2 * m * (m + 1) * np.finfo(float).eps
    try:
        np.linalg.cholesky(unit - shift * np.eye(m))
    except np.linalg.LinAlgError:
        return False
    return True


def _is_semidefinite(W: Floats) -> bool:
    values = np.linalg.eigvalsh((W + W.T) / 2)
    return bool(values.min(initial=0.0) >= -1e-10 * np.abs(values).max(initial=0.0))


def _find_overlap(core: _core.Reduced, p: _Scaled) -> Floats | None:
    """Find ``λ >= 0`` with ``λ·W_n = 0``, ``λ·R_n = 0``, ``λ·q_n < 0``."""
    from scipy.optimize import nnls

    if not p.size:
        return None
    q = p.q[p.normal] / p.size
    rows = np.vstack([p.W[p.normal].T, p.R[p.normal].T, q])
    try:
        amounts, _ = nnls(rows, np.append(np.zeros(len(rows) - 1), -1.0))
    except RuntimeError:  # its limit of iterations
        return None
    if not amounts.any():
        return None
    # Amounts of unscaled displacements: the scaled ones are v times the scale.
    overlap = amounts * p.scale / np.max(amounts * p.scale)
    return overlap if core.is_contradiction(overlap) else None


def _find_inside(p: _Scaled) -> Floats | None:
    """A possible displacement with ``v_n > mu |v_t|`` at every contact."""
    contacts, d = len(p.mu), len(p.kept) // len(p.mu)
    size = p.size or 1.0
    U, values, _ = np.linalg.svd(np.hstack([p.W, p.R]), full_matrices=False)
    U = U[:, values > 1e-12 * values.max(initial=0.0)]
    # Back to all rows: the rows left out have mu = 0.
    span = np.zeros((contacts * d, U.shape[1]))
    span[p.kept] = U
    free = np.zeros(contacts * d)
    free[p.kept] = p.q / size
    # (v_n - t, mu v_t) in the cones; the margin t is the last unknown, at most 1.
    by = np.ones((contacts, d))
    by[:, 1:] = p.mu[:, None]
    G = np.zeros((contacts + 1, d, U.shape[1] + 1))
    G[:-1, :, :-1] = by[..., None] * span.reshape(contacts, d, -1)
    G[:, 0, -1] = -1.0
    h = np.zeros((contacts + 1, d))
    h[:-1], h[-1, 0] = by * free.reshape(contacts, d), 1.0
    cost = np.append(np.zeros(U.shape[1]), -1.0)
    y = make_cone_set(G.reshape(h.size, -1), h).minimise(cost)[0][:-1]
    v = (free + span @ y).reshape(contacts, d)
    margin = v[:, 0] - p.mu * np.linalg.norm(v[:, 1:], axis=1)
    if margin.min(initial=1.0) <= 1e-9 * (1 + np.abs(y).max(initial=0.0)):
        return None
    return np.asarray(v * size / p.scale[:, None], np.float64)


def _find_balanced(
    core: _core.Reduced, p: _Scaled
) -> tuple[Floats | None, Floats | None]:
    """Find normal reactions that balance the loads, or a motion that they do not stop.

    Neither is returned if the reactions are larger than those of any solution.
    """
    # Rounding leaves a small component of a normal along which nothing can move a body.
    # Only reactions that are too large would balance the loads by it.
    columns = p.R[p.normal].copy()
    small = np.abs(columns) * _core.largest_reaction
    columns[small <= np.abs(p.motions).max(initial=0.0)] = 0.0
    count = len(columns)
    half_lines = np.ones(count, int), np.zeros(count), np.zeros(count)
    decision = statics_of_rows(columns, *half_lines).decide(p.e)
    if decision.verdict == "none":
        return None, decision.motion
    pressure = decision.reaction * p.scale
    return (pressure if core.balances(pressure) else None), None


def make_dense(W: Floats | CsrMatrix) -> Floats:
    """``W`` as a dense array."""
    whole = W.toarray() if hasattr(W, "toarray") else W
    return np.asarray(whole, np.float64)
