"""The problems of a load path one after the other, each with its reference answers.

The slip history of a step is that of the reference answers of the steps before, in float64.
Each problem is therefore the same on all machines up to the rounding of W and q, and
complete without the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy import sparse

from bipot_rs._lib.types import Floats
from bipot_rs.contact.errors import NotConvergedError
from bipot_rs.contact.global_problem import GlobalProblem
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.reduced import ReducedProblem
from bipot_rs.contact.results.solution import Solution
from bipot_rs.fclib import Vectors
from collection.load_path import LoadPath, Proof
from collection.reference import Reference, refine
from collection.system import System, system

Problem = ReducedProblem | GlobalProblem
# Residual of the approximate answers: their statuses are then right unless a contact is
# this close to a change, and the reference corrects those.
TOLERANCE = 1e-12


class Step(NamedTuple):
    """A problem of the collection.

    Attributes
    ----------
    problem
        As in its file.
    answers
        Known answers; the path goes on from the first. Empty if there is none.
    complete
        Whether it is proved by enumeration that there are no other answers.
    proof
        A motion or forces that prove that there is no answer; see `LoadPath`.
    """

    problem: Problem
    answers: list[Reference]
    complete: bool
    proof: Vectors | None


def steps(path: LoadPath) -> Iterator[Step]:
    """Problem and reference answers of each load step.

    Raises
    ------
    NotConvergedError
        A problem that should have an answer is not solved.
    ArithmeticError
        There is no reference answer near the approximate one.
    """
    make = _global(path) if path.form == "global" else _local(path)
    # Displacement w of the node relative to the surface of the obstacle, (39) of theory.md.
    w = np.zeros(path.gap_of(0).shape)
    for k in range(path.steps):
        frame = _frames(path, k)
        before = w if frame is None else np.einsum("cij,cj->ci", frame, w)
        problem = make(k, before[:, 1:])
        if path.proof is not None and k == path.steps - 1:
            yield Step(problem, [], True, proved(path, problem, path.proof))
            return
        answers, complete = _answers(path, problem)
        yield Step(problem, answers, complete, None)
        w = before + answers[0].u
        if frame is not None and isinstance(path.gaps, MovingGaps):
            # The normal part is n · w: not an increment, and not the distance.
            now = path.gaps[k]
            lead = np.einsum("ci,ci->c", frame[:, 0], now.drag)
            w[:, 0] = answers[0].u[:, 0] - now.gap - lead
            w = np.einsum("cij,ci->cj", frame, w)


def _frames(path: LoadPath, step: int) -> Floats | None:
    """Frames ``(n_c, d, d)`` of a step, if these change along the path."""
    return path.gaps[step].frame if isinstance(path.gaps, MovingGaps) else None


def _local(path: LoadPath) -> Callable[[int, Floats], ReducedProblem]:
    condensed = ContactProblem(
        path.K,
        path.B,
        gap=path.gap_of(0),
        mu=path.mu,
        fixed=path.fixed,
        frame=path.frame,
        num_threads=1,
        engine="direct",
        working_set=False,
    )

    def make(step: int, tangential: Floats) -> ReducedProblem:
        gap = path.gap if path.gaps is None else path.gaps[step]
        reduced = condensed.reduced(path.load[step], path.prescribed[step], gap=gap)
        q = reduced.q.copy()
        q[:, 1:] -= tangential
        return ReducedProblem(reduced.W, q, path.mu, rigid=reduced.rigid)

    return make


def _global(path: LoadPath) -> Callable[[int, Floats], GlobalProblem]:
    """Problems with the prescribed degrees of freedom eliminated."""
    n = path.K.shape[0]
    free = np.setdiff1d(np.arange(n), path.fixed)
    K, B = sparse.csr_array(path.K), sparse.csr_array(path.B)
    M, H = K[free][:, free], sparse.csr_array(B[:, free].T)
    coupling, lead = K[free][:, path.fixed], B[:, path.fixed]

    def make(step: int, tangential: Floats) -> GlobalProblem:
        gap, moved = path.gap_of(step), path.prescribed[step]
        w = gap + (lead @ moved).reshape(gap.shape)
        w[:, 1:] -= tangential
        f = path.load[step][free] - coupling @ moved
        return GlobalProblem(M, H, f, w, path.mu)

    return make


def _answers(path: LoadPath, problem: Problem) -> tuple[list[Reference], bool]:
    whole, complete = system(problem), False
    if path.several and isinstance(problem, ReducedProblem):
        exhausted = problem.answers()
        answers, complete = list(exhausted), exhausted.complete
    else:
        answers = [problem.solve(tol=TOLERANCE, num_threads=1)]
    if not answers or not answers[0].converged:
        raise NotConvergedError(
            answers[0].message if answers else "no answer was found"
        )
    return [_reference(path, problem, whole, answer) for answer in answers], complete


def _reference(
    path: LoadPath, problem: Problem, whole: System, known: Solution
) -> Reference:
    if isinstance(problem, GlobalProblem):
        y = problem.velocity(known)
    else:
        y = np.zeros(0) if known.rigid_motion is None else known.rigid_motion
    return refine(whole, known.reaction, y, known.status, redundant=path.redundant)


def proved(path: LoadPath, problem: Problem, proof: Proof) -> Vectors:
    """Proof in the form of a file: ``r`` are forces, ``u = V l`` a motion."""
    rigid = problem.rigid if isinstance(problem, ReducedProblem) else None
    V, _ = rigid or (np.zeros((path.gap.size, 0)), None)
    u, r = np.zeros(path.gap_of(0).shape), np.zeros(path.gap_of(0).shape)
    amplitudes = np.zeros(V.shape[1])
    if proof.motion is not None:
        wanted = sparse.csr_array(path.B) @ proof.motion
        amplitudes = np.linalg.lstsq(V, wanted, rcond=None)[0]
        u = (V @ amplitudes).reshape(u.shape)
    if proof.forces is not None:
        r[:, 0] = proof.forces
    return Vectors(u, r, None, amplitudes)
