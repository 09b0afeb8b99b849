"""Draws 10-stop-rule.png: speed against error, down to what the mesh is worth.

python docs/paper/figures_stop_rule.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bipot_rs import scene
from bipot_rs.discretisation import Estimator
from bipot_rs.mesh_error.enough import tolerance

HERE = Path(__file__).parent
SCENES = (("cattaneo_mindlin", 10), ("sheared_cube", 6))
METHODS = ("auto", "gauss_seidel", "nesterov", "uzawa")
LADDER = tuple(10.0 ** (-k / 2) for k in range(1, 21))


def main() -> None:
    """Draw the picture."""
    figure = Figure(figsize=(11.0, 4.0), layout="constrained")
    for axes, (name, n) in zip(figure.subplots(1, 2), SCENES, strict=True):
        read = scene.read(name, ["mesh.element=P1", f"mesh.n={n}"])
        case = scene.assemble(read, scene.bodies(read))
        problem, K = case.model.problem(), case.model.K
        estimator = Estimator(case)
        exact = problem.solve(case.load, case.prescribed, tol=1e-14).displacement
        size = max(float(u @ (K @ u)) for u in exact)
        mesh = 0.0
        for color, method in enumerate(METHODS):
            enough = tolerance(estimator, problem, method=method)
            mesh = enough.discretisation
            curve = []
            for tol in (*LADDER, enough.tol):
                result = problem.solve(
                    case.load, case.prescribed, method=method, tol=tol
                )
                off = result.displacement - exact
                missed = max(float(u @ (K @ u)) for u in off)
                curve.append((result.work.sum(), np.sqrt(missed / size)))
            *ladder, stop = curve
            work, error = np.array(ladder).T
            axes.loglog(work, error, ".-", color=f"C{color}", label=method)
            axes.plot(*stop, "o", color=f"C{color}", ms=11, mfc="none", mew=2)
        axes.axhline(mesh, color="grey", lw=1)
        axes.axhline(mesh / 10, color="grey", lw=1, ls="--")
        axes.text(axes.get_xlim()[1], mesh, "mesh ", ha="right", va="bottom", size=8)
        axes.text(
            axes.get_xlim()[1], mesh / 10, "a tenth ", ha="right", va="bottom", size=8
        )
        axes.set_title(f"{name}, n = {n}, P1", size=10)
        axes.set_xlabel("products with W, all load steps")
        axes.set_ylim(1e-11, 1.0)
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("error of u left by the iteration, energy norm")
    figure.axes[0].plot([], [], "o", color="grey", ms=11, mfc="none", label="stopped")
    figure.axes[0].legend(fontsize="small", frameon=False)
    figure.savefig(HERE / "10-stop-rule.png", dpi=90)


if __name__ == "__main__":
    main()
