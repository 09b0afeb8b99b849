"""Draws `9-error-bound.svg`: bound and true error along an iteration.

python docs/paper/figures_bound.py
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np

import bipot_rs as bp
from bipot_rs import scene

mpl.use("svg")
import matplotlib.pyplot as plt

HERE = Path(__file__).resolve().parent


def blocks(mu: float) -> bp.ReducedProblem:
    """The first load step of a shipped scene, with another friction."""
    read = scene.read("two_blocks", ["mesh.n=4"])
    case = scene.assemble(read, scene.bodies(read))
    load = None if case.load is None else case.load[0]
    step = case.model.problem().reduced(load, case.prescribed[0])
    return bp.ReducedProblem(step.W, step.q, mu)


def draw(axes: plt.Axes, problem: bp.ReducedProblem, title: str) -> None:
    """The curves of one problem."""
    exact = problem.solve(tol=1e-15).reaction
    counts = [*range(1, 20), *range(20, 80, 4), *range(80, 400, 10)]
    solutions = []
    for count in counts:
        solutions.append(problem.solve("nesterov", 1e-13, max_iterations=count))
        if solutions[-1].converged:
            break
    points = np.array([solution.reaction for solution in solutions])
    bounds = problem.error_bounds(points)
    work = [solution.work for solution in solutions]

    def norm(d: np.ndarray) -> float:
        return float(np.sqrt(d.ravel() @ problem.W @ d.ravel()))

    size = norm(exact)
    axes.semilogy(
        work, [norm(p - exact) / size for p in points], "k-", label="true error"
    )
    for name, style, label in (
        ("energy", "C0-", "guaranteed bound"),
        ("energy_by_gap", "C1--", "bound by the gap"),
    ):
        values = [getattr(bound, name) for bound in bounds]
        if None not in values:
            axes.semilogy(work, np.array(values) / size, style, label=label)
    axes.semilogy(work, [s.residual for s in solutions], "0.6", label="residual η")
    axes.set(xlabel="products with W", title=title)
    axes.grid(visible=True, alpha=0.3)


def main() -> None:
    """Write the picture."""
    plt.rcParams.update({"svg.hashsalt": "bipot", "svg.fonttype": "none"})
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), sharey=True, layout="tight")
    draw(axes[0], blocks(0.2), "μ = 0.2, L < 1")
    draw(axes[1], blocks(0.6), "μ = 0.6")
    axes[0].set_ylabel("‖r − r*‖ / ‖r*‖ in the norm of W")
    axes[0].legend()
    figure.savefig(HERE / "9-error-bound.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
