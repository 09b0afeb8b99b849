"""Seconds to η ≤ 1e-8 beside Siconos and a NumPy sweep, on the same W, q and μ.

    python benches/solvers_and_peers.py
    python benches/solvers_and_peers.py --seeds 10 --sets held,random

For each problem in turn: ours, the sweep of `peers/sweep.py`, and Siconos' projected
Gauss–Seidel (NSGS) and Alart–Curnier Newton (NSN_AC) with its default parameters, one
thread each. Siconos runs in a process of its own (`peers/siconos_reduced.py`) under the first
Python that has it, or the one of ``--siconos``; only its driver is timed. Every answer
is judged by `ReducedProblem.residual`: Siconos' tolerance, which means something else,
is tightened by factors of ten until that is 1e-8 or less, and only the run that met it
counts. The peers are given node-scaled variables, the largest of q being 1: the same
problem, and the kindest form of it. Siconos' measures are absolute: in SI units it
stops at once or never, and with stiff beside soft contacts too early for good.

Ours is told twice: the call from Python, checks and conversions of arrays included, and
what the solver takes of that, which is what Siconos' driver is to its own.

Sets with bodies held by contact alone are left out: the peers have no such unknowns.
Unsolved counts as infinite. Rewrites the table of the README where all sets and seeds
were asked for.
"""

import json
import os
import select
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np
import problems
import tables
from peers.commands import PEERS, pythons
from peers.sweep import sweep
from reference_solution import Scaled
from speed_against_error import timed

import bipot_rs as bp

WISH = 1e-8
SETS = [name for name in problems.SETS if name != "floating"]
PROGRAMS = {
    "call": "bipot_rs auto, call from Python",
    "auto": "bipot_rs auto, solver alone",
    "sweep": "NumPy sweep",
    "NSGS": "Siconos NSGS",
    "NSN_AC": "Siconos NSN_AC",
}


class Siconos:
    """The other process; started again when it has to be stopped."""

    def __init__(self, python, folder, limit):
        self.command = [python, str(PEERS / "siconos_reduced.py")]
        self.folder, self.limit, self.process = Path(folder), limit, None

    def start(self):
        """Whether it runs."""
        pipe, environment = subprocess.PIPE, {**os.environ, "PYTHONPATH": ""}
        self.process = subprocess.Popen(
            self.command,
            stdin=pipe,
            stdout=pipe,
            stderr=subprocess.DEVNULL,
            text=True,
            env=environment,
        )
        return bool(self.process.stdout.readline())

    def ask(self, solver, tol):
        """Reactions and seconds, or ``None`` after the time limit."""
        if self.process is None:
            self.start()
        files = {
            "problem": self.folder / "problem.npz",
            "answer": self.folder / "r.npy",
        }
        question = {key: str(path) for key, path in files.items()}
        # More than it can do in the time limit.
        question |= {"solver": solver, "tol": tol, "iterations": 1_000_000}
        self.process.stdin.write(json.dumps(question) + "\n")
        self.process.stdin.flush()
        ready, _, _ = select.select([self.process.stdout], [], [], self.limit)
        line = self.process.stdout.readline() if ready else ""
        if not line:
            self.close()
            return None
        return np.load(files["answer"]), json.loads(line)["seconds"]

    def close(self):
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process.stdin.close()
            self.process.stdout.close()
            self.process = None


def find(asked, folder, limit):
    """Siconos under the Python asked for, or any; ``None`` where it is not installed."""
    for python in [asked] if asked else pythons():
        siconos = Siconos(python, folder, limit)
        if siconos.start():
            return siconos
        siconos.close()
    print("Siconos: not installed", file=sys.stderr)
    return None


def judged(reduced, answer):
    """Whether reactions meet the wish."""
    return bool(np.isfinite(answer).all()) and reduced.residual(answer) <= WISH


def ours(reduced, limit):
    """Seconds of the call and of the solver within it, infinite where not solved."""
    seconds, answer = timed(reduced, tol=WISH, max_seconds=limit)
    if not (answer.converged and judged(reduced, answer.reaction)):
        return np.inf, np.inf
    return seconds, min(answer.seconds, seconds)


def seconds_of(peer, problem, reduced, siconos, limit):
    """Seconds of a peer to the wish, infinite where it did not reach it."""
    scaled = Scaled(problem)
    largest = np.abs(scaled.q).max()
    W, q, mu, force = scaled.W, scaled.q / largest, problem.mu, largest * scaled.to_v
    if peer == "sweep":
        start = perf_counter()
        r = sweep(W, q, mu, WISH, limit)
        seconds = perf_counter() - start
        return seconds if judged(reduced, r * force) else np.inf
    np.savez(siconos.folder / "problem.npz", W=W, q=q, mu=mu)
    for tol in 10.0 ** -np.arange(6, 15):
        answer = siconos.ask(peer, tol)
        if answer is None:
            break
        r, seconds = answer
        if judged(reduced, r * force):
            return seconds
    return np.inf


def compare(name, seeds, programs, siconos, limit):
    """Seconds of every program on the problems of a set, ``{program: (problems,)}``."""
    found = {program: [] for program in programs}
    for seed in seeds:
        problem = problems.SETS[name](seed)
        if problem.rigid is not None:
            continue
        reduced = bp.ReducedProblem(problem.W, problem.q, problem.mu)
        for program, seconds in zip(
            ("call", "auto"), ours(reduced, limit), strict=True
        ):
            found[program].append(seconds)
        for peer in programs[2:]:
            found[peer].append(seconds_of(peer, problem, reduced, siconos, limit))
    return {program: np.array(seconds) for program, seconds in found.items()}


def ratio(seconds, ours):
    """Median of the ratios, problem by problem, of those that one of the two solved."""
    either = np.isfinite(ours) | np.isfinite(seconds)
    if not either.any():
        return np.inf
    return np.quantile(seconds[either] / ours[either], 0.5, method="higher")


HEAD = (
    "set",
    "problems",
    "program",
    "solved",
    "median, ms",
    "90 %, ms",
    "time / call",
    "time / solver",
)


def rows(name, found):
    """A row for each program on the problems of a set."""
    for program, seconds in found.items():
        middle, high = np.quantile(seconds, [0.5, 0.9], method="higher")
        ratios = (ratio(seconds, found[own]) for own in ("call", "auto"))
        figures = (1e3 * middle, 1e3 * high, *ratios)
        cells = (f"{x:.2g}" if x < np.inf else "∞" for x in figures)
        solved = int(np.isfinite(seconds).sum())
        yield (name, str(len(seconds)), PROGRAMS[program], str(solved), *cells)


def main():
    """Compare, and rewrite the table."""
    parser = tables.parser(__doc__)
    parser.add_argument("--sets", default=",".join(SETS))
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seconds-limit", type=float, default=5.0, help="of a solve")
    parser.add_argument("--siconos", help="the Python that has it")
    asked = parser.parse_args()
    limit, lines = asked.seconds_limit, []
    whole = tables.whole(parser, asked, "sets", "seeds", "first_seed")
    with tempfile.TemporaryDirectory() as folder:
        siconos = find(asked.siconos, folder, limit)
        programs = list(PROGRAMS) if siconos else ["call", "auto", "sweep"]
        for name in asked.sets.split(","):
            seeds = problems.seeds(name, asked.seeds, asked.first_seed)
            found = compare(name, seeds, programs, siconos, limit)
            for row in rows(name, found):
                print("| " + " | ".join(row) + " |", flush=True)
                lines.append(row)
        if siconos:
            siconos.close()
    tables.publish(
        "solvers and peers", tables.table(HEAD, lines), write=whole and not asked.print
    )


if __name__ == "__main__":
    main()
