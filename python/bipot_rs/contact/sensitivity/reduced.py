"""Derivatives of the solution of a reduced problem ``v = W r + R a + q`` (33), (34)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

import bipot_rs._core as _core
from bipot_rs._lib.types import CsrMatrix, Floats, MatrixLike
from bipot_rs._lib.validation import csr, floats
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.results.derivatives import ReducedGradient, ReducedTangent
from bipot_rs.contact.sensitivity.directional import differentiate_step
from bipot_rs.contact.sensitivity.laws import Point
from bipot_rs.contact.sensitivity.linear import (
    LinearisedStep,
    StepChange,
    find_borders,
)
from bipot_rs.contact.sensitivity.model import (
    check_cotangent,
    check_rest,
    spread_change,
    spread_friction,
)
from bipot_rs.contact.sensitivity.response import ReducedResponse

if TYPE_CHECKING:
    from bipot_rs.contact.results.solution import Solution


@dataclass(frozen=True)
class ReducedModel:
    """The data of a reduced problem, for the derivatives of its solutions."""

    core: _core.Reduced  # the problem in the core
    # W, law: as given.
    W: Floats | CsrMatrix
    law: ContactLaw
    modes: Floats | CsrMatrix  # (d n_c, k): R

    def linear(self, solution: Solution) -> LinearisedStep:
        """The problem, linearised at a solution.

        Raises `ValueError`: the solution did not converge.
        """
        if not solution.converged:
            raise ValueError(
                f"the solution did not converge ({solution.outcome}) and has no "
                "derivatives: solve with a larger max_iterations or another method"
            )
        r, v = solution.reaction, solution.relative_displacement
        friction = spread_friction(self.law.mu, r.shape[1])
        status = solution.status.astype(np.int64)
        opening, cohesion, dilatancy = v[:, 0], self.law.cohesion, self.law.dilatancy
        if dilatancy is not None:
            opening = opening - dilatancy * np.linalg.norm(v[:, 1:], axis=1)
        point = Point(r, opening, v[:, 1:], status, friction, cohesion, dilatancy)
        response = ReducedResponse(self.core, self.W, r.shape, self.modes)
        rigid = solution.rigid_motion
        moved = response.find_relative_motion(
            r, np.zeros(self.modes.shape[1]) if rigid is None else rigid
        )
        # q and W r + R a.
        size = np.linalg.norm(np.abs(v - moved) + np.abs(moved), axis=1)
        compliance = response.diagonal.mean(axis=1)
        borders = find_borders(point, compliance, solution.tolerance, size)
        return LinearisedStep(response, point, borders)

    def jvp(
        self,
        solution: Solution,
        W: MatrixLike | None,
        q: ArrayLike | None,
        mu: ArrayLike | None,
        cohesion: ArrayLike | None = None,
        dilatancy: ArrayLike | None = None,
    ) -> ReducedTangent:
        """`Solution.jvp`."""
        shape = solution.reaction.shape
        free = np.zeros(shape) if q is None else floats("q", q, shape=shape)
        if W is not None:
            free = free + self._apply_change(W, solution.reaction)
        friction = spread_change("mu", mu, self.law.mu, shape[1])
        rest = check_rest(cohesion, dilatancy, self.law.mu)
        linear = self.linear(solution)
        still = np.zeros(self.modes.shape[1])
        r, a = differentiate_step(linear, StepChange(free, still, friction, rest))
        v = free + linear.response.find_relative_motion(r, a)
        return ReducedTangent(r, v, linear.borders.any)

    def _apply_change(self, W: Any, reaction: Floats) -> Floats:
        """``dW r``."""
        from scipy.sparse import issparse

        size = reaction.size
        change = csr("W", W).matrix if issparse(W) else floats("W", W, ndim=2)
        if change.shape != (size, size):
            raise ValueError(f"W has shape {change.shape}, expected {(size, size)}")
        moved = np.asarray(change @ reaction.ravel(), np.float64)
        return moved.reshape(reaction.shape)

    def vjp(
        self,
        solution: Solution,
        reaction: ArrayLike | None,
        relative_displacement: ArrayLike | None,
    ) -> ReducedGradient:
        """`Solution.vjp`."""
        shape = solution.reaction.shape
        cotangent = check_cotangent("reaction", reaction, shape)
        r = np.zeros(shape) if cotangent is None else cotangent
        moved = check_cotangent("relative_displacement", relative_displacement, shape)
        v = np.zeros(shape) if moved is None else moved
        linear = self.linear(solution)
        system = linear.adjoint()
        pushed = np.asarray(self.W.T @ v.ravel(), np.float64).reshape(shape)
        w, _ = system.solve_transposed(r + pushed, self.modes.T @ v.ravel())
        pulled, by_mu = system.laws.adjoint(w, self.law.mu)
        return ReducedGradient(
            v - pulled,
            by_mu,
            system.laws.adjoint_rest(w) * (self.law.mu.ndim == 1),
            linear.borders.any,
            solution.reaction,
            self.W,
        )
