"""Draws 10-stop-rule.png: speed against error, down to what the mesh is worth.

python docs/paper/figures_stop_rule.py
"""

from pathlib import Path

import numpy as np
from curves import Point, read, save, write
from matplotlib.figure import Figure

from bipot_rs import scene
from bipot_rs.discretisation import Estimator
from bipot_rs.discretisation.stopping import tolerance

PICTURE = Path(__file__).resolve().with_name("10-stop-rule.png")
NUMBERS = PICTURE.with_suffix(".csv")
SCENES = (("cattaneo_mindlin", 10), ("sheared_cube", 6))
METHODS = ("auto", "gauss_seidel", "nesterov", "uzawa")
LADDER = tuple(10.0 ** (-k / 2) for k in range(1, 21))


def curves(name: str, n: int, methods: tuple[str, ...] = METHODS) -> list[Point]:
    """Work and error of each method on one scene; the error of the mesh without work.

    ``METHOD, stopped`` is the point where the rule of the chapter stops.
    """
    read_ = scene.read(name, ["mesh.element=P1", f"mesh.n={n}"])
    case = scene.assemble(read_, scene.bodies(read_))
    problem, K = case.model.problem(), case.model.K
    estimator = Estimator(case)
    exact = problem.solve(case.load, case.prescribed, tol=1e-14).displacement
    size = max(float(u @ (K @ u)) for u in exact)
    panel = f"{name}, n = {n}, P1"
    points_of_panel = []
    for method in methods:
        enough = tolerance(estimator, problem, method=method)
        points_of_panel.append(
            Point(panel, f"{method}, mesh", 0.0, enough.discretisation)
        )
        stopped = f"{method}, stopped"
        for curve, tol in (*((method, t) for t in LADDER), (stopped, enough.tol)):
            result = problem.solve(case.load, case.prescribed, method=method, tol=tol)
            off = result.displacement - exact
            missed = np.sqrt(max(float(u @ (K @ u)) for u in off) / size)
            points_of_panel.append(
                Point(panel, curve, float(result.work.sum()), missed)
            )
    return points_of_panel


def main() -> None:
    """Write the numbers and the picture."""
    write(NUMBERS, [point for name, n in SCENES for point in curves(name, n)])
    stored_points = read(NUMBERS)
    figure = Figure(figsize=(11.0, 4.0), layout="constrained")
    panels = list(dict.fromkeys(point.panel for point in stored_points))
    for axes, panel in zip(figure.subplots(1, 2), panels, strict=True):

        def of(curve: str, panel: str = panel) -> np.ndarray:
            xy = [
                (p.x, p.y)
                for p in stored_points
                if (p.panel, p.curve) == (panel, curve)
            ]
            return np.transpose(xy)

        mesh = 0.0
        for color, method in enumerate(METHODS):
            axes.loglog(*of(method), ".-", color=f"C{color}", label=method)
            stop = of(f"{method}, stopped")
            axes.plot(*stop, "o", color=f"C{color}", ms=11, mfc="none", mew=2)
            mesh = float(of(f"{method}, mesh")[1, 0])
        axes.axhline(mesh, color="grey", lw=1)
        axes.axhline(mesh / 10, color="grey", lw=1, ls="--")
        axes.text(axes.get_xlim()[1], mesh, "mesh ", ha="right", va="bottom", size=8)
        axes.text(
            axes.get_xlim()[1], mesh / 10, "a tenth ", ha="right", va="bottom", size=8
        )
        axes.set_title(panel, size=10)
        axes.set_xlabel("products with W, all load steps")
        axes.set_ylim(1e-11, 1.0)
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("error of u left by the iteration, energy norm")
    figure.axes[0].plot([], [], "o", color="grey", ms=11, mfc="none", label="stopped")
    figure.axes[0].legend(fontsize="small", frameon=False)
    save(figure, PICTURE, NUMBERS, dpi=90)


if __name__ == "__main__":
    main()
