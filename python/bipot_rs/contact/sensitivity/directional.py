"""The directional derivative of one step, also at contacts on borders (35).

On borders it is a complementarity problem. The other contacts are eliminated, with springs in
place of the border contacts: ``w dr + dv = z``, with ``w`` from the diagonal of W. Both ``dr``
and ``dv`` are then affine in ``z``, and the side of each border contact is found by an
active-set iteration, or by trying all sides.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.types import Bools, Floats
from bipot_rs.contact import tuning
from bipot_rs.contact.errors import NotDifferentiableError
from bipot_rs.contact.law.status import Status
from bipot_rs.contact.sensitivity.laws import Point, linearise_laws
from bipot_rs.contact.sensitivity.linear import (
    LinearisedStep,
    StepChange,
    make_right_side,
)
from bipot_rs.contact.sensitivity.response import System

# Violation of a complementarity condition, relative to the change of all border contacts,
# that counts as rounding.
_SATISFIED = 1e-9
# Relative difference of two answers, far above the rounding of both.
_SAME = 1e-6
# Singular values below this share of the largest one are rounding.
_RANK = 1e-13


@dataclass(frozen=True)
class Side:
    """A side of a border contact."""

    status: int  # `Status` on this side
    direction: Floats  # of its slip
    # slip, normal: of a contact that rests: `‖D ds‖` and `dr_n`, between which the direction of
    # the slip is linearised. With the values here the direction is kept.
    slip: float = 1.0
    normal: float = 0.0


class BorderProblem:
    """The complementarity problem of the border contacts."""

    def __init__(
        self, linear: LinearisedStep, direction: Floats, of: StepChange
    ) -> None:
        self.linear, self.of = linear, of
        self.point, borders = linear.point, linear.borders
        self.at = np.flatnonzero(borders.any)
        self.direction = direction
        self.resting, self.yielding = (
            borders.resting[self.at],
            borders.yielding[self.at],
        )
        d = self.point.reaction.shape[1]
        self.d, self.size = d, len(self.at) * d
        self._eliminate()
        # Each combination of sides that is tried is a list of these.
        self.sides = [self._list_sides(j) for j in range(len(self.at))]

    def _eliminate(self) -> None:
        """``dr``, ``da`` and ``dv`` of all contacts as affine functions of ``z``."""
        point, response, d = self.point, self.linear.response, self.d
        side = point.status.copy()
        side[self.at] = Status.STICK
        laws = self.linear.laws(side, self.direction)
        place = np.searchsorted(laws.contacts, self.at)
        springs = response.diagonal[self.at].mean(axis=1)
        laws.by_r[place] = springs[:, None, None] * np.eye(d)
        laws.by_v[place] = np.eye(d)
        laws.by_mu[place] = 0.0
        laws.by_rest[place] = 0.0
        made = self.linear.system(laws)
        right = make_right_side(laws, self.of)
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
        amounts = self._iterate()
        count = np.prod([float(len(sides)) for sides in self.sides])
        if count <= (tuning.SIDES_TRIED if amounts is None else tuning.SIDES_COMPARED):
            amounts = self._find_only(amounts)
        if amounts is None:
            raise NotDifferentiableError(
                f"{count_noun(len(self.at), 'contact')} on a border between two statuses "
                f"(the first is contact {self.at[0]}): no change of their statuses was "
                "found that fits this direction, and the directional derivative is not "
                "known; change the load a little"
            )
        dr, da = self.base[0].copy(), self.base[1]
        for amount, (by_dr, by_da) in zip(amounts, self.columns, strict=True):
            dr, da = dr + amount * by_dr, da + amount * by_da
        opens = [side.status == Status.OPEN for side in self._choose_sides(amounts)]
        dr[self.at[opens]] = 0.0
        return dr, da

    def _split_unknowns(self, z: Floats) -> tuple[Floats, Floats]:
        """``dr`` and ``dv`` of the border contacts."""
        dr = self.P @ z + self.p
        return dr.reshape(-1, self.d), (z - self.spring * dr).reshape(-1, self.d)

    def _find_only(self, answer: Floats | None) -> Floats | None:
        """The answer among all combinations of sides; raise if there are several."""
        for sides in itertools.product(*self.sides):
            matrix, right = self._make_matrix(list(sides))
            singular = _is_singular(matrix)
            z: Floats
            if singular:
                # One of the answers, if there is any; all others differ by a null vector.
                z = np.asarray(
                    np.linalg.lstsq(matrix, right, rcond=_RANK)[0], np.float64
                )
                if _measure(matrix @ z - right) > _SATISFIED * (_measure(right) or 1.0):
                    continue
            else:
                z = np.asarray(np.linalg.solve(matrix, right), np.float64)
            if self._measure_violation(z) > _SATISFIED:
                continue
            if singular or (answer is not None and self._differ(z, answer)):
                raise NotDifferentiableError(
                    f"{count_noun(len(self.at), 'contact')} on a border between two statuses: "
                    "several changes of their statuses fit this direction, and the "
                    "reactions are not determined there"
                )
            answer = z
        return answer

    def _differ(self, z: Floats, answer: Floats) -> bool:
        ours, other = self._split_unknowns(z), self._split_unknowns(answer)
        unit = np.sqrt(self.spring.reshape(-1, self.d))
        size = _measure(other[0] * unit, other[1] / unit)
        apart = _measure((ours[0] - other[0]) * unit, (ours[1] - other[1]) / unit)
        return apart > _SAME * size

    def _list_sides(self, j: int) -> list[Side]:
        """Sides of a border contact, each with a direction of slip."""
        p = self.direction[self.at[j]]
        if not self.resting[j]:
            first = Status.STICK if self.yielding[j] else Status.OPEN
            return [Side(int(first), p), Side(int(Status.SLIP), p)]
        ends = [Side(int(Status.OPEN), p), Side(int(Status.STICK), p)]
        ways = [np.eye(self.d - 1)[0], -np.eye(self.d - 1)[0]]
        return ends + [Side(int(Status.SLIP), way) for way in ways]

    def _make_matrix(self, sides: list[Side]) -> tuple[Floats, Floats]:
        """The equations of ``z`` with each border contact on one side."""
        side = np.array([s.status for s in sides])
        p = np.stack([s.direction for s in sides])
        # At rest a change of the friction has no effect.
        d, of = self.d, self.of.friction[self.at] * ~self.resting[:, None]
        by_r = np.tile(np.eye(d), (len(sides), 1, 1))  # open: dr = 0
        by_v, by_change = np.zeros_like(by_r), np.zeros((len(sides), d))
        laws = linearise_laws(
            self._move_to_borders(sides, p), side, p, self.linear.movable[self.at]
        )
        by_r[laws.contacts], by_v[laws.contacts] = laws.by_r, laws.by_v
        by_change[laws.contacts] = np.einsum(
            "ijk,ik->ij", laws.by_mu, of[laws.contacts]
        )
        springs = self.spring.reshape(-1, 1, d)
        across = (by_r - by_v * springs).astype(np.float64)
        rows = self.P.reshape(len(sides), d, -1)
        matrix = np.einsum("ijk,ikl->ijl", across, rows).reshape(self.size, self.size)
        for j in range(len(sides)):
            rest = slice(d * j, d * (j + 1))
            matrix[rest, rest] += by_v[j]
        moved = np.einsum("ijk,ik->ij", across, self.p.reshape(-1, d))
        # The scale of a row is that of its terms: they may cancel, as where other contacts
        # hold the node of a border contact, and rounding is then no equation.
        terms = np.abs(by_r) + np.abs(by_v) * springs
        sizes = np.einsum("ijk,ikl->ijl", terms, np.abs(rows))
        scale = np.maximum(sizes.max(axis=2), np.abs(by_v).max(axis=2)).ravel()
        scale = np.where(scale > 0, scale, 1.0)
        return matrix / scale[:, None], (by_change - moved).ravel() / scale

    def _move_to_borders(self, sides: list[Side], p: Floats) -> Point:
        """The border contacts, exactly on their borders and about to slip along ``p``."""
        point, at = self.point, self.at
        D = point.friction[at]
        reaction = np.where(self.yielding[:, None], point.reaction[at], 0.0)
        reaction[self.resting, 0] = np.array([s.normal for s in sides])[self.resting]
        far = self.resting * np.array([s.slip for s in sides])
        begins = p / np.where(D > 0, D, 1.0) * far[:, None]
        slip = np.where(
            self.yielding[:, None] | self.resting[:, None], begins, point.slip[at]
        )
        return Point(reaction, np.zeros(len(at)), slip, point.status[at], D)

    def _solve_sides(self, sides: list[Side]) -> Floats | None:
        """``z`` with each border contact on one side; None if this is singular."""
        matrix, right = self._make_matrix(sides)
        if _is_singular(matrix):
            return None
        return np.asarray(np.linalg.solve(matrix, right), np.float64)

    def _find_excess(self, j: int, dr: Floats) -> float:
        """``d(r_n - ‖D⁻¹ r_t‖)`` of a contact at the friction limit."""
        i = self.at[j]
        D, p = self.point.friction[i], self.direction[i]
        # Zero at a contact that just touches.
        r_n = float(self.point.reaction[i, 0]) if self.yielding[j] else 0.0
        grown = dr[1:] / D + r_n * p * self.of.friction[i] / D
        return float(dr[0] + p @ grown)

    def _choose_sides(self, z: Floats) -> list[Side]:
        """The side on which the natural map puts each border contact."""
        dr, dv = self._split_unknowns(z)
        chosen = []
        for j, i in enumerate(self.at):
            w, p = self.spring[self.d * j], self.direction[i]
            D = self.point.friction[i]
            # D² w and w dr_n have the units of the slip D s.
            spring = w * float(D.max()) ** 2
            side, slip, normal = Status.SLIP, 1.0, 0.0
            if self.yielding[j]:
                slides = float(p @ (D * dv[j, 1:]))
                if spring * self._find_excess(j, dr[j]) >= slides:
                    side = Status.STICK
            elif w * dr[j, 0] <= dv[j, 0]:
                side = Status.OPEN
            elif self.resting[j]:
                normal = float(dr[j, 0] - dv[j, 0] / w)
                along = spring * dr[j, 1:] / D - D * dv[j, 1:]
                far = float(np.linalg.norm(along))
                slip = far - spring * normal
                if slip <= 0:
                    side = Status.STICK
                else:
                    p = (-along / far).astype(np.float64)
            chosen.append(Side(int(side), p, slip, normal))
        return chosen

    def _iterate(self) -> Floats | None:
        """Active-set iteration from some starts; None if it does not end."""
        for z in self._list_starts():
            for _ in range(tuning.SIDE_ITERATIONS):
                after = self._solve_sides(self._choose_sides(z))
                if after is None:
                    break
                change = _measure(after - z)
                z = after
                if change <= 1e-14 * _measure(z):
                    break
            if self._measure_violation(z) <= _SATISFIED:
                return z
        return None

    def _list_starts(self) -> Iterator[Floats]:
        yield np.zeros(self.size)
        for side in (Status.STICK, Status.SLIP, Status.OPEN):
            chosen = []
            for sides in self.sides:
                those_on_side = [s for s in sides if s.status == side]
                chosen.append((those_on_side or sides)[0])
            z = self._solve_sides(chosen)
            if z is not None:
                yield z

    def _measure_violation(self, z: Floats) -> float:
        """Largest violation of the laws of the border contacts, relative to their change."""
        dr, dv = self._split_unknowns(z)
        worst = 0.0
        unit = np.sqrt(self.spring.reshape(-1, self.d))
        size = _measure(
            dr * unit,
            dv / unit,
            self.p * unit.ravel(),
            self._scale_friction_change(unit),
        )
        for j, i in enumerate(self.at):
            root, D = unit[j, 0], self.point.friction[i]
            r, v = dr[j] * root, dv[j] / root
            if self.yielding[j]:
                worst = max(
                    worst, abs(v[0]), self._measure_yielding(j, dr[j] * root, v, root)
                )
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

    def _scale_friction_change(self, unit: Floats) -> Floats:
        """Changes of the friction limits of yielding contacts, scaled as reactions."""
        of = self.of.friction[self.at] * self.point.reaction[self.at, :1]
        D = np.where(
            self.point.friction[self.at] > 0, self.point.friction[self.at], 1.0
        )
        change: Floats = unit[:, :1] * of / D * self.yielding[:, None]
        return change

    def _measure_yielding(self, j: int, r: Floats, v: Floats, root: float) -> float:
        """Violation of ``0 ≤ dσ ⊥ β ≥ 0`` and of the direction of slip."""
        i = self.at[j]
        D, p = self.point.friction[i], self.direction[i]
        excess = self._find_excess(j, r / root) * root
        slid = D * v[1:]
        beta = float(p @ slid)
        aside = float(np.linalg.norm(slid - beta * p))
        return max(-excess, -beta, min(excess, beta), aside)


def _is_singular(matrix: Floats) -> bool:
    values = np.linalg.svd(matrix, compute_uv=False)
    return bool(values[-1] <= _RANK * values[0])


def _measure(*parts: Floats) -> float:
    return float(np.sqrt(sum(np.sum(np.square(part)) for part in parts)))


def differentiate_step(linear: LinearisedStep, of: StepChange) -> tuple[Floats, Floats]:
    """``dr (n_c, d)`` and ``da`` of a step whose data change.

    Raises `NotDifferentiableError`: there is no directional derivative, or several candidates
    for it.
    Raises `ValueError`: a friction coefficient that is zero decreases.
    """
    point, direction = linear.point, linear.direction
    linear.refuse_borders(linear.borders.any)
    smooth = (point.friction[:, 0] == 0) & (point.reaction[:, 0] > 0)
    smooth &= point.is_coulomb
    if smooth.any():
        direction = _find_friction_direction(linear, smooth, direction, of.friction)
    if linear.borders.any.any():
        return BorderProblem(linear, direction, of).solve()
    system = linear.reported
    if smooth.any():
        # The direction changes the right side alone.
        system = System(linear.laws(point.status, direction), system.core, system.shape)
    return system.solve(make_right_side(system.laws, of), -of.balance)


def _find_friction_direction(
    linear: LinearisedStep, smooth: Bools, direction: Floats, change: Floats
) -> Floats:
    """The direction of the friction that begins at contacts without any."""
    asked = smooth & (change != 0).any(axis=1)
    if not asked.any():
        return direction
    lost = asked & (change < 0).any(axis=1)
    if lost.any():
        raise ValueError(
            f"mu of contact {int(np.argmax(lost))} is zero, and its direction "
            "is negative: friction coefficients cannot be negative, so give zero or a "
            "positive direction there"
        )
    # Friction has no effect where the tangential displacement is prescribed.
    loose = linear.movable[:, 1:].any(axis=1)
    still = asked & loose & ~(linear.point.slip != 0).any(axis=1)
    if still.any():
        raise NotDifferentiableError(
            f"mu of contact {int(np.flatnonzero(still)[0])} is zero and it does not "
            "slip: the direction of friction that begins there is not determined"
        )
    turned = direction.copy()
    pushed = change[asked] * linear.point.slip[asked]
    size = np.linalg.norm(pushed, axis=1)[:, None]
    turned[asked] = np.divide(pushed, size, where=size > 0, out=np.zeros_like(pushed))
    return turned
