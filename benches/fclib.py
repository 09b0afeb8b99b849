"""All methods, and Siconos, on a folder of FCLIB files: solved or not, and how fast.

    python benches/fclib.py --data DIR
    python benches/fclib.py --data DIR --max-seconds 60 --methods auto,newton

Every problem is solved from r = 0 to η = 1e-4, 1e-8 and 1e-12, one thread a solve, by
each method and, where its Python module is installed, by Siconos' projected
Gauss–Seidel (NSGS) and Alart–Curnier Newton (NSN_AC). A global problem is condensed
first, for all alike, and that is not timed; a file NAME__local beside NAME is the same
problem and left out. Seconds of ours are those of the call, checks and conversions
included, of Siconos those of its driver.

What counts as solved is decided here: η of (13) is computed anew with NumPy, in
node-scaled variables, so that no unit moves it, and must be at most the target, or the
rounding of W r + q where that is larger. What fails at a target is not tried at a
tighter one. Siconos' tolerance means something else: it is tightened by factors of ten
until η is met, and only the run that met it counts. It is given node-scaled variables,
the kindest form of the problem, with a dense W, and nothing above 2000 contacts.

Writes `results/fclib.csv`, draws the performance profiles `results/fclib.png` from it and,
with all methods, rewrites the table of the README. Families are those of DIR/MANIFEST.csv, else
the first word of a file's name.
"""

import csv
import itertools
import os
import tempfile
from functools import cached_property
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import fclib_figure
import numpy as np
import tables
from peers.sweep import project
from scipy.sparse import csr_array
from solvers_and_peers import find
from speed_against_error import METHODS, available
from timing import repeated

import bipot_rs as bp

TARGETS = (1e-4, 1e-8, 1e-12)
SICONOS = ("NSGS", "NSN_AC")
LARGEST_DENSE = 2000
COLUMNS = (
    "file",
    "family",
    "form",
    "contacts",
    "dim",
    "program",
    "target",
    "solved",
    "seconds",
    "work",
    "iterations",
    "eta",
)


class Judge:
    """The problem of a file in node-scaled variables, and η in NumPy alone."""

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
        """Scaled ``W`` and ``q``, the largest of ``q`` one, and what gives ``r`` back."""
        q = self.scale * self.q
        largest = np.abs(q).max() or 1.0
        return self.W.toarray(), q / largest, largest * self.scale

    def map(self, r, v):
        """``F`` of (11): what one projection moves."""
        lifted = v.copy()
        lifted[:, 0] += self.mu * np.linalg.norm(v[:, 1:], axis=1)
        return r - project(r - lifted, self.mu)

    def eta(self, reaction, amounts=None):
        """η of (13), and the rounding below which it says nothing."""
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
        """Whether reactions are an answer to a target, and their η."""
        if not np.isfinite(reaction).all():
            return False, np.inf
        eta, floor = self.eta(reaction, amounts)
        # The sums of η itself may be taken in another order than a solver's.
        return bool(eta <= (1 + 1e-6) * target or eta <= floor), float(eta)


def ours(judge, method, target, limit):
    """Whether it is solved, seconds, work, iterations, η."""
    seconds, answer = repeated(
        lambda: judge.reduced.solve(
            method, target, max_seconds=limit, max_iterations=2**31 - 1, num_threads=1
        )
    )
    met, eta = judge.meets(target, answer.reaction, answer.rigid_motion)
    solved = met and answer.converged
    return solved, seconds, answer.work, answer.iterations, eta


def theirs(judge, solver, target, siconos):
    """The same of Siconos, which counts no products."""
    W, q, to_r = judge.dense
    np.savez(siconos.folder / "problem.npz", W=W, q=q, mu=judge.mu)
    for tol in 10.0 ** np.arange(min(-4, int(np.log10(target)) + 2), -16, -1.0):
        answer = siconos.ask(solver, tol)
        if answer is None:
            break
        r, seconds = answer
        met, eta = judge.meets(target, r * to_r)
        if met:
            return True, seconds, np.nan, 0, eta
    return False, np.inf, np.nan, 0, np.inf


def families(folder):
    """``{file: family}`` of a manifest."""
    manifest = folder / "MANIFEST.csv"
    if not manifest.exists():
        return {}
    with manifest.open(newline="") as file:
        return {line["file"]: line["family"] for line in csv.DictReader(file)}


def measure(path, family, methods, siconos, limit):
    """A row for each program and target."""
    judge = Judge(path)
    known = (path.name, family, judge.form, judge.contacts, judge.d)
    programs = [(name, ours, limit) for name in methods]
    if siconos and judge.rigid is None and judge.contacts <= LARGEST_DENSE:
        programs += [(name, theirs, siconos) for name in SICONOS]
    for name, run, extra in programs:
        solved = True
        for target in TARGETS:
            found = (False, np.inf, np.nan, 0, np.inf)
            if solved:
                found = run(judge, name, target, extra)
            solved = found[0]
            yield dict(zip(COLUMNS, (*known, name, target, *found), strict=True))


def report(lines, *, write):
    """What each program solves at each target, and what `auto` does not."""
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
    """Solve, write and draw."""
    parser = tables.parser(__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of files")
    parser.add_argument("--max-seconds", type=float, default=10.0, help="of a solve")
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--siconos", help="the Python that has it")
    asked = parser.parse_args()
    methods = available(asked.methods.split(","))
    names = families(asked.data)
    paths = sorted([*asked.data.glob("*.hdf5"), *asked.data.glob("*.h5")])
    if not paths:
        parser.error(f"--data {asked.data} holds no .hdf5 or .h5 file")
    present = {path.stem for path in paths}
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        siconos = find(asked.siconos, folder, asked.max_seconds)
        for path in paths:
            if path.stem.removesuffix("__local") in present - {path.stem}:
                continue
            family = names.get(path.name, path.stem.partition("_")[0])
            new = measure(path, family, methods, siconos, asked.max_seconds)
            lines += new
        if siconos:
            siconos.close()
    whole = tables.whole(parser, asked, "methods")
    report(lines, write=whole and not asked.print)
    if not asked.print:
        path = tables.RESULTS / "fclib.csv"
        tables.write_rows(path, lines)
        fclib_figure.draw(path, path.with_suffix(".png"))


if __name__ == "__main__":
    main()
