"""Check the reference answers of a collection without the solvers of this package.

Sums are `numpy.longdouble`, and the law is that of textbooks, (6) and (8). The forward error
of an answer is estimated by one step of Newton's method for its statuses.
"""

from __future__ import annotations

import itertools
import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse.linalg import splu

from bipot_rs._lib.types import Bools, Floats
from bipot_rs.fclib import Vectors, read, read_guesses, read_solution
from bipot_rs.files.drafts import place
from collection import manifest
from collection.manifest import Row
from collection.system import System, system

Long = NDArray[np.longdouble]
# What the references promise, relative to the largest reaction or displacement.
ERROR = 1e-12
# Stored numbers are rounded once: each term of a sum has half a unit, and products of two
# stored numbers one.
_ROUNDING = 8 * float(np.finfo(np.float64).eps)
# Answers are different if a displacement differs by more, relative to the largest.
_DIFFERENT = 1e-6
# Share of |q| |r| that proves negative work: more than the rounding of q.
_WORK = 1e-6
_RANK = 1e-11
_DENSE = 0.2


class Checked(NamedTuple):
    """What the check of a file found.

    Attributes
    ----------
    file
        Its name.
    error
        Largest estimated forward error of its answers; 0 without answers.
    faults
        What is wrong, in sentences; empty if the file is right.
    """

    file: str
    error: float
    faults: list[str]


def check(
    folder: str | os.PathLike[str],
    *,
    on_file: Callable[[Checked], object] | None = None,
) -> list[Checked]:
    """Check every file of a collection: its answers, or the proof that there is none.

    Parameters
    ----------
    folder
        Where `generate` has written a collection.
    on_file
        Called with what was found for each file.

    Raises
    ------
    FileNotFoundError, ValueError
        There is no manifest, or it cannot be read. A file that cannot be read is a fault
        in the list instead.
    """
    target, checked_files = place(folder), []
    for row in manifest.read(target):
        try:
            checked_file = _checked(target / row.file, row)
        except (OSError, ValueError) as error:
            checked_file = Checked(row.file, np.inf, [str(error)])
        checked_files.append(checked_file)
        if on_file is not None:
            on_file(checked_file)
    return checked_files


def _checked(path: Path, row: Row) -> Checked:
    p = system(read(path))
    solution, guesses = read_solution(path), read_guesses(path)
    if not row.answers:
        faults = (
            [] if solution is None else ["there is an answer, but none was expected"]
        )
        if len(guesses) != 1:
            return Checked(row.file, 0.0, [*faults, "the proof is missing"])
        return Checked(row.file, 0.0, faults + _faults_of_proof(p, guesses[0]))
    answers = [*([] if solution is None else [solution]), *guesses]
    faults, errors = [], [0.0]
    if solution is None or len(answers) != row.answers:
        faults.append(f"{len(answers)} answers, expected {row.answers}")
    unique = row.determined == "r and u"
    for number, answer in enumerate(answers):
        faults_of_answer, error = _faults_of_answer(p, answer, unique=unique)
        errors.append(error)
        faults += [f"answer {number}: {fault}" for fault in faults_of_answer]
    for answer_of_pair, other in itertools.combinations(answers, 2):
        if (
            np.abs(answer_of_pair.u - other.u).max()
            <= _DIFFERENT * np.abs(answer_of_pair.u).max()
        ):
            faults.append("two answers are the same")
    return Checked(row.file, max(errors), faults)


def _faults_of_answer(
    p: System, answer: Vectors, *, unique: bool
) -> tuple[list[str], float]:
    """What is wrong with an answer, and its estimated forward error."""
    inner = answer.v if answer.v is not None else answer.multiplier
    y = np.zeros(p.E.shape[1]) if inner is None else inner
    r, u, y = (_long(x) for x in (answer.r, answer.u, y))
    v, force, terms, sums = _equations(p, r, y)
    faults = []
    if (np.abs(v - u.ravel()) > _ROUNDING * (terms + _sizes(u.ravel()))).any():
        faults.append("u is not W r + V l + q, or not Hᵀ v + w")
    if (np.abs(force) > _ROUNDING * sums).any():
        faults.append("the forces do not balance")
    closed = (r != 0).any(axis=1)
    slips = closed & (u[:, 1:] != 0).any(axis=1)
    faults += _faults_of_law(p, r, u, closed, slips, unique=unique)
    try:
        error = _forward_error(p, (r, u, y), (v, force), closed, slips, unique=unique)
    except (RuntimeError, ValueError, linalg.LinAlgError, linalg.LinAlgWarning):
        return [*faults, "the equations of its statuses are singular"], np.inf
    if not error <= ERROR:
        faults.append(f"its error is about {error:.1e}")
    return faults, error


def _long(a: Any) -> Any:
    return np.asarray(a).astype(np.longdouble)


def _equations(p: System, r: Long, y: Long) -> tuple[Long, Long, Long, Long]:
    """u, imbalance, and the sums of the absolute values of their terms."""
    W, E, M = (matrix.astype(np.longdouble) for matrix in (p.W, p.E, p.M))
    flat = r.ravel()
    v, force = W @ flat + E @ y + p.q, E.T @ flat + p.s - M @ y
    large_r, large_y = _sizes(flat), _sizes(y)
    terms = abs(W) @ large_r + abs(E) @ large_y + abs(p.q)
    sums = abs(E).T @ large_r + abs(p.s) + abs(M) @ large_y
    return v, force, terms, sums


def _sizes(a: Long) -> Long:
    """Absolute values, with room for the grid of stored numbers, 2⁻⁷⁵ of the largest."""
    return np.asarray(abs(a) + 2.0**-22 * abs(a).max(initial=0))


def _length(a: Long) -> Long:
    return np.asarray(np.sqrt((a * a).sum(axis=1)))


def _faults_of_law(
    p: System, r: Long, u: Long, closed: Bools, slips: Bools, *, unique: bool
) -> list[str]:
    """Violations of (6) and (8) by stored numbers, beyond their rounding."""
    limit, friction, slip = p.mu * r[:, 0], _length(r[:, 1:]), _length(u[:, 1:])
    # Redundant reactions are those of a solver.
    allowed = _ROUNDING * limit + (0 if unique else ERROR * np.abs(r).max())
    power = (r[:, 1:] * u[:, 1:]).sum(axis=1)
    tests = {
        "a contact pulls": r[:, 0] < 0,
        "a contact penetrates": u[:, 0] < 0,
        "a pressed contact is open": closed & (u[:, 0] != 0),
        "friction is too large": friction > limit + allowed,
        "a sliding contact has too little friction": slips
        & (friction < limit - allowed),
        "friction does not oppose slip": power > -(1 - _ROUNDING) * friction * slip,
    }
    # Without friction or slip the last inequality is 0 > 0.
    return [fault for fault, violated in tests.items() if violated.any()]


def _forward_error(
    p: System,
    answer: tuple[Long, Long, Long],
    equations: tuple[Long, Long],
    closed: Bools,
    slips: Bools,
    *,
    unique: bool,
) -> float:
    """Size of Newton's correction, for u relative to the largest of u, q, W r and E y."""
    (r, u, y), (v, force) = answer, equations
    at = np.flatnonzero(closed)
    rows = (p.d * at[:, None] + np.arange(p.d)).ravel()
    law, by_r, by_v = _law(r[at], v.reshape(r.shape)[at], slips[at], p.mu[at])
    left = sparse.block_diag([*by_v, np.zeros((0, 0))], format="csr")
    E = p.E[rows]
    by_reaction = sparse.block_diag([*by_r, np.zeros((0, 0))], format="csr")
    J = sparse.bmat([[by_reaction + left @ p.W[rows][:, rows], left @ E], [E.T, -p.M]])
    step = -_solve(sparse.csr_array(J), np.append(law.ravel(), force), unique=unique)
    moved = np.zeros(r.size)
    moved[rows] = step[: len(rows)]
    inner = step[len(rows) :]
    flat = r.ravel().astype(np.float64)
    change = p.W @ moved + p.E @ inner + (v - u.ravel()).astype(np.float64)
    length = p.length(flat, y.astype(np.float64), u.ravel().astype(np.float64))
    error = float(np.abs(change).max(initial=0.0)) / length
    if not unique or not len(at):
        return error
    return max(error, float(np.abs(moved).max() / np.abs(flat).max()))


def _law(r: Long, u: Long, slips: Bools, mu: Floats) -> tuple[Long, Floats, Floats]:
    """Equations of closed contacts and their derivatives by r and by u."""
    count, d = r.shape
    speed = np.where(slips, _length(u[:, 1:]), 1)
    along = np.where(slips[:, None], u[:, 1:] / speed[:, None], 0)
    sticks = ~slips & (mu > 0)
    limit = mu * r[:, 0]
    sliding = np.concatenate([u[:, :1], r[:, 1:] + limit[:, None] * along], axis=1)
    law = np.where(sticks[:, None], u, sliding)
    by_r, by_u = np.zeros((2, count, d, d))
    by_r[:, 1:, 1:], by_u[:, 0, 0] = np.eye(d - 1), 1
    t = along.astype(np.float64)
    by_r[:, 1:, 0] = mu[:, None] * t
    turn = np.where(slips[:, None, None], np.eye(d - 1) - t[:, :, None] * t[:, None], 0)
    if d == 3:  # in the plane slip has no direction that could turn
        by_u[:, 1:, 1:] = (limit / speed).astype(np.float64)[:, None, None] * turn
    by_r[sticks], by_u[sticks] = 0.0, np.eye(d)
    return law, by_r, by_u


def _solve(J: Any, right: Long, *, unique: bool) -> Floats:
    """Solve in float64, with rows and columns scaled to a largest entry of 1."""
    if not J.shape[0]:
        return np.zeros(0)
    rows = 1 / np.maximum(abs(J).max(axis=1).toarray().ravel(), 1e-300)
    J = sparse.csr_array(J.multiply(rows[:, None]))
    columns = 1 / np.maximum(abs(J).max(axis=0).toarray().ravel(), 1e-300)
    J = sparse.csc_array(J.multiply(columns))
    scaled = (right * rows).astype(np.float64)
    with warnings.catch_warnings():
        # A zero pivot, which leaves no number that could be judged.
        warnings.simplefilter("error", linalg.LinAlgWarning)
        if not unique:
            solution = linalg.lstsq(J.toarray(), scaled, cond=_RANK)[0]
        elif J.nnz > _DENSE * J.shape[0] ** 2:
            solution = linalg.lu_solve(linalg.lu_factor(J.toarray()), scaled)
        else:
            solution = splu(J).solve(scaled)
    return np.asarray(columns * solution, np.float64)


def _faults_of_proof(p: System, proof: Vectors) -> list[str]:
    """What is wrong with a proof that there is no answer."""
    amplitudes = (
        np.zeros(p.E.shape[1]) if proof.multiplier is None else proof.multiplier
    )
    r, y = _long(proof.r), _long(amplitudes)
    E, W = p.E.astype(np.longdouble), p.W.astype(np.longdouble)
    if not np.any(r):
        u, terms = (E @ y).reshape(r.shape), (abs(E) @ abs(y)).reshape(r.shape)
        inside = u[:, 0] - p.mu * _length(u[:, 1:])
        work, size = p.s @ y, abs(p.s) @ abs(y)
        faults = []
        if (inside <= _ROUNDING * (1 + p.mu) * terms.sum(axis=1)).any():
            faults.append("the motion is not inside every dual cone")
        if work <= _ROUNDING * size:
            faults.append("the loads do no work on the motion")
        return faults
    flat = r.ravel()
    faults = []
    if (r[:, 0] < 0).any() or (r[:, 1:] != 0).any():
        faults.append("the forces are not normal reactions")
    if (abs(W @ flat) > _ROUNDING * (abs(W) @ abs(flat))).any():
        faults.append("the forces move a contact")
    if (abs(E.T @ flat) > _ROUNDING * (abs(E).T @ abs(flat))).any():
        faults.append("the forces do not balance")
    if p.q @ flat >= -_WORK * (abs(p.q) @ abs(flat)):
        faults.append("the forces do no negative work on q")
    return faults


def summary(found: Sequence[Checked]) -> str:
    """One sentence about all files."""
    wrong = sum(bool(file.faults) for file in found)
    error = max((file.error for file in found), default=0.0)
    right = f"{len(found) - wrong} of {len(found)} files are right"
    return f"{right}; the largest estimated error is {error:.1e}"
