"""Discrete energies, functionals and bifunctional of one load step: [dSF91, 23-30, 67-72].

A displacement is the vector of all degrees of freedom; it is admissible if it has the
prescribed values. A stress field is given by the contact reactions with which it is in
equilibrium. The load contains body forces and tractions; there may be several bodies. All
quantities are increments from a start state ``(t0, u0, h0)``. By default this is the
unloaded state; increments are then totals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

import bipot_rs._core as _core
from bipot_rs._lib.messages import make_type_error
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, MatrixLike
from bipot_rs._lib.validation import csr, floats, integer, number
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.results.result import Result


@dataclass(frozen=True, kw_only=True, eq=False)
class StepStart:
    """State at the start of a step: ``t0``, ``u0`` and the loads in equilibrium with them.

    Attributes
    ----------
    reaction
        ``t0``, contact forces ``(n_c, d)``, of any sign.
    displacement
        ``u0``, ``(n,)``.
    load
        Loads of this state, ``(n,)``. By default the loads that balance it,
        ``K u0 - Bᵀ t0``; at prescribed degrees of freedom, the loads of the step.
    offset
        Relative displacement to which increments are added, ``(n_c, d)``. By default, as in
        [dSF91], its normal part is the gap ``u_n0 + h0`` and its tangential part zero.
    """

    reaction: ArrayLike
    displacement: ArrayLike
    load: ArrayLike | None = None
    offset: ArrayLike | None = None


class Functionals:
    """The functionals of one load step of a contact problem.

    ``du (n,)`` and ``dr (n_c, d)`` are increments of displacement and contact reaction
    from the start state; energies are in units of work. The relative displacement is
    ``v = B du + offset``, the reaction ``r = t0 + dr``.

    Parameters
    ----------
    problem
        The contact problem. Its factor of ``K`` is used to solve for displacements.
    K
        Its stiffness, which a `ContactProblem` does not keep.
    load, prescribed
        Totals at the end of the step, ``(n,)`` and ``(len(fixed),)``; default zero.
    start
        State at the start of the step; default the unloaded bodies.
    slack
        Tolerance of constraints: of penetration relative to the largest displacement, of
        contact forces to the largest reaction, of balance on rigid motions to the loads.
        Without it the indicator at a computed solution would be infinite.

    Attributes
    ----------
    load, prescribed
        Increments of the step.
    offset
        ``(u_n0 + h0, 0)`` of each contact, ``(n_c, d)``.
    start_work
        ``Σ t0·offset``, the constant ``Σ t_n0 (u_n0 + h0)`` that (54) omits.

    Raises
    ------
    TypeError, ValueError
        A wrong argument.
    """

    def __init__(
        self,
        problem: ContactProblem,
        K: MatrixLike,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        *,
        start: StepStart | None = None,
        slack: float = 1e-9,
    ) -> None:
        if not isinstance(problem, ContactProblem):
            raise make_type_error("problem", problem, "a ContactProblem")
        n, fixed = problem.loading.n, problem.stiffness.options.fixed
        contacts, d = problem.contacts.shape
        stiffness = csr("K", K)
        if stiffness.shape != (n, n):
            raise ValueError(f"K has shape {stiffness.shape}, expected ({n}, {n})")
        self._problem = problem
        self._core = problem.stiffness.core
        self._stiffness = stiffness.matrix
        self._contact = _matrix(problem)
        self._fixed = fixed
        self._by, self._mu = _core.isotropic(problem.contacts.law.mu, d)
        self._shape = (contacts, d)
        self._slack = number("slack", slack)
        force = np.zeros(n) if load is None else floats("load", load, shape=(n,))
        moved = np.zeros(len(fixed))
        if prescribed is not None:
            moved = floats("prescribed", prescribed, shape=moved.shape)
        gap: Floats = problem.contacts.gap_by_component
        # Relative displacements are differences of displacements, those of the start
        # included: these set the size of rounding.
        self._reach = np.abs(gap).max(initial=0.0)
        if start is None:
            self._before = np.zeros((contacts, d))
            self.load, self.prescribed, self.offset = force, moved, gap.copy()
        else:
            t0 = floats("reaction of start", start.reaction, shape=(contacts, d))
            u0 = floats("displacement of start", start.displacement, shape=(n,))
            self._before = t0
            self._reach += (abs(self._contact) @ np.abs(u0)).max(initial=0.0)
            if start.load is None:
                carried = self._stiffness @ u0 - self._contact.T @ t0.ravel()
                carried[fixed] = force[fixed]
            else:
                carried = floats("load of start", start.load, shape=(n,))
            self.load = force - carried
            self.prescribed = moved - u0[fixed]
            if start.offset is None:
                self.offset = np.zeros((contacts, d))
                self.offset[:, 0] = self._relative(u0)[:, 0] + gap[:, 0]
            else:
                self.offset = floats(
                    "offset of start", start.offset, shape=(contacts, d)
                )
        self.start_work = float(np.sum(self._before * self.offset))

    @classmethod
    def of_step(
        cls,
        problem: ContactProblem,
        K: MatrixLike,
        result: Result,
        k: int = -1,
        *,
        increments: bool = True,
        slack: float = 1e-9,
    ) -> Functionals:
        """The functionals of step ``k`` of a solved load path.

        Parameters
        ----------
        problem, K
            The problem that was solved, and its stiffness.
        result
            Result of ``problem.solve``. A result from a file has no loads and is refused.
        k
            Index of the step.
        increments
            If true, quantities are increments from the step before; otherwise totals, with
            the slip history in the offset as in (22). If the step before is in equilibrium,
            the two bifunctionals differ by ``start_work`` only.

        Raises
        ------
        ValueError
            ``k`` is out of range, the result was read from a file, or frames change along
            the path.
        """
        count = len(result)
        if count == 0:
            raise ValueError("result has no steps, expected one or more")
        at = integer("k", k, least=-count, most=count - 1) % count
        step, before = result[at], result[at - 1] if at else result.start
        if step.load is None or (before is not None and before.load is None):
            raise ValueError(
                f"step {at} of result, or the step before it, has no loads: give the result of "
                "problem.solve, not one from a file or the first step from a bp.State"
            )
        if step.frame is not None or (before is not None and before.frame is not None):
            raise ValueError(
                f"step {at} of result, or the step before it, has frames of its own: the "
                "functionals need those of B"
            )
        start = None
        if before is not None:
            u0 = before.displacement
            if increments:
                start = StepStart(
                    reaction=before.reaction, displacement=u0, load=before.load
                )
            else:
                gap = problem.contacts.gap_by_component.copy()
                moved = (_matrix(problem) @ u0).reshape(gap.shape)
                gap[:, 1:] = -moved[:, 1:]
                start = StepStart(
                    reaction=np.zeros_like(before.reaction),
                    displacement=np.zeros_like(u0),
                    load=np.zeros_like(u0),
                    offset=gap,
                )
        return cls(problem, K, step.load, step.prescribed, start=start, slack=slack)

    def relative_displacement(self, du: ArrayLike) -> Floats:
        """``v = B du + offset``, ``(n_c, d)``: gap at the end and slip of the step."""
        return self._relative(self._admissible(du)) + self.offset

    def strain_energy(self, du: ArrayLike) -> float:
        """``V = ½ duᵀ K du``, the strain energy of (64)."""
        return self._energy(self._admissible(du))

    def elastic_answer(
        self, dr: ArrayLike, at_supports: ArrayLike | None = None
    ) -> Floats | None:
        """Elastic displacement ``w (n,)``: ``K w = load + Bᵀ dr`` at free degrees of freedom.

        The stresses of ``w`` are statically admissible (20) with the reactions ``dr``. With
        redundant supports there are several such fields; ``w`` at the prescribed degrees of
        freedom selects one. By default these values are the prescribed ones, which minimise
        [dSF91, 27]. Other values ``at_supports (len(fixed),)`` give other support forces.

        ``None`` if loads and ``dr`` do not balance on a free rigid motion, ``Rᵀ r + e ≠ 0``.

        Raises
        ------
        ValueError
            A wrong argument; ``K`` is not the stiffness of the problem.
        """
        reaction = floats("dr", dr, shape=self._shape)
        ends = self.prescribed
        if at_supports is not None:
            ends = floats("at_supports", at_supports, shape=ends.shape)
        _, modes, force = self._core.free_part(self.load, ends)
        if len(force):
            lack = np.abs(modes @ reaction.ravel() + force).max()
            # e has the rounding of the loads, even where the loads balance each other.
            carried = np.linalg.norm(self._contact.T @ reaction.ravel())
            size = np.linalg.norm(self.load) + carried + np.linalg.norm(force)
            if lack > self._slack * size:
                return None
        motion = np.zeros(len(force))
        (w,) = self._core.displacements([(self.load, ends, reaction, motion)])
        self._answers(w, reaction)
        return np.asarray(w, np.float64)

    def complementary_energy(
        self, dr: ArrayLike, at_supports: ArrayLike | None = None
    ) -> float:
        """``W = ½ wᵀ K w`` with ``w`` of `elastic_answer`; infinite where that is ``None``."""
        w = self.elastic_answer(dr, at_supports)
        return np.inf if w is None else self._energy(w)

    def potential(self, du: ArrayLike) -> float:
        """``Φ = V - load·du``: (26), or (67) for increments."""
        u = self._admissible(du)
        return self._energy(u) - float(self.load @ u)

    def complementary(
        self, dr: ArrayLike, at_supports: ArrayLike | None = None
    ) -> float:
        """``Π = W - s·prescribed``, ``s`` the support forces: (27), or (71) for increments.

        Infinite if reactions and loads do not balance on a free rigid motion.
        """
        w = self.elastic_answer(dr, at_supports)
        if w is None:
            return np.inf
        reaction = np.asarray(dr, np.float64)
        support = self._stiffness @ w - self.load - self._contact.T @ reaction.ravel()
        return self._energy(w) - float(support[self._fixed] @ self.prescribed)

    def bipotential(self, du: ArrayLike, dr: ArrayLike) -> Floats:
        """(54) of each contact, ``b(-B du, dr)``, ``(n_c,)``; infinite outside its domain.

        As printed, without the constant of `start_work`. If the offset has a tangential
        part ``c`` (from ``gap`` or from a slip history), the slip is ``B_t du + c``, and
        ``dr_t·c`` is added.
        """
        u, reaction = self._admissible(du), floats("dr", dr, shape=self._shape)
        moved = self._relative(u)
        v, r = moved + self.offset, self._before + reaction
        at_start = self._before * moved + reaction * self.offset
        finite = at_start.sum(axis=1) + self._mu * r[:, 0] * self._slip(v)
        size = self._reach + (abs(self._contact) @ np.abs(u)).max(initial=0.0)
        size += np.abs(self.offset).max(initial=0.0)
        outside = v[:, 0] < -self._slack * size
        outside |= self._beyond(r)
        return np.where(outside, np.inf, finite)

    def bifunctional(
        self, du: ArrayLike, dr: ArrayLike, at_supports: ArrayLike | None = None
    ) -> float:
        """``B = Φ + Π + Σ b``: (23), with the sign of ``u`` from (21).

        Never less than ``-start_work``, which is zero if the start state is complementary;
        equal at solutions only. Infinite outside the domain of ``b`` or without balance.
        """
        contact = float(self.bipotential(du, dr).sum())
        if not np.isfinite(contact):
            return np.inf
        return self.potential(du) + self.complementary(dr, at_supports) + contact

    def excess(
        self, du: ArrayLike, dr: ArrayLike, at_supports: ArrayLike | None = None
    ) -> float:
        """``½ ‖du - w‖²_K + Σ r·ṽ``: the bifunctional above its bound ``-start_work``.

        The first term is the energy of the error in equilibrium, the second the sum of the
        gaps of the contact law. It equals ``bifunctional + start_work`` where that is finite,
        without cancellation: its rounding is that of ``r·ṽ``, instead of ``Φ`` and ``Π``.
        Constraints are not checked; if they hold, no term is negative.
        """
        u = self._admissible(du)
        w = self.elastic_answer(dr, at_supports)
        if w is None:
            return np.inf
        v = self._relative(u) + self.offset
        r = self._before + np.asarray(dr, np.float64)
        friction = self._mu * r[:, 0] * self._slip(v)
        return self._energy(u - w) + float(np.sum(r * v) + friction.sum())

    def displacement_functional(self, du: ArrayLike, dr: ArrayLike) -> float:
        """``ΔΦ_b`` (68), which ``du`` minimises for given normal reactions of ``dr``.

        Infinite where ``du`` penetrates. ``ΔΦ_b + ΔΠ_b`` is not `bifunctional`, because both
        terms contain friction, ``Σ μ r_n ‖v_t‖``.
        """
        reaction = floats("dr", dr, shape=self._shape)
        held = np.zeros_like(reaction)
        held[:, 0] = reaction[:, 0] + self._before[:, 0]
        # (68) contains only r_n of dr, so that only the constraint on du is checked.
        if not np.isfinite(self.bipotential(du, held - self._before)).all():
            return np.inf
        u = self._admissible(du)
        work = float(np.sum(self._before * self._relative(u)))
        return self.potential(u) + work + self._friction(u, reaction)

    def stress_functional(
        self, dr: ArrayLike, du: ArrayLike, at_supports: ArrayLike | None = None
    ) -> float:
        """``ΔΠ_b`` (72), which ``dr`` minimises for given slip of ``du``.

        Infinite if a reaction is outside the cone, or a free rigid motion is not balanced.
        """
        reaction = floats("dr", dr, shape=self._shape)
        r = self._before + reaction
        if self._beyond(r).any():
            return np.inf
        work = float(np.sum(reaction * self.offset))
        friction = self._friction(self._admissible(du), reaction)
        return self.complementary(reaction, at_supports) + work + friction

    def _admissible(self, du: ArrayLike) -> Floats:
        u = floats("du", du, shape=(self._stiffness.shape[0],), copy=False)
        lack = np.abs(u[self._fixed] - self.prescribed)
        size = np.abs(u).max(initial=0.0) + np.abs(self.prescribed).max(initial=0.0)
        if (lack > self._slack * size).any():
            at = int(np.argmax(lack))
            dof = int(self._fixed[at])
            raise ValueError(
                f"du is {u[dof]} at degree of freedom {dof}, expected the prescribed value "
                f"{self.prescribed[at]}"
            )
        return u

    def _answers(self, w: Floats, reaction: Floats) -> None:
        """Raise an error if ``w`` does not satisfy equilibrium with the ``K`` given here."""
        force = self.load + self._contact.T @ reaction.ravel()
        free = np.ones(len(w), bool)
        free[self._fixed] = False
        terms = abs(self._stiffness) @ np.abs(w) + np.abs(force)
        lack = np.abs(self._stiffness @ w - force)[free].max(initial=0.0)
        # w is exact up to rounding, and the loads balance up to the slack.
        if lack > (1e-8 + self._slack) * terms.max(initial=0.0):
            raise ValueError(
                f"K is not the stiffness of the problem: with K, a force of {lack} stays "
                f"unbalanced, where forces are up to {terms.max()}; give the K that the "
                "problem was made from"
            )

    def _relative(self, u: Floats) -> Floats:
        return np.asarray(self._contact @ u, np.float64).reshape(self._shape)

    def _energy(self, u: Floats) -> float:
        return 0.5 * float(u @ (self._stiffness @ u))

    def _friction(self, u: Floats, reaction: Floats) -> float:
        slip = self._slip(self._relative(u) + self.offset)
        return float(np.sum(self._mu * (self._before + reaction)[:, 0] * slip))

    def _slip(self, v: Floats) -> Floats:
        # Scaled components: friction is isotropic in them.
        return np.asarray(np.linalg.norm((self._by * v)[:, 1:], axis=1))

    def _beyond(self, r: Floats) -> Bools:
        """Contacts whose reaction is outside the cone by more than the slack."""
        force = np.abs(r).max(initial=0.0) + np.abs(self._before).max(initial=0.0)
        shear = np.linalg.norm((r / self._by)[:, 1:], axis=1)
        slack = self._slack * force
        limit = self._mu * np.maximum(r[:, 0], 0.0) + slack / self._by.min(axis=1)
        return np.asarray((r[:, 0] < -slack) | (shear > limit))


def _matrix(problem: ContactProblem) -> CsrMatrix:
    """``B`` of a problem."""
    matrix: CsrMatrix = problem.contacts.operator.matrix
    return matrix
