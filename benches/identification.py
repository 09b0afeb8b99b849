"""Identification of μ(x), E and a gap: an exact Jacobian beside differences and a simplex.

    python benches/identification.py
    python benches/identification.py --quick
    python benches/identification.py --cells 194 32 --knots 9 33 --print

A block is pressed on a plate and moved to and fro, as in docs/tutorials/identification.md.
From tangential displacements of its surface, with noise, `scipy.optimize.least_squares` finds
the friction coefficient at knots along the surface, Young's modulus and the depth of a
recess. Ways: the exact Jacobian of `Result.jvp`, a column for each parameter; forward
differences; Nelder and Mead's simplex, which is stopped at ``--most`` paths. All have one
factor of K, because E divides the loads. Many knots are more than the data determine: the
differences between neighbouring knots are data too, zero with a standard deviation of
`VARIATION`. Counted are load paths (``paths``) and
columns of `jvp`. ``off`` is the largest distance from the parameters of the exact Jacobian,
in standard deviations; ``inside`` counts the true values in the intervals of ± 2
standard deviations.

Rewrites a table of `benches/README.md` and `results/identification.csv`.
"""

import argparse
import os
import time

import numpy as np
import tables
from scipy.optimize import least_squares, minimize

from bipot_rs import fem

SHEET = "identification.csv"
HEAD = tables.columns(
    "unknowns | contacts | steps | parameters | data | way | paths | jvp columns | s | "
    "processor s | "
    "inside | off"
)
YOUNG, PRESS, DEPTH = 3000.0, 10.0, 2e-3  # MPa, MPa, mm: first guesses
FRICTION = 0.3
TRUE_YOUNG, TRUE_DEPTH = 3300.0, 4e-3
NOISE = 1e-3  # mm, a tenth of a pixel of a camera that sees 20 mm with 2,000 pixels
VARIATION = (
    0.04  # of friction from knot to knot; the largest true one of 24 knots is 0.022
)
LOOP = np.array([0, 1, 2, 1, 0, -1, -2, -1, 0, 1, 2]) / 2  # of 0.03 mm


def true_friction(x):
    """The friction coefficient to find."""
    return 0.33 + 0.08 * np.sin(np.pi * x / 10 + 0.5)


class Rig:
    """A block, its load path and what a camera sees through the plate."""

    def __init__(self, cells, knots):
        wide, high = np.linspace(0, 20, cells[0] + 1), np.linspace(0, 5, cells[1] + 1)
        mesh = fem.box([wide, high], "quadrilateral")
        plane = ((0, 0), (0, 1))
        self.model = fem.assemble(
            [fem.Body("block", mesh, fem.Material(YOUNG, 0.35))],
            contacts=[fem.Contact("block", "bottom", mu=FRICTION, plane=plane)],
            supports=[fem.Support("block", "top", components=(0,))],
        )
        self.problem = self.model.problem()
        x = self.model.points[:, 0]
        places = np.linspace(0, 20, knots)
        self.shape = np.array([np.interp(x, places, hat) for hat in np.eye(knots)])
        self.recess = np.where(abs(x - 10) < 2.5, 1.0, 0.0)
        self.press = self.model.pressure("block", "top", PRESS)
        self.path = np.array([self.model.prescribed([(0.03 * s,)]) for s in LOOP])
        self.guess = np.array([*[FRICTION] * knots, YOUNG, DEPTH])
        self.true = np.array([*true_friction(places), TRUE_YOUNG, TRUE_DEPTH])
        steps = np.diff(np.eye(knots), axis=0) * FRICTION / VARIATION
        self.prior = np.pad(steps, ((0, 0), (0, 2)))
        self.paths = self.columns = 0
        self.last = (None, None)

    @staticmethod
    def seen(result):
        """Tangential displacements of the surface in all steps, or their derivatives."""
        return result.relative_displacement[:, :, 1].ravel()

    def solved(self, p):
        """The path of parameters, relative to the first guess."""
        self.paths += 1
        *knots, young, depth = p * self.guess
        case = {"load": self.press * YOUNG / young, "prescribed": self.path}
        case |= {"mu": knots @ self.shape, "gap": self.model.gap + depth * self.recess}
        (result,) = self.problem.solve_many([case])
        if not result.success:
            raise SystemExit(result.message)
        return result

    def measure(self, seed):
        """What is seen with the true parameters, with noise."""
        exact = self.seen(self.solved(self.true / self.guess))
        noise = np.random.default_rng(seed).normal(size=exact.size)
        self.measured = exact + NOISE * noise

    def residual(self, p):
        """Differences to the measurement and between knots, in standard deviations."""
        self.last = (p.copy(), self.solved(p))
        seen = (self.seen(self.last[1]) - self.measured) / NOISE
        return np.concatenate([seen, self.prior @ p])

    def jacobian(self, p):
        """Of `residual`, exactly."""
        at, result = self.last
        if not np.array_equal(at, p):
            result = self.solved(p)
        young = p[-2] * self.guess[-2]
        directions = [{"mu": hat} for hat in self.shape]
        directions += [{"load": -self.press * YOUNG / young**2}, {"gap": self.recess}]
        self.columns += len(directions)
        columns = [self.seen(result.jvp(**direction)) for direction in directions]
        return np.vstack([np.column_stack(columns) * self.guess / NOISE, self.prior])

    def ways(self, most):
        """Names of the ways, and what each finds from a start."""
        positive = {"bounds": (0.0, np.inf)}
        return {
            "exact Jacobian": lambda p: least_squares(
                self.residual, p, jac=self.jacobian, **positive
            ),
            "finite differences": lambda p: least_squares(self.residual, p, **positive),
            "Nelder-Mead": lambda p: minimize(
                lambda p: (self.residual(p) ** 2).sum(),
                p,
                method="Nelder-Mead",
                bounds=[(0.0, None)] * self.guess.size,
                options={"maxfev": most, "adaptive": True},
            ),
        }


def rows_of(cells, knots, most):
    """Rows of the CSV file for one number of parameters."""
    began = time.perf_counter()
    rig = Rig(cells, knots)
    rig.measure(seed=1)
    made = time.perf_counter() - began
    best = deviation = None
    for name, find in rig.ways(most).items():
        rig.paths = rig.columns = 0
        began, used = time.perf_counter(), time.process_time()
        fitted = find(np.ones(len(rig.guess)))
        seconds, used = time.perf_counter() - began, time.process_time() - used
        if best is None:
            best = fitted.x
            # The residuals are in standard deviations of the noise.
            deviation = np.sqrt(np.diag(np.linalg.inv(fitted.jac.T @ fitted.jac)))
            inside = abs(best - rig.true / rig.guess) < 2 * deviation
        row = {
            "unknowns": rig.model.n,
            "contacts": len(rig.model.points),
            "steps": len(LOOP),
            "parameters": len(best),
            "data": rig.measured.size,
            "way": name,
            "paths": rig.paths,
            "jvp_columns": rig.columns,
            "seconds": round(seconds, 3),
            "processor_s": round(used, 3),
            "model_s": round(made, 3),
            "inside": int(inside.sum()) if fitted.x is best else "",
            "off": (abs(fitted.x - best) / deviation).max(),
            "finished": bool(fitted.success),
            "machine": tables.processor(),
            "load": f"{os.getloadavg()[0]:.1f}",
        }
        print(row, flush=True)
        yield row


def written(rows):
    """The table."""
    lines = [
        (
            f"{int(row['unknowns']):,}",
            str(row["contacts"]),
            str(row["steps"]),
            str(row["parameters"]),
            f"{int(row['data']):,}",
            str(row["way"]),
            f"{row['paths']}{'' if row['finished'] else ' (stopped)'}",
            str(row["jvp_columns"] or ""),
            tables.figures(float(row["seconds"])),
            tables.figures(float(row["processor_s"])),
            str(row["inside"]),
            f"{float(row['off']):.0e}" if row["inside"] == "" else "",
        )
        for row in rows
    ]
    loads = sorted(float(row["load"]) for row in rows)
    machine = f"{tables.machines(rows)}, load {loads[0]:g} to {loads[-1]:g}."
    return f"{tables.table(HEAD, lines)}\n\n{machine}"


def main():
    """Measure, and rewrite the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a small size")
    parser.add_argument("--cells", type=int, nargs=2, help="along x and y")
    parser.add_argument("--knots", type=int, nargs="+")
    parser.add_argument("--most", type=int, help="paths of the simplex")
    parser.add_argument("--print", action="store_true", help="write no files")
    args = parser.parse_args()
    cells = args.cells or ([32, 8] if args.quick else [184, 32])
    most = args.most or (100 if args.quick else 400)
    rows = []
    for knots in args.knots or ([3] if args.quick else [3, 24]):
        rows += rows_of(cells, knots, most)
    text = written(rows)
    print(text)
    if not args.print:
        folder = tables.folder(args.quick)
        tables.write_rows(folder / "results" / SHEET, rows)
        tables.rewrite(folder / "README.md", "identification", text)


if __name__ == "__main__":
    main()
