"""Types that an editor completes: `make types` checks this program, which nothing runs."""

from typing import assert_type

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

import bipot_rs as bp

K = np.eye(2)
problem = bp.ContactProblem(K, K, gap=[0.0], mu=0.3)
result = problem.solve([-1.0, 0.0])
assert_type(result, bp.Result)
assert_type(problem.follow(lambda s: [-s, 0.0]), bp.Result)
assert_type(problem.solve_many([{"load": [-1.0, 0.0]}]), list[bp.Result])
assert_type(bp.solve(K, K, gap=[0.0], mu=0.3, fixed=[0], tol=1e-9), bp.Result)
assert_type(bp.load("result.h5"), bp.Result)
assert_type(bp.load_result("result.h5"), bp.Result)
assert_type(result[-1], bp.Step)
assert_type(result.pressure, NDArray[np.float64])
assert_type(result.points, NDArray[np.float64])
assert_type(result[-1].shear_traction, NDArray[np.float64])
assert_type(bp.nodal_areas([[0.0, 0.0]], [[0, 0]]), NDArray[np.float64])
assert_type(problem.solve([-1.0, 0.0], mu=0.2, progress=True), bp.Result)
assert_type(result[1:], tuple[bp.Step, ...])
assert_type(list(result), list[bp.Step])
assert_type(result[-1].outcome, bp.Outcome)
assert_type(result[-1].error, bp.ErrorBound)
reduced = problem.reduced([-1.0, 0.0])
assert_type(reduced, bp.ReducedProblem)
assert_type(reduced.solve(), bp.Solution)
assert_type(reduced.answers()[0], bp.Solution)
assert_type(problem.existence([-1.0, 0.0]), bp.Existence)
assert_type(bp.plots.convergence(result), Axes)
assert_type(bp.plots.deformed(result), Axes)
assert_type(bp.plots.dissipation(result), Axes)
assert_type(bp.plots.force_displacement(result), Axes)
assert_type(bp.plots.resultants(result), Axes)
assert_type(bp.plots.sensitivity(result.vjp(), "gap"), Axes)
assert_type(bp.plots.slip(result), Axes)
assert_type(bp.plots.status_map(result), Axes)
assert_type(bp.plots.status_shares(result), Axes)
assert_type(bp.plots.surface_map(result), Axes)
assert_type(bp.plots.tractions(result), Axes)
worn = problem.wear([-1.0, 0.0], coefficient=1e-9, cycles=3)
assert_type(worn, bp.Wear)
assert_type(bp.plots.wear(worn), Axes)
ranges = bp.ReducedProblem([[0, 0], [0, 0]], [[0, 0]], 0, rigid=([[1], [0]], [-1]))
assert_type(ranges.reaction_range(0), bp.ReactionRange)
band = bp.plots.reaction_band(ranges.reaction_ranges(), contacts={"x": [[0, 0]]})
assert_type(band, Axes)

# mypy warns of an `ignore` that is not needed: these lines are errors.
assert_type(result[-1], bp.Result)  # type: ignore[assert-type]
bp.solve(K, K, gap=[0.0], mu=0.3, fixd=[0])  # type: ignore[call-arg]
