"""Springs that the iterative engine adds to K, and multipliers that remove what they change.

Degrees of freedom without stiffness, such as those of a rigid obstacle under a force, get a
spring k each, so that the diagonal of K is positive. With the load ``f + k a⁰``, a solution with
``a = a⁰`` is a solution without springs. The iteration ``a⁰ ← a``, the proximal point method,
converges by a factor of ``k / (k + s)`` with the stiffness s of the bodies under the obstacle.

A contact needs a node of its own. One whose nodes have other contacts too, or are held along
a direction that is neither its normal nor a tangent, gets a copy of the displacement of one of
its sides, on springs k to that side. With ``e = G u`` the elongation and the load ``Gᵀ m``, a
solution with ``e = 0`` is a solution without springs. The iteration ``m ← m - k e``, the method of
multipliers, converges by a factor of ``1 / (1 + k w)`` with the compliance w at the contact.
Secants of the iterations before make both faster (Anderson).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import Parts
from bipot_rs.contact import tuning
from bipot_rs.contact.law.status import Outcome
from bipot_rs.contact.results.solution import Step

# A row smaller than this, relative to the other tangent of its contact, is rounding.
_ROUNDING = 64 * np.finfo(float).eps
# Compliance of a direction, relative to the largest, that supports hold, and the least that a
# spring follows: a stiffer spring would spoil the preconditioner.
_HELD, _STIFFEST = 1e-6, 1e-3


@dataclass(frozen=True)
class Springs:
    """Springs of the core, each with the row that gives its elongation."""

    place: Ints  # number of each degree of freedom in the core, (n,)
    rows: CsrMatrix  # the elongations of displacements of the core, (m, n')
    stiffness: Floats  # k, (m,)
    contacts: Ints  # contacts with a copy, (m_c,); their rows are the last ones
    # S, (m_c, d, d): a copy c has the relative displacement S c, but for other bodies.
    blocks: Floats

    @classmethod
    def find(
        cls, parts: Parts, fixed: Ints, d: int, num_threads: int | None = None
    ) -> Springs:
        """The springs of degrees of freedom that K, by rows, does not hold."""
        start, _, value = parts
        # The largest entry of a positive semidefinite matrix is on its diagonal, and a row
        # with a zero there is zero.
        diagonal = _core.diagonal(parts, num_threads)
        bare = diagonal == 0.0
        bare[fixed] = False
        zero = np.flatnonzero(bare).tolist()
        dofs = [i for i in zero if not value[start[i] : start[i + 1]].any()]
        largest = float(diagonal.max(initial=0.0))
        return cls.hold(dofs, tuning.LOOSE_SPRING * largest, len(diagonal), d)

    @classmethod
    def hold(cls, dofs: Sequence[int], stiffness: float, n: int, d: int) -> Springs:
        """A spring at each of some of n degrees of freedom."""
        from scipy.sparse import csr_array

        entries = np.ones(len(dofs)), (np.arange(len(dofs)), dofs)
        return cls(
            np.arange(n),
            csr_array(entries, shape=(len(dofs), n)),
            np.full(len(dofs), stiffness),
            np.zeros(0, np.int64),
            np.zeros((0, d, d)),
        )

    def with_copies(
        self,
        place: Ints,
        body: Ints,
        stiffness: Floats,
        operator: CsrMatrix,
        contacts: Sequence[int],
        fixed: Ints,
    ) -> tuple[Springs, CsrMatrix]:
        """The springs with those of copies at some contacts, and the rows of B with the copies.

        Contacts whose sides do not move like a point get no copy.

        Parameters
        ----------
        place
            Place ``d node + component`` of each degree of freedom.
        body
            The body of each node.
        stiffness
            Diagonal of K.
        """
        from scipy.sparse import csr_array, vstack

        n, d = len(self.place), self.blocks.shape[1]
        diagonal, free = np.empty(n), np.ones(n, bool)
        diagonal[place], free[place[fixed]] = stiffness, False
        compliance = np.where(free, 1.0 / np.where(diagonal > 0, diagonal, np.inf), 0.0)
        soft = compliance.reshape(-1, d)
        B = csr_array(operator, copy=True)
        B.eliminate_zeros()
        made: list[int] = []
        blocks, entries, of_contacts, keys, added = [], [], [], [], []
        for i in contacts:
            side = _choose_side(B, i, d, place, body, soft)
            if side is None:
                continue
            S, weights, w = side
            first = n + d * len(made)
            for node, weight in weights.items():
                keys.append(i * n + node)
                entries += [(first - n + k, d * node + k, -weight) for k in range(d)]
            entries += [(first - n + k, first + k, 1.0) for k in range(d)]
            of_contacts += [
                (d * i + k, first + m, float(S[k, m])) for k, m in np.ndindex(d, d)
            ]
            added += list(tuning.COPY_SPRING / w)
            made.append(i)
            blocks.append(S)
        size = n + d * len(made)
        of_copies = _assemble(entries, (d * len(made), size))
        loose = self.rows.tocoo()
        of_loose = csr_array(
            (loose.data, (loose.row, place[loose.col])), shape=(loose.shape[0], size)
        )
        rows = csr_array(vstack([of_loose, of_copies], format="csr"))
        springs = Springs(
            place,
            rows,
            np.concatenate([self.stiffness, added]),
            np.array(made, np.int64),
            np.array(blocks).reshape(-1, d, d),
        )
        # The rows of B: the copied sides leave, the copies take their place.
        old = B.tocoo()
        column = place[old.col]
        kept = ~np.isin(old.row // d * n + column // d, keys)
        old = old.data[kept], (old.row[kept], column[kept])
        shape = B.shape[0], size
        changed = csr_array(csr_array(old, shape=shape) + _assemble(of_contacts, shape))
        changed.eliminate_zeros()
        return springs, changed

    def add_to(self, parts: Parts) -> Parts:
        """K with the springs, by the places of the core."""
        if not self.stiffness.size:
            return parts
        from scipy.sparse import csr_array, diags_array

        (start, column, value), (n, size) = parts, (len(self.place), self.rows.shape[1])
        if not np.array_equal(self.place, np.arange(n)):
            order = np.argsort(self.place)
            K = csr_array((value, self.place[column], start), shape=(n, n))[order]
            value, column, start = K.data, K.indices, K.indptr
        ends = np.full(size - n, len(value))
        K = csr_array((value, column, np.append(start, ends)), shape=(size, size))
        weighted = diags_array(self.stiffness) @ self.rows
        stiffened = csr_array(K + csr_array(self.rows.T @ weighted))
        stiffened.sort_indices()
        return (
            stiffened.indptr.astype(parts[0].dtype),
            stiffened.indices.astype(parts[1].dtype),
            stiffened.data,
        )

    def place_coordinates(self, coordinates: Floats | None) -> Floats | None:
        """Coordinates of all degrees of freedom of the core, those of copies included."""
        if coordinates is None or not self.contacts.size:
            return coordinates
        n, d = len(self.place), self.blocks.shape[1]
        at = np.zeros((self.rows.shape[1], coordinates.shape[1]))
        at[self.place] = coordinates
        # Weights are equal for all components.
        at[n:] = np.repeat((-(self.rows @ at)[-d * len(self.contacts) :: d]), d, axis=0)
        return at

    def spread(self, displacement: Floats) -> Floats:
        """Displacements ``(n,)`` with those of the copies, on springs without elongation."""
        n = len(self.place)
        moved = np.zeros(self.rows.shape[1])
        moved[self.place] = displacement
        moved[n:] = -(self.rows @ moved)[len(self.stiffness) - (len(moved) - n) :]
        return moved

    def solve(
        self,
        step: Callable[[Floats, bool, bool], tuple[Step, str]],
        load: Floats,
        reaction: Floats | None,
        displacement: Floats | None,
        tol: float,
        agreed: Callable[[tuple[Floats, float]], tuple[Floats, float]] = lambda mine: (
            mine
        ),
    ) -> tuple[Step, str]:
        """Iterate until the springs change nothing, relative to ``tol``.

        Parameters
        ----------
        step
            Solves the load step with the springs, for a load; once more from the last
            solution; without an estimate of its errors. It returns the step, and why it
            stalled if it did.
        load
            ``(n,)``.
        reaction, displacement
            Those of the step before, to start from.
        agreed
            The numbers of the first of several processes, which round alike only nearly.
        """
        copies = self.blocks.shape[1] * len(self.contacts)
        loose = slice(len(self.stiffness) - copies)
        copied = slice(loose.stop, None)
        force = np.zeros(self.rows.shape[1])
        force[self.place] = load
        multiplier = np.zeros(len(self.stiffness))
        iterates: list[tuple[Floats, Floats]] = []
        status, draft = None, copies > 0
        if displacement is not None:
            moved = self.rows @ self.spread(displacement)
            multiplier[loose] = (self.stiffness * moved)[loose]
        if reaction is not None:
            pressed = np.einsum("ckl,ck->cl", self.blocks, reaction[self.contacts])
            multiplier[copied] = -pressed.ravel()
        for count in range(tuning.SPRING_ITERATIONS):
            solved, reason = step(force + self.rows.T @ multiplier, count > 0, draft)
            if not solved.converged:
                return solved, reason
            after = self.stiffness * (self.rows @ solved.displacement)
            after[copied] = multiplier[copied] - after[copied]
            change = after - multiplier
            size = max(np.abs(load).max(), np.abs(solved.reaction).max(initial=0.0))
            settled = np.abs(change[loose]).max(initial=0.0) <= tol * size
            # Between the same statuses the change is affine in the multipliers: the secants
            # of the solutions before tell what is left of it, and where it vanishes.
            if status is None or (solved.status != status).any():
                iterates.clear()
            status = solved.status
            iterates.append((multiplier, change))
            M, F = (np.diff(np.column_stack(v)) for v in zip(*iterates, strict=True))
            shares = np.linalg.lstsq(F, change, rcond=tuning.LEAST_SECANT)[0]
            ahead = change - (M + F) @ shares
            left = max(float(np.linalg.norm(v[copied])) for v in (change, ahead))
            if left:
                left /= float(np.linalg.norm(solved.reaction)) or left
            ahead, left = agreed((ahead, left))
            if copies:
                # Without secants a change tells what is left only if it is small.
                limit = max(tol, solved.tolerance)
                settled &= left <= (limit if len(iterates) > 1 else 0.1 * limit)
            if settled and not draft:
                return self._complete(solved, change[copied], left), reason
            draft &= not settled
            multiplier = multiplier + ahead
        stalled = replace(
            self._complete(solved, change[copied], left), outcome=Outcome.STALLED
        )
        return stalled, (
            "the multipliers of contacts that share nodes do not settle"
            if copies
            else "the position of an obstacle under a force does not settle"
        )

    def _complete(self, step: Step, change: Floats, left: float) -> Step:
        """A step with the displacements and the errors of the problem without springs."""
        computed, errors = step.computed, step.computed.error_estimate
        if errors is not None and change.size:
            v = np.column_stack([step.relative_displacement[:, 0], step.slip])
            stretched = np.linalg.norm(change / self.stiffness[-len(change) :])
            size = float(np.linalg.norm(v))
            errors = errors[0] + left, errors[1] + float(stretched / (size or np.inf))
        moved = step.displacement[self.place]
        return replace(
            step,
            residual=max(step.residual, left),
            computed=replace(computed, displacement=moved, error_estimate=errors),
        )


def turn_tangents(
    operator: CsrMatrix, contacts: int, fixed: Ints
) -> tuple[Floats, CsrMatrix] | None:
    """Tangents in space along what supports leave free, by rotations ``(n_c, 3, 3)``, and their B.

    None if no contact needs it: where supports hold a tangential direction at a contact, this
    direction is a tangent.
    """
    from scipy.sparse import csr_array

    from bipot_rs._lib.matrices import block_diagonal

    free = csr_array(operator, copy=True)
    held = np.isin(free.indices, fixed)
    free.data[held] = 0.0
    first, second = free[1::3], free[2::3]
    a, b = (np.asarray((t * t).sum(axis=1)).ravel() for t in (first, second))
    both = np.asarray((first * second).sum(axis=1)).ravel()
    angle = 0.5 * np.arctan2(2.0 * both, a - b)
    rotation = np.tile(np.eye(3), (contacts, 1, 1))
    cos, sin = np.cos(angle), np.sin(angle)
    rotation[:, 1, 1], rotation[:, 1, 2] = cos, sin
    rotation[:, 2, 1], rotation[:, 2, 2] = -sin, cos
    across = csr_array(first * -sin[:, None] + second * cos[:, None])
    left = np.sqrt(np.asarray((across * across).sum(axis=1)).ravel())
    turned = (left <= _ROUNDING * np.sqrt(a + b)) & (a > 0) & (b > 0)
    if not turned.any():
        return None
    rotation[~turned] = np.eye(3)
    B = csr_array(block_diagonal(rotation) @ operator)
    row = np.repeat(np.arange(B.shape[0]), np.diff(B.indptr))
    rounding = turned[row // 3] & (row % 3 == 2) & ~np.isin(B.indices, fixed)
    B.data[rounding] = 0.0
    B.eliminate_zeros()
    B.sort_indices()
    return rotation, B


def number_by_nodes(n: int, d: int, coordinates: Floats | None) -> Ints:
    """Places ``d node + component``; those given may be numbered by components."""
    dof = np.arange(n)
    if coordinates is None:
        return dof
    at = coordinates.reshape(n // d, d, -1)
    if (at == at[:, :1]).all():
        return dof
    return d * (dof % (n // d)) + dof // (n // d)


def _assemble(
    entries: Sequence[tuple[object, object, object]], shape: tuple[int, int]
) -> CsrMatrix:
    """A matrix of entries (row, column, value)."""
    from scipy.sparse import csr_array

    row, column, value = np.array(entries).reshape(-1, 3).T
    made: CsrMatrix = csr_array((value, (row.astype(int), column.astype(int))), shape)
    return made


def find_bodies(parts: Parts, d: int, place: Ints) -> Ints:
    """The body of each node: nodes that K joins."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    n = len(parts[0]) - 1
    count, of_dof = connected_components(csr_array(parts[::-1], shape=(n, n)), False)
    node = place // d
    first = np.empty(n // d, np.int64)
    first[node] = of_dof
    joined = csr_array((np.ones(n), (of_dof, first[node])), shape=(count, count))
    return np.asarray(connected_components(joined, False)[1])[first]


def _choose_side(
    B: CsrMatrix, contact: int, d: int, place: Ints, body: Ints, soft: Floats
) -> tuple[Floats, dict[int, float], Floats] | None:
    """The softest side of a contact: its S, the weights of its nodes, and the compliance.

    This is that of the contact, along each component of the copy.
    """
    blocks: dict[int, Floats] = {}
    for k in range(d):
        part = slice(B.indptr[d * contact + k], B.indptr[d * contact + k + 1])
        for at, value in zip(place[B.indices[part]], B.data[part], strict=True):
            blocks.setdefault(int(at) // d, np.zeros((d, d)))[k, at % d] += value
    largest = max(blocks.values(), key=lambda block: float(np.abs(block).max()))
    several = len({body[node] for node in blocks}) > 1
    sides: dict[int, list[int]] = {}
    for node, block in blocks.items():
        # Two sides of one body have opposite signs.
        side = body[node] if several else int((block * largest).sum() > 0)
        sides.setdefault(side, []).append(node)
    best, most = None, 0.0
    for nodes in sides.values():
        S = np.sum([blocks[node] for node in nodes], axis=0)
        if np.linalg.cond(S) > tuning.MOST_OBLIQUE:
            continue
        shares = [np.linalg.solve(S, blocks[node]) for node in nodes]
        weights = {
            node: float(np.trace(N)) / d for node, N in zip(nodes, shares, strict=True)
        }
        off = max(
            float(np.abs(N - weights[node] * np.eye(d)).max())
            for node, N in zip(nodes, shares, strict=True)
        )
        compliance = sum(
            weight**2 * soft[node].sum() for node, weight in weights.items()
        )
        if off <= tuning.MOST_OBLIQUE * _ROUNDING and compliance > most:
            moved = [
                np.linalg.solve(S, b) ** 2 @ soft[node] for node, b in blocks.items()
            ]
            w = np.sum(moved, axis=0)
            # Nothing follows a multiplier along what supports hold on all sides.
            w = np.where(
                w > _HELD * w.max(), np.maximum(w, _STIFFEST * w.max()), w.max()
            )
            best, most = (S, weights, w), compliance
    return best
