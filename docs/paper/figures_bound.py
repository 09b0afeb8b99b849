"""Draws `9-error-bound.svg`: bound and true error along an iteration; writes its numbers.

python docs/paper/figures_bound.py
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from curves import Point, read, save, write

import bipot_rs as bp
from bipot_rs import scene

mpl.use("svg")
import matplotlib.pyplot as plt

PICTURE = Path(__file__).resolve().with_name("9-error-bound.svg")
NUMBERS = PICTURE.with_suffix(".csv")
PANELS = (("μ = 0.2, L < 1", 0.2), ("μ = 0.6", 0.6))
TRUE, BOUND = "true error", "guaranteed bound"
BY_GAP, RESIDUAL = "bound by the gap", "residual η"
STYLES = {TRUE: "k-", BOUND: "C0-", BY_GAP: "C1--", RESIDUAL: "0.6"}


def blocks(mu: float) -> bp.ReducedProblem:
    """The first load step of a shipped scene, with another friction."""
    read = scene.read("two_blocks", ["mesh.n=4"])
    case = scene.assemble(read, scene.bodies(read))
    load = None if case.load is None else case.load[0]
    step = case.model.problem().reduced(load, case.prescribed[0])
    return bp.ReducedProblem(step.W, step.q, mu)


def norm(W: np.ndarray, d: np.ndarray) -> float:
    """Length in the norm of W."""
    return float(np.sqrt(d.ravel() @ W @ d.ravel()))


def curves(panel: str, mu: float) -> list[Point]:
    """The curves of one panel, along an iteration."""
    problem = blocks(mu)
    exact = problem.solve(tol=1e-15).reaction
    counts = [*range(1, 20), *range(20, 80, 4), *range(80, 400, 10)]
    solutions = []
    for count in counts:
        solutions.append(problem.solve("nesterov", 1e-13, max_iterations=count))
        if solutions[-1].converged:
            break
    reactions = [solution.reaction for solution in solutions]
    bounds = problem.error_bounds(np.array(reactions))
    size = norm(problem.W, exact)
    curves_by_name = {
        TRUE: [norm(problem.W, r - exact) / size for r in reactions],
        BOUND: [bound.energy for bound in bounds],
        BY_GAP: [bound.energy_by_gap for bound in bounds],
        RESIDUAL: [solution.residual for solution in solutions],
    }
    for name in (BOUND, BY_GAP):
        curves_by_name[name] = (
            []
            if None in curves_by_name[name]
            else [x / size for x in curves_by_name[name]]
        )
    work = [solution.work for solution in solutions]
    return [
        Point(panel, name, x, y)
        for name, values in curves_by_name.items()
        for x, y in zip(work, values, strict=bool(values))
    ]


def points() -> list[Point]:
    """All curves of the picture."""
    return [point for panel, mu in PANELS for point in curves(panel, mu)]


def main() -> None:
    """Write the numbers and the picture."""
    write(NUMBERS, points())
    stored_points = read(NUMBERS)
    plt.rcParams.update({"svg.hashsalt": "bipot", "svg.fonttype": "none"})
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), sharey=True, layout="tight")
    for ax, (panel, _) in zip(axes, PANELS, strict=True):
        for name, style in STYLES.items():
            xy = [
                (p.x, p.y) for p in stored_points if (p.panel, p.curve) == (panel, name)
            ]
            if xy:
                ax.semilogy(*np.transpose(xy), style, label=name)
        ax.set(xlabel="products with W", title=panel)
        ax.grid(visible=True, alpha=0.3)
    axes[0].set_ylabel("‖r − r*‖ / ‖r*‖ in the norm of W")
    axes[0].legend()
    save(figure, PICTURE, NUMBERS)


if __name__ == "__main__":
    main()
