"""A body of an implicit standard material: the boundary-value problem (19)–(23) of [dSF91].

The material has the bipotential β of `elastoplastic`, there is no contact (``S_2`` is
empty), and ``u`` is prescribed at some degrees of freedom. For increments ``Δu`` of a step,
total loads ``f`` and total stresses ``σ``, (23) is

    ``B(Δu, σ) = ∫ β(ε(Δu), σ) dΩ - f·Δu - s·Δū``,    s the forces of the supports.

If ``Δu`` and ``σ`` are admissible, ``B = ∫ [β(ε(Δu), σ) - σ:ε(Δu)] dΩ >= 0``, and zero at
solutions only. A stress is admissible if it satisfies the criterion and balances the loads
in the weak sense, tested with the shape functions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import make_type_error
from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats, integer, loads, number, one_of
from bipot_rs.fem.bodies.body import Body, Field
from bipot_rs.theory.body_assembly import BodyAssembly
from bipot_rs.theory.body_step import BodyState, BodyStep, StepSolver, law_of
from bipot_rs.theory.limit_load import LimitLoadError, StepNotConvergedError, mechanism
from bipot_rs.theory.soils import DruckerPrager, mandel

METHODS = ("newton", "displacements")


class ImplicitBody:
    """An elastic body with Drucker–Prager flow.

    Parameters
    ----------
    body
        Mesh and elasticity, isotropic, in 2D in plane strain. Its volumes may have
        different moduli.
    soil
        Criterion and flow, the same in the whole body.
    fixed
        Degrees of freedom ``dim * node + component`` with prescribed displacement. They
        must stop all rigid motions.

    Attributes
    ----------
    shape
        ``(cells, points)`` of the quadrature.
    weights
        Volumes that the quadrature points stand for, ``(cells, points)`` [m³].

    Raises
    ------
    TypeError, ValueError
        A wrong argument.
    """

    def __init__(self, body: Body, soil: DruckerPrager, fixed: ArrayLike) -> None:
        if not isinstance(soil, DruckerPrager):
            raise make_type_error("soil", soil, "a DruckerPrager")
        self._assembly = BodyAssembly(body, fixed)
        self.body, self.soil = body, soil
        self.fixed = self._assembly.fixed
        self.shape = self._assembly.shape
        self.weights = self._assembly.weights.reshape(self.shape)

    def at_rest(self, stress: Field | None = None) -> BodyState:
        """State without displacement, with an initial stress.

        Parameters
        ----------
        stress
            A constant tensor ``(3, 3)``, tensors ``(3, 3, cells, points)``, or a function
            of the positions ``(d, cells, points)`` that returns one of these [Pa]; by
            default zero. It need not balance a load: the first step brings it into
            equilibrium.

        Raises
        ------
        ValueError
            The stress has a wrong shape or violates the criterion.
        """
        zero = np.zeros((*self.shape, 6))
        start = BodyState(
            displacement=np.zeros(self.body.points.size),
            stress=zero,
            plastic_strain=zero,
        )
        if stress is None:
            return start
        places = self.body.volume().places
        tensor_given = floats("stress", stress(places) if callable(stress) else stress)
        if tensor_given.shape not in ((3, 3), (3, 3, *self.shape)):
            raise ValueError(
                f"stress has shape {tensor_given.shape}, expected (3, 3) or "
                f"{(3, 3, *self.shape)}"
            )
        if tensor_given.ndim == 2:
            tensor_given = tensor_given[..., None, None]
        vectors = mandel(np.moveaxis(tensor_given, (0, 1), (-2, -1)))
        return self._check_start(
            replace(start, stress=np.broadcast_to(vectors, zero.shape))
        )

    def strain(self, displacement: ArrayLike) -> Floats:
        """Strain at the quadrature points, ``(cells, points, 6)``."""
        n = self.body.points.size
        u = floats("displacement", displacement, shape=(n,))
        return self._assembly.strains(u).reshape(*self.shape, 6)

    def internal_forces(self, stress: ArrayLike) -> Floats:
        """Nodal forces ``∫ σ:ε(φ_i) dΩ`` that balance a stress field, ``(n,)`` [N]."""
        vectors = floats("stress", stress, shape=(*self.shape, 6))
        return self._assembly.forces(vectors.reshape(-1, 6))

    def solve(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        *,
        start: BodyState | None = None,
        method: str = "newton",
        tol: float = 1e-10,
        max_iterations: int = 200,
    ) -> tuple[BodyStep, ...]:
        """Solve load steps, each from the end of the one before.

        ``"newton"`` solves equilibrium with the law (22) by Newton's method, whose matrix is
        not symmetric. ``"displacements"`` is (37), (38): each pass minimises
        ``B(·, σ_i)``, which is the problem of a body with associated flow and the limits of
        ``σ_i``. Both are judged alike: by the gap of the bipotential and by equilibrium.

        Parameters
        ----------
        load, prescribed
            Totals at the end of each step, ``(steps, n)`` [N] and ``(steps, len(fixed))``
            [m]; one without steps serves for all; default zero.
        start
            State at the start, from `at_rest` or a `BodyStep`; default no stress.
        method
            ``"newton"`` or ``"displacements"``.
        tol
            Largest gap and imbalance, see `BodyStep`.
        max_iterations
            Largest number of passes of a step.

        Raises
        ------
        LimitLoadError
            No stress that satisfies the criterion balances the load.
        StepNotConvergedError
            A step did not reach the tolerance. Both carry the steps before.
        TypeError, ValueError
            A wrong argument.
        """
        one_of("method", method, METHODS)
        tol = number("tol", tol)
        if not 0 < tol < 1:
            raise ValueError(f"tol is {tol}, expected a number between 0 and 1")
        passes = integer("max_iterations", max_iterations, least=1)
        n = self.body.points.size
        state = self.at_rest() if start is None else self._check_start(start)
        steps: list[BodyStep] = []
        for force, moved in loads(load, prescribed, n, len(self.fixed)):
            step = StepSolver(self._assembly, self.soil, state, force, moved, tol)
            newton = method == "newton"
            state = step.newton() if newton else step.displacements(passes)
            if not state.converged:
                self._refuse(tuple(steps), state)
            steps.append(state)
        return tuple(steps)

    def bifunctional(self, start: BodyState, end: BodyState, load: ArrayLike) -> float:
        """B of (23), from the energies, at the increments from ``start`` to ``end`` [J].

        The minimum over ``p`` in β is replaced by the increment of plastic strain, which
        is an upper bound and the same at solutions. The value is infinite if ``end``
        violates the criterion or the plastic strain dilates too little. It is not negative
        if the stress of ``end`` balances the load.

        Parameters
        ----------
        start, end
            States at the start and at the end of a step; that at the end may be any.
        load
            Total loads at the end, ``(n,)`` [N].
        """
        force = floats("load", load, shape=(self.body.points.size,))
        before, after = self._check_start(start), self._check_shape("end", end)
        body = self._assembly
        law = law_of(body, self.soil, before)
        du = after.displacement - before.displacement
        p = (after.plastic_strain - before.plastic_strain).reshape(-1, 6)
        stress = after.stress.reshape(-1, 6)
        energy = law.energy(body.strains(du) - p) + law.split_bipotential(p, stress)
        supports = (body.forces(stress) - force)[self.fixed]
        total = body.weights @ energy - force @ du
        return float(total - supports @ du[self.fixed])

    def mechanism(self, load: ArrayLike) -> Floats | None:
        """Displacement that proves that no stress in the criterion balances the load.

        See `limit_load.mechanism`.

        Parameters
        ----------
        load
            ``(n,)`` [N].

        Returns
        -------
        mechanism
            ``(n,)``, scaled so that its largest component is 1. None if none was found:
            the load can be carried, or is within 1e-6 of the limit, or the mesh is too
            large for the search.
        """
        force = floats("load", load, shape=(self.body.points.size,))
        return mechanism(self._assembly, self.soil, force)

    def _refuse(self, found: tuple[BodyStep, ...], step: BodyStep) -> None:
        """Raise the error of a step that did not converge."""
        flow = self.mechanism(step.load)
        which = f"step {len(found)}"
        if flow is not None:
            above = LimitLoadError(
                f"the load of {which} is above the limit load: no stress satisfies the "
                "criterion and balances it, because on the mechanism of this error the "
                "load does more work than the soil can dissipate; reduce the load, or "
                "prescribe displacements"
            )
            above.steps, above.mechanism = found, flow
            raise above
        failed = StepNotConvergedError(
            f"{which} did not converge: gap {step.gap:.1e}, imbalance "
            f"{step.imbalance:.1e}. Its load may be above the limit load of the flow, "
            "or the step too large: use smaller steps, or prescribe displacements"
        )
        failed.steps, failed.last = found, step
        raise failed

    def _check_shape(self, what: str, state: BodyState) -> BodyState:
        """Refuse a state of another shape."""
        if not isinstance(state, BodyState):
            raise make_type_error(what, state, "a BodyState")
        points, n = (*self.shape, 6), self.body.points.size
        return BodyState(
            displacement=floats(
                f"displacement of {what}", state.displacement, shape=(n,)
            ),
            stress=floats(f"stress of {what}", state.stress, shape=points),
            plastic_strain=floats(
                f"plastic_strain of {what}", state.plastic_strain, shape=points
            ),
        )

    def _check_start(self, state: BodyState) -> BodyState:
        """Refuse a start of another shape, or with a stress outside the criterion."""
        start = self._check_shape("start", state)
        none = np.zeros_like(start.stress)
        outside = np.isinf(self.soil.bipotential(none, start.stress))
        if outside.any():
            cell, point = np.argwhere(outside)[0]
            over = self.soil.criterion(start.stress)[cell, point]
            raise ValueError(
                f"stress of start violates the criterion at point {point} of cell {cell} "
                f"by {over:g}: start from an admissible stress"
            )
        return start
