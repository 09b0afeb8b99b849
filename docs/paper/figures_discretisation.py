"""Draws 10-discretisation-error.png: where the mesh is coarse, and what estimates are worth.

    python docs/paper/figures_discretisation.py

The curves are those of the chapter's table, which benches/discretisation_error.py writes.
"""

from pathlib import Path

from matplotlib.figure import Figure

from bipot_rs import scene
from bipot_rs.discretisation import discretisation_error
from bipot_rs.plots.run_figure import draw_error

HERE = Path(__file__).parent
HEAD = "| scene | mu | n |"


def rows(page: str) -> list[list[str]]:
    """Cells of the table of effectivities."""
    _, _, table = page.partition(HEAD)
    lines = table.partition("<!-- end")[0].splitlines()[2:]
    return [
        [cell.strip() for cell in line.strip("|").split("|")] for line in lines if line
    ]


def main() -> None:
    """Draw the picture."""
    read = scene.read("cattaneo_mindlin", ["mesh.element=P1"])
    case = scene.assemble(read, scene.bodies(read))
    result = case.model.problem().solve(case.load, case.prescribed)
    error = discretisation_error(case, result)
    figure = Figure(figsize=(13.0, 4.0), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=[2.0, 1.2])
    model = case.model
    draw_error(
        left, model.nodes, model.cells, error.cells, contacts=model.points, unit="mm"
    )
    left.suptitle(f"cattaneo_mindlin, n = 10: {error.kind}, {error.relative:.1%}")
    axes = right.subplots()
    curves: dict[tuple[str, str], list[tuple[float, float, float]]] = {}
    for name, mu, n, _, _, estimate, true, *_ in rows(
        (HERE / "10-discretisation-error.md").read_text(encoding="utf-8")
    ):
        curves.setdefault((name, mu), []).append((int(n), float(estimate), float(true)))
    for k, ((name, mu), points) in enumerate(curves.items()):
        n, estimate, true = zip(*points, strict=True)
        kind = "bound" if mu == "0" else "indicator"
        axes.loglog(
            n, estimate, "o-", color=f"C{k}", ms=4, label=f"{name}, μ = {mu}: {kind}"
        )
        axes.loglog(n, true, "s:", color=f"C{k}", ms=4, mfc="white")
    axes.plot([], [], "s:", color="grey", mfc="white", label="true error")
    axes.set_xlabel("n")
    axes.set_ylabel("relative error in energy norm")
    axes.set_ylim(0.012, 0.8)
    axes.legend(fontsize="x-small", frameon=False, loc="lower left")
    axes.spines[["top", "right"]].set_visible(False)
    axes.minorticks_off()
    axes.set_yticks([0.02, 0.05, 0.1, 0.2, 0.4], ["2 %", "5 %", "10 %", "20 %", "40 %"])
    axes.set_xticks([2, 4, 8, 16, 32], ["2", "4", "8", "16", "32"])
    figure.savefig(HERE / "10-discretisation-error.png", dpi=80)


if __name__ == "__main__":
    main()
