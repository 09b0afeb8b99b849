"""Draw speed_against_error.csv: products with W against true error, one panel for each set.

python benches/speed_against_error_figure.py
"""

from textwrap import fill

import numpy as np
import tables
from plot_style import light_grid, pyplot

# Wong's colours, which colour-blind readers can distinguish; each has its own mark.
STYLES = {
    "auto": ("#000000", "o", "auto"),
    "newton": ("#D55E00", "s", "Newton"),
    "gauss_seidel": ("#0072B2", "^", "Gauss–Seidel, accelerated"),
    "nesterov": ("#009E73", "D", "Nesterov, restarted"),
    "uzawa": ("#CC79A7", "v", "Uzawa, one projection"),
    "uzawa_two_projection": ("#E69F00", "P", "Uzawa, two projections"),
    "return_mapping": ("#8DA0CB", "h", "return mapping"),
    "perturbed_lagrangian": ("#A6D854", "d", "perturbed Lagrangian"),
    "displacement_principle": ("#56B4E9", "<", "displacement principle"),
    "alternating_principles": ("#8B6914", ">", "alternating principles"),
    "stress_principle": ("#7F7F7F", "X", "stress principle"),
    "minimising_sequence": ("#B2182B", "*", "minimising sequence"),
    "pivoting": ("#4D004B", "p", "pivoting"),
}
TITLES = {
    "held": "held blocks",
    "two bodies": "two bodies",
    "islands": "islands",
    "floating": "held by contact alone",
    "random": "random matrices",
    "rigid": "rigid, redundant",
    "scenes": "the shipped scenes",
}


def read(path):
    """Targets and median products, ``{set: {method: (2, targets)}}``."""
    curves = {}
    for line in tables.read_rows(path):
        if line["measure"] == "error":
            point = [float(line[k]) for k in ("target", "products_median")]
            methods = curves.setdefault(line["set"], {})
            methods.setdefault(line["method"], []).append(point)
    return {
        name: {method: np.array(points).T for method, points in methods.items()}
        for name, methods in curves.items()
    }


def draw(source, target):
    """Draw the figure of a CSV file."""
    plt = pyplot()
    curves = read(source)
    rows = -(-(len(curves) + 1) // 4)
    figure, axes = plt.subplots(
        rows, 4, figsize=(11, 2.9 * rows), sharex=True, sharey=True, squeeze=False
    )
    panels, open_ends = axes.ravel(), False
    for panel, (name, methods) in zip(panels, curves.items(), strict=False):
        missing = []
        # `auto` last, so that it lies on top.
        for method in sorted(methods, key=lambda m: m == "auto"):
            error, products = methods[method]
            colour, mark, label = STYLES[method]
            reached = np.isfinite(products)
            if not reached.any():
                missing.append(label)
                continue
            style = {"color": colour, "marker": mark, "markersize": 4}
            width = 2.2 if method == "auto" else 1.3
            panel.plot(error[reached], products[reached], lw=width, **style)
            if not reached.all():
                # If more than half are unsolved, the median is infinite.
                at, open_ends = np.flatnonzero(reached)[-1], True
                end = {"marker": "o", "mfc": "white", "mec": colour, "ms": 8}
                panel.plot(error[at], products[at], mew=1.5, **end)
        if missing:
            # Wrapped, because a long line would push the panels apart.
            note = fill("over half unsolved: " + ", ".join(missing), 32)
            panel.text(0.04, 0.04, note, transform=panel.transAxes, color="0.35")
        panel.set(xscale="log", yscale="log", title=TITLES[name])
        light_grid(panel)
    panels[0].set(xlim=(2e-2, 5e-13), xticks=[1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
    panels[0].minorticks_off()
    for row in axes:
        row[0].set_ylabel("products with W, median")
    drawn = [m for m in STYLES if any(m in methods for methods in curves.values())]
    handles = [
        plt.Line2D([], [], color=STYLES[m][0], marker=STYLES[m][1], label=STYLES[m][2])
        for m in drawn
    ]
    if open_ends:
        end = {"ls": "", "marker": "o", "mfc": "white", "mec": "0.3", "ms": 8}
        label = "beyond: over half unsolved"
        handles.append(plt.Line2D([], [], label=label, **end))
    for panel in panels[len(curves) :]:
        panel.axis("off")
    panels[-1].legend(handles=handles, loc="center", frameon=False)
    below = list(zip(panels, curves, strict=False))[-4:]
    for panel, name in below:
        # W of rigid assemblies does not determine r.
        panel.set_xlabel(f"true relative error of {'v' if name == 'rigid' else 'r'}")
        panel.tick_params(labelbottom=True)
    figure.tight_layout()
    figure.savefig(target, dpi=100)
    plt.close(figure)


if __name__ == "__main__":
    path = tables.RESULTS / "speed_against_error.csv"
    draw(path, path.with_suffix(".png"))
