"""Draw results/fclib.csv: performance profiles by family, after Dolan and Moré.

    python benches/fclib_figure.py

A curve gives, for each factor on the axis, the share of the problems that a program
solves within that factor of the time of the fastest program. At the left edge it is the
share on which the program is the fastest, at the right edge the share that it solves.
"""

import numpy as np
import tables
from plot_style import light_grid, pyplot
from speed_against_error_figure import STYLES

PROGRAMS = STYLES | {
    "NSGS": ("#56B4E9", "X", "Siconos NSGS"),
    "NSN_AC": ("#7A5C00", "d", "Siconos NSN_AC"),
}
# Families with fewer problems are drawn together as "others".
FEWEST = 3
MAIN = 1e-8


def read(path):
    """Seconds ``{target: {family: {program: (problems,)}}}``, infinite if unsolved."""
    lines = tables.read_rows(path)
    of = {line["file"]: line["family"] for line in lines}
    size = {name: list(of.values()).count(name) for name in of.values()}
    programs = list(dict.fromkeys(line["program"] for line in lines))
    seconds = {
        (line["file"], line["program"], float(line["target"])): float(line["seconds"])
        for line in lines
        if line["solved"] == "True"
    }

    def all_of(files, target):
        return {
            p: np.array([seconds.get((f, p, target), np.inf) for f in files])
            for p in programs
        }

    groups = {"all": list(of)}
    for file, name in of.items():
        key = name if size[name] >= FEWEST else "others"
        groups.setdefault(key, []).append(file)
    if "others" in groups:
        groups["others"] = groups.pop("others")  # last
    targets = sorted({float(line["target"]) for line in lines}, reverse=True)
    return {t: {g: all_of(files, t) for g, files in groups.items()} for t in targets}


def profile(seconds):
    """Steps of each curve, ``{program: (factors, shares)}``."""
    best = np.min(list(seconds.values()), axis=0)
    curves = {}
    for program, program_times in seconds.items():
        solved = np.isfinite(program_times)
        ratios = np.sort(program_times[solved] / best[solved])
        curves[program] = ratios, np.arange(1, len(ratios) + 1) / len(program_times)
    return curves


def draw(source, target):
    """Draw the figure of a CSV file."""
    plt = pyplot()
    table = read(source)
    panels = [(f"all, η ≤ {t:.0e}", groups["all"]) for t, groups in table.items()]
    main = table.get(MAIN, next(iter(table.values())))
    panels += [
        (f"{name}, η ≤ {MAIN:.0e}", x) for name, x in main.items() if name != "all"
    ]
    rows = -(-len(panels) // 4)
    figure, axes = plt.subplots(rows, 4, figsize=(11, 2.7 * rows + 0.7), squeeze=False)
    longest = max(
        (x[-1] for _, s in panels for x, _ in profile(s).values() if len(x)),
        default=10.0,
    )
    edge = 1.3 * max(longest, 10.0)
    for panel, (title, seconds) in zip(axes.ravel(), panels, strict=False):
        curves = profile(seconds)
        # `auto` last, so that it lies on top.
        for program in sorted(curves, key=lambda p: p == "auto"):
            factors, shares = curves[program]
            colour, mark, _ = PROGRAMS[program]
            x = np.concatenate([[1.0], factors, [edge]])
            y = np.concatenate([[0.0], shares, shares[-1:] if len(shares) else [0.0]])
            width = 2.2 if program == "auto" else 1.3
            panel.step(x, y, where="post", color=colour, lw=width)
            panel.plot(edge, y[-1], color=colour, marker=mark, ms=4, clip_on=False)
        count = len(next(iter(seconds.values())))
        panel.set(xscale="log", xlim=(1, edge), ylim=(-0.03, 1.03))
        panel.set_title(f"{title} ({count})")
        light_grid(panel)
    for row in axes:
        row[0].set_ylabel("share solved")
    for panel in axes.ravel()[max(len(panels) - 4, 0) : len(panels)]:
        panel.set_xlabel("seconds / the fastest")
    drawn = [p for p in PROGRAMS if p in panels[0][1]]
    handles = [
        plt.Line2D(
            [], [], color=PROGRAMS[p][0], marker=PROGRAMS[p][1], label=PROGRAMS[p][2]
        )
        for p in drawn
    ]
    for panel in axes.ravel()[len(panels) :]:
        panel.axis("off")
    figure.tight_layout(rect=(0, 0.6 / (2.7 * rows + 0.7), 1, 1))
    figure.legend(handles=handles, loc="lower center", ncols=4, frameon=False)
    figure.savefig(target, dpi=110, metadata={"Software": None})
    plt.close(figure)


def main():
    """Draw the figure of the last run."""
    draw(tables.RESULTS / "fclib.csv", tables.RESULTS / "fclib.png")


if __name__ == "__main__":
    main()
