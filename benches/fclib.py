"""Solve a folder of FCLIB files with all methods and with Siconos.

    python benches/fclib.py --data DIR
    python benches/fclib.py --data DIR --max-seconds 60 --methods auto,newton

Every problem is solved from r = 0 to η = 1e-4, 1e-8 and 1e-12, on one thread, by each
method and, if its Python module is installed, by Siconos' projected Gauss–Seidel (NSGS)
and Alart–Curnier Newton (NSN_AC). A global problem is condensed first, which is not timed;
a file NAME__local next to NAME is the same problem and is left out. Seconds of bipot_rs are
those of the call, with checks and conversions; those of Siconos are of its driver.

A problem counts as solved if η of (13), computed again with NumPy in node-scaled variables
(independent of the units), is at most the target, or the rounding of W r + q if that is
larger. A method that fails at a target is not tried at a smaller one. Siconos' tolerance has
another meaning: it is reduced by factors of ten until η is met, and only that run counts. It
gets node-scaled variables, the easiest form of the problem, with a dense W, and no problem
above 2000 contacts.

Writes `results/fclib.csv`, draws the performance profiles `results/fclib.png` from it and,
with all methods, rewrites the table of the README. DIR/MANIFEST.csv names the families;
without it the first word of the file name does.
"""

import itertools
import os
import tempfile
from functools import cached_property
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import fclib_figure
import numpy as np
import tables
from peers.siconos_process import find
from scipy.sparse import csr_array
from speed_against_error import METHODS, available
from timing import repeated

import bipot_rs as bp

TARGETS = (1e-4, 1e-8, 1e-12)
SICONOS = ("NSGS", "NSN_AC")
LARGEST_DENSE = 2000
COLUMNS = tables.columns(
    "file | family | form | contacts | dim | program | target | solved | "
    "seconds | work | iterations | eta"
)


def project(tau, mu):
    """Projection of each row of ``tau (n_c, d)`` onto Coulomb's cone, closed form (12)."""
    n, t = tau[:, 0], np.linalg.norm(tau[:, 1:], axis=1)
    normal = (n + mu * t) / (1 + mu**2)
    scale = np.divide(mu * normal, t, out=np.zeros_like(t), where=t > 0)
    slips = np.column_stack([normal, scale[:, None] * tau[:, 1:]])
    projected = np.where((t <= mu * n)[:, None], tau, slips)
    projected[mu * t <= -n] = 0.0
    return projected


class ScaledProblem:
    """Problem of a file in node-scaled variables, with η in NumPy alone."""

    def __init__(self, path):
        problem = bp.fclib.read(path)
        self.form = "global" if isinstance(problem, bp.fclib.GlobalProblem) else "local"
        self.reduced = problem.reduced() if self.form == "global" else problem
        self.q, self.mu = self.reduced.q, self.reduced.mu
        self.contacts, self.d = self.q.shape
        W = csr_array(self.reduced.W)
        trace = W.diagonal().reshape(self.q.shape).sum(axis=1) / self.d
        # A contact with every component prescribed has no compliance of its own.
        self.scale = np.where(trace > 0, trace, 1.0)[:, None] ** -0.5
        each = np.repeat(self.scale[:, 0], self.d)
        self.W = csr_array(W.multiply(each[:, None]).multiply(each))
        self.rigid = None
        if self.reduced.rigid is not None:
            R, e = self.reduced.rigid
            self.rigid = np.linalg.qr(R * each[:, None])[0], R * each[:, None], e

    @cached_property
    def dense(self):
        """Scaled ``W``, ``q`` with largest entry 1, and the factor that gives ``r`` back."""
        q = self.scale * self.q
        largest = np.abs(q).max() or 1.0
        return self.W.toarray(), q / largest, largest * self.scale

    def map(self, r, v):
        """Natural map F of (11)."""
        lifted = v.copy()
        lifted[:, 0] += self.mu * np.linalg.norm(v[:, 1:], axis=1)
        return r - project(r - lifted, self.mu)

    def eta(self, reaction, amounts=None):
        """η of (13), and the rounding error below which it has no meaning."""
        r, q = reaction / self.scale, self.scale * self.q
        v = (self.W @ r.ravel()).reshape(r.shape) + q
        free, balance = q, 0.0
        if self.rigid is not None:
            _, modes, e = self.rigid
            moved = (modes @ amounts).reshape(r.shape)
            v, free = v + moved, free + moved
            # In the orthonormal basis Q of R = Q T, Tᵀ (Qᵀ r) = Rᵀ r.
            T = self.rigid[0].T @ modes
            force = np.linalg.solve(T.T, e)
            lacking = self.rigid[0].T @ r.ravel() + force
            balance = np.linalg.norm(lacking) / (np.linalg.norm(force) or 1.0)
        size = max(np.linalg.norm(r), np.linalg.norm(self.map(np.zeros_like(r), free)))
        if size == 0.0:
            return 0.0, 0.0
        terms = (abs(self.W) @ np.abs(r.ravel())).reshape(r.shape) + np.abs(q)
        floor = 4 * np.finfo(float).eps * np.linalg.norm(terms) / size
        return max(np.linalg.norm(self.map(r, v)) / size, balance), floor

    def meets(self, target, reaction, amounts=None):
        """Whether reactions meet a target, and their η."""
        if not np.isfinite(reaction).all():
            return False, np.inf
        eta, floor = self.eta(reaction, amounts)
        # The sums of η may be taken in another order than in a solver.
        return bool(eta <= (1 + 1e-6) * target or eta <= floor), float(eta)


def run_bipot(problem, method, target, limit):
    """Solve with bipot_rs: whether solved, seconds, products, iterations, η."""
    seconds, answer = repeated(
        lambda: problem.reduced.solve(
            method, target, max_seconds=limit, max_iterations=2**31 - 1, num_threads=1
        )
    )
    met, eta = problem.meets(target, answer.reaction, answer.rigid_motion)
    solved = met and answer.converged
    return solved, seconds, answer.work, answer.iterations, eta


def siconos_answer(problem, solver, target, siconos):
    """Seconds, reactions and η of Siconos with the first tolerance that meets the target.

    ``None`` if no tolerance does.
    """
    W, q, to_r = problem.dense
    np.savez(siconos.folder / "problem.npz", W=W, q=q, mu=problem.mu)
    for tol in 10.0 ** np.arange(min(-4, int(np.log10(target)) + 2), -16, -1.0):
        answer = siconos.ask(solver, tol)
        if answer is None:
            break
        r, seconds = answer
        met, eta = problem.meets(target, r * to_r)
        if met:
            return seconds, r * to_r, eta
    return None


def run_siconos(problem, solver, target, siconos):
    """Solve with Siconos, which does not count products; result as of `run_bipot`."""
    answer = siconos_answer(problem, solver, target, siconos)
    if answer is None:
        return False, np.inf, np.nan, 0, np.inf
    seconds, _, eta = answer
    return True, seconds, np.nan, 0, eta


def families(folder):
    """Families of the files in a manifest, ``{file: family}``."""
    manifest = folder / "MANIFEST.csv"
    if not manifest.exists():
        return {}
    return {line["file"]: line["family"] for line in tables.read_rows(manifest)}


def measure(path, family, methods, siconos, limit):
    """Row of each program and target."""
    problem = ScaledProblem(path)
    row_head = (path.name, family, problem.form, problem.contacts, problem.d)
    programs = [(name, run_bipot, limit) for name in methods]
    if siconos and problem.rigid is None and problem.contacts <= LARGEST_DENSE:
        programs += [(name, run_siconos, siconos) for name in SICONOS]
    for name, run, extra in programs:
        solved = True
        for target in TARGETS:
            outcome = (False, np.inf, np.nan, 0, np.inf)
            if solved:
                outcome = run(problem, name, target, extra)
            solved = outcome[0]
            yield dict(zip(COLUMNS, (*row_head, name, target, *outcome), strict=True))


def report(lines, *, write):
    """Print the table, and the problems that `auto` does not solve."""
    programs = list(dict.fromkeys(line["program"] for line in lines))
    files = list(dict.fromkeys(line["file"] for line in lines))
    titles = [(f"{t:.0e}: solved", "median, ms", "products") for t in TARGETS]
    head, rows = ("program", *itertools.chain(*titles)), []
    for program in programs:
        cells = []
        for target in TARGETS:
            some = [
                x for x in lines if (x["program"], x["target"]) == (program, target)
            ]
            seconds = [x["seconds"] if x["solved"] else np.inf for x in some]
            work = [x["work"] if x["solved"] else np.inf for x in some]
            middle = 1e3 * np.quantile(seconds, 0.5, method="higher")
            cells += [f"{np.isfinite(seconds).sum()} of {len(some)}", f"{middle:.2g}"]
            products = "–" if program in SICONOS else f"{np.median(work):.3g}"
            cells.append(products)
        rows.append((program, *cells))
    tables.publish("FCLIB", tables.table(head, rows), write=write)
    print(f"\n{len(files)} problems. Not solved by auto:")
    for x in lines:
        if x["program"] == "auto" and not x["solved"] and np.isfinite(x["eta"]):
            print(f"- {x['file']}, {x['target']:.0e}: η = {x['eta']:.1e}")


def main():
    """Solve, write the results and draw the figure."""
    parser = tables.parser(__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of files")
    parser.add_argument("--max-seconds", type=float, default=10.0, help="for one solve")
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--siconos", help="the Python that has it")
    args = parser.parse_args()
    methods = available(args.methods.split(","))
    names = families(args.data)
    paths = sorted([*args.data.glob("*.hdf5"), *args.data.glob("*.h5")])
    if not paths:
        parser.error(f"--data {args.data} holds no .hdf5 or .h5 file")
    present = {path.stem for path in paths}
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        siconos = find(args.siconos, folder, args.max_seconds)
        for path in paths:
            if path.stem.removesuffix("__local") in present - {path.stem}:
                continue
            family = names.get(path.name, path.stem.partition("_")[0])
            new = measure(path, family, methods, siconos, args.max_seconds)
            lines += new
        if siconos:
            siconos.close()
    whole = tables.whole(parser, args, "methods")
    report(lines, write=whole and not args.print)
    if not args.print:
        path = tables.RESULTS / "fclib.csv"
        tables.write_rows(path, lines)
        fclib_figure.draw(path, path.with_suffix(".png"))


if __name__ == "__main__":
    main()
