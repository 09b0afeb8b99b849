"""`ContactProblem.wear`: repeat a load path, and wear the contacts."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from bipot_rs._lib.validation import callback, integer, iteration_limit, settings
from bipot_rs.contact.path.load_path import Following
from bipot_rs.contact.path.load_paths import LoadPaths
from bipot_rs.contact.results.solution import Step

if TYPE_CHECKING:
    from bipot_rs.contact.path.moving_gaps import MovingGaps
    from bipot_rs.contact.results.state import Start
    from bipot_rs.contact.wear.record import Wear


class Wearing(LoadPaths):
    """The part of a `ContactProblem` that repeats load paths with wear."""

    def wear(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        *,
        coefficient: ArrayLike,
        cycles: int,
        jump: bool = True,
        rtol: float = 0.01,
        method: str = "auto",
        tol: float = 1e-10,
        max_iterations: int | None = None,
        max_seconds: float | None = None,
        start: Wear | Start | None = None,
        on_cycle: Callable[[int, Step], object] | None = None,
        gap: ArrayLike | MovingGaps | None = None,
        maxiter: int | None = None,
    ) -> Wear:
        """Repeat a load path, and wear the contacts by Archard's law.

        After each load step the gap of each contact grows by ``k p ‖slip‖`` with the
        pressure ``p = r_n / area``, equation (28). The slip history continues from cycle to
        cycle. Only gaps change: nothing is factored again. ``area`` must be known.

        The depth that a cycle wears off changes slowly, so that cycles may be jumped over
        by Heun's method: see section 16 of ``docs/theory.md`` for its estimate of the error,
        and for the bound of jumps beyond which pressures would oscillate.

        Parameters
        ----------
        load, prescribed, gap
            One cycle, as in `solve`. With `MovingGaps` each step wears along its own normal;
            the bound of jumps uses the frames of B.
        coefficient
            Wear coefficient ``k``, depth per pressure and slip [1/stress], a number or
            ``(n_c,)``: Archard's dimensionless coefficient divided by the hardness. For two
            worn bodies it is the sum of theirs.
        cycles
            Number of cycles.
        jump
            Whether cycles may be jumped over. Otherwise every cycle is solved.
        rtol
            Allowed error of the depth by jumps, relative to the largest depth.
        method, tol, max_iterations, max_seconds
            As in `solve`.
        start
            State before the first cycle: a `Result`, a step or a `State` that presses the
            bodies, which wears nothing, or a `Wear` to continue, whose cycles and depths are
            counted on.
            `solve` continues from ``wear.result`` with ``gap`` plus ``wear.depth[-1]``.
        on_cycle
            Called as ``on_cycle(number, step)`` with the last step of each cycle that was
            solved; ``step.wear`` is the depth.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the areas are not known; the message names it.
        NoEquilibriumError, NotConvergedError
            A load step of a cycle failed. ``.result`` holds the steps of this cycle before
            it, and ``.wear`` the cycles before. If this happens in a trial, the jump is
            rejected instead.

        Examples
        --------
        A point on two springs is held 10 mm below a surface and pulled along it by 4 mm to
        and fro. The pressure decays with the depth that is worn off:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> K, B = 1e3 * np.eye(2), np.array([[1.0, 0.0], [0.0, 1.0]])
        >>> problem = bp.ContactProblem(K, B, gap=[-0.01], mu=0.0, area=[1e-4])
        >>> pull = np.array([[0.0, 4.0], [0.0, -4.0]])
        >>> wear = problem.wear(pull, coefficient=2.5e-8, cycles=400, jump=False)
        >>> wear.pressure[[0, 199, 399], 0].round(-1)  # Pa
        array([99900., 45030., 20220.])
        >>> jumped = problem.wear(pull, coefficient=2.5e-8, cycles=400, rtol=1e-3)
        >>> jumped.paths < 120, bool(abs(jumped.depth[-1] / wear.depth[-1] - 1) < 1e-3)
        (True, True)
        """
        from bipot_rs.contact.wear.begin import begun, coefficients, relative
        from bipot_rs.contact.wear.cycle import Cycles
        from bipot_rs.contact.wear.jumps import Run
        from bipot_rs.contact.wear.stability import Stability

        chosen = settings(
            method, tol, iteration_limit(max_iterations, maxiter), max_seconds
        )
        callback("on_cycle", on_cycle)
        area, contacts = self._contacts["area"], self._shape[1]
        if area is None:
            raise ValueError(
                "area is missing: wear needs pressures, so pass area= to ContactProblem"
            )
        k = coefficients(coefficient, contacts)
        count = integer("cycles", cycles, least=1)
        if not isinstance(jump, bool):
            raise TypeError(f"jump is {jump!r}, expected a bool")
        allowed = relative(rtol)
        at = begun(start, self._shape[1:])
        totals = self._loading.totals(load, prescribed, gap, None)
        engine = self._engine(count * len(totals), method)

        def path(at: Step | None) -> Following:
            return self._following(engine, self._mu, chosen, at)

        stability = Stability(
            self._matrix(), self._contact, self._fixed, self._shape[2]
        )
        made = Cycles(path, totals, self._given.gap, k, area)
        return Run(made, at, count, allowed, stability, jump, on_cycle).go()
