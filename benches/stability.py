"""Errors and work over the whole range of one parameter, compared with rounding bounds.

python benches/stability.py [--study NAME] [--draw]

Writes ``stability_NAME.csv`` and ``stability_NAME.png`` into `results` and the table of
``docs/stability.md``; with ``--draw`` only figures and table, from the CSV files. All studies
take about five minutes and 4 GB.
"""

import argparse
import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import tables
from plot_style import light_grid, pyplot
from studies import contrast, friction, gaps, poisson, size, slender, steps
from studies.measure import Row

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "stability.md"
MARK = "<!-- table by benches/stability.py -->"
# Smaller errors are drawn at this value.
FOOT = 1e-17
# Factor of the bounds, which are of first order and without constants: entries of K are
# sums over four or eight cells, those of W of about a hundred terms, and rounding errors
# add up as the square root of the number of terms.
CONSTANT = 4.0


class Study(NamedTuple):
    """Function that yields the rows, and label of the axis."""

    rows: Callable[[], Iterator[Row]]
    axis: str


STUDIES = {
    "poisson": Study(poisson.rows, "1/2 - ν"),
    "contrast": Study(contrast.rows, "E above / E below"),
    "friction": Study(friction.rows, "friction coefficient μ"),
    "gaps": Study(gaps.rows, "gap / size"),
    "slender": Study(slender.slender, "length / height"),
    "needles": Study(slender.needles, "width / height of the cells at the contact"),
    "steps": Study(steps.rows, "load of a step / load"),
    "size": Study(size.rows, "contacts"),
}


def table(name: str) -> Path:
    """CSV file of a study."""
    return tables.RESULTS / f"stability_{name}.csv"


def run(name: str) -> None:
    """Measure a study and write its CSV file."""
    began = time.perf_counter()
    lines = []
    for row in STUDIES[name].rows():
        lines.append({k: cell(x) for k, x in dataclasses.asdict(row).items()})
        print(f"{name}: {row.case}, {row.parameter:g}: {described(row)}", flush=True)
    tables.write_rows(table(name), lines)
    print(f"{name}: {time.perf_counter() - began:.1f} s")


def cell(x: object) -> str:
    """Format with three digits; further digits vary from run to run."""
    return f"{x:.3g}" if isinstance(x, float) else str(x)


def described(row: Row) -> str:
    """One line of text for a row."""
    if row.outcome != "converged":
        return row.outcome
    return (
        f"r {row.error_r:.0e}, v {row.error_v:.0e}, u {row.error_u:.0e}, "
        f"{share(row):.2f} of the bound, "
        f"statuses {'right' if row.statuses_right else 'WRONG'}, "
        f"{row.products:.0f} products"
    )


def share(row: Row) -> float:
    """Largest of the three errors divided by their bounds; NaN if none is known."""
    pairs = (
        (row.error_r, row.bound_r),
        (row.error_v, row.bound_v),
        (row.error_u, row.bound_u),
    )
    shares = [e / (CONSTANT * b) for e, b in pairs if e == e and b == b and b + e > 0]
    return max(shares, default=float("nan"))


def read(name: str) -> dict[str, list[Row]]:
    """Rows of a study by case, from its CSV file."""
    kinds = {f.name: f.type for f in dataclasses.fields(Row)}
    cases: dict[str, list[Row]] = {}
    for line in tables.read_rows(table(name)):
        values = {
            k: x == "True" if kinds[k] is bool else kinds[k](x)  # type: ignore[operator]
            for k, x in line.items()
        }
        cases.setdefault(line["case"], []).append(Row(**values))
    return cases


def summary() -> str:
    """Table of the page, one row for each case."""
    head = tables.columns("study | case | over | r | v | u | of the bound | products")
    lines = []
    for name, study in STUDIES.items():
        for case, rows in read(name).items():
            solved = [r for r in rows if r.outcome == "converged"]
            ends = sorted(r.parameter for r in solved)
            over = f"{ends[0]:g} … {ends[-1]:g}"
            refused = [f"{r.parameter:g}" for r in rows if r.outcome != "converged"]
            over += ", refused at " + ", ".join(refused) if refused else ""
            errors = [
                largest(getattr(r, f"error_{symbol}") for r in solved)
                for symbol in "rvu"
            ]
            products = sorted(r.products for r in solved)
            work = f"{products[0]:.0f} … {products[-1]:.0f}"
            worst = largest(map(share, solved))
            of = "" if worst != worst else f"{worst:.2f}"
            shown = ["" if e != e else f"{e:.0e}" for e in errors]
            lines.append((name, case, f"{study.axis}: {over}", *shown, of, work))
    return tables.table(head, lines) + "\n"


def largest(values: Iterable[float]) -> float:
    """Largest of the values that are not NaN; NaN if there is none."""
    return max((x for x in values if x == x), default=float("nan"))


def write_page() -> None:
    """Write the table into the page."""
    text = PAGE.read_text(encoding="utf-8")
    head, _, rest = text.partition(MARK)
    _, _, tail = rest.partition(MARK)
    PAGE.write_text(f"{head}{MARK}\n{summary()}{MARK}{tail}", encoding="utf-8")


def draw(name: str) -> None:
    """Draw one panel of errors and bounds for each case, and one of the work."""
    plt = pyplot(8)
    cases = read(name)
    width = 2.6 * (len(cases) + 1)
    figure, panels = plt.subplots(1, len(cases) + 1, figsize=(width, 3.0))
    *errors, work = panels
    # Wong's colours, each with its own mark.
    styles = {"r": ("#D55E00", "o"), "v": ("#009E73", "^"), "u": ("#0072B2", "s")}
    values = [r.parameter for rows in cases.values() for r in rows]
    least, most = min(x for x in values if x > 0), max(values)
    # Zero has its own place on the logarithmic axis.
    zero = least / 30
    lines = iter(("-", "--", ":", "-."))
    for panel, (case, rows) in zip(errors, cases.items(), strict=True):
        x = np.array([r.parameter or zero for r in rows])
        for symbol, (colour, mark) in styles.items():
            error = np.array([getattr(r, f"error_{symbol}") for r in rows])
            bound = np.array([getattr(r, f"bound_{symbol}") for r in rows])
            seen = np.isfinite(error)
            if seen.any():
                # An error below double precision is drawn at the foot.
                shown = np.maximum(error[seen], FOOT)
                panel.plot(x[seen], shown, mark, color=colour, ms=3.5, label=symbol)
                # A zero bound, without contacts, is not drawn on a logarithmic axis.
                bound = np.where(bound > 0, CONSTANT * bound, np.nan)
                panel.plot(x, bound, color=colour, lw=1, ls="--")
        panel.set(yscale="log", title=case, xlabel=STUDIES[name].axis)
        panel.set_ylim(bottom=FOOT / 2, top=10 * panel.get_ylim()[1])
        products = [r.products for r in rows]
        work.plot(x, products, color="k", ls=next(lines), label=case)
    work.set(yscale="log", title="products with W", xlabel=STUDIES[name].axis)
    work.set_ylim(bottom=1, top=max(20, 2 * work.get_ylim()[1]))
    for panel in panels:
        panel.set_xscale("log")
        if 0 in values:
            first, last = round(np.log10(least)), round(np.log10(most))
            step = 4 if last - first > 8 else 1
            # No label next to that of zero.
            powers = range(first + (step > 1) * step, last + 1, step)
            labels = [f"$10^{{{k}}}$" for k in powers]
            panel.set_xticks([zero, *(10.0**k for k in powers)], ["0", *labels])
            panel.minorticks_off()
        light_grid(panel)
    errors[0].set_ylabel("relative error; dashed: bound")
    # Below the panels, so that no mark looks like a point.
    marks, symbols = errors[0].get_legend_handles_labels()
    figure.legend(
        marks, symbols, loc="lower left", ncols=3, frameon=False, handletextpad=0.1
    )
    if len(cases) > 1:
        figure.legend(
            *work.get_legend_handles_labels(),
            loc="lower right",
            ncols=len(cases),
            frameon=False,
            fontsize=7,
        )
    figure.tight_layout(rect=(0, 0.09, 1, 1))
    figure.savefig(table(name).with_suffix(".png"), dpi=100)
    plt.close(figure)


def main() -> None:
    """Measure, draw, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--study", choices=STUDIES, action="append")
    parser.add_argument("--draw", action="store_true", help="do not measure")
    chosen = parser.parse_args()
    for name in chosen.study or STUDIES:
        if not chosen.draw:
            run(name)
        draw(name)
    write_page()


if __name__ == "__main__":
    main()
