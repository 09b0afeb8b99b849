"""Draw whole_job.csv and time_against_error.csv: seconds against unknowns and against error.

python benches/whole_job_figure.py [--quick]
"""

import argparse

import numpy as np
import tables
from plot_style import light_grid, pyplot

# Wong's colours, which colour-blind readers can distinguish; each has its own mark.
STYLES = {
    "bipot_rs": ("#000000", "o"),
    "GetFEM": ("#D55E00", "s"),
    "Siconos": ("#0072B2", "^"),
    "SciPy": ("#009E73", "D"),
}
PANELS = {
    "2D": {"pressed_block": "-", "cattaneo_mindlin": "--"},
    "3D": {"sheared_cube": "-", "two_blocks": "--", "cyclic_cube": ":"},
}


def dress(axis):
    """Set logarithmic axes and a light grid."""
    axis.set(xscale="log", yscale="log")
    axis.tick_params(axis="x", which="minor", labelbottom=False)
    light_grid(axis)


def unknowns(plt, rows, target):
    """Draw job seconds against unknowns, one panel for 2D and one for 3D."""
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), sharey=True)
    for axis, (title, scenes) in zip(axes, PANELS.items(), strict=True):
        for scene, dash in scenes.items():
            for program, (colour, mark) in STYLES.items():
                points = [
                    (float(row["dofs"]), float(row["job_min"]))
                    for row in rows
                    if (row["scene"], row["program"]) == (scene, program)
                    and row["job_min"]
                ]
                if points:
                    width = 2.2 if program == "bipot_rs" else 1.3
                    style = {"color": colour, "marker": mark, "markersize": 4}
                    axis.plot(*np.array(points).T, ls=dash, lw=width, **style)
        dress(axis)
        axis.set_xlabel(f"unknowns, {title}")
        handles = [
            plt.Line2D([], [], color="0.4", ls=dash, label=scene)
            for scene, dash in scenes.items()
        ]
        place = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "ncols": 3}
        axis.legend(handles=handles, frameon=False, **place)
    axes[0].set_ylabel("seconds, mesh to written result")
    present = {row["program"] for row in rows if row["job_min"]}
    legend(plt, figure, present)
    figure.savefig(target, dpi=110)
    plt.close(figure)


def legend(plt, figure, present):
    """Draw the names of the programs below the panels."""
    handles = [
        plt.Line2D([], [], color=colour, marker=mark, label=program)
        for program, (colour, mark) in STYLES.items()
        if program in present
    ]
    figure.tight_layout(rect=(0, 0.08, 1, 1))
    figure.legend(handles=handles, loc="lower center", ncols=4, frameon=False)


def frontier(points):
    """For each error the least seconds that reach it or a smaller one."""
    best = []
    for error, seconds in sorted(points):
        if not best or seconds < best[-1][1]:
            best.append((error, seconds))
    return best[::-1]


def errors(plt, rows, target):
    """Draw seconds against error, of the whole job and of its load steps."""
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), sharex=True)
    titles = {"job": "mesh to written result", "contact": "load steps alone"}
    for axis, (key, title) in zip(axes, titles.items(), strict=True):
        for program, (colour, mark) in STYLES.items():
            points = [
                (float(row["error"]), float(row[key]))
                for row in rows
                if row["program"] == program
            ]
            if points:
                axis.scatter(*np.array(points).T, s=14, c=colour, marker=mark)
                best = np.array(frontier(points)).T
                # A run that reaches a small error also reaches a larger one.
                far = np.insert(best[0], 0, 1.0), np.insert(best[1], 0, best[1, 0])
                width = 2.2 if program == "bipot_rs" else 1.3
                axis.step(*far, where="pre", lw=width, color=colour)
        dress(axis)
        axis.set(title=title, xlabel="traction error against the reference")
        axis.set(xlim=(1, 1e-16), xticks=10.0 ** -np.arange(0, 17, 4))
        axis.tick_params(axis="x", which="minor", bottom=False)
    axes[0].set_ylabel("seconds")
    figure.suptitle(f"{rows[0]['scene']}, n = {rows[0]['n']}", y=0.99, fontsize=10)
    legend(plt, figure, {row["program"] for row in rows})
    figure.savefig(target, dpi=110)
    plt.close(figure)


def main():
    """Draw both figures."""
    plt = pyplot()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick", action="store_true", help="draw the files of out/bench"
    )
    folder = tables.folder(parser.parse_args().quick) / "results"
    unknowns(
        plt,
        tables.read_rows(folder / "whole_job.csv"),
        folder / "time_against_unknowns.png",
    )
    sheet = folder / "time_against_error.csv"
    errors(plt, tables.read_rows(sheet), sheet.with_suffix(".png"))


if __name__ == "__main__":
    main()
