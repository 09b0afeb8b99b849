"""The directional derivative of one step, also at contacts on borders (30).

Contacts inside a status give a linear system. Each contact on a border gives a small
complementarity problem between its changes ``dr`` and ``dv``. The other contacts are
eliminated with springs in place of the border contacts: ``w dr + dv = z``, with ``w`` from
the diagonal of W. Both ``dr`` and ``dv`` are then linear in ``z``, and the side of each border
contact is found by an active-set iteration, or by trying all sides.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.messages import counted
from bipot_rs._lib.types import Floats, Ints
from bipot_rs.contact.errors import NotDifferentiableError
from bipot_rs.contact.sensitivity.borders import Borders
from bipot_rs.contact.sensitivity.laws import Laws, Point, laws, tangents
from bipot_rs.contact.sensitivity.response import Response, System, system
from bipot_rs.contact.status import Status

# Combinations of sides that are all tried, which also shows whether there are several
# answers.
_TRIED = 4096
_ITERATIONS = 100
# Violation of a complementarity condition, relative to the change of all border contacts,
# that counts as rounding.
_SATISFIED = 1e-9
# Relative difference of two answers, far above the rounding of both.
_SAME = 1e-6
# Singular values below this share of the largest one are rounding.
_RANK = 1e-13


@dataclass(frozen=True)
class Change:
    """Changes of the data of a step.

    Attributes
    ----------
    free : (n_c, d)
        ``dq``, with the change of the gap, less that of the slip before in its tangential
        components.
    balance : (k,)
        ``de``.
    friction : (n_c, d - 1)
        ``dD``.
    """

    free: Floats
    balance: Floats
    friction: Floats


class Linear:
    """The linearised problem of one step.

    Attributes
    ----------
    point
        Its solution.
    borders
        Contacts on borders.
    """

    def __init__(self, response: Response, point: Point, borders: Borders) -> None:
        self.response, self.point, self.borders = response, point, borders
        self._scale = np.sqrt(response.diagonal.mean(axis=1))
        self._movable = response.movable()
        self._reported: System | None = None

    @property
    def reported(self) -> System:
        """The system with each border contact on the side of its reported status."""
        if self._reported is None:
            self._reported = self._with(self.point.status, self.direction)
        return self._reported

    def adjoint(self) -> System:
        """`reported`, for gradients.

        Raises
        ------
        NotDifferentiableError
            It is singular, also with the contacts that just touch closed: reactions are
            then not determined beside this point.
        """
        touching = self.borders.touching & (self.point.status == Status.OPEN)
        if touching.any():
            side = self.point.status.copy()
            side[touching] = Status.SLIP
            side[touching & self.borders.resting] = Status.STICK
            self._with(side, self.direction)
        return self.reported

    @property
    def direction(self) -> Floats:
        """Direction of slip of each contact."""
        return tangents(self.point, self._scale)

    def laws(self, side: Ints, direction: Floats) -> Laws:
        """The law of each contact on a side of its borders."""
        return laws(self.point, side, direction, self._movable)

    def _with(self, side: Ints, direction: Floats) -> System:
        shape = self.point.reaction.shape
        made = self.laws(side, direction)
        return system(self.response, made, (shape[0], shape[1]))

    def change(self, of: Change) -> tuple[Floats, Floats]:
        """``dr (n_c, d)`` and ``da`` of a change of the data.

        Raises
        ------
        NotDifferentiableError
            There is no directional derivative, or several candidates for it.
        """
        direction = self.direction
        smooth = (self.point.friction[:, 0] == 0) & (self.point.reaction[:, 0] > 0)
        if smooth.any():
            direction = self._without_friction(smooth, direction, of.friction)
        if not self.borders.any.any():
            own = self.reported
            if smooth.any():
                own = System(
                    self.laws(self.point.status, direction), own.core, own.shape
                )
            return own.solve(_right(own.laws, of), -of.balance)
        return _Bordered(self, direction, of).solve()

    def _without_friction(
        self, smooth: np.ndarray, direction: Floats, change: Floats
    ) -> Floats:
        """The direction of the friction that begins at contacts without any."""
        asked = smooth & (change != 0).any(axis=1)
        if not asked.any():
            return direction
        if (change[asked] < 0).any():
            raise ValueError(
                f"mu of contact {int(np.flatnonzero(asked)[0])} is zero, and its direction "
                "is negative: friction coefficients cannot be negative"
            )
        still = asked & ~(self.point.slip != 0).any(axis=1)
        if still.any():
            raise NotDifferentiableError(
                f"mu of contact {int(np.flatnonzero(still)[0])} is zero and it does not "
                "slip: the direction of friction that begins there is not determined"
            )
        found = direction.copy()
        pushed = change[asked] * self.point.slip[asked]
        found[asked] = pushed / np.linalg.norm(pushed, axis=1)[:, None]
        return found


def _right(own: Laws, of: Change) -> Floats:
    """Right side of (28)."""
    at = own.contacts
    moved = np.einsum("ijk,ik->ij", own.by_v, of.free[at])
    rubbed: Floats = np.einsum("ijk,ik->ij", own.by_mu, of.friction[at])
    return rubbed - moved


class _Bordered:
    """The complementarity problem of the border contacts."""

    def __init__(self, linear: Linear, direction: Floats, of: Change) -> None:
        self.linear, self.of = linear, of
        self.point, known = linear.point, linear.borders
        self.at = np.flatnonzero(known.any)
        self.direction = direction
        self.resting, self.yielding = known.resting[self.at], known.yielding[self.at]
        d = self.point.reaction.shape[1]
        self.d, self.size = d, len(self.at) * d
        self._eliminate()
        # Each combination of sides that is tried is a list of these.
        self.sides = [self._sides_of(j) for j in range(len(self.at))]

    def _eliminate(self) -> None:
        """``dr``, ``da`` and ``dv`` of all contacts as affine functions of ``z``."""
        point, response, d = self.point, self.linear.response, self.d
        side = point.status.copy()
        side[self.at] = Status.STICK
        own = self.linear.laws(side, self.direction)
        place = np.searchsorted(own.contacts, self.at)
        springs = response.diagonal[self.at].mean(axis=1)
        own.by_r[place] = springs[:, None, None] * np.eye(d)
        own.by_v[place] = np.eye(d)
        own.by_mu[place] = 0.0
        shape = (len(point.reaction), d)
        made = system(response, own, shape)
        right = _right(own, self.of)
        self.base = made.solve(right, -self.of.balance)
        self.columns = []
        for i, k in itertools.product(place, range(d)):
            unit = np.zeros_like(right)
            unit[i, k] = 1.0
            self.columns.append(made.solve(unit, np.zeros_like(self.of.balance)))
        self.spring = np.repeat(springs, d)
        # dr = P z + p, dv = z - w dr at the border contacts.
        self.P = np.stack([dr[self.at].ravel() for dr, _ in self.columns], axis=1)
        self.p = self.base[0][self.at].ravel()

    def solve(self) -> tuple[Floats, Floats]:
        """``dr`` and ``da``."""
        found = self._iterate()
        count = np.prod([float(len(sides)) for sides in self.sides])
        if count <= _TRIED:
            found = self._only(found)
        if found is None:
            raise NotDifferentiableError(
                f"{counted(len(self.at), 'contact')} on a border between two statuses "
                f"(the first is contact {self.at[0]}): no change of their statuses was "
                "found that fits this direction, and the directional derivative is not "
                "known; change the load a little"
            )
        dr, da = self.base
        for amount, (by_dr, by_da) in zip(found, self.columns, strict=True):
            dr, da = dr + amount * by_dr, da + amount * by_da
        return self._exact(dr, found), da

    def _exact(self, dr: Floats, z: Floats) -> Floats:
        """Border contacts that open have exactly no reaction."""
        own = self._pair(z)[0]
        dr = dr.copy()
        dr[self.at] = own
        return dr

    def _pair(self, z: Floats) -> tuple[Floats, Floats]:
        """``dr`` and ``dv`` of the border contacts."""
        dr = self.P @ z + self.p
        return dr.reshape(-1, self.d), (z - self.spring * dr).reshape(-1, self.d)

    def _only(self, known: Floats | None) -> Floats | None:
        """The answer among all combinations of sides; raise if there are several."""
        for sides in itertools.product(*self.sides):
            matrix, right = self._matrix(list(sides))
            singular = _is_singular(matrix)
            if singular:
                # One of the answers, if there is any; all others differ by a null vector.
                z = np.linalg.lstsq(matrix, right, rcond=_RANK)[0]
                if _size(matrix @ z - right) > _SATISFIED * (_size(right) or 1.0):
                    continue
            else:
                z = np.linalg.solve(matrix, right)
            if self._violation(z) > _SATISFIED:
                continue
            if singular or (known is not None and self._differ(z, known)):
                raise NotDifferentiableError(
                    f"{counted(len(self.at), 'contact')} on a border between two statuses: "
                    "several changes of their statuses fit this direction, and the "
                    "reactions are not determined there"
                )
            known = z
        return known

    def _differ(self, z: Floats, known: Floats) -> bool:
        one, other = self._pair(z), self._pair(known)
        unit = np.sqrt(self.spring.reshape(-1, self.d))
        size = _size(other[0] * unit, other[1] / unit)
        apart = _size((one[0] - other[0]) * unit, (one[1] - other[1]) / unit)
        return apart > _SAME * size

    def _sides_of(self, j: int) -> list[tuple[int, Floats]]:
        """Sides of a border contact, each with a direction of slip."""
        p = self.direction[self.at[j]]
        if not self.resting[j]:
            first = Status.STICK if self.yielding[j] else Status.OPEN
            return [(int(first), p), (int(Status.SLIP), p)]
        ends = [(int(Status.OPEN), p), (int(Status.STICK), p)]
        ways = [np.eye(self.d - 1)[0], -np.eye(self.d - 1)[0]]
        return ends + [(int(Status.SLIP), way) for way in ways]

    def _matrix(self, sides: list[tuple[int, Floats]]) -> tuple[Floats, Floats]:
        """The equations of ``z`` with each border contact on one side."""
        matrix, right = np.zeros((self.size, self.size)), np.zeros(self.size)
        for j, (side, p) in enumerate(sides):
            by_r, by_v, known = self._law(j, side, p)
            rows = slice(self.d * j, self.d * (j + 1))
            own = self.P[rows]
            springs = self.spring[rows]
            matrix[rows] = (by_r - by_v * springs) @ own
            matrix[rows, rows] += by_v
            right[rows] = known - (by_r - by_v * springs) @ self.p[rows]
        scale = np.abs(matrix).max(axis=1)
        scale = np.where(scale > 0, scale, 1.0)
        return matrix / scale[:, None], right / scale

    def _at(self, sides: list[tuple[int, Floats]]) -> Floats | None:
        """``z`` with each border contact on one side; None if this is singular."""
        matrix, right = self._matrix(sides)
        if _is_singular(matrix):
            return None
        found: Floats = np.linalg.solve(matrix, right)
        return found

    def _law(self, j: int, side: int, p: Floats) -> tuple[Floats, Floats, Floats]:
        """``by_r dr + by_v dv = known`` of a border contact on one side."""
        d, i = self.d, self.at[j]
        by_r, by_v, known = np.zeros((d, d)), np.zeros((d, d)), np.zeros(d)
        if side == Status.OPEN:
            return np.eye(d), by_v, known
        by_v[0, 0] = 1.0
        if side == Status.STICK:
            return by_r, np.eye(d), known
        D, r_n = self.point.friction[i], self._normal(j)
        if D[0] == 0:
            by_r[1:, 1:] = np.eye(d - 1)
            return by_r, by_v, known
        by_r[1, 0], by_r[1, 1:] = 1.0, p / D
        known[1] = -r_n * (p * p / D) @ self.of.friction[i]
        if d == 3:
            across = np.array([-p[1], p[0]])
            if self.yielding[j]:
                by_v[2, 1:] = across * D
            else:
                by_r[2, 1:] = across / D
        return by_r, by_v, known

    def _normal(self, j: int) -> float:
        """``r_n``, which is zero at a contact that just touches."""
        return float(self.point.reaction[self.at[j], 0]) if self.yielding[j] else 0.0

    def _excess(self, j: int, dr: Floats) -> float:
        """``d(r_n - ‖D⁻¹ r_t‖)`` of a contact at the friction limit."""
        i = self.at[j]
        D, p = self.point.friction[i], self.direction[i]
        grown = dr[1:] / D + self._normal(j) * p * self.of.friction[i] / D
        return float(dr[0] + p @ grown)

    def _preferred(self, z: Floats) -> list[tuple[int, Floats]]:
        """The side on which the natural map puts each border contact."""
        dr, dv = self._pair(z)
        chosen = []
        for j, i in enumerate(self.at):
            w, p = self.spring[self.d * j], self.direction[i]
            D = self.point.friction[i]
            side = Status.SLIP
            if self.yielding[j]:
                slides = float(p @ (D * dv[j, 1:]))
                # D² w and w dr_n have the units of the slip D s.
                if w * float(D.max()) ** 2 * self._excess(j, dr[j]) >= slides:
                    side = Status.STICK
            elif w * dr[j, 0] <= dv[j, 0]:
                side = Status.OPEN
            elif self.resting[j]:
                pushed = w * dr[j] - dv[j]
                along = pushed[1:] / D
                far = float(np.linalg.norm(along))
                if far <= pushed[0]:
                    side = Status.STICK
                elif far > 0:
                    p = -along / far
            chosen.append((int(side), p))
        return chosen

    def _iterate(self) -> Floats | None:
        """Active-set iteration from some starts; None if it does not end."""
        for z in self._starts():
            for _ in range(_ITERATIONS):
                after = self._at(self._preferred(z))
                if after is None:
                    break
                change = _size(after - z)
                z = after
                if change <= 1e-14 * _size(z):
                    break
            if self._violation(z) <= _SATISFIED:
                return z
        return None

    def _starts(self) -> Iterator[Floats]:
        yield np.zeros(self.size)
        for side in (Status.STICK, Status.SLIP, Status.OPEN):
            chosen = []
            for sides in self.sides:
                own = [s for s in sides if s[0] == side]
                chosen.append((own or sides)[0])
            z = self._at(chosen)
            if z is not None:
                yield z

    def _violation(self, z: Floats) -> float:
        """Largest violation of the laws of the border contacts, relative to their change."""
        dr, dv = self._pair(z)
        worst = 0.0
        unit = np.sqrt(self.spring.reshape(-1, self.d))
        size = _size(dr * unit, dv / unit, self.p * unit.ravel(), self._rubbed(unit))
        for j, i in enumerate(self.at):
            root, D = unit[j, 0], self.point.friction[i]
            r, v = dr[j] * root, dv[j] / root
            if self.yielding[j]:
                worst = max(worst, abs(v[0]), self._yields(j, dr[j] * root, v, root))
                continue
            worst = max(worst, -r[0], -v[0], min(r[0], v[0]))
            if D[0] == 0:
                worst = max(worst, float(np.abs(r[1:]).max()))
                continue
            along = r[1:] / D
            if not self.resting[j]:
                p = self.direction[i]
                worst = max(worst, float(np.abs(along + r[0] * p).max()))
                continue
            worst = max(worst, float(np.linalg.norm(along)) - r[0])
            slid = D * v[1:]
            far = float(np.linalg.norm(slid))
            if r[0] > v[0] and far > 0:
                # No slip, or a reaction that opposes it.
                aside = float(np.linalg.norm(along + r[0] * slid / far))
                worst = max(worst, min(far, aside))
        return worst / size if size > 0 else worst

    def _rubbed(self, unit: Floats) -> Floats:
        """Changes of the friction limits of yielding contacts, scaled as reactions."""
        of = self.of.friction[self.at] * self.point.reaction[self.at, :1]
        D = np.where(
            self.point.friction[self.at] > 0, self.point.friction[self.at], 1.0
        )
        found: Floats = unit[:, :1] * of / D * self.yielding[:, None]
        return found

    def _yields(self, j: int, r: Floats, v: Floats, root: float) -> float:
        """Violation of ``0 ≤ dσ ⊥ β ≥ 0`` and of the direction of slip."""
        i = self.at[j]
        D, p = self.point.friction[i], self.direction[i]
        excess = self._excess(j, r / root) * root
        slid = D * v[1:]
        beta = float(p @ slid)
        aside = float(np.linalg.norm(slid - beta * p))
        return max(-excess, -beta, min(excess, beta), aside)


def _is_singular(matrix: Floats) -> bool:
    values = np.linalg.svd(matrix, compute_uv=False)
    return bool(values[-1] <= _RANK * values[0])


def _size(*parts: Floats) -> float:
    return float(np.sqrt(sum(np.sum(np.square(part)) for part in parts)))
