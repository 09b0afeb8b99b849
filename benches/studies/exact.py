"""Exact solution of a contact problem whose matrices are taken without rounding.

The statuses of an approximate solution turn (1), (2) and the law into a square linear
system for displacements and reactions, in 2D with slip and in 3D without: open ``r = 0``,
stick ``v = 0``, slip ``v_n = 0`` and ``r_t = -s μ r_n`` with the sign s of the slip. It is
solved by refinement: a factorisation in double precision, residuals in integers. Then the
inequalities of the law are tested, which reveals wrong statuses.

`Exact.condition` is the limit of any arithmetic with 53 bits. If each entry of the data has
a relative error ε, as the rounding of K alone causes, the solution has an error

    |z - z'| ≤ ε |A⁻¹| (|A||z| + |b|)                                      (Skeel)

to first order, and reaches that bound for some signs of the rounding errors.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]
Integers = NDArray[np.object_]
OPEN, SLIP, STICK = 0, 1, 2
EPS = float(np.finfo(float).eps)
# Bits after the binary point of exact numbers. Data with smaller bits are refused.
BITS = 400
# Smaller corrections leave errors below double precision.
ENOUGH = 1e-25
# Up to this order |A⁻¹| is formed; above it, its product is estimated.
DENSE = 800


@dataclass(frozen=True)
class Case:
    """Data of one load step, (1), (2), with the slip of earlier steps in `gap`.

    Attributes
    ----------
    K, B
        ``(n, n)``, ``(d n_c, n)``, sparse.
    load, gap, mu
        ``(n,)``, ``(n_c, d)``, ``(n_c,)``.
    fixed, prescribed
        Degrees of freedom and their values.
    """

    K: Any
    B: Any
    load: Array
    gap: Array
    mu: Array
    fixed: NDArray[np.int64]
    prescribed: Array


@dataclass(frozen=True)
class Exact:
    """Exact solution; integers are in units of ``2**-BITS``."""

    case: Case
    u: Integers
    r: Integers
    v: Integers
    lawful: bool
    A: Any
    b: Array
    lu: Any

    def errors(self, r: Array, v: Array, u: Array) -> tuple[float, float, float]:
        """Errors of r, v and u, relative to the largest r, u or gap, and u.

        v is a difference of u and gap and may vanish, so it is compared with those.
        """
        force = _largest(self.r)
        size = _largest(self.u)
        length = max(size, _largest(to_integers(self.case.gap.ravel())))
        pairs = ((r, self.r, force), (v, self.v, length), (u, self.u, size))
        return tuple(  # type: ignore[return-value]
            _ratio(_largest(to_integers(x.ravel()) - y), z) for x, y, z in pairs
        )

    def condition(self, at_contacts: Array | None = None) -> tuple[float, float, float]:
        """Skeel's condition numbers of r, v and u, relative as in `errors`.

        `at_contacts` ``(d n_c,)`` is a further error of v, in ε, where the law
        prescribes v.
        """
        case, n = self.case, self.case.K.shape[0]
        free = np.setdiff1d(np.arange(n), case.fixed)
        m, K, B = len(free), sparse.csr_array(case.K), sparse.csr_array(case.B)
        r, u = to_floats(self.r), to_floats(self.u)
        w = abs(self.A) @ np.abs(np.append(u[free], r)) + np.abs(self.b)
        # Part of the right side due to prescribed displacements.
        moved = np.abs(u)
        moved[free] = 0
        w[:m] += (abs(K) @ moved)[free]
        if at_contacts is not None:
            w[m:] += np.where(abs(self.A[m:, :m]).sum(axis=1) > 0, at_contacts, 0)
        of_B = abs(B) @ np.abs(u) + np.abs(case.gap.ravel())
        length = max(np.abs(u).max(), np.abs(case.gap).max(initial=0))
        pick = sparse.eye_array(len(self.b), format="csr")
        nothing = sparse.csr_array((len(r), len(r)))
        at_v = sparse.csr_array(sparse.hstack([B[:, free], nothing]))
        parts = (
            (self._amplification(pick[m:], w), np.abs(r).max(initial=0)),
            (self._amplification(at_v, w) + of_B.max(initial=0), length),
            (self._amplification(pick[:m], w), np.abs(u).max()),
        )
        return tuple(x / (size or 1) for x, size in parts)  # type: ignore[return-value]

    def _amplification(self, pick: Any, w: Array) -> float:
        """Largest entry of ``|P A⁻¹| w``, above `DENSE` unknowns by Hager's estimate."""
        if not pick.shape[0]:
            return 0.0
        if len(w) <= DENSE:
            return float((np.abs(pick @ self._inverse) @ w).max())
        return _hager(pick, self.lu, w)

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(self.lu.solve(np.eye(len(self.b))))


def _hager(pick: Any, lu: Any, w: Array) -> float:
    """Lower estimate of ``‖P A⁻¹ diag(w)‖_∞``, rarely below a third of it."""
    x = np.full(pick.shape[0], 1 / pick.shape[0])
    best = 0.0
    for _ in range(6):
        y = w * lu.solve(pick.T @ x, trans="T")
        value = float(np.abs(y).sum())
        z = pick @ lu.solve(w * np.where(y >= 0, 1.0, -1.0))
        best = max(best, value)
        at = int(np.argmax(np.abs(z)))
        if np.abs(z[at]) <= z @ x:
            break
        x = np.zeros_like(x)
        x[at] = 1
    return best


def solve(case: Case, status: NDArray[np.int8], slip: Array) -> Exact:
    """Exact solution with the given statuses and directions of ``slip (n_c, d-1)``.

    Raises
    ------
    ArithmeticError
        If refinement does not converge: A is singular to double precision.
    """
    n, (contacts, d) = case.K.shape[0], case.gap.shape
    free = np.setdiff1d(np.arange(n), case.fixed)
    u = np.zeros(n)
    u[case.fixed] = case.prescribed
    K, B = sparse.csr_array(case.K), sparse.csr_array(case.B)
    A, b = _system(case, status, slip, free)
    # The part of the right side due to prescribed displacements is exact.
    whole = to_integers(u)
    shift_K = _product(_exact(K), whole)[free]
    at_v = _product(_exact(B), whole)
    is_v = np.repeat(status != OPEN, d).reshape(contacts, d)
    is_v[:, 1:] &= (status != SLIP)[:, None]
    right = to_integers(b) << BITS
    right[: len(free)] -= shift_K
    right[len(free) :] -= np.where(is_v.ravel(), at_v, 0)

    lu = splu(sparse.csc_array(A))
    rows = _exact(A)
    z = np.zeros(len(b), dtype=object)
    m, last = len(free), np.inf
    for _ in range(60):
        residual = _floats(right - _product(rows, z), 2 * BITS)
        change = lu.solve(residual)
        z = z + to_integers(_cut(change))
        size = to_floats(z)
        moved = max(
            _share(change[:m], size[:m]),
            _share(change[m:], size[m:]),
        )
        if moved <= ENOUGH:
            break
        if not moved < 0.9 * last and moved < 1:
            raise ArithmeticError(
                f"refinement does not converge: relative correction {moved:g}"
            )
        last = moved
    else:
        raise ArithmeticError(
            f"refinement does not converge in 60 steps: relative correction {moved:g}"
        )
    whole[free] = z[:m]
    gap = to_integers(case.gap.ravel())
    v = (_product(_exact(B), whole) >> BITS) + gap
    lawful = _lawful(to_floats(z[m:]), to_floats(v), case, status, slip)
    return Exact(case, whole, z[m:], v, lawful, A, b, lu)


def _system(
    case: Case, status: NDArray[np.int8], slip: Array, free: NDArray[np.int64]
) -> tuple[Any, Array]:
    contacts, d = case.gap.shape
    if d > 2 and (status == SLIP).any() and case.mu.any():
        raise ValueError(
            "slip in 3D: the law is not linear; give statuses without slip"
        )
    kind = np.repeat(status[:, None], d, axis=1)
    normal = np.zeros((contacts, d), bool)
    normal[:, 0] = True
    moves = ((kind == STICK) | ((kind == SLIP) & normal)).ravel()
    # Rows of v = 0, then rows of the law of r.
    B_f = sparse.csr_array(case.B)[:, free]
    top = sparse.hstack([sparse.csr_array(case.K)[free][:, free], -B_f.T])
    of_u = sparse.diags_array(moves.astype(float)) @ B_f
    of_r = sparse.diags_array((~moves).astype(float)).tolil()
    for i in np.flatnonzero(status == SLIP):
        if case.mu[i] and d == 2:
            of_r[2 * i + 1, 2 * i] = np.sign(slip[i, 0]) * case.mu[i]
    A = sparse.vstack([top, sparse.hstack([of_u, of_r])]).tocsr()
    A.eliminate_zeros()
    A.sort_indices()
    b = np.append(case.load[free], np.where(moves, -case.gap.ravel(), 0.0))
    return A, b


def _lawful(
    r: Array, v: Array, case: Case, status: NDArray[np.int8], slip: Array
) -> bool:
    """Whether the inequalities of (6) and (8) hold; the equations were solved."""
    r, v = r.reshape(case.gap.shape), v.reshape(case.gap.shape)
    closed, slides, sticks = status != OPEN, status == SLIP, status == STICK
    # Rounding of the load and of u decides ties.
    force, length = 1e-13 * np.abs(r).max(initial=0), 1e-13 * np.abs(v).max(initial=0)
    r_t, along = np.linalg.norm(r[:, 1:], axis=1), (v[:, 1:] * np.sign(slip)).sum(1)
    with_friction = slides & (case.mu > 0)
    return bool(
        (r[closed, 0] >= -force).all()
        and (v[~closed, 0] >= -length).all()
        and (r_t[sticks] <= case.mu[sticks] * (r[sticks, 0] + force)).all()
        and (along[with_friction] >= -length).all()
    )


def to_integers(x: Array) -> Integers:
    """``x 2^BITS``; raises `ArithmeticError` if that is not an integer."""
    mantissa, exponent = np.frexp(np.asarray(x, float))
    whole = (mantissa * 2.0**53).astype(np.int64).astype(object)
    shift = exponent.astype(int) + (BITS - 53)
    if np.any((shift < 0) & (mantissa != 0)):
        raise ArithmeticError(f"a number has bits below 2^-{BITS}")
    return np.asarray(whole << np.maximum(shift, 0).astype(object), dtype=object)


def to_floats(x: Integers) -> Array:
    """Floating-point numbers from integers, rounded once."""
    return _floats(x, BITS)


def _floats(x: Integers, bits: int) -> Array:
    unit = 1 << bits
    return np.array([i / unit for i in x.tolist()], float)


def _cut(x: Array) -> Array:
    """Set numbers to zero that have bits below 2^-BITS."""
    return np.where(np.abs(x) >= 2.0 ** (54 - BITS), x, 0.0)


def _exact(A: Any) -> tuple[Integers, Any, Any]:
    A = sparse.csr_array(A)
    return to_integers(A.data), A.indices, A.indptr


def _product(A: tuple[Integers, Any, Any], x: Integers) -> Integers:
    """``A x`` in units of 2^-2BITS."""
    data, indices, indptr = A
    out = np.zeros(len(indptr) - 1, dtype=object)
    filled = np.flatnonzero(np.diff(indptr) > 0)
    if len(filled):
        out[filled] = np.add.reduceat(data * x[indices], indptr[filled])
    return out


def _largest(x: Integers) -> int:
    return max((abs(i) for i in x.tolist()), default=0)


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else float(part > 0)


def _share(part: Array, whole: Array) -> float:
    size = np.abs(whole).max(initial=0)
    return float(np.abs(part).max(initial=0) / size) if size else 0.0
