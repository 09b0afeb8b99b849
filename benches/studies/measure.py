"""Solve a case and compare it with its exact solution: a row of the table of a study."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import bipot_rs as bp
from studies import exact
from studies.exact import EPS, Array, Case, Exact

# Tolerance of the solver, so small that rounding limits the result.
TOL = 1e-14
NAN = float("nan")
# `LoadPath` corrects with K if W has lost more than this, in ε.
CORRECTED = 1e5
# Violations of the law below this are due to η and the condition of W.
LAWFUL = 1e-12
# Number of contacts above which W is not computed a second time for the bounds.
LARGE = 3000


class Answer(NamedTuple):
    """Reactions and relative displacements ``(n_c, d)``, displacements ``(n,)``."""

    r: Array
    v: Array
    u: Array


@dataclass(frozen=True)
class Row:
    """Errors, their bounds, and the work, at one value of the parameter.

    ``error_*`` is against the closed form, or against the exact solution of the same body
    in other units, whose K is rounded differently; ``own_*`` is against the exact solution
    of the given matrices. Both are relative to the largest r and u; v, which may vanish,
    to the largest u or gap. ``bound_*`` is that of `bounds`, without a constant. ``law`` is
    the largest violation of (1), (6) and (8). If the solver refuses the case, `outcome`
    is the name of the error and the numbers are NaN.
    """

    case: str
    parameter: float
    unknowns: int
    contacts: int
    outcome: str = "converged"
    error_r: float = NAN
    error_v: float = NAN
    error_u: float = NAN
    own_r: float = NAN
    own_v: float = NAN
    own_u: float = NAN
    bound_r: float = NAN
    bound_v: float = NAN
    bound_u: float = NAN
    law: float = NAN
    statuses_right: bool = False
    iterations: int = 0
    products: float = NAN
    residual: float = NAN
    cond_S: float = NAN
    bytes: int = 0


COLUMNS = tuple(field.name for field in fields(Row))


def row(
    name: str,
    parameter: float,
    case: Case,
    closed: Answer | None = None,
    *,
    twin: tuple[Case, float] | None = None,
    statuses: NDArray[np.int8] | None = None,
    exactly: bool = True,
    data: float = 0.0,
) -> Row:
    """Solve a case, compare, and return the row.

    Parameters
    ----------
    name, parameter
        Name of the case, value of the parameter.
    case
        The problem, with one load step.
    closed
        Closed form of the solution, if there is one.
    twin
        Without a closed form: the case in other units of force, and that unit.
    statuses
        Statuses of the closed form. Without them the inequalities of the law, tested on
        the exact solution, decide whether the statuses are right.
    exactly
        Whether to compute the exact solution: not possible with slip in 3D.
    data
        Relative error of the solution due to data other than K, B and loads.
    """
    sizes = (name, parameter, len(case.load), len(case.mu))
    try:
        problem, step = solved(case)
    except bp.BipotError as error:
        return Row(*sizes, outcome=type(error).__name__)
    answer_of_row = Answer(step.reaction, step.relative_displacement, step.displacement)
    stats = problem.stats
    at_island = 8 * case.gap.size**2 // max(stats["islands"], 1)
    work = Row(
        *sizes,
        law=violation(case, answer_of_row),
        iterations=int(step.iterations),
        products=float(step.work),
        residual=float(step.residual),
        cond_S=float(stats["cond_S"]),
        bytes=int(stats["bytes_peak"] + at_island),
    )
    agree = statuses is None or np.array_equal(step.status, statuses)
    if closed is not None:
        work = replace(work, **named("error", against(answer_of_row, closed, case)))
    if not exactly:
        # A wrong status violates the law by more than this.
        return replace(work, statuses_right=bool(agree and work.law <= LAWFUL))
    right = exact.solve(case, step.status, step.slip)
    errors_of_row = right.errors(*answer_of_row)
    if closed is None and twin is not None:
        other, unit = twin
        theirs = exact.solve(other, step.status, step.slip)
        work = replace(
            work, **named("error", against(answer_of_row, answer(theirs, unit), case))
        )
    elif closed is None:
        work = replace(work, **named("error", errors_of_row))
    return replace(
        work,
        statuses_right=bool(right.lawful and agree),
        **named("own", errors_of_row),
        **named("bound", bounds(right, problem, work.residual, data)),
    )


def solved(case: Case) -> tuple[bp.ContactProblem, bp.Step]:
    """Problem of a case, and its solution."""
    dim = case.gap.shape[1]
    problem = bp.ContactProblem(
        case.K, case.B, gap=case.gap, mu=case.mu, fixed=case.fixed, dim=dim
    )
    return problem, problem.solve(case.load, case.prescribed, tol=TOL)[0]


def named(prefix: str, values: tuple[float, float, float]) -> dict[str, float]:
    """Fields of a row with a common prefix."""
    return {f"{prefix}_{x}": y for x, y in zip("rvu", values, strict=True)}


def answer(right: Exact, unit: float = 1.0) -> Answer:
    """Exact solution, rounded, with forces divided by ``unit``."""
    shape = right.case.gap.shape
    r, v, u = (exact.to_floats(x) for x in (right.r, right.v, right.u))
    return Answer(r.reshape(shape) / unit, v.reshape(shape), u)


def bounds(
    right: Exact, problem: bp.ContactProblem, residual: float, data: float = 0.0
) -> tuple[float, float, float]:
    """Effect of rounding on r, v and u, to first order and for the worst signs.

    Three things are rounded. The data: ``ε |A⁻¹| (|A||z| + |b|)`` of `Exact.condition`.
    The reactions, from which v and u are computed: ``ε |W||r|``. And W, the inverse of
    S, which is a difference of matrices of the size of the contact block of K: its error
    is ``W δS W``, ``|δS| ≤ ε max K_cc``, unless that exceeds 1e5 ε of W, where the
    solution is corrected with K. In addition the law holds to the residual η of (13), so
    that the error of ``v_i`` is ``η ‖r̂‖ / D_i``; if a large μ lifts the floor of η
    above the tolerance, the tolerance counts, because only v is multiplied by μ.
    `data` is the relative error of other data.
    """
    case, contacts = right.case, len(right.case.mu)
    if contacts > LARGE or not contacts:
        return tuple(EPS * x for x in right.condition())  # type: ignore[return-value]
    W, d = np.abs(problem.compliance), case.gap.shape[1]
    r, u = np.abs(exact.to_floats(right.r)), np.abs(exact.to_floats(right.u))
    of_r = W @ r
    # 1 / D_i of (15), one for each component.
    each = np.repeat(np.sqrt(W.diagonal().reshape(-1, d).sum(axis=1) / d), d)
    passed = min(residual, TOL) / EPS * np.linalg.norm(r * each) * each
    touched = np.unique(abs(case.B).indices)
    stiffest = float(case.K.diagonal()[touched].max())
    if stiffest * W.sum(axis=0).max() <= CORRECTED:
        passed += stiffest * (W @ of_r)
    size = float(u.max())
    length = max(size, largest(case.gap))
    at_r, at_v, at_u = right.condition(passed)
    off = float(of_r.max())
    return (
        EPS * (1 + at_r) + data,
        EPS * (1 + at_v + off / length),
        EPS * (1 + at_u + off / size) + data,
    )


def violation(case: Case, found: Answer) -> float:
    """Largest violation of equilibrium and of the law, in extended precision.

    Equilibrium is relative to ``|K||u|`` and the forces; the law, in its textbook
    inequalities, is relative to the largest r, and u or gap.
    """
    long = np.longdouble
    u, r, v = (np.asarray(x, long) for x in (found.u, found.r, found.v))
    free = np.setdiff1d(np.arange(len(u)), case.fixed)
    push = long_product(case.B.T, r.ravel())
    left = (case.load + push - long_product(case.K, u))[free]
    size = largest(abs(case.K) @ np.abs(found.u)) + largest(case.load)
    worst = largest(left) / (size or 1)
    if not len(r):
        return worst
    r, v = r / (largest(r) or 1), v / (max(largest(u), largest(case.gap)) or 1)
    r_t, v_t = np.sqrt((r[:, 1:] ** 2).sum(1)), np.sqrt((v[:, 1:] ** 2).sum(1))
    power = np.abs((r[:, 1:] * v[:, 1:]).sum(1) + case.mu * r[:, 0] * v_t)
    parts = [
        -r[:, 0],
        -v[:, 0],
        (r_t - case.mu * r[:, 0]) / np.maximum(1, case.mu),
        np.abs(r[:, 0] * v[:, 0]),
        power / np.maximum(1, case.mu),
    ]
    return max(worst, *(float(x.max()) for x in parts))


def long_product(A: Any, x: NDArray[np.longdouble]) -> NDArray[np.longdouble]:
    """``A x`` of a sparse matrix in extended precision."""
    A = A.tocoo()
    out = np.zeros(A.shape[0], np.longdouble)
    np.add.at(out, A.row, A.data.astype(np.longdouble) * x[A.col])
    return out


def against(found: Answer, closed: Answer, case: Case) -> tuple[float, float, float]:
    """Errors against a closed form, relative as in `Row`."""
    force, size = largest(closed.r), largest(closed.u)
    length = max(size, largest(case.gap))
    sizes = (force, length, size)
    return tuple(  # type: ignore[return-value]
        largest(x - y) / (z or 1) for x, y, z in zip(found, closed, sizes, strict=True)
    )


def largest(x: Any) -> float:
    """Largest absolute entry; 0 if there is none."""
    return float(np.abs(x).max(initial=0))


def powers(first: int, last: int, each: int = 1) -> Iterable[float]:
    """Powers of ten, each the double nearest to its decimal."""
    return [float(f"1e{k}") for k in range(first, last + 1, each)]
